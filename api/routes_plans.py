"""POST /v1/plans."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Annotated, Any

import anyio
from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import StreamingResponse
from starlette.datastructures import State

from api.answers import PlanAnswer
from api.clients import client_of
from api.convert import FindMap, to_problem
from api.errors import Refusal, problem_document
from api.fair_queue import Ticket
from api.formats import BY_MEDIA_TYPE, FORMATS, Format, find_format, formats_for, refuse_drive
from api.heartbeat import with_heartbeat
from api.http import body_response, leased_maps, problems, read_model, request_body, settings_of
from api.metrics import Metrics
from api.negotiation import accepts_gzip, choose
from api.planning import Answer, answer_plan, server_sent_event, stream_plan
from api.scheduler import Scheduler
from api.schemas import PlanRequest
from api.spool import Spool, pieces
from planner.errors import PlanningError
from planner.problem import Problem

__all__ = ["answered", "router", "ticket_for"]

router = APIRouter(prefix="/v1/plans", tags=["plans"])

_EVENTS = Format("events", "text/event-stream", "Each better plan as it is found", lambda *_: b"")
_GONE = 499
_NAMES = ", ".join([*FORMATS, _EVENTS.name])
_Wanted = Annotated[str | None, Query(description=f"One of {_NAMES}; wins over Accept.", examples=["csv"])]


@router.post(
    "",
    summary="Plan a motion",
    response_model=PlanAnswer,
    responses={
        200: {
            "content": {
                each.media_type: {
                    "schema": {"description": f"{each.describes}."}
                    | ({} if each.media_type.endswith("json") else {"type": "string"})
                }
                for each in [*FORMATS.values(), _EVENTS]
                if each.name != "json"
            }
        },
        **problems(
            "malformed-json", "unsupported-media-type", "payload-too-large", "invalid-request",
            "invalid-geometry", "start-in-collision", "goal-in-collision", "start-out-of-bounds",
            "goal-out-of-bounds", "no-path-exists", "no-path-found", "limits-infeasible",
            "too-many-samples", "unknown-map", "map-corrupt", "deadline-exceeded", "worker-crashed",
            "audit-failed", "overloaded", "draining",
        ),
    },
    openapi_extra=request_body(PlanRequest),
)  # fmt: skip
async def create_plan(
    request: Request, find_map: Annotated[FindMap, Depends(leased_maps)], format: _Wanted = None
) -> Response:
    """A certified schedule of wheel speeds from start to goal, or the reason why there is none.

    As text/event-stream, with effort best: each better plan as it is found. An event `plan` holds
    {"plan": what the JSON answer would be, "elapsed": s of planning, "final": whether it is the last}; an
    event `problem` holds the problem document, where the work failed after the answer had begun: with the
    first plan, or after 10 s. After every 10 s without an event comes a comment, a line that begins with a
    colon.
    """
    state, settings = request.app.state, settings_of(request)
    _wanted(request, format)
    asked = await read_model(request, PlanRequest)
    problem = await anyio.to_thread.run_sync(
        to_problem, asked, find_map, settings.max_time_budget, settings.max_samples
    )
    wanted = _wanted(request, format, problem.robot.drive.kind)
    ticket = ticket_for(problem, client_of(request.scope))
    if wanted is _EVENTS:
        events: asyncio.Queue[bytes | Spool | None] = asyncio.Queue()
        work = answered(state, problem, ticket, stream_plan, progress=events.put_nowait)
        return await _stream(request, work, events)
    compress = accepts_gzip(request.headers.get("accept-encoding"))
    work = answered(state, problem, ticket, answer_plan, wanted.media_type, compress)
    answer: Answer | None = await while_connected(request, work)
    if answer is None:
        return Response(status_code=_GONE)
    headers = {"Vary": "Accept, Accept-Encoding"} | ({"Content-Encoding": "gzip"} if compress else {})
    return body_response(answer.body, headers, wanted.media_type)


def ticket_for(problem: Problem, client: str) -> Ticket:
    """A plan's place in the queue."""
    options = problem.options
    return Ticket(client=client, foreseen=options.time_budget if options.effort == "best" else None)


async def answered(
    state: State,
    problem: Problem,
    ticket: Ticket,
    function: Callable[..., Answer],
    *args: Any,
    progress: Callable[[Any], None] | None = None,
) -> Answer:
    """What function(problem, *args) answers in a worker; counted. Raises PlanningError and Refusal."""
    scheduler: Scheduler[Any] = state.pool
    metrics: Metrics = state.metrics
    deadline = problem.options.time_budget + state.settings.deadline_grace
    try:
        answer: Answer = await scheduler.run(
            function, problem, *args, deadline=deadline, ticket=ticket, progress=progress
        )
    except (PlanningError, Refusal) as error:
        metrics.refused.labels(error.code).inc()
        raise
    metrics.planned(problem, answer)
    return answer


async def _stream(
    request: Request, work: Coroutine[Any, Any, Answer], events: asyncio.Queue[bytes | Spool | None]
) -> Response:
    """The events as they come, then the work's answer. Raises what the work raises before the first event."""
    job = asyncio.ensure_future(work)
    gone = asyncio.ensure_future(_disconnect(request))
    for end in (job, gone):
        end.add_done_callback(lambda _: events.put_nowait(None))
    told = with_heartbeat(events.get, b": still planning\n\n")
    first = await anext(told)
    if first is None and job.done() and job.exception() is not None:
        gone.cancel()
        await job

    async def body() -> AsyncIterator[bytes]:
        try:
            event = first
            while event is not None:
                async for piece in pieces(event):
                    yield piece
                event = await anext(told)
            if job.done():
                try:
                    async for piece in pieces(job.result().body):
                        yield piece
                except (PlanningError, Refusal) as error:
                    yield server_sent_event("problem", problem_document(error))
        finally:
            job.cancel()
            gone.cancel()

    headers = {"Vary": "Accept, Accept-Encoding", "Cache-Control": "no-store", "X-Accel-Buffering": "no"}
    return StreamingResponse(body(), 200, headers, "text/event-stream")


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


def _wanted(request: Request, format: str | None, drive: str | None = None) -> Format:
    """The format that ?format= names, or that Accept likes best of those for this type of drive."""
    if format is None:
        offers = [each.media_type for each in [*formats_for(drive), _EVENTS]]
        best = choose(request.headers.get("accept"), offers)
        return BY_MEDIA_TYPE.get(best, _EVENTS)
    found = _EVENTS if format == _EVENTS.name else find_format(format)
    if not found.suits(drive):
        raise refuse_drive(found, str(drive))
    return found
