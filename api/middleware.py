"""Around every request: its id, one line in the log, and an answer even when the code behind it fails. Before
plans: whether one more is taken."""

from __future__ import annotations

import asyncio
import math
import re
import time
import traceback
import uuid
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from opentelemetry import trace
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.bounds import PROBES, Allowance
from api.clients import client_of
from api.errors import Refusal, problem_response
from api.fair_queue import Ticket
from api.log import log
from api.metrics import Metrics
from api.scheduler import Scheduler

__all__ = ["Envelope", "Gate"]

_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_GONE = 499
_PATIENCE = 5.0
"""How long the rest of a refused body may take to arrive, s."""

_LEAST_RATE = 1 << 16
"""A body may take longer than the receive timeout by 1 s for each so many bytes that have arrived."""

_METHODS = {"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"}

_STRANGER_BYTES, _STRANGER_PATIENCE = 1 << 16, 1.0
"""How much of its body a client without a token may still send after its 401, and how long that may take (s),
before its connection is closed. Closed at once, many clients would not see the answer."""


class Envelope:
    """ASGI middleware: X-Request-Id, the request log and counter, a deadline for the request's body, and
    internal-error as a problem."""

    def __init__(self, app: ASGIApp, metrics: Metrics, receive_timeout: float, bodies: Allowance) -> None:
        self.app = app
        self.metrics = metrics
        self.receive_timeout = receive_timeout
        self.bodies = bodies

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        with self.bodies.share() as take:
            await self._answer(scope, receive, send, take)

    async def _answer(self, scope: Scope, receive: Receive, send: Send, take: Callable[[int], None]) -> None:
        began = time.perf_counter()
        headers = Headers(scope=scope)
        theirs = headers.get("x-request-id", "")
        request_id = theirs if _ID.fullmatch(theirs) else uuid.uuid4().hex
        trace.get_current_span().set_attribute("wheelplan.request_id", request_id)
        pending = headers.get("content-length", "0") != "0" or "transfer-encoding" in headers
        body = _Body(receive, pending, self.receive_timeout, take)
        status = 0

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                more = MutableHeaders(scope=message)
                more["X-Request-Id"] = request_id
                if status != 401 and "expect" not in headers:
                    await body.discard(_PATIENCE)
                if body.pending:
                    more["Connection"] = "close"
            elif status == 401 and body.pending and "expect" not in headers:
                await send({**message, "more_body": True})
                await body.discard(_STRANGER_PATIENCE, _STRANGER_BYTES)
                message = {"type": "http.response.body"}
            await send(message)

        failure = None
        try:
            await self.app(scope, body.receive, send_with_id)
        except ClientDisconnect:
            pass
        except Exception as error:
            failure = "".join(traceback.format_exception(error))
            if not status:
                detail = "Something went wrong here. The log has more under this request's id."
                problem = problem_response(Refusal("internal-error", detail, request_id=request_id))
                await problem(scope, body.receive, send_with_id)
        finally:
            route = getattr(scope.get("route"), "path", "none")
            method = scope["method"] if scope["method"] in _METHODS else "other"
            self.metrics.requests.labels(method, route, status or _GONE).inc()
            line = {
                "method": scope["method"],
                "path": scope["path"][:200],
                "status": status or _GONE,
                "ms": round((time.perf_counter() - began) * 1e3, 1),
                "request_id": request_id,
            }
            if scope["path"] not in PROBES or status >= 400:
                log(**line, **({"failure": failure} if failure else {}))


class _Body:
    """The request's body, which has to arrive in time: receive raises Refusal, request-timeout, and what
    `take` raises, which is told of its bytes.

    Where it is refused before it has been read, the rest is thrown away first: uvicorn would not serve this
    connection again, and a client still sending might never see the answer.
    """

    def __init__(self, receive: Receive, pending: bool, timeout: float, take: Callable[[int], None]) -> None:
        self.pending = pending
        self._take = take
        self._receive = receive
        self._timeout = timeout
        self._until = time.monotonic() + timeout

    async def receive(self) -> Message:
        if not self.pending:
            return await self._receive()
        try:
            async with asyncio.timeout(self._until - time.monotonic()):
                message = await self._receive()
        except TimeoutError:
            detail = f"The body must arrive within {self._timeout:g} s, or at {_LEAST_RATE} bytes a second."
            raise Refusal("request-timeout", detail) from None
        self._until += len(message.get("body", b"")) / _LEAST_RATE
        self.pending = message.get("more_body", False)
        self._take(len(message.get("body", b"")))
        return message

    async def discard(self, patience: float, most: float = math.inf) -> None:
        """Reads on for `patience` s and `most` bytes at most, and keeps nothing."""
        left = most

        def drop(size: int) -> None:
            nonlocal left
            left -= size

        self._take = drop
        with suppress(TimeoutError, Refusal):
            async with asyncio.timeout(patience):
                while self.pending and left > 0:
                    await self.receive()


class Gate:
    """ASGI middleware: while no plan of a client is taken, refuses its requests to this route before they are
    routed or read.

    What refusing costs, the workers lack.
    """

    def __init__(self, app: ASGIApp, route: Route, scheduler: Scheduler[Any], metrics: Metrics) -> None:
        self.app = app
        self.route = route
        self.scheduler = scheduler
        self.metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http" and scope["path"] == self.route.path and scope["method"] == "POST":
            try:
                self.scheduler.admit(Ticket(client=client_of(scope)))
            except Refusal as refusal:
                scope["route"] = self.route
                self.metrics.refused.labels(refusal.code).inc()
                await problem_response(refusal)(scope, receive, send)
                return
        await self.app(scope, receive, send)
