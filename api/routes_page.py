"""GET /: the page, and the files it is made of."""

from __future__ import annotations

from pathlib import Path

from fastapi import APIRouter, Request, Response
from starlette.staticfiles import StaticFiles

__all__ = ["router"]

router = APIRouter(include_in_schema=False)

# Looked up when somebody asks, with the file's type, its ETag, and 304 where the client has it already.
_FILES = StaticFiles(directory=Path(__file__).with_name("static"), check_dir=False)

_TYPES = {".js": "text/javascript; charset=utf-8", ".woff2": "font/woff2"}
"""What the tables of some machines say otherwise, or do not know."""

_HEADERS = {
    # Kept, but asked about each time: the page and its modules are always of one version.
    "Cache-Control": "no-cache",
    "Content-Security-Policy": (
        "default-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
}


@router.get("/")
async def page(request: Request) -> Response:
    """The page."""
    return await _file(request, "index.html")


@router.get("/static/{name}")
async def asset(request: Request, name: str) -> Response:
    """A module, style, font or picture of the page."""
    return await _file(request, name)


async def _file(request: Request, name: str) -> Response:
    response = await _FILES.get_response(name, request.scope)
    response.headers.update(_HEADERS)
    if kind := _TYPES.get(Path(name).suffix):
        response.headers["Content-Type"] = kind
    return response
