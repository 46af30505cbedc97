"""A route is a short way of the disc inside the footprint, and coordinates for poses beside it."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drives.se2 import Pose
from planner.environment import CollisionWorld
from planner.guide import Guide
from planner.problem import Bounds, Environment, Footprint, Polygon, Problem
from planner.route import Route

Ask = Callable[..., Problem]

DISC = Footprint(np.zeros((1, 2)), 0.3)
AHEAD = Footprint(np.array([[-0.2, -0.25], [0.9, -0.25], [0.9, 0.25], [-0.2, 0.25]]))
START, GOAL = Pose(-2.0, 0.0, 0.4), Pose(2.0, 0.0, -2.0)


def wall(x: float, low: float, high: float) -> Polygon:
    return Polygon(np.array([[x - 0.1, low], [x + 0.1, low], [x + 0.1, high], [x - 0.1, high]]))


def guide(*walls: Polygon, footprint: Footprint = DISC, fixed: float | None = None) -> Guide:
    world = CollisionWorld.build(Environment(Bounds(-3.0, -3.0, 3.0, 3.0), walls), footprint, 0.0, fixed)
    return Guide(world.kernel, START, GOAL)


def length(way: np.ndarray) -> float:
    return float(np.hypot(*np.diff(way, axis=0).T).sum())


def test_a_route_on_an_open_floor_is_straight() -> None:
    route = guide().route(along=True)
    assert route is not None
    assert route.length == pytest.approx(4.0, rel=0.02)


def test_a_route_goes_round_a_wall_at_a_distance() -> None:
    route = guide(wall(0.0, -1.0, 3.0)).route(along=True)
    assert route is not None
    end = np.array([0.0, -1.0])
    assert np.hypot(*(route.way - end).T).min() > 0.3
    assert route.length < 1.2 * 2 * math.hypot(2.0, 1.3)


def test_a_second_route_takes_the_other_gap() -> None:
    both = guide(wall(0.0, -1.5, 1.6))
    first, second = both.route(along=True), both.route(along=True)
    assert first is not None
    assert second is not None
    middle = [np.interp(0.0, *route.way.T) for route in (first, second)]
    assert middle[0] < -1.5
    assert middle[1] > 1.6


def test_no_route_through_a_gap_clearly_narrower_than_the_disc() -> None:
    assert guide(wall(0.0, -3.0, -0.27), wall(0.0, 0.27, 3.0)).route(along=True) is None


@pytest.mark.parametrize("middle", [-0.13, -0.05, 0.0, 0.04, 0.1, 0.17])
def test_a_gap_narrower_than_the_disc_is_no_short_cut(middle: float) -> None:
    walls = wall(0.0, -3.0, middle - 0.2), wall(0.0, middle + 0.2, 1.8)
    route = guide(*walls).route(along=True)
    assert route is not None
    assert np.interp(0.0, *route.way.T) > 1.8


@pytest.mark.parametrize("middle", [-0.13, 0.0, 0.1, 0.17])
def test_a_route_keeps_to_the_middle_of_a_gap_hardly_wider_than_the_disc(middle: float) -> None:
    route = guide(wall(0.0, -3.0, middle - 0.31), wall(0.0, middle + 0.31, 3.0)).route(along=True)
    assert route is not None
    assert np.interp(0.0, *route.way.T) == pytest.approx(middle, abs=0.03)


@pytest.mark.parametrize("along", [True, False])
@pytest.mark.parametrize("fixed", [None, 0.7])
def test_the_ends_have_the_coordinates_of_start_and_goal(along: bool, fixed: float | None) -> None:
    route = guide(wall(0.0, -1.0, 3.0), footprint=AHEAD, fixed=fixed).route(along)
    assert route is not None
    for pose, s in ((START, 0.0), (GOAL, route.length)):
        back = route.pose(*route.coordinates(pose, s))
        assert back[:2] == pytest.approx(pose[:2], abs=1e-9)
        assert math.remainder(back.theta - pose.theta, math.tau) == pytest.approx(0.0, abs=1e-9)


@given(st.floats(-1.0, 6.0), st.floats(-1.0, 1.0), st.floats(-3.1, 3.1), st.booleans())
def test_the_point_of_the_footprint_lies_beside_the_way(
    s: float, left: float, angle: float, along: bool
) -> None:
    way = np.array([[0.0, 0.0], [5.0, 0.0]])
    route = Route(way, (0.35, 0.1), 1.0, None, START, along, True)
    x, y, theta = route.pose(s, left, angle)
    c, d = math.cos(theta), math.sin(theta)
    off = y + d * 0.35 + c * 0.1
    assert x + c * 0.35 - d * 0.1 == pytest.approx(s, abs=1e-12)
    assert abs(off) <= abs(left) + 1e-12
    assert off * left >= -1e-12


@given(st.floats(-math.pi, math.pi), st.booleans(), st.booleans())
def test_a_heading_has_a_coordinate(theta: float, tight: bool, backwards: bool) -> None:
    way = np.array([[0.0, 0.0], [3.0, 4.0]])
    route = Route(way, (0.0, 0.0), 1.0, None, START, True, tight, backwards)
    back = route.pose(*route.coordinates(Pose(0.0, 0.0, theta), 0.0)).theta
    assert math.remainder(back - theta, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_many_draws_lie_on_the_route_and_head_along_it_or_against_it() -> None:
    route = Route(np.array([[0.0, 0.0], [5.0, 0.0]]), (0.0, 0.0), 1.0, None, START, True, True)
    angles = np.linspace(-math.pi, math.pi, 2001)
    headings = np.array([route.pose(1.0, 0.0, float(angle)).theta for angle in angles])
    assert (np.diff(headings) >= 0).all()
    assert headings[[0, -1]] == pytest.approx([-math.pi, math.pi])
    assert 0.2 < np.mean(np.sin(headings) ** 2 < 1e-20) < 0.4
    assert np.mean(np.abs(np.sin(headings)) > 0.5) > 0.2
    offs = np.array([route.pose(1.0, float(left), 0.0).y for left in np.linspace(-2.0, 2.0, 2001)])
    assert (np.diff(offs) >= 0).all()
    assert offs[[0, -1]] == pytest.approx([-2.0, 2.0])
    assert 0.2 < np.mean(offs == 0.0) < 0.4
