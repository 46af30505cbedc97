"""Proofs that there is no path, with the connectivity of shapely's free space for an oracle."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from drives.se2 import Pose
from planner.environment import CollisionWorld
from planner.problem import Circle, Environment, Footprint, Goal, MapLayer, Polygon
from tests.planner.worlds import ROOM, box, rectangle, star

START, GOAL = Pose(-3.0, 0.0, 0.0), Goal(3.0, 0.0, 0.0)


def gapped(width: float) -> Environment:
    return Environment(ROOM, (box(-0.2, -4, 0.2, 1 - width / 2), box(-0.2, 1 + width / 2, 0.2, 4)))


def test_a_wall_from_side_to_side_is_a_proof() -> None:
    proof = CollisionWorld.build(Environment(ROOM, (box(-0.2, -4, 0.2, 4),)), rectangle(1, 0.6)).separation(
        START, GOAL
    )
    assert proof is not None
    assert proof.width == 0
    assert proof.width_needed == pytest.approx(0.6)


@pytest.mark.parametrize("fixed", [None, 0.5])
def test_the_widest_gap_is_named_when_it_is_a_hair_too_narrow(fixed: float | None) -> None:
    footprint = rectangle(1.2, 0.6, offset=0.4)
    world = CollisionWorld.build(gapped(0.8 - 1e-4), footprint, 0.1, fixed)
    proof = world.separation(START, GOAL)
    assert proof is not None
    assert proof.width == pytest.approx(0.8 - 1e-4)
    assert proof.width_needed == pytest.approx(0.8)
    assert abs(proof.x) <= 0.2 + 1e-9
    assert proof.y == pytest.approx(1.0)
    assert CollisionWorld.build(gapped(0.8), footprint, 0.1, fixed).separation(START, GOAL) is None


def test_any_goal_heading_is_proven_with_the_disc_about_the_origin() -> None:
    anyhow = Goal(3.0, 0.0, None)
    ahead = rectangle(1.0, 0.6, offset=0.4)  # 0.1 m behind the origin, 0.3 m to its sides
    assert CollisionWorld.build(gapped(0.19), ahead).separation(START, anyhow) is not None
    assert CollisionWorld.build(gapped(0.4), ahead).separation(START, anyhow) is None
    away = rectangle(1.0, 0.6, offset=1.0)
    assert CollisionWorld.build(gapped(0.1), away).separation(START, anyhow) is None


def test_a_goal_in_which_the_disc_does_not_fit_is_a_proof() -> None:
    world = CollisionWorld.build(Environment(ROOM, (Circle(3.0, 0.5, 0.4),)), rectangle(1, 0.6))
    proof = world.separation(START, GOAL)
    assert proof is not None
    assert (proof.x, proof.y) == pytest.approx((3, 0))
    assert proof.width == pytest.approx(0.2)


def test_a_turned_map_is_separated_by_its_own_walls(tmp_path: Path) -> None:
    cells = np.zeros((60, 100))
    cells[:, 50] = 1
    cells[20:25, 50] = 0  # 0.5 m
    np.save(tmp_path / "cells.npy", cells.astype(np.int8))
    layer = MapLayer("passage", tmp_path, 0.1, Pose(2.0, 1.0, 0.5))
    c, s = math.cos(0.5), math.sin(0.5)
    start, goal = Pose(2 + 2 * c - 3 * s, 1 + 2 * s + 3 * c, 0.5), (2 + 8 * c - 3 * s, 1 + 8 * s + 3 * c)
    proof = CollisionWorld.build(Environment(map=layer), rectangle(0.8, 0.52)).separation(
        start, Goal(*goal, 0.5)
    )
    assert proof is not None
    assert proof.width == pytest.approx(0.5)
    fits = CollisionWorld.build(Environment(map=layer), rectangle(0.8, 0.48))
    assert fits.separation(start, Goal(*goal, 0.5)) is None


def joined(environment: Environment, radius: float, a: tuple[float, float], b: tuple[float, float]) -> bool:
    room = shapely.box(ROOM.x_min, ROOM.y_min, ROOM.x_max, ROOM.y_max).buffer(-radius)
    for o in environment.obstacles:
        shape = (
            shapely.Point(o.x, o.y).buffer(o.radius, 128)
            if isinstance(o, Circle)
            else shapely.Polygon(o.vertices)
        )
        room = room - shape.buffer(radius, 128)
    parts = shapely.get_parts(room)
    return any(p.intersects(shapely.Point(a)) and p.intersects(shapely.Point(b)) for p in parts)


def test_separation_is_the_connectivity_of_free_space_and_its_width_the_bottleneck() -> None:
    rng = np.random.default_rng(3)
    proofs = 0
    for _ in range(60):
        environment = Environment(
            ROOM,
            tuple(
                Polygon(star(rng, rng.uniform(0.3, 2), rng.uniform(-1.5, 1.5), rng.uniform(-4, 4)))
                if rng.random() < 0.5
                else Circle(rng.uniform(-1.5, 1.5), rng.uniform(-4, 4), rng.uniform(0.1, 1))
                for _ in range(14)
            ),
        )
        radius = rng.uniform(0.1, 0.5)
        a, b = (-4.2, rng.uniform(-3, 3)), (4.2, rng.uniform(-3, 3))
        world = CollisionWorld.build(environment, Footprint(np.zeros((1, 2)), radius))
        proof = world.separation(Pose(*a, 0.0), Goal(*b, None))
        assert (proof is None) == joined(environment, radius, a, b)
        if proof is not None:
            proofs += 1
            assert not joined(environment, proof.width / 2 + 0.001, a, b)
            if proof.width > 0.004:
                assert joined(environment, proof.width / 2 - 0.002, a, b)
    assert 10 < proofs < 50


@pytest.mark.parametrize("door", [0, 4, 6])
@pytest.mark.parametrize("out", [True, False])
def test_in_a_large_cluttered_map_the_ring_about_a_small_room_is_the_proof(
    tmp_path: Path, door: int, out: bool
) -> None:
    cells = (np.random.default_rng(1).random((800, 800)) < 0.02).astype(np.int8)  # 1 in 50: 12,000 of them
    cells[300:360, 300:360] = 0
    cells[310:350, 310:350] = 1
    cells[311:349, 311:349] = 0
    cells[310, 330 : 330 + door] = 0
    np.save(tmp_path / "cells.npy", cells)
    environment = Environment(map=MapLayer("clutter", tmp_path, 0.1, Pose(0.0, 0.0, 0.0)))
    world = CollisionWorld.build(environment, Footprint(np.zeros((1, 2)), 0.25))
    inside, outside = Pose(33.0, 33.0, 0.0), Pose(30.5, 30.5, 0.0)
    start, goal = (inside, outside) if out else (outside, inside)
    proof = world.separation(start, Goal(*goal))
    if door * 0.1 > 0.5:
        assert proof is None
    else:
        assert proof is not None
        assert proof.width == pytest.approx(door * 0.1)
