"""Ways on arcs whose radii fit lead to the goal and keep to what the robot can do."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from drives.se2 import Array, Pose, Twist, compose, exp, wrap
from planner.connect import connector
from planner.environment import CollisionWorld
from planner.fits import fitted
from planner.problem import Bounds, Environment, Options, Robot

WIDE = Environment(Bounds(-50.0, -50.0, 50.0, 50.0))


def ends(start: Array, steps: Array) -> Pose:
    pose = Pose(*start.tolist())
    for step in steps:
        pose = compose(pose, exp(Twist(*step.tolist())))
    return pose


@pytest.mark.parametrize("reverse", [True, False])
@pytest.mark.parametrize("kind", ["differential", "ackermann", "mecanum"])
def test_every_way_ends_on_the_goal(robot: Callable[..., Robot], kind: str, reverse: bool) -> None:
    given = robot(kind)
    local = connector(given, CollisionWorld.build(WIDE, given.footprint), Options(reverse=reverse))
    a, b = np.random.default_rng(3).uniform(-3.0, 3.0, (2, 300, 3))
    times, steps = fitted(local.law, a, b)
    found = np.argwhere(np.isfinite(times))
    assert len(np.unique(found[:, 0])) > 0.3 * len(a)
    for i, way in found:
        end = ends(a[i], steps[i, way])
        assert math.dist(end[:2], b[i, :2]) < 1e-9 * max(1.0, np.abs(steps[i, way]).max())
        assert abs(wrap(end.theta - b[i, 2])) < 1e-9
    if not reverse:
        assert steps[np.isfinite(times)][..., 0].min() >= 0.0


def test_arcs_of_cars_are_no_tighter_than_they_can_turn(robot: Callable[..., Robot]) -> None:
    given = robot("ackermann")
    local = connector(given, CollisionWorld.build(WIDE, given.footprint), Options())
    a, b = np.random.default_rng(4).uniform(-3.0, 3.0, (2, 300, 3))
    times, steps = fitted(local.law, a, b)
    driven = steps[np.isfinite(times)]
    assert len(driven) > 100
    assert (np.abs(driven[..., 2]) * local.turning_radius <= np.abs(driven[..., 0]) * (1 + 1e-8)).all()


def test_a_single_arc_between_two_poses_is_found(robot: Callable[..., Robot]) -> None:
    given = robot("differential")
    local = connector(given, CollisionWorld.build(WIDE, given.footprint), Options())
    arc = Twist(2.0, 0.0, 1.1)
    start = Pose(0.3, -0.2, 0.7)
    goal = compose(start, exp(arc))
    times, steps = fitted(local.law, np.array([start]), np.array([goal]))
    alone = [way for way in steps[0][np.isfinite(times[0])] if np.count_nonzero(way.any(1)) == 1]
    assert any(np.allclose(way.sum(0), arc, atol=1e-9) for way in alone)
