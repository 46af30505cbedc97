"""A way over the lattice is there where the disc has one, and says what was seen where it is not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drives.se2 import Array
from planner.collision import World
from planner.environment import CollisionWorld
from planner.lattice import rooms, shortest
from planner.problem import Bounds, Environment, Footprint, Polygon

RADIUS, SPACING = 0.3, 0.15


def world(*walls: tuple[float, float, float, float]) -> World:
    solids = tuple(
        Polygon(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=np.float64))
        for x0, y0, x1, y1 in walls
    )
    disc = Footprint(np.zeros((1, 2)), RADIUS)
    return CollisionWorld.build(Environment(Bounds(0.0, 0.0, 12.0, 8.0), solids), disc).kernel


def search(
    around: World, haste: float = 1.0, used: Array | None = None, work: int = 100_000, most: float = RADIUS
) -> tuple[Array, bool, tuple[float, float, float, float]]:
    passed = np.empty((0, 2)) if used is None else used
    found: tuple[Array, bool, tuple[float, float, float, float]] = shortest(
        around, (1.0, 4.0), (11.0, 4.0), RADIUS, most, SPACING, False, passed, haste, work
    )
    return found


@pytest.mark.parametrize("haste", [1.0, 2.0, 10.0])
def test_a_way_leads_from_the_start_to_the_goal_and_keeps_the_disc_free(haste: float) -> None:
    around = world((4.0, 2.0, 5.0, 8.0), (7.0, 0.0, 8.0, 6.0))
    way, _, _ = search(around, haste)
    assert tuple(way[0]) == (1.0, 4.0)
    assert tuple(way[-1]) == (11.0, 4.0)
    assert np.hypot(*np.diff(way, axis=0).T).max() < 1.5 * SPACING
    assert rooms(around, way, 1.0).min() >= RADIUS


def test_without_haste_no_way_over_the_lattice_is_shorter() -> None:
    way, _, _ = search(world((5.0, 2.0, 6.0, 8.0)))
    length = np.hypot(*np.diff(way, axis=0).T).sum()
    around = math.hypot(4.0, 2.0 + RADIUS) + 1.0 + math.hypot(5.0, 2.0 + RADIUS)
    octile = 1 / math.cos(math.pi / 8)  # the most that eight directions add
    assert around * 0.98 < length < around * octile * 1.02


def test_a_used_way_is_avoided_where_another_is_not_much_longer() -> None:
    around = world((5.0, 3.0, 6.0, 5.2))
    first, _, _ = search(around)
    second, _, _ = search(around, used=first)
    middle = [np.interp(5.5, *way.T) for way in (first, second)]
    assert middle[0] < 3.0
    assert middle[1] > 5.2


def test_more_room_is_worth_a_detour() -> None:
    around = world((5.0, 0.0, 6.0, 3.5), (5.0, 4.3, 6.0, 5.2))
    near, _, _ = search(around)
    roomy, _, _ = search(around, most=1.2)
    assert np.interp(5.5, *near.T) < 4.3
    assert np.interp(5.5, *roomy.T) > 5.2


def test_where_there_is_no_way_all_within_reach_was_looked_at() -> None:
    way, whole, (x_min, y_min, x_max, y_max) = search(world((5.0, 0.0, 6.0, 8.0)))
    assert len(way) == 0
    assert whole
    assert (x_min, y_min, x_max, y_max) == pytest.approx((0.3, 0.3, 4.7, 7.7), abs=SPACING)


def test_work_ends_a_search_that_has_not_seen_all() -> None:
    way, whole, _ = search(world((5.0, 0.0, 6.0, 8.0)), work=50)
    assert len(way) == 0
    assert not whole
