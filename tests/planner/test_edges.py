"""What is told of motions without looking at all of them is true."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from drives.se2 import Pose
from planner.collision import surely_hits
from planner.connect import connector
from planner.edges import bound, ways_between
from planner.environment import CollisionWorld
from planner.problem import Environment, Footprint, Options, Robot


@pytest.mark.parametrize("fixed", [None, 0.4])
@pytest.mark.parametrize("min_clearance", [0.0, 0.15])
def test_where_the_field_alone_tells_of_a_hit_there_is_one(
    clutter: Environment, fixed: float | None, min_clearance: float
) -> None:
    # The middle of this footprint is far from the body's origin.
    footprint = Footprint(np.array([[0.1, -0.2], [0.9, -0.2], [0.9, 0.2], [0.1, 0.2]]), 0.05)
    world = CollisionWorld.build(clutter, footprint, min_clearance, fixed)
    poses = np.random.default_rng(3).uniform([-3, -2, -3], [3, 2, 3], (4000, 3))
    told = np.array([surely_hits(world.kernel, *pose) for pose in poses.tolist()])
    free = np.array([world.is_free(Pose(*pose)) for pose in poses.tolist()])
    assert not (told & free).any()
    assert told.sum() > 0.3 * (~free).sum()


@pytest.mark.parametrize("effort", ["first", "good"])
@pytest.mark.parametrize("reverse", [True, False])
def test_no_curve_takes_less_than_its_bound(
    robot: Callable[..., Robot], clutter: Environment, effort: str, reverse: bool
) -> None:
    given = robot("ackermann")
    world = CollisionWorld.build(clutter, given.footprint)
    law = connector(given, world, Options(effort=effort, reverse=reverse)).law  # type: ignore[arg-type]
    times, steps = np.empty(4), np.empty((4, 5, 3))
    for a, b in np.random.default_rng(4).uniform(-3, 3, (300, 2, 3)):
        ways_between(law, a, b, times, steps)
        assert 0.0 < bound(law, a, b) <= times[0] + 1e-12
    straight = np.array([2.0, 0.0, 0.0])
    ways_between(law, np.zeros(3), straight, times, steps)
    assert bound(law, np.zeros(3), straight) == pytest.approx(times[0])
