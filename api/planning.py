"""What a worker does with one request: plan, and write the answer down as the bytes that the client gets."""

from __future__ import annotations

import gzip
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from api.errors import Refusal
from api.formats import BY_MEDIA_TYPE
from api.spool import Spool, spooled
from api.strict_json import write_json
from api.workers import report
from drives.se2 import Array
from planner.errors import AuditFailed
from planner.problem import Problem

if TYPE_CHECKING:
    from planner.plan import Plan

__all__ = [
    "Answer", "answer_plan", "duration_ratio", "make_plan", "plan_document", "server_sent_event",
    "stream_plan",
]  # fmt: skip


class Answer(NamedTuple):
    """The body of a response, in a file if it is large; the seconds that planning took, the planner that
    found the way, how near the motion is to the shortest (see duration_ratio), and how many faster motions
    failed their certificate."""

    body: bytes | Spool
    seconds: float
    planner: str
    duration_ratio: float
    refused: int


def answer_plan(problem: Problem, media_type: str, compress: bool) -> Answer:
    """Plans, and writes the plan in the format of this media type.

    Raises PlanningError, and Refusal: unknown-map where the map has been deleted meanwhile, not-acceptable
    where the format cannot tell this plan.
    """
    began = time.perf_counter()
    made = make_plan(problem)
    document = plan_document(problem, made)
    seconds = time.perf_counter() - began
    with _map_may_go(problem):
        body = BY_MEDIA_TYPE[media_type].write(document, problem)
    # Level 1: level 9 takes ten times as long to save a few per cent more.
    return _answer(problem, made, gzip.compress(body, 1, mtime=0) if compress else body, seconds)


def stream_plan(problem: Problem) -> Answer:
    """Plans, and reports each better plan on the way as a server-sent event; the last event is the answer."""
    began = time.perf_counter()

    def event(made: Plan, final: bool) -> bytes:
        elapsed = time.perf_counter() - began
        data = {"plan": plan_document(problem, made), "elapsed": elapsed, "final": final}
        return server_sent_event("plan", data)

    made = make_plan(problem, lambda better: report(spooled(event(better, final=False))))
    seconds = time.perf_counter() - began
    return _answer(problem, made, event(made, final=True), seconds)


def _answer(problem: Problem, made: Plan, body: bytes, seconds: float) -> Answer:
    about = made.planning
    return Answer(spooled(body), seconds, about["planner"], duration_ratio(problem, made), about["refused"])


def duration_ratio(problem: Problem, made: Plan) -> float:
    """The motion's duration over the least time in which its busiest wheel could turn as far, from rest to
    rest within its limits on speed and acceleration. At 1 no motion along this path is shorter."""
    limits = problem.robot.limits
    turned = np.abs(np.diff(made.schedule.wheel_angle, axis=0)).sum(0)
    speed, acceleration = limits.wheel_speed, limits.wheel_acceleration
    reaches_speed = turned * acceleration > speed**2
    cruising = turned / speed + speed / acceleration
    least = np.where(reaches_speed, cruising, 2 * np.sqrt(turned / acceleration)).max()
    return float(made.duration / least) if least > 0 else 1.0


def server_sent_event(name: str, data: Any) -> bytes:
    """The bytes of an event whose data is JSON."""
    return b"event: %s\ndata: %s\n\n" % (name.encode(), write_json(data))


def make_plan(problem: Problem, improved: Callable[[Plan], None] | None = None) -> Plan:
    """planner.plan.plan, which only workers import: it takes seconds. Raises PlanningError, and Refusal where
    the map has been deleted meanwhile."""
    from planner.plan import plan

    with _map_may_go(problem):
        return plan(problem, improved)


@contextmanager
def _map_may_go(problem: Problem) -> Iterator[None]:
    layer = problem.environment.map
    try:
        yield
    except FileNotFoundError:
        if layer is not None and not layer.directory.exists():
            raise Refusal("unknown-map", f"The map {layer.id} has been deleted.") from None
        raise


def plan_document(problem: Problem, made: Plan) -> dict[str, Any]:
    """The contract's answer to a problem; its arrays are numpy's. Raises AuditFailed."""
    drive, schedule = problem.robot.drive, made.schedule
    # JSON has no infinity, and orjson would write null without a word.
    scalars = np.array([made.duration, made.length, *asdict(made.certificate).values()])
    if not all(
        np.isfinite(values).all()
        for values in (scalars, *(getattr(schedule, f.name) for f in fields(schedule)))
    ):
        raise AuditFailed("The plan holds a number that is not finite.", {}, ["A number is not finite."])
    wheels = zip(
        drive.wheel_names,
        schedule.wheel_angle.T, schedule.wheel_velocity.T, schedule.wheel_acceleration.T,
        strict=True,
    )  # fmt: skip
    steering = zip(drive.steered_names, schedule.steering_angle.T, schedule.steering_rate.T, strict=True)
    return {
        "id": uuid.uuid4().hex,
        "duration": made.duration,
        "length": made.length,
        "schedule": {
            "time": _column(schedule.time),
            "wheels": {
                name: {"angle": _column(q), "velocity": _column(v), "acceleration": _column(a)}
                for name, q, v, a in wheels
            },
            "steering": {name: {"angle": _column(q), "rate": _column(v)} for name, q, v in steering},
        },
        "trajectory": {
            **{name: _column(schedule.pose[:, i]) for i, name in enumerate(("x", "y", "theta"))},
            **{name: _column(schedule.twist[:, i]) for i, name in enumerate(("vx", "vy", "omega"))},
        },
        "certificate": asdict(made.certificate),
        "planning": made.planning,
    }


def _column(values: Array) -> Array:
    return np.ascontiguousarray(values, dtype=np.float64)
