"""A sign of life in answers that take long, so that nobody on the way takes the connection for dead."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import TypeVar

__all__ = ["with_heartbeat"]

_SILENCE = 10.0
"""No stream is silent for longer, s."""

T = TypeVar("T")


async def with_heartbeat(wait: Callable[[], Awaitable[T]], sign: bytes) -> AsyncIterator[T | bytes]:
    """What `wait` returns, again and again, and the sign after each 10 s of waiting. `wait` may be cancelled
    and called anew."""
    while True:
        try:
            async with asyncio.timeout(_SILENCE):
                value: T | bytes = await wait()
        except TimeoutError:
            value = sign
        yield value
