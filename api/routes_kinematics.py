"""POST /v1/kinematics/inverse and /v1/kinematics/forward."""

from __future__ import annotations

import numpy as np
from fastapi import APIRouter, Depends, Request, Response

from api.answers import ForwardAnswer, InverseAnswer
from api.convert import Errors, by_name
from api.drive_schemas import build_drive
from api.errors import Refusal
from api.http import json_only, json_response, problems, read_model, request_body
from api.schemas import ForwardRequest, InverseRequest
from drives.drive import InadmissibleTwist
from drives.se2 import Twist

__all__ = ["router"]

router = APIRouter(prefix="/v1/kinematics", tags=["kinematics"], dependencies=[Depends(json_only)])

_REFUSALS = (
    "malformed-json", "unsupported-media-type", "payload-too-large", "invalid-request", "invalid-geometry",
)  # fmt: skip


@router.post(
    "/inverse",
    summary="Twist to wheel rates",
    response_model=InverseAnswer,
    responses=problems(*_REFUSALS, "inadmissible-twist"),
    openapi_extra=request_body(InverseRequest),
)
async def inverse(request: Request) -> Response:
    """The wheel rates and steering angles of a twist of the body."""
    asked = await read_model(request, InverseRequest)
    drive = build_drive(asked.drive, ("drive",))
    errors = Errors()
    steering = None
    if asked.steering is not None:
        steering = by_name(asked.steering, drive.steered_names, ("steering",), "steered wheel", errors)
    elif drive.kind == "powered_caster":
        errors.add(("steering",), "steering is missing: a powered_caster needs its present steering angles.")
    errors.check()
    twist = Twist(asked.twist.vx, asked.twist.vy, asked.twist.omega)
    try:
        state = drive.inverse(twist, steering)
    except InadmissibleTwist as error:
        raise Refusal("inadmissible-twist", f"{error}.", twist=twist._asdict()) from None
    answer = {
        "wheels": dict(zip(drive.wheel_names, state.rates.tolist(), strict=True)),
        "steering": dict(zip(drive.steered_names, state.steering.tolist(), strict=True)),
    }
    if state.steering_rates.any():
        answer["steering_rates"] = dict(zip(drive.steered_names, state.steering_rates.tolist(), strict=True))
    return json_response(answer)


@router.post(
    "/forward",
    summary="Wheel rates to twist",
    response_model=ForwardAnswer,
    responses=problems(*_REFUSALS),
    openapi_extra=request_body(ForwardRequest),
)
async def forward(request: Request) -> Response:
    """The least-squares twist of wheel rates, and how far they are from agreeing on it."""
    asked = await read_model(request, ForwardRequest)
    drive = build_drive(asked.drive, ("drive",))
    errors = Errors()
    names = drive.steered_names
    rates = by_name(asked.wheels, drive.wheel_names, ("wheels",), "wheel", errors)
    steering = by_name(asked.steering, names, ("steering",), "steered wheel", errors)
    steering_rates = np.zeros(len(names))
    if asked.steering_rates is not None:
        steering_rates = by_name(asked.steering_rates, names, ("steering_rates",), "steered wheel", errors)
    errors.check()
    twists, slip = drive.forward(rates[None], steering[None], steering_rates[None])
    twist = dict(zip(("vx", "vy", "omega"), twists[0].tolist(), strict=True))
    return json_response({"twist": twist, "slip": float(slip[0])})
