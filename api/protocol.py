"""HTTP connections: uvicorn's, with a deadline for a request's head, and a problem where it is no HTTP."""

from __future__ import annotations

import asyncio
import math
import socket
from typing import Any

import h11
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from api.bounds import CROWDED
from api.errors import Refusal, problem_response

__all__ = ["Protocol"]

_STALLED = 4
"""An answer may stand still for so many times the receive timeout."""

_SPARE = 64
"""Connections beyond max_connections on which probes are answered, and all else refused; more are closed."""


def _crowded(app: ASGIApp) -> ASGIApp:
    async def marked(scope: Scope, receive: Receive, send: Send) -> None:
        await app({**scope, CROWDED: True}, receive, send)

    return marked


class Protocol(H11Protocol):
    """Closes a connection whose request's head has not arrived within `receive_timeout`; uvicorn itself only
    closes one that is silent after an answer. Bodies have their deadline in api.middleware. A client who does
    not take its answer is given up by the kernel, on Linux.

    Beyond `max_connections`, a new connection closes the one that has waited longest for a head. If all are
    being answered, requests on the new one are refused."""

    def __init__(self, config: Any, *args: Any, **more: Any) -> None:
        super().__init__(config, *args, **more)
        self._head_timeout: float = config.app.state.settings.receive_timeout
        self._most: int = config.app.state.settings.max_connections
        self._closing: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            milliseconds = round(_STALLED * self._head_timeout * 1000)
            connection: socket.socket = transport.get_extra_info("socket")
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, milliseconds)
        self._make_room()
        self._await_head()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self.conn.their_state is h11.IDLE:  # part of a head, or nothing after an answer
            self._await_head()
        else:
            self._stop_waiting()

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_waiting()
        super().connection_lost(exc)

    def send_400_response(self, msg: str) -> None:
        if self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE):
            problem = problem_response(Refusal("malformed-http", "This is not HTTP/1.1."))
            headers = [*problem.raw_headers, (b"connection", b"close")]
            for event in (
                h11.Response(status_code=problem.status_code, headers=headers),
                h11.Data(data=bytes(problem.body)),
                h11.EndOfMessage(),
            ):
                self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def _make_room(self) -> None:
        """Before this connection waits for a head itself."""
        others = [each for each in self.connections if not each.transport.is_closing()]
        excess = len(others) - self._most
        if excess <= 0:
            return
        waiting = [each for each in others if isinstance(each, Protocol) and each._closing is not None]
        if waiting:
            min(waiting, key=Protocol._waits_until).timeout_keep_alive_handler()
        elif excess <= _SPARE:
            self.app = _crowded(self.app)
        else:
            self.transport.abort()

    def _waits_until(self) -> float:
        return math.inf if self._closing is None else self._closing.when()

    def _await_head(self) -> None:
        if self._closing is None:
            self._closing = self.loop.call_later(self._head_timeout, self.timeout_keep_alive_handler)

    def _stop_waiting(self) -> None:
        if self._closing is not None:
            self._closing.cancel()
            self._closing = None
