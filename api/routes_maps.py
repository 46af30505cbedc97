"""The collection /v1/maps."""

from __future__ import annotations

import hashlib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Annotated, Any

import anyio
from fastapi import APIRouter, Depends, Path, Request, Response
from starlette.datastructures import FormData, UploadFile
from starlette.exceptions import HTTPException

from api.answers import MapAnswer, MapsAnswer
from api.bounds import Allowance
from api.errors import FieldErrors, Refusal
from api.http import (
    CONDITIONAL,
    IF_NONE_MATCH,
    body_response,
    bounded,
    json_only,
    json_response,
    not_modified,
    problems,
    settings_of,
    tagged,
)
from api.maps import MapStore, room_or_refusal, take_upload
from api.negotiation import choose
from api.scheduler import Scheduler
from api.spool import LARGE, Spool
from api.validation import pointer

__all__ = ["router"]

router = APIRouter(prefix="/v1/maps", tags=["maps"])

_JSON = [Depends(json_only)]
_FOREVER = "private, max-age=31536000, immutable"
"""The id names the content, so an image never changes."""

MapId = Annotated[str, Path(description="The map's id, 64 hexadecimal digits.", examples=["0" * 64])]

_PARTS = ("yaml", "image")
_FORM = {
    "type": "object",
    "required": list(_PARTS),
    "properties": {
        "yaml": {"type": "string", "format": "binary", "description": "A ROS map_server file."},
        "image": {"type": "string", "format": "binary", "description": "Its image, PGM (P2, P5) or PNG."},
    },
}


def _store(request: Request) -> MapStore:
    store: MapStore = request.app.state.maps
    return store


@router.post(
    "",
    dependencies=_JSON,
    summary="Upload a map",
    status_code=201,
    response_model=MapAnswer,
    responses={
        200: {"model": MapAnswer, "description": "The same map is in store already."},
        **problems(
            "unsupported-media-type",
            "payload-too-large",
            "invalid-request",
            "quota-exceeded",
            "insufficient-storage",
        ),
    },
    openapi_extra={"requestBody": {"required": True, "content": {"multipart/form-data": {"schema": _FORM}}}},
)
async def upload_map(request: Request) -> Response:
    """Stores a map under the SHA-256 of its decoded content."""
    settings, store = settings_of(request), _store(request)
    scheduler: Scheduler[Any] = request.app.state.pool
    async with (
        _parts(request, settings.max_map_bytes) as (description, image),
        request.app.state.decoding,  # one at a time: a decoded map is large
    ):
        summary, new = await scheduler.apart(take_upload, store, description, image, settings.max_map_cells)
    return json_response(summary, 201 if new else 200, {"Location": f"/v1/maps/{summary['id']}"})


@router.get(
    "",
    dependencies=_JSON,
    summary="All maps",
    response_model=MapsAnswer,
    responses={**CONDITIONAL, **problems()},
    openapi_extra=IF_NONE_MATCH,
)
async def list_maps(request: Request) -> Response:
    """The maps in store."""
    maps = await anyio.to_thread.run_sync(_store(request).list)
    tag = hashlib.sha256("".join(summary["id"] for summary in maps).encode()).hexdigest()
    return not_modified(request, tag, "no-cache") or tagged(json_response({"maps": maps}), tag, "no-cache")


@router.get(
    "/{id}",
    dependencies=_JSON,
    summary="One map",
    response_model=MapAnswer,
    responses={**CONDITIONAL, **problems("unknown-map", "map-corrupt")},
    openapi_extra=IF_NONE_MATCH,
)
async def get_map(request: Request, id: MapId) -> Response:
    """What is known of one map."""
    summary = await anyio.to_thread.run_sync(_store(request).get, id)
    return not_modified(request, id, "no-cache") or tagged(json_response(summary), id, "no-cache")


@router.get(
    "/{id}/image",
    summary="One map's image",
    response_class=Response,
    responses={
        200: {"content": {"image/png": {"schema": {"type": "string", "format": "binary"}}}},
        **CONDITIONAL,
        **problems("unknown-map", "map-corrupt"),
    },
    openapi_extra=IF_NONE_MATCH,
)
async def get_image(request: Request, id: MapId) -> Response:
    """The cells as a PNG in the greys of map_saver: occupied 0, unknown 205, free 254. Row 0 is the top."""
    choose(request.headers.get("accept"), ["image/png"])
    store = _store(request)
    await anyio.to_thread.run_sync(store.get, id)
    if unchanged := not_modified(request, id, _FOREVER):
        return unchanged
    image = await anyio.to_thread.run_sync(store.image, id)
    if image is None:
        async with request.app.state.decoding:
            await request.app.state.pool.apart(store.draw, id)
        image = await anyio.to_thread.run_sync(store.image, id)
    return tagged(body_response(image or b"", {}, "image/png"), id, _FOREVER)


@router.delete(
    "/{id}", dependencies=_JSON, summary="Delete a map", status_code=204, responses=problems("unknown-map")
)
async def delete_map(request: Request, id: MapId) -> Response:
    """Forgets a map."""
    await anyio.to_thread.run_sync(_store(request).delete, id)
    return Response(status_code=204)


@asynccontextmanager
async def _parts(request: Request, limit: int) -> AsyncIterator[list[bytes | Spool]]:
    """The yaml and the image; large ones in temporary files."""
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != "multipart/form-data":
        raise Refusal("unsupported-media-type", "Send the map as multipart/form-data with yaml and image.")
    uploads: Allowance = request.app.state.uploads
    with uploads.share() as take:
        try:
            with room_or_refusal():  # large parts wait in a temporary file
                form = await bounded(request, limit, take).form(
                    max_files=2, max_fields=2, max_part_size=limit
                )
        except HTTPException as error:
            detail = f"The form cannot be read: {error.detail}"
            raise FieldErrors([{"pointer": "", "detail": detail}]) from None
        try:
            yield [await _content(part) for part in _named(form)]
        finally:
            await form.close()


def _named(form: FormData) -> list[UploadFile | str]:
    """The parts of a map, in order. Raises FieldErrors."""
    errors = [
        {"pointer": pointer(name[:40]), "detail": "This is no part of a map: send yaml and image."}
        for name in form
        if name not in _PARTS
    ]
    for name in _PARTS:
        if (count := len(form.getlist(name))) != 1:
            detail = f"{name} is given twice." if count else f"{name} is missing."
            errors.append({"pointer": f"/{name}", "detail": detail})
    if errors:
        raise FieldErrors(errors)
    return [form[name] for name in _PARTS]


async def _content(part: UploadFile | str) -> bytes | Spool:
    if isinstance(part, str):
        return part.encode()
    large = part.size is not None and part.size >= LARGE
    return Spool(part.file) if large else await part.read()
