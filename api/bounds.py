"""What all clients together may hold of the server: bytes of request bodies, and connections."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from starlette.types import ASGIApp, Receive, Scope, Send

from api.errors import Refusal, problem_response
from api.scheduler import RETRY_AFTER

__all__ = ["CROWDED", "PROBES", "Allowance", "Crowd", "busy"]

PROBES = {"/livez", "/readyz", "/metrics"}

CROWDED = "wheelplan.crowded"
"""Key of a scope: its connection is one more than max_connections."""


class Allowance:
    """A number of bytes that requests may hold at once; `what` names them. A request that is alone may hold
    more."""

    def __init__(self, limit: int, what: str) -> None:
        self.limit = limit
        self.what = what
        self.held = 0

    @contextmanager
    def share(self) -> Iterator[Callable[[int], None]]:
        """A function that takes more bytes for one request, or raises Refusal, busy. All are given back at
        the end."""
        mine = 0

        def take(size: int) -> None:
            nonlocal mine
            if self.held > mine and self.held + size > self.limit:
                raise busy(f"The server holds {self.held} bytes of {self.what}.", limit=self.limit)
            self.held += size
            mine += size

        try:
            yield take
        finally:
            self.held -= mine


class Crowd:
    """ASGI middleware: refuses requests on connections that are too many. Probes are answered."""

    def __init__(self, app: ASGIApp, max_connections: int) -> None:
        self.app = app
        self.max_connections = max_connections

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope.get(CROWDED) and scope["path"] not in PROBES:
            refusal = busy("There are too many connections.", limit=self.max_connections)
            await problem_response(refusal, {"Connection": "close"})(scope, receive, send)
            return
        await self.app(scope, receive, send)


def busy(detail: str, limit: int) -> Refusal:
    return Refusal("busy", detail, limit=limit, retry_after=RETRY_AFTER)
