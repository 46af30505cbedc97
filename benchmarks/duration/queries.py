"""Random queries with a fixed seed: on an open floor, and in clutter."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from typing import Literal

import numpy as np

from benchmarks.duration.robots import ROBOTS
from drives.se2 import Pose
from planner.environment import CollisionWorld
from planner.errors import PlanningError
from planner.plan import plan
from planner.problem import Bounds, Circle, Environment, Goal, Options, Polygon, Problem, Robot

__all__ = ["COUNT", "SEED", "SETS", "Set", "query", "solvable", "world"]

Set = Literal["open", "clutter"]

SETS: tuple[Set, ...] = ("open", "clutter")
SEED = 2024
COUNT = 20
"""Queries of a set for a drive."""

_REACH = 8.0
_SIDE, _OBSTACLES = 12.0, 14
_CORNER, _ROOM = 1.3, 1.7
"""Where starts and goals lie, from the corner (m), and how far from them there is no obstacle."""


def world(problem: Problem) -> CollisionWorld:
    """What the problem's footprint may hit."""
    robot = problem.robot
    return CollisionWorld.build(problem.environment, robot.footprint, 0.0, robot.drive.fixed_body_heading)


def query(drive: str, which: Set, draw: int) -> Problem:
    """One of the drive's random problems, without options."""
    random = np.random.default_rng([SEED, zlib.crc32(drive.encode()), SETS.index(which), draw])
    robot = ROBOTS[drive]
    return _open(robot, random) if which == "open" else _clutter(robot, random)


def solvable(drive: str, which: Set) -> Iterator[int]:
    """The draws that can be planned at all, first to last."""
    for draw in count():
        try:
            plan(replace(query(drive, which, draw), options=Options(time_budget=3.0, effort="good")))
        except PlanningError:
            continue
        yield draw


def _open(robot: Robot, random: np.random.Generator) -> Problem:
    x, y, theta = random.uniform(-1.0, 1.0, 3) * (_REACH, _REACH, math.pi)
    floor = Environment(Bounds(-30.0, -30.0, 30.0, 30.0))
    return Problem(robot, Pose(0.0, 0.0, 0.0), Goal(float(x), float(y), float(theta)), floor)


def _clutter(robot: Robot, random: np.random.Generator) -> Problem:
    near, far = _CORNER, _SIDE - _CORNER
    corners = np.array([[near, near], [far, near], [far, far], [near, far]])
    first = int(random.integers(4))
    (sx, sy), (gx, gy) = ends = corners[[first, (first + 2) % 4]]
    a, b = random.uniform(-math.pi, math.pi, 2)
    obstacles: list[Polygon | Circle] = []
    while len(obstacles) < _OBSTACLES:
        obstacle, centre, reach = _obstacle(random)
        if (np.hypot(*(ends - centre).T) > reach + _ROOM).all():
            obstacles.append(obstacle)
    return Problem(
        robot, Pose(float(sx), float(sy), float(a)), Goal(float(gx), float(gy), float(b)),
        Environment(Bounds(0.0, 0.0, _SIDE, _SIDE), tuple(obstacles)),
    )  # fmt: skip


def _obstacle(random: np.random.Generator) -> tuple[Polygon | Circle, np.ndarray, float]:
    """A convex obstacle, its centre and how far it reaches from there."""
    centre, reach = random.uniform(0.5, _SIDE - 0.5, 2), float(random.uniform(0.25, 0.75))
    if random.random() < 0.3:
        return Circle(float(centre[0]), float(centre[1]), reach), centre, reach
    n = int(random.integers(3, 7))
    angle = random.uniform(0, math.tau) + math.tau / n * (np.arange(n) + random.uniform(-0.3, 0.3, n))
    return Polygon(centre + reach * np.stack([np.cos(angle), np.sin(angle)], -1)), centre, reach
