"""GET /v1/drives."""

from __future__ import annotations

from functools import cache
from typing import Any

from fastapi import APIRouter, Depends, Response

from api.answers import DrivesAnswer
from api.drive_schemas import EXAMPLES, SCHEMAS, build_drive
from api.http import json_only, json_response, problems

__all__ = ["catalogue", "router"]

router = APIRouter(prefix="/v1/drives", tags=["drives"], dependencies=[Depends(json_only)])


@router.get("", summary="The drives", response_model=DrivesAnswer, responses=problems())
async def list_drives() -> Response:
    """Every drive with its parameters' JSON schema, an example, and the example's wheels."""
    return json_response(catalogue())


@cache
def catalogue() -> dict[str, Any]:
    """The answer of GET /v1/drives."""
    drives = []
    for kind, schema in SCHEMAS.items():
        drive = build_drive(schema.model_validate(EXAMPLES[kind]), ())
        drives.append(
            {
                "type": kind,
                "parameters": schema.model_json_schema(),
                "example": EXAMPLES[kind],
                "wheels": drive.wheel_names,
                "steering": drive.steered_names,
            }
        )
    return {"drives": drives}
