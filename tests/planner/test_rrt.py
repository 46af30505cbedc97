"""Trees that meet have found a free way; how they grow depends on nothing but the seed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from drives.se2 import Pose, wrap
from planner.connect import Connector, connector
from planner.edges import LINE
from planner.environment import CollisionWorld
from planner.path import TwistPiece, as_path
from planner.problem import Bounds, Environment, Options, Polygon, Robot
from planner.rrt import CHECKED, Space, Trees, driven, grow, roomier, rooted

KINDS = ["mecanum", "differential", "ackermann"]
START, GOAL = Pose(-2.4, 0.0, 0.3), Pose(2.2, -0.9, -0.5)
NO_ROUTE = np.zeros((0, 5)), np.zeros(9)


def local(robot: Robot, environment: Environment, reverse: bool = True) -> Connector:
    world = CollisionWorld.build(environment, robot.footprint)
    return connector(robot, world, Options(effort="first", reverse=reverse))


def roots(asked: Connector, half: float, stride: float = 2.0) -> tuple[Space, Trees]:
    """Trees in a square about the origin."""
    law, high = asked.law, np.array([half, half, math.pi])
    space = Space(*NO_ROUTE, -high, high, 1.0, stride, law.kind, law.radius, law.reverse)
    return space, rooted(np.array(START * 2), np.array([GOAL * 2]), 20_000)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("reverse", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_trees_that_meet_have_found_a_free_way(
    robot: Callable[..., Robot], clutter: Environment, kind: str, reverse: bool, seed: int
) -> None:
    asked = local(robot(kind), clutter, reverse)
    space, trees = roots(asked, 4.0)
    assert grow(asked.world.kernel, space, trees, np.random.default_rng(seed), 10_000)
    path = as_path(np.array(START), driven(asked.world.kernel, space, trees), asked.law.kind == LINE)
    assert path[0].start == pytest.approx(START)
    assert path[-1].end[:2] == pytest.approx(GOAL[:2])
    assert wrap(path[-1].end.theta - GOAL.theta) == pytest.approx(0.0, abs=1e-9)
    poses = np.concatenate([piece.poses(np.linspace(0.0, 1.0, 200)) for piece in path])
    assert asked.world.clearance(poses).min() > 0.0
    if not reverse:
        assert all(piece.twist.vx >= 0.0 for piece in path if isinstance(piece, TwistPiece))


@pytest.mark.parametrize("kind", KINDS)
def test_they_grow_the_same_at_once_and_bit_by_bit(
    robot: Callable[..., Robot], clutter: Environment, kind: str
) -> None:
    asked = local(robot(kind), clutter)
    space, whole = roots(asked, 4.0)
    _, bits = roots(asked, 4.0)
    world, random = asked.world.kernel, np.random.default_rng(5)
    met = grow(world, space, whole, np.random.default_rng(5), 10_000)
    assert met
    while not grow(world, space, bits, random, 20):
        bits = roomier(bits, 40_000)
    np.testing.assert_array_equal(bits.counts, whole.counts)
    np.testing.assert_array_equal(driven(world, space, bits), driven(world, space, whole))


@pytest.mark.parametrize("kind", KINDS)
def test_they_stop_after_so_much_work(robot: Callable[..., Robot], kind: str) -> None:
    wall = Polygon(np.array([[-0.1, -4.0], [0.1, -4.0], [0.1, 4.0], [-0.1, 4.0]]))
    asked = local(robot(kind), Environment(Bounds(-4.0, -4.0, 4.0, 4.0), (wall,)))
    space, trees = roots(asked, 4.0)
    assert not grow(asked.world.kernel, space, trees, np.random.default_rng(1), 300)
    assert 300 <= trees.counts[CHECKED] < 330


def test_they_stop_where_nothing_that_is_drawn_is_free(robot: Callable[..., Robot]) -> None:
    asked = local(robot("mecanum"), Environment(Bounds(-4.0, -4.0, 4.0, 4.0)))
    space, trees = roots(asked, 4.0)
    outside = space._replace(low=np.array([5.0, 5.0, 0.0]), high=np.array([6.0, 6.0, 1.0]))
    assert not grow(asked.world.kernel, outside, trees, np.random.default_rng(1), 300)
    assert trees.counts[CHECKED] == 0


@pytest.mark.parametrize("kind", KINDS[:2])
def test_no_motion_is_longer_than_the_stride(
    robot: Callable[..., Robot], clutter: Environment, kind: str
) -> None:
    asked = local(robot(kind), clutter)
    space, trees = roots(asked, 4.0, 0.5)
    grow(asked.world.kernel, space, trees, np.random.default_rng(2), 400)
    for tree in range(2):
        nodes = trees.nodes[tree, 1 : trees.counts[tree]]
        before = trees.nodes[tree, trees.parents[tree, 1 : trees.counts[tree]]]
        assert len(nodes) > 20
        assert np.hypot(*(nodes - before)[:, :2].T).max() <= 0.5 + 1e-9
