"""A plan as an order of VDA 5050, 2.1 or 3.0: one edge a part between two rests, its way as a NURBS.

A robot that goes where it points follows its edges tangentially, forwards (0) or backwards (π), and turns on
the spot at nodes. One that keeps a heading of its own has it on edges that are cut where it has turned by
more than HEADING_STEP: the orientation of each is the heading at its end. Fields by the specification,
VDA5050/VDA5050, tags 2.1.0 (section 6.6.6) and 3.0.0 (7.3, 7.8).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from api.errors import Refusal
from api.formats.format import PlanDocument, world_velocity
from api.formats.nurbs import DEGREE, Curve, fit
from api.strict_json import write_json
from drives.drive import Holonomic
from drives.se2 import Array, wrap
from planner.problem import Problem

__all__ = ["HEADING_STEP", "LARGEST_ERROR", "write_2_1", "write_3_0"]

LARGEST_ERROR = 5e-3
"""No curve is further from the plan, m"""
HEADING_STEP = 0.1
"""Most that a robot with a heading of its own turns on one edge, rad"""
_POSITION, _DIRECTION = 1e-3, 0.01
"""What curves are fitted to, m and rad"""
_SHORTEST = 5e-4
"""A part that leads less far from where the last one ended is left out, m"""
_STILL = 1e-3
"""Share of the top speed below which the robot stands, or turns on the spot"""
_FINE = 4
"""Points to fit to for each step of the plan"""


@dataclass(frozen=True, slots=True, eq=False)
class _Edge:
    """curve: the way; orientation rad and whether it is in the world frame, else along the way; heading rad:
    where the body points at both ends; error rad: how far it is at most from the orientation; length m,
    speed m/s, yaw_rate rad/s: the largest."""

    curve: Curve
    orientation: float
    in_world: bool
    heading: tuple[float, float]
    error: float
    length: float
    speed: float
    yaw_rate: float


def write_2_1(plan: PlanDocument, problem: Problem) -> bytes:
    """{"order": an order message, "fitError": {"position": m, "heading": rad}}.

    manufacturer and serialNumber are empty, for a plan does not know who drives it.
    """
    edges, error = _edges(plan, problem)
    order = _order(plan, problem, edges, "2.1.0", datetime.now(UTC))
    for i, (edge, made) in enumerate(zip(edges, order["edges"], strict=True)):
        made["startNodeId"], made["endNodeId"] = order["nodes"][i]["nodeId"], order["nodes"][i + 1]["nodeId"]
        made["maxSpeed"], made["maxRotationSpeed"] = edge.speed, edge.yaw_rate
        made["rotationAllowed"] = edge.in_world
    return write_json({"order": order, "fitError": error})


def write_3_0(plan: PlanDocument, problem: Problem) -> bytes:
    """The same with the names of 3.0, and "intermediatePath": the plan's samples as a polyline with times of
    arrival, as if the robot left at the order's timestamp."""
    (edges, error), now = _edges(plan, problem), datetime.now(UTC)
    order = _order(plan, problem, edges, "3.0.0", now)
    for edge, made in zip(edges, order["edges"], strict=True):
        made["maximumSpeed"], made["maximumRotationSpeed"] = edge.speed, edge.yaw_rate
    if edges and edges[0].in_world:
        turns_first = abs(_headings(plan, problem)[0] - edges[0].heading[0]) > _DIRECTION
        order["edges"][0]["reachOrientationBeforeEntering"] = turns_first
    time = np.asarray(plan["schedule"]["time"], float)
    x, y = (np.asarray(plan["trajectory"][name], float) for name in "xy")
    polyline = [
        {"x": px, "y": py, "theta": wrap(float(theta)), "eta": _timestamp(now + timedelta(seconds=float(t)))}
        for px, py, theta, t in zip(x, y, _headings(plan, problem), time, strict=True)
    ]
    return write_json({"order": order, "intermediatePath": {"polyline": polyline}, "fitError": error})


def _order(
    plan: PlanDocument, problem: Problem, edges: list[_Edge], version: str, now: datetime
) -> dict[str, Any]:
    """What both versions name alike."""
    headings, layer = _headings(plan, problem), problem.environment.map
    ends = [edge.curve.points[-1] for edge in edges]
    first = [plan["trajectory"][name][0 if edges else -1] for name in "xy"]
    leaving = [edge.heading[0] for edge in edges[1:]] + [headings[-1]]
    thetas = [headings[0], *leaving] if edges else leaving
    nodes = [
        {
            "nodeId": f"n{i}",
            "sequenceId": 2 * i,
            "released": True,
            "nodePosition": {
                "x": x, "y": y, "theta": wrap(float(theta)), "mapId": layer.id if layer else "",
            },
            "actions": [],
        }
        for i, ((x, y), theta) in enumerate(zip([first, *ends], thetas, strict=True))
    ]  # fmt: skip
    return {
        "headerId": 0,
        "timestamp": _timestamp(now),
        "version": version,
        "manufacturer": "",
        "serialNumber": "",
        "orderId": plan["id"],
        "orderUpdateId": 0,
        "nodes": nodes,
        "edges": [
            {
                "edgeId": f"e{i}",
                "sequenceId": 2 * i + 1,
                "released": True,
                "orientation": edge.orientation,
                "orientationType": "GLOBAL" if edge.in_world else "TANGENTIAL",
                "length": edge.length,
                "trajectory": {
                    "degree": DEGREE,
                    "knotVector": edge.curve.knots,
                    "controlPoints": [{"x": x, "y": y} for x, y in edge.curve.points],
                },
                "actions": [],
            }
            for i, edge in enumerate(edges)
        ],
    }


def _timestamp(at: datetime) -> str:
    return at.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _headings(plan: PlanDocument, problem: Problem) -> Array:
    """Where the body points (n,), rad: a synchro drive's does not turn with its wheels."""
    theta = np.asarray(plan["trajectory"]["theta"], float)
    fixed = problem.robot.drive.fixed_body_heading
    return theta if fixed is None else np.full(len(theta), fixed)


def _edges(plan: PlanDocument, problem: Problem) -> tuple[list[_Edge], dict[str, float]]:
    """The parts of the motion, and how far they are from it: position m, heading rad.

    Raises Refusal: not-acceptable beyond LARGEST_ERROR.
    """
    from scipy.interpolate import CubicHermiteSpline  # only workers need it

    drive = problem.robot.drive
    fixed = drive.fixed_body_heading
    free = fixed is not None or isinstance(drive.mobility(problem.robot.limits), Holonomic)
    time, velocity = np.asarray(plan["schedule"]["time"], float), world_velocity(plan)
    if len(time) < 2:
        return [], {"position": 0.0, "heading": 0.0}
    body = {name: np.asarray(values, float) for name, values in plan["trajectory"].items()}
    place = CubicHermiteSpline(time, np.column_stack([body["x"], body["y"]]), velocity)
    turn = CubicHermiteSpline(time, _headings(plan, problem), body["omega"] * (fixed is None))
    edges: list[_Edge] = []
    end, off = place(time[0]), 0.0
    for t in _parts(time, velocity):
        points, heading = place(t), turn(t)
        away = np.hypot(*(points - end).T)
        if away.max() < _SHORTEST:
            off = max(off, float(away.max()))
            continue
        # What it drifts while it turns on the spot is made up for along the way.
        off = max(off, float(away[0]))
        steps = np.hypot(*np.diff(points, axis=0).T)
        left = 1.0 - np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
        points += np.outer(left, end - points[0])
        moved = np.concatenate([[True], np.hypot(*np.diff(points, axis=0).T) > 1e-9])
        t, points, heading = t[moved], points[moved], heading[moved]
        backwards = math.pi * float(np.interp(t[len(t) // 2], time, body["vx"]) < 0)
        for a, b in itertools.pairwise(_cuts(heading) if free else [0, len(t) - 1]):
            part = slice(a, b + 1)
            if free:
                curve = fit(points[part], _directions(points[part]), _POSITION, np.inf)
            else:
                curve = fit(points[part], heading[part] + backwards, _POSITION, _DIRECTION)
            off = max(off, curve.position)
            edges.append(
                _Edge(
                    curve=curve,
                    orientation=wrap(float(heading[b])) if free else backwards,
                    in_world=free,
                    heading=(float(heading[a]), float(heading[b])),
                    error=float(np.ptp(heading[part])) if free else curve.direction,
                    length=float(np.hypot(*np.diff(points[part], axis=0).T).sum()),
                    speed=float(np.hypot(*place(t[part], 1).T).max()),
                    yaw_rate=float(np.abs(turn(t[part], 1)).max()),
                )
            )
        end = points[-1]
    off = max(off, float(np.hypot(*(place(time[-1]) - end))))
    if off > LARGEST_ERROR:
        raise Refusal("not-acceptable", f"The curves are {off:g} m off; at most {LARGEST_ERROR:g} m will do.")
    return edges, {"position": off, "heading": max((edge.error for edge in edges), default=0.0)}


def _parts(time: Array, velocity: Array) -> Iterator[Array]:
    """Times, _FINE to a step of the plan, of each part from rest to rest: where the velocity (n, 2) vanishes,
    or where it turns back between samples, there taken as linear."""
    before, change = velocity[:-1], -np.diff(velocity, axis=0)
    back = (before * velocity[1:]).sum(axis=1) < 0
    least = (before * change)[back].sum(axis=1) / (change**2)[back].sum(axis=1)
    rests = time[:-1][back] + least * np.diff(time)[back]
    fine = np.interp(np.arange((len(time) - 1) * _FINE + 1) / _FINE, np.arange(len(time)), time)
    grid = np.union1d(fine, rests)
    speed = np.hypot(*(np.interp(grid, time, component) for component in velocity.T))
    still = (speed < _STILL * speed.max()) | np.isin(grid, rests)
    still[[0, -1]] = True
    for i, j in itertools.pairwise(np.flatnonzero(still)):
        if j - i > 1:
            yield grid[i : j + 1]


def _cuts(heading: Array) -> list[int]:
    """Where edges end, so that the heading (n,) stays within HEADING_STEP on each."""
    cuts = [0]
    low = high = heading[0]
    for i, value in enumerate(heading):
        low, high = min(low, value), max(high, value)
        if high - low > HEADING_STEP and i - 1 > cuts[-1]:
            cuts.append(i - 1)
            low, high = min(heading[i - 1], value), max(heading[i - 1], value)
    return [*cuts, len(heading) - 1]


def _directions(points: Array) -> Array:
    """The direction (n,) of a way at points (n, 2), rad."""
    steps = np.diff(points, axis=0)
    along = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    return np.asarray(np.arctan2(along[:, 1], along[:, 0]))
