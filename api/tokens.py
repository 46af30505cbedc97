"""Who may use the service: clients that send one of the bearer tokens (RFC 6750) in the operator's file."""

from __future__ import annotations

import hashlib
import hmac
import os
from pathlib import Path

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from api.clients import known_by_token
from api.errors import Refusal, problem_response
from api.log import log

__all__ = ["OPEN", "Guard", "Tokens"]

OPEN = {"/livez", "/readyz", "/", "/docs", "/openapi.json"}
_FILES = ("/static/", "/static-offline-docs/")
"""Open to everybody are the probes, and what a browser loads without a token and holds no data: the page, the
documentation and their files. Both ask for a token before they call the service."""


class Tokens:
    """The tokens in a file, one a line; empty lines and those that begin with # do not count.

    The file is read again when it changes, so that tokens can be added and withdrawn in service. While it
    cannot be read, those read last remain. Raises OSError, and ValueError where there is no token in it.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._seen = self._version()
        self._digests = self._read()
        if not self._digests:
            raise ValueError(f"there is no token in {file}")

    def include(self, token: str) -> bool:
        """Whether it is one of them. Takes as long whichever it is, and however much of it is right."""
        self._refresh()
        given = hashlib.sha256(token.encode("latin-1")).digest()
        return sum(hmac.compare_digest(given, digest) for digest in self._digests) > 0

    def _refresh(self) -> None:
        try:
            if (version := self._version()) != self._seen:
                self._seen, self._digests = version, self._read()
                log(event="tokens read", count=len(self._digests))
        except OSError as error:
            if self._seen is not None:
                self._seen = None
                log(event="tokens cannot be read", error=str(error))

    def _version(self) -> tuple[int, int, int] | None:
        stat = os.stat(self._file)
        return stat.st_mtime_ns, stat.st_size, stat.st_ino

    def _read(self) -> list[bytes]:
        lines = (line.strip() for line in self._file.read_bytes().splitlines())
        return [hashlib.sha256(line).digest() for line in lines if line and not line.startswith(b"#")]


class Guard:
    """ASGI middleware: lets in who sends a token, and everybody to what is open."""

    def __init__(self, app: ASGIApp, tokens: Tokens) -> None:
        self.app = app
        self.tokens = tokens

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["path"] in OPEN or scope["path"].startswith(_FILES):
            await self.app(scope, receive, send)
            return
        scheme, _, token = Headers(scope=scope).get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and self.tokens.include(token.strip()):
            known_by_token(scope, token.strip())
            await self.app(scope, receive, send)
            return
        known = 'Bearer realm="wheelplan"' + (', error="invalid_token"' if token else "")
        detail = "Send a valid token as Authorization: Bearer <token>."
        problem = problem_response(Refusal("unauthorized", detail), {"WWW-Authenticate": known})
        await problem(scope, receive, send)
