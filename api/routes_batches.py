"""The collection /v1/batches."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Request, Response
from fastapi.responses import StreamingResponse

from api.batch_schemas import BatchAnswer, BatchRequest
from api.batches import Batches
from api.clients import client_of
from api.http import json_only, json_response, problems, read_model, request_body, settings_of
from api.maps import room_or_refusal
from api.negotiation import choose

__all__ = ["router"]

router = APIRouter(prefix="/v1/batches", tags=["batches"])

NDJSON = "application/x-ndjson"
BatchId = Annotated[str, Path(description="The batch's id, 32 hexadecimal digits.", examples=["0" * 32])]


def _batches(request: Request) -> Batches:
    batches: Batches = request.app.state.batches
    return batches


@router.post(
    "",
    summary="Plan many motions",
    status_code=202,
    response_model=BatchAnswer,
    responses=problems(
        "malformed-json", "unsupported-media-type", "payload-too-large", "invalid-request", "overloaded",
        "draining", "insufficient-storage",
    ),
    openapi_extra=request_body(BatchRequest),
    dependencies=[Depends(json_only)],
)  # fmt: skip
async def create_batch(request: Request) -> Response:
    """Takes up to 1,000 plan requests, to be planned while no single request needs the workers. Location
    leads to their counts, and Location/results to the results."""
    batches = _batches(request)
    batches.admit()  # before the body is read
    asked = await read_model(request, BatchRequest, settings_of(request).max_batch_bytes)
    with room_or_refusal():
        document = await batches.add(asked.requests, client_of(request.scope))
    return json_response(document, 202, {"Location": f"/v1/batches/{document['id']}"})


@router.get(
    "/{id}",
    summary="How far is a batch?",
    response_model=BatchAnswer,
    responses=problems("unknown-batch"),
    dependencies=[Depends(json_only)],
)
async def get_batch(request: Request, id: BatchId) -> Response:
    """The counts of a batch: of one that runs, and of one whose results are still kept."""
    return json_response(await _batches(request).document(id))


@router.get(
    "/{id}/results",
    summary="The results of a batch, as they come",
    response_class=StreamingResponse,
    responses={
        200: {
            "description": "A JSON object a line, in the order in which they were finished. An empty line "
            "after every 10 s without one says that the batch still runs.",
            "content": {NDJSON: {"schema": {"$ref": "#/components/schemas/BatchLine"}}},
        },
        **problems("unknown-batch"),
    },
)
async def get_results(request: Request, id: BatchId) -> Response:
    """All results from the first on. While the batch runs, the answer stays open and ends with it; skip empty
    lines. A client that leaves does not stop the batch, and may come back."""
    choose(request.headers.get("accept"), [NDJSON])
    return StreamingResponse(await _batches(request).lines(id), media_type=NDJSON)


@router.delete(
    "/{id}",
    summary="Cancel a batch",
    status_code=204,
    responses=problems("unknown-batch"),
    dependencies=[Depends(json_only)],
)
async def cancel_batch(request: Request, id: BatchId) -> Response:
    """Ends a batch. What is being planned is stopped; results that are there stay until they expire."""
    await _batches(request).cancel(id)
    return Response(status_code=204)
