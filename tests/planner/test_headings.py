"""The headings in which a footprint is free are known as intervals, and some of each are tried."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from drives.se2 import Pose
from planner.environment import CollisionWorld
from planner.headings import free_headings, goal_headings
from planner.problem import Bounds, Circle, Environment, Footprint, Polygon, Robot

LONG = Footprint(np.array([[-0.2, -0.1], [1.0, -0.1], [1.0, 0.1], [-0.2, 0.1]]))
AROUND = Bounds(-5.0, -5.0, 5.0, 5.0)


@pytest.mark.parametrize("seed", range(20))
def test_intervals_are_the_headings_that_are_free(seed: int) -> None:
    random = np.random.default_rng(seed)
    posts = tuple(Circle(*random.uniform(-1.3, 1.3, 2), 0.1) for _ in range(6))
    world = CollisionWorld.build(Environment(AROUND, posts), LONG)
    intervals = free_headings(world, 0.0, 0.0)
    assert (intervals[:, 0] < intervals[:, 1]).all()
    for heading in np.linspace(0.0, math.tau, 1000, endpoint=False):
        inside = any(low <= heading + turn <= high for low, high in intervals for turn in (0.0, math.tau))
        near = any(abs(math.remainder(heading - end, math.tau)) < 1e-3 for end in intervals.ravel())
        assert near or inside == world.is_free(Pose(0.0, 0.0, heading))


def test_all_headings_of_an_empty_floor_are_one_interval() -> None:
    intervals = free_headings(CollisionWorld.build(Environment(AROUND), LONG), 0.0, 0.0)
    assert intervals.shape == (1, 2)
    assert intervals[0, 1] - intervals[0, 0] == pytest.approx(math.tau)


def test_a_slot_is_headed_for_although_it_is_a_degree_wide(robot: Callable[..., Robot]) -> None:
    slot = tuple(
        Polygon(np.array([[0.3, y], [1.1, y], [1.1, y + side], [0.3, y + side]]))
        for y, side in ((0.105, 0.5), (-0.105, -0.5))
    )
    world = CollisionWorld.build(Environment(AROUND, slot), LONG)
    tried = goal_headings(world, Pose(-3.0, 0.4, 0.0), 0.0, 0.0)
    inside = [heading for heading in tried if abs(math.remainder(heading, math.tau)) < 0.05]
    assert any(world.is_free(Pose(0.0, 0.0, heading)) for heading in inside)
