"""Around every request: its id, one line in the log, and an answer even when the code behind it fails."""

from __future__ import annotations

import logging
import re
import time
import traceback
import uuid

import orjson
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.errors import Refusal, problem_response
from api.metrics import Metrics

__all__ = ["Envelope"]

_log = logging.getLogger("wheelplan")
_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")
_GONE = 499
_PROBES = {"/livez", "/readyz", "/metrics"}


class Envelope:
    """ASGI middleware: X-Request-Id, the request log, the request counter, and internal-error as a problem."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app = app
        self.metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        began = time.perf_counter()
        theirs = Headers(scope=scope).get("x-request-id", "")
        request_id = theirs if _ID.fullmatch(theirs) else uuid.uuid4().hex
        status = 0

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)["X-Request-Id"] = request_id
            await send(message)

        failure = None
        try:
            await self.app(scope, receive, send_with_id)
        except Exception as error:
            failure = "".join(traceback.format_exception(error))
            if not status:
                detail = "Something went wrong here. The log has more under this request's id."
                problem = problem_response(Refusal("internal-error", detail, request_id=request_id))
                await problem(scope, receive, send_with_id)
        finally:
            route = getattr(scope.get("route"), "path", "none")
            self.metrics.requests.labels(scope["method"], route, status or _GONE).inc()
            line = {
                "method": scope["method"],
                "path": scope["path"][:200],
                "status": status or _GONE,
                "ms": round((time.perf_counter() - began) * 1e3, 1),
                "request_id": request_id,
            }
            if scope["path"] not in _PROBES or status >= 400:
                _log.info(orjson.dumps(line | ({"failure": failure} if failure else {})).decode())
