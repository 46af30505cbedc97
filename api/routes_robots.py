"""POST /v1/robots/from-factsheet."""

from __future__ import annotations

from fastapi import APIRouter, Depends, Request, Response

from api.factsheet import Factsheet, RobotOfFactsheet, robot_of
from api.http import json_only, json_response, problems, read_model, request_body

__all__ = ["router"]

router = APIRouter(prefix="/v1/robots", tags=["robots"], dependencies=[Depends(json_only)])


@router.post(
    "/from-factsheet",
    summary="VDA 5050 factsheet to robot",
    response_model=RobotOfFactsheet,
    responses=problems(
        "malformed-json", "unsupported-media-type", "payload-too-large", "invalid-request"
    ),
    openapi_extra=request_body(Factsheet),
)  # fmt: skip
async def from_factsheet(request: Request) -> Response:
    """The robot that a factsheet (VDA 5050 2.1 or 3.0) describes, what it lacks, and what was assumed."""
    return json_response(robot_of(await read_model(request, Factsheet)))
