"""POST /v1/plans."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

import anyio
from fastapi import APIRouter, Request, Response
from starlette.datastructures import State

from api.answers import PlanAnswer
from api.convert import to_problem
from api.errors import FieldErrors, Refusal
from api.http import problems, read_model, request_body, settings_of
from api.metrics import Metrics
from api.negotiation import accepts_gzip, choose
from api.planning import Answer, answer_plan
from api.scheduler import Scheduler
from api.schemas import PlanRequest
from planner.errors import PlanningError
from planner.problem import Problem

__all__ = ["answered", "router"]

router = APIRouter(prefix="/v1/plans", tags=["plans"])

_FORMATS = {"json": "application/json", "csv": "text/csv"}
_GONE = 499


@router.post(
    "",
    summary="Plan a motion",
    response_model=PlanAnswer,
    responses={
        200: {"content": {"text/csv": {"schema": {"type": "string"}}}},
        **problems(
            "malformed-json", "unsupported-media-type", "payload-too-large", "invalid-request",
            "invalid-geometry", "start-in-collision", "goal-in-collision", "start-out-of-bounds",
            "goal-out-of-bounds", "no-path-exists", "no-path-found", "limits-infeasible", "unknown-map",
            "deadline-exceeded", "worker-crashed", "audit-failed", "overloaded", "draining",
        ),
    },
    openapi_extra=request_body(PlanRequest),
)  # fmt: skip
async def create_plan(request: Request, format: str | None = None) -> Response:
    """A certified schedule of wheel speeds from start to goal, or the reason why there is none."""
    state, settings = request.app.state, settings_of(request)
    media_type = _media_type(request, format)
    compress = accepts_gzip(request.headers.get("accept-encoding"))
    asked = await read_model(request, PlanRequest)
    problem = await anyio.to_thread.run_sync(to_problem, asked, state.maps.layer, settings.max_time_budget)
    answer: Answer | None = await while_connected(request, answered(state, problem, media_type, compress))
    if answer is None:
        return Response(status_code=_GONE)
    headers = {"Vary": "Accept, Accept-Encoding"} | ({"Content-Encoding": "gzip"} if compress else {})
    return Response(answer.body, 200, headers, media_type)


async def answered(state: State, problem: Problem, media_type: str, compress: bool) -> Answer:
    """Has a worker plan, and counts what comes of it. Raises PlanningError and Refusal."""
    scheduler: Scheduler = state.pool
    metrics: Metrics = state.metrics
    deadline = problem.options.time_budget + state.settings.deadline_grace
    try:
        answer: Answer = await scheduler.run(answer_plan, problem, media_type, compress, deadline=deadline)
    except (PlanningError, Refusal) as error:
        metrics.refused.labels(error.code).inc()
        raise
    metrics.planning.labels(problem.robot.drive.kind).observe(answer.seconds)
    return answer


async def while_connected(request: Request, work: Coroutine[Any, Any, Any]) -> Any:
    """What the work returns, or None if the client leaves first: then the work is cancelled."""
    # The server does not cancel a handler whose client has left, so we listen for it.
    task = asyncio.ensure_future(work)
    gone = asyncio.ensure_future(_disconnect(request))
    try:
        await asyncio.wait({task, gone}, return_when=asyncio.FIRST_COMPLETED)
        return task.result() if task.done() else None
    finally:
        task.cancel()
        gone.cancel()


async def _disconnect(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


def _media_type(request: Request, format: str | None) -> str:
    if format is None:
        return choose(request.headers.get("accept"), list(_FORMATS.values()))
    if format not in _FORMATS:
        detail = f"format must be one of {', '.join(_FORMATS)}."
        raise FieldErrors([{"parameter": "format", "detail": detail, "value": format[:40]}])
    return _FORMATS[format]
