"""A shortened path is free, joins the same poses, and makes no detours."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from drives.se2 import wrap
from planner.connect import Connector, connector
from planner.environment import CollisionWorld
from planner.path import Path
from planner.problem import Bounds, Environment, Options, Polygon, Robot
from planner.roadmap import quickest_path
from planner.shorten import shorten
from tests.planner.worlds import is_path_free

KINDS = ["mecanum", "swerve", "differential", "ackermann", "powered_caster"]
EFFORTS = ["first", "good"]


def local(robot: Robot, environment: Environment, effort: str) -> Connector:
    world = CollisionWorld.build(environment, robot.footprint)
    return connector(robot, world, Options(effort=effort))  # type: ignore[arg-type]


def by_way_of(asked: Connector, *poses: tuple[float, float, float]) -> Path:
    """The connector's own motions from pose to pose, headings continuous."""
    path = quickest_path(np.array(poses), 1, asked, 16)
    assert path is not None
    return path


def length(path: Path) -> float:
    return sum(piece.length for piece in path)


def wandering(n: int, seed: int) -> list[tuple[float, float, float]]:
    """Poses up and down a floor of 40 m by 10 m."""
    random = np.random.default_rng(seed)
    rows = np.column_stack([np.linspace(2, 38, n), random.uniform(2, 8, n), random.uniform(-3, 3, n)])
    return [tuple(row) for row in rows.tolist()]


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [3, 12, 60])
def test_on_an_open_floor_nothing_is_left_of_a_detour(
    robot: Callable[..., Robot], kind: str, effort: str, n: int
) -> None:
    asked = local(robot(kind), Environment(Bounds(0.0, 0.0, 40.0, 10.0)), effort)
    poses = wandering(n, n)
    path = by_way_of(asked, *poses)
    straight = by_way_of(asked, poses[0], poses[-1])
    shorter = shorten(path, asked, rough=effort == "good")
    assert asked.duration(shorter) <= asked.duration(straight) + 1e-6


def walled() -> Environment:
    """A floor of 40 m by 10 m and a wall 6 m high in its middle."""
    wall = Polygon(np.array([[19.0, 0.0], [21.0, 0.0], [21.0, 6.0], [19.0, 6.0]]))
    return Environment(Bounds(0.0, 0.0, 40.0, 10.0), (wall,))


START, GOAL = (4.0, 2.0, 0.0), (36.0, 2.0, 0.0)
OVER = ((8.0, 8.5, 1.0), (20.0, 9.0, 0.0), (30.0, 8.5, -0.5))


@pytest.mark.parametrize("rough", [True, False])
@pytest.mark.parametrize("kind", KINDS[1:])  # mecanum bases are slow across, and go round for it
def test_round_a_wall_the_way_is_hardly_longer_than_a_taut_rope(
    robot: Callable[..., Robot], kind: str, rough: bool
) -> None:
    asked = local(robot(kind), walled(), "first")
    path = by_way_of(asked, START, *OVER, GOAL)
    rope = 2 * math.dist(START[:2], (19.0, 6.0)) + 2.0
    shorter = shorten(path, asked, rough)
    assert length(path) > 1.1 * rope
    assert rope <= length(shorter) < 1.05 * rope


@pytest.mark.parametrize("rough", [True, False])
@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize("kind", KINDS)
def test_it_is_free_no_slower_and_joins_the_same_poses(
    robot: Callable[..., Robot], kind: str, effort: str, rough: bool
) -> None:
    asked = local(robot(kind), walled(), effort)
    path = by_way_of(asked, START, *OVER, GOAL)
    shorter = shorten(path, asked, rough)
    assert is_path_free(asked.world, shorter)
    assert asked.duration(shorter) <= asked.duration(path) + 1e-9
    assert shorter[0].start == pytest.approx(path[0].start)
    assert shorter[-1].end[:2] == pytest.approx(path[-1].end[:2], abs=1e-6)
    assert wrap(shorter[-1].end.theta - path[-1].end.theta) == pytest.approx(0.0, abs=1e-6)
    for piece, after in itertools.pairwise(shorter):
        assert after.start == pytest.approx(piece.end, abs=1e-6)
    assert shorten(path, asked, rough) == shorter
