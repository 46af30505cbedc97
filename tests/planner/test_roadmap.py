"""The quickest free path through poses in a row is the best of all there are."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from drives.se2 import Array, Pose
from planner.connect import Connector, connector
from planner.environment import CollisionWorld
from planner.path import TwistPiece, as_path, as_steps
from planner.problem import Bounds, Environment, Options, Polygon, Robot
from planner.roadmap import merged, quickest_path, quickest_steps
from tests.planner.worlds import is_path_free

KINDS = ["mecanum", "differential", "ackermann"]


def local(robot: Robot, environment: Environment, effort: str = "first") -> Connector:
    world = CollisionWorld.build(environment, robot.footprint)
    return connector(robot, world, Options(effort=effort))  # type: ignore[arg-type]


def free_poses(asked: Connector, count: int, seed: int) -> Array:
    random = np.random.default_rng(seed)
    poses = random.uniform([-2.6, -1.6, -3.0], [2.6, 1.6, 3.0], (400, 3))
    return np.array([pose for pose in poses if asked.world.is_free(Pose(*pose))])[:count]


def least(asked: Connector, poses: Array, reach: int) -> float:
    """Time of the quickest way by any of the poses, all tried; reversals are not counted."""
    times = {}
    for i, j in itertools.combinations(range(len(poses)), 2):
        motions = asked.motions(poses[i : i + 1], poses[j : j + 1])
        times[i, j] = float(np.where(motions.free(), motions.times, math.inf).min())
    last = len(poses) - 1
    return min(
        sum(times[leg] for leg in itertools.pairwise((0, *inner, last)))
        for k in range(last)
        for inner in itertools.combinations(range(1, last), k)
        if max(j - i for i, j in itertools.pairwise((0, *inner, last))) <= reach
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("reach", [2, 7])
@pytest.mark.parametrize("seed", range(4))
def test_no_choice_of_poses_is_quicker(
    robot: Callable[..., Robot], clutter: Environment, kind: str, reach: int, seed: int
) -> None:
    # Cars steer between motions, too, which no single one knows of: at once here.
    asked = local(robot(kind, **({"steering_rate": 1e9} if kind == "ackermann" else {})), clutter)
    poses = free_poses(asked, 8, seed)
    best = least(asked, poses, reach)
    path = quickest_path(poses, reach, asked, 16)
    if path is None:
        assert best == math.inf
        return
    assert is_path_free(asked.world, path)
    assert path[0].start == pytest.approx(tuple(poses[0]))
    assert path[-1].end[:2] == pytest.approx(tuple(poses[-1, :2]))
    # Less where one motion goes on where another ended.
    assert asked.duration(path) <= best + 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_there_is_none_through_a_wall(robot: Callable[..., Robot], kind: str) -> None:
    wall = Polygon(np.array([[-0.1, -3.0], [0.1, -3.0], [0.1, 3.0], [-0.1, 3.0]]))
    asked = local(robot(kind), Environment(Bounds(-3.0, -2.0, 3.0, 2.0), (wall,)))
    poses = np.array([[x, 0.0, 0.0] for x in (-2.0, -1.0, 1.0, 2.0)])
    assert quickest_path(poses, 4, asked, 4) is None
    assert quickest_path(poses[:2], 4, asked, 4) is not None


def test_what_is_known_to_be_free_is_taken_where_no_motion_is(robot: Callable[..., Robot]) -> None:
    # All but a turn: the connector would turn the shorter way, and so does nothing that ends where this does.
    poses = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 3.0]])
    known = poses[:1], np.array([[0.0, 0.0, 3.0 - math.tau]]), np.array([0, 1])

    def turned(half: float) -> float:
        asked = local(robot("differential"), Environment(Bounds(-half, -half, half, half)))
        steps, found = quickest_steps(asked.world.kernel, asked.law, poses, np.arange(2), 2, 2, *known, False)
        assert found
        return float(steps[:, 2].sum())

    assert turned(0.9) == pytest.approx(3.0)  # the quicker of the two
    assert turned(0.2) == pytest.approx(3.0 - math.tau)  # nothing is free


def test_changes_of_direction_cost_their_time(robot: Callable[..., Robot], floor: Environment) -> None:
    asked = local(robot("differential"), floor, "good")
    assert asked.reversal > 0.1
    # Forwards twice is longer than backwards and forwards, but does without the reversal.
    poses = np.array([[0.0, 0.0, 0.0], [-0.02, 0.0, 0.0], [1.0, 0.0, 0.0]])
    path = quickest_path(poses, 2, asked, 2)
    assert path is not None
    assert all(isinstance(piece, TwistPiece) and piece.twist.vx >= 0 for piece in path)


def test_of_poses_at_one_station_the_best_is_passed(robot: Callable[..., Robot], floor: Environment) -> None:
    asked = local(robot("differential"), floor)
    on_the_way = [0.8, 0.0, 0.0]
    poses = np.array([[0.0, 0.0, 0.0], [0.8, 0.5, 2.0], on_the_way, [0.8, -0.5, -2.0], [1.6, 0.0, 0.0]])
    station = np.array([0, 1, 1, 1, 2])
    none = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64)
    steps, found = quickest_steps(asked.world.kernel, asked.law, poses, station, 1, 2, *none, False)
    assert found
    np.testing.assert_allclose(steps, [[1.6, 0.0, 0.0]], atol=1e-9)


@pytest.mark.parametrize("straight", [True, False])
def test_steps_are_merged_as_pieces_are(straight: bool) -> None:
    steps = np.array([
        [1.0, 0.0, 0.5], [2.0, 0.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -2.5], [0.5, 0.0, 0.0],
        [1.5, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, -2.0],
    ])  # fmt: skip
    pieces = as_steps(as_path(np.zeros(3), steps, straight))[1]
    np.testing.assert_allclose(merged(steps, straight), pieces, atol=1e-12)
    assert len(pieces) < len(steps)
