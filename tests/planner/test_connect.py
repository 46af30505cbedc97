"""Motions between poses: what is asked of some of them is what is true of all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from drives.se2 import Pose
from planner.connect import connector
from planner.curves import SEGMENTS
from planner.edges import joined
from planner.environment import CollisionWorld
from planner.path import LinePiece, Path, TwistPiece
from planner.problem import Bounds, Environment, Options, Robot
from tests.planner.worlds import is_path_free


@pytest.mark.parametrize("reverse", [True, False])
@pytest.mark.parametrize("effort", ["first", "good"])
@pytest.mark.parametrize("kind", ["mecanum", "differential", "ackermann"])
def test_ways_are_as_free_one_by_one_as_together_and_as_their_paths(
    robot: Callable[..., Robot], clutter: Environment, kind: str, effort: str, reverse: bool
) -> None:
    given = robot(kind)
    world = CollisionWorld.build(clutter, given.footprint)
    local = connector(given, world, Options(effort=effort, reverse=reverse))  # type: ignore[arg-type]
    random = np.random.default_rng(5)
    poses = random.uniform([-4, -4, -3], [4, 4, 3], (400, 3))
    a, b = np.array([p for p in poses if world.is_free(Pose(*p))])[:60].reshape(2, 30, 3)
    verdicts = []
    for motions in local.direct(a.copy(), b.copy()):
        free = motions.free()
        assert free.shape == motions.times.shape
        for pair, way in np.argwhere(motions.times < np.inf).tolist():
            alone = motions.free(slice(pair, pair + 1), slice(way, way + 1))
            assert alone.shape == (1, 1)
            assert alone[0, 0] == free[pair, way] == is_path_free(world, motions.path(pair, way))
            verdicts.append(bool(alone[0, 0]))
    assert {True, False} == set(verdicts)


@pytest.mark.parametrize("reverse", [True, False])
@pytest.mark.parametrize("kind", ["mecanum", "differential", "ackermann"])
def test_an_edge_is_free_where_one_of_the_shortest_motions_is(
    robot: Callable[..., Robot], clutter: Environment, kind: str, reverse: bool
) -> None:
    given = robot(kind)
    world = CollisionWorld.build(clutter, given.footprint)
    local = connector(given, world, Options(effort="first", reverse=reverse))
    poses = np.random.default_rng(8).uniform([-3, -2, -3], [3, 2, 3], (900, 3))
    a, b = np.array([p for p in poses if world.is_free(Pose(*p))])[:200].reshape(2, 100, 3)
    law, steps = local.law, np.empty((SEGMENTS, 3))
    motion = world.kernel, law.kind, law.radius, law.reverse
    free = np.array([joined(*motion, *p, *q, steps) for p, q in zip(a, b, strict=True)])
    assert {True, False} == set(free.tolist())
    motions = local.motions(a, b)
    some = (motions.free() & (motions.times < np.inf)).any(1)
    assert not (free & ~some).any()
    if kind != "ackermann":  # of curves only the shortest is looked at
        assert (free == some).all()


@pytest.mark.parametrize("reverse", [True, False])
def test_wider_curves_are_those_of_a_connector_of_that_radius(
    robot: Callable[..., Robot], clutter: Environment, reverse: bool
) -> None:
    given = robot("ackermann")
    world = CollisionWorld.build(clutter, given.footprint)
    local = connector(given, world, Options(reverse=reverse))
    a, b = np.random.default_rng(6).uniform(-3, 3, (2, 20, 3))
    *curves, _ = local.direct(a, b)  # the last are ways whose radii fit
    for motions, scale in zip(curves, (1.0, 1.5, 2.5, 4.0), strict=True):
        radius = scale * local.turning_radius
        wider = connector(given, world, Options(reverse=reverse, turning_radius=radius)).motions(a, b)
        np.testing.assert_allclose(motions.times, wider.times, rtol=1e-12)


def test_a_swerve_that_steers_slowly_holds_a_twist_all_the_way(robot: Callable[..., Robot]) -> None:
    given = robot("swerve")
    world = CollisionWorld.build(Environment(Bounds(-9.0, -9.0, 9.0, 9.0)), given.footprint)
    a, b = np.array([[0.0, 0.0, 0.2]]), np.array([[2.0, 1.0, 1.4]])

    def quickest(rate: float) -> Path:
        limits = replace(given.limits, steering_rate=rate)
        tried = connector(replace(given, limits=limits), world, Options(effort="first")).direct(a, b)
        motions = min(tried, key=lambda motions: float(motions.times.min(initial=np.inf)))
        return motions.path(0, int(np.argmin(motions.times[0])))

    (piece,) = quickest(0.1)
    assert isinstance(piece, TwistPiece)
    np.testing.assert_allclose(piece.end, b[0], atol=1e-12)
    (piece,) = quickest(100.0)
    assert isinstance(piece, LinePiece)
