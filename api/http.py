"""What all routes share: reading bodies within bounds, writing JSON, and documenting both."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from typing import Any, TypeVar

import anyio
from pydantic import BaseModel
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.types import Message

from api.convert import FindMap
from api.errors import CODES, PROBLEM_JSON, Refusal
from api.maps import MapStore
from api.negotiation import choose
from api.settings import Settings
from api.spool import Spool, pieces
from api.strict_json import MalformedJson, read_json, write_json
from api.validation import validated

__all__ = [
    "CONDITIONAL", "IF_NONE_MATCH", "body_response", "bounded", "json_only", "json_response",
    "leased_maps", "not_modified", "problems", "read_model", "request_body", "settings_of", "tagged",
]  # fmt: skip

Model = TypeVar("Model", bound=BaseModel)
_LARGE = 1 << 16

CONDITIONAL: dict[int | str, dict[str, Any]] = {
    304: {"description": "What If-None-Match names is still true."}
}
"""The `responses` of a route that answers If-None-Match,"""

IF_NONE_MATCH: dict[str, Any] = {
    "parameters": [
        {
            "name": "If-None-Match",
            "in": "header",
            "required": False,
            "description": "The ETag of an earlier answer; 304 where it still holds.",
            "schema": {"type": "string"},
            "example": '"' + "0" * 64 + '"',
        }
    ]
}
"""and its `openapi_extra`."""


def settings_of(request: Request) -> Settings:
    settings: Settings = request.app.state.settings
    return settings


def json_response(content: Any, status: int = 200, headers: dict[str, str] | None = None) -> Response:
    return Response(write_json(content), status, headers, "application/json")


def body_response(body: bytes | Spool, headers: dict[str, str], media_type: str) -> Response:
    """The answer 200 with this body, streamed if it is a spool."""
    if isinstance(body, bytes):
        return Response(body, 200, headers, media_type)
    headers = headers | {"Content-Length": str(body.size)}
    return StreamingResponse(pieces(body), 200, headers, media_type)


async def leased_maps(request: Request) -> AsyncIterator[FindMap]:
    """Dependency: finds maps, whose files stay until the answer has been sent, even if they are deleted."""
    store: MapStore = request.app.state.maps
    with store.leased() as find_map:
        yield find_map


def tagged(response: Response, tag: str, cache_control: str) -> Response:
    """The response, with an ETag of this tag."""
    response.headers.update({"ETag": f'"{tag}"', "Cache-Control": cache_control})
    return response


def not_modified(request: Request, tag: str, cache_control: str) -> Response | None:
    """The answer 304 where If-None-Match names this tag (RFC 9110, section 13.1.2)."""
    named = {name.strip().removeprefix("W/") for name in request.headers.get("if-none-match", "").split(",")}
    return tagged(Response(status_code=304), tag, cache_control) if named & {f'"{tag}"', "*"} else None


def json_only(request: Request) -> None:
    """Dependency of routes that answer in JSON: refuses a client who would not read it."""
    choose(request.headers.get("accept"), ["application/json"])


async def read_model(request: Request, model: type[Model], limit: int | None = None) -> Model:
    """The JSON body, at most `limit` bytes long (max_body_bytes), as a model.

    Raises Refusal: unsupported-media-type, payload-too-large, malformed-json, invalid-request.
    """
    media_type, _, parameters = request.headers.get("content-type", "").partition(";")
    charset = parameters.lower().replace('"', "").replace(" ", "").partition("charset=")[2] or "utf-8"
    if media_type.strip().lower() != "application/json" or charset not in ("utf-8", "utf8"):
        raise Refusal("unsupported-media-type", "Send the body as Content-Type: application/json, in UTF-8.")
    body = bytearray()
    async for chunk in bounded(request, limit or settings_of(request).max_body_bytes).stream():
        body += chunk

    def read() -> Model:
        try:
            return validated(model, read_json(bytes(body)))
        except MalformedJson as error:
            raise Refusal("malformed-json", str(error)) from None

    # A large body must not hold up the other clients.
    return await anyio.to_thread.run_sync(read) if len(body) > _LARGE else read()


def bounded(request: Request, limit: int, take: Callable[[int], None] = lambda _: None) -> Request:
    """The same request, its body at most `limit` bytes long; take is told of its bytes as they come. Raises
    Refusal, here or while it is read."""
    too_large = Refusal("payload-too-large", f"The body must not exceed {limit} bytes.", limit=limit)
    if request.headers.get("content-encoding", "identity").lower() != "identity":
        raise Refusal("unsupported-media-type", "Send the body without a Content-Encoding.")
    length = request.headers.get("content-length", "0")
    if length.isdecimal() and int(length[:20]) > limit:
        raise too_large
    left = limit

    async def receive() -> Message:
        nonlocal left
        message = await request.receive()
        left -= len(message.get("body", b""))
        if left < 0:
            raise too_large
        take(len(message.get("body", b"")))
        return message

    return Request(request.scope, receive)


def problems(*codes: str) -> dict[int | str, dict[str, Any]]:
    """The `responses` of a route that may refuse with these codes."""
    by_status: dict[int | str, list[str]] = {}
    for code in (*codes, "not-acceptable", "unauthorized", "request-timeout", "busy", "internal-error"):
        by_status.setdefault(CODES[code][0], []).append(code)
    schema = {"$ref": "#/components/schemas/Problem"}
    return {
        status: {"description": ", ".join(sorted(found)), "content": {PROBLEM_JSON: {"schema": schema}}}
        for status, found in sorted(by_status.items())
    }


def request_body(model: type[BaseModel]) -> dict[str, Any]:
    """The `openapi_extra` of a route that reads this model."""
    schema = {"$ref": f"#/components/schemas/{model.__name__}"}
    return {"requestBody": {"required": True, "content": {"application/json": {"schema": schema}}}}
