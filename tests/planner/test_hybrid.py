"""Hybrid A* finds its way through bends that are hardly wider than the robot."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from drives.se2 import Pose
from planner.connect import connector
from planner.environment import CollisionWorld
from planner.hybrid import hybrid_steps
from planner.path import as_path
from planner.problem import Bounds, Environment, Options, Polygon, Robot


def corner() -> Environment:
    """A passage 0.62 m wide that turns to the left by a right angle."""
    walls = (
        [[-1.0, -0.31], [3.0, -0.31], [3.0, -1.0], [-1.0, -1.0]],
        [[2.31, -1.0], [3.0, -1.0], [3.0, 4.0], [2.31, 4.0]],
        [[-1.0, 0.31], [1.69, 0.31], [1.69, 4.0], [-1.0, 4.0]],
    )
    return Environment(Bounds(-1.0, -1.0, 3.0, 4.0), tuple(Polygon(np.array(wall)) for wall in walls))


@pytest.mark.parametrize("kind", ["differential", "mecanum", "ackermann"])
def test_it_leads_round_a_narrow_corner(robot: Callable[..., Robot], kind: str) -> None:
    given = robot(kind)
    world = CollisionWorld.build(corner(), given.footprint)
    local = connector(given, world, Options(effort="good"))
    start, goal = Pose(0.0, 0.0, 0.0), Pose(2.0, 3.0, math.pi / 2)
    cell = 0.2 if kind == "mecanum" else 0.1
    asked = world.kernel, local.law, np.array(start), np.array(goal), cell, 1.0, 100_000
    steps, checked = hybrid_steps(*asked)
    assert 0 < checked <= 100_100
    path = as_path(np.array(start), steps, kind == "mecanum")
    assert path[-1].end == pytest.approx(goal, abs=1e-9)
    for piece in path:
        assert world.polyline_free(piece.poses(np.linspace(0.0, 1.0, 200))) < 0
    again, _ = hybrid_steps(*asked)
    assert (again == steps).all()


def test_its_work_is_bounded(robot: Callable[..., Robot]) -> None:
    given = robot("differential")
    world = CollisionWorld.build(corner(), given.footprint)
    local = connector(given, world, Options(effort="good"))
    steps, checked = hybrid_steps(
        world.kernel, local.law, np.zeros(3), np.array([2.0, 3.0, math.pi / 2]), 0.02, 1.0, 300
    )
    assert len(steps) == 0
    assert checked <= 400
