"""Whole edges against the world: what is valid is valid everywhere, and what fits gets through."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from drives.se2 import Array, Pose, Twist, compose, exp
from planner.collision import COLUMNS, END, FIELD, ROWS, STEP, pose_clearance_at_least, pose_free, to_local
from planner.environment import CollisionWorld
from planner.problem import Bounds, Circle, Environment, Footprint, MapLayer, Polygon
from planner.sweep import _advance, linear_free, twist_free
from tests.planner.worlds import ROOM, box, is_line_free, is_twist_free, rectangle

ORIGIN = Pose(0.0, 0.0, 0.0)
FORK = np.array(
    [[-0.3, -0.3], [0.6, -0.3], [0.6, -0.2], [-0.1, -0.2], [-0.1, 0.2], [0.6, 0.2], [0.6, 0.3], [-0.3, 0.3]]
)


def gap(width: float, length: float = 1.0) -> Environment:
    """A wall across the room with a passage along y = 0."""
    return Environment(
        ROOM, (box(-length / 2, -4, length / 2, -width / 2), box(-length / 2, width / 2, length / 2, 4))
    )


def turned(environment: Environment, angle: float) -> Environment:
    """The same obstacles turned about the origin, in bounds large enough."""
    c, s = math.cos(angle), math.sin(angle)
    obstacles = tuple(Polygon(o.vertices @ np.array([[c, s], [-s, c]])) for o in environment.obstacles)  # type: ignore[union-attr]
    return Environment(Bounds(-9, -9, 9, 9), obstacles)


def on_line(a: Pose, b: Pose, samples: int) -> Array:
    return np.linspace(a, b, samples)


def on_arc(a: Pose, twist: Twist, samples: int) -> Array:
    return np.array([compose(a, exp(Twist(*(u * v for v in twist)))) for u in np.linspace(0, 1, samples)])


def overlap(environment: Environment, footprint: Footprint, poses: Array) -> bool:
    """Whether any of the footprints meets an obstacle or leaves the bounds, by shapely."""
    c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x, y = footprint.vertices.T
    bodies = shapely.polygons(
        np.stack([poses[:, :1] + c * x - s * y, poses[:, 1:2] + s * x + c * y], axis=-1)
    )
    bounds = environment.bounds
    assert bounds is not None
    room = shapely.box(bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max)
    if not shapely.contains_properly(room, bodies).all():
        return True
    for o in environment.obstacles:
        if isinstance(o, Circle):
            if (shapely.distance(bodies, shapely.Point(o.x, o.y)) <= o.radius).any():
                return True
        elif shapely.intersects(bodies, shapely.Polygon(o.vertices)).any():
            return True
    return False


CLUTTER = Environment(
    ROOM,
    (
        box(-1.5, 0.8, 1.5, 1.0),
        Circle(0.8, -0.9, 0.3),
        Circle(-1.2, -0.6, 1e-4),
        box(2.2, -2, 2.3, 2.5),
        Polygon(np.array([[-3.0, -2.5], [-1.5, -2.0], [-2.6, -1.9], [-2.4, 0.5]])),
        box(-0.5, -3.0, 1.5, -2.9),
    ),
)
WORLDS = [(f, CollisionWorld.build(CLUTTER, f)) for f in (rectangle(1.2, 0.6, 0.4), Footprint(FORK))]
coordinate = st.floats(-3.5, 3.5)
poses = st.builds(Pose, coordinate, coordinate, st.floats(-4, 4))


@given(st.sampled_from(WORLDS), poses, st.floats(-2, 2), st.floats(-2, 2), st.floats(-3, 3), st.booleans())
@settings(max_examples=600, deadline=None, derandomize=True)
def test_an_edge_is_valid_exactly_where_all_of_it_is_free(
    case: tuple[Footprint, CollisionWorld], a: Pose, x: float, y: float, turn: float, arc: bool
) -> None:
    footprint, world = case
    if arc:
        valid, path = is_twist_free(world, a, Twist(x, y, turn)), on_arc(a, Twist(x, y, turn), 400)
    else:
        b = Pose(a.x + x, a.y + y, a.theta + turn)
        valid, path = is_line_free(world, a, b), on_line(a, b, 400)
    if valid:
        assert not overlap(CLUTTER, footprint, path)
    else:
        # no point of the footprint moves as far as this from one sample to the next
        assert world.clearance(path).min() < (math.hypot(x, y) + 1.1 * abs(turn)) / 399 + 2e-5


@pytest.mark.parametrize("angle", [0.0, 0.5, math.pi / 3])
@pytest.mark.parametrize(
    "footprint", [rectangle(1.2, 0.6, 0.4), Footprint(np.zeros((1, 2)), 0.3), Footprint(FORK)]
)
def test_a_passage_a_tenth_of_a_millimetre_wider_on_each_side_is_passed_and_a_narrower_one_is_not(
    footprint: Footprint, angle: float
) -> None:
    c, s = math.cos(angle), math.sin(angle)
    a, b = Pose(-3 * c, -3 * s, angle), Pose(3 * c, 3 * s, angle)
    wide = CollisionWorld.build(turned(gap(0.6 + 2e-4), angle), footprint)
    assert is_line_free(wide, a, b)
    assert is_twist_free(wide, a, Twist(6, 0, 0))
    assert is_twist_free(wide, b, Twist(-6, 0, 0))
    narrow = CollisionWorld.build(turned(gap(0.6 - 1e-6), angle), footprint)
    assert not is_line_free(narrow, a, b)
    assert not is_twist_free(narrow, a, Twist(6, 0, 0))


def test_min_clearance_narrows_a_passage_by_itself_on_each_side() -> None:
    a, b = Pose(-3, 0, 0), Pose(3, 0, 0)
    assert is_line_free(CollisionWorld.build(gap(0.8 + 2e-4), rectangle(1.2, 0.6), 0.1), a, b)
    assert not is_line_free(CollisionWorld.build(gap(0.8 - 1e-6), rectangle(1.2, 0.6), 0.1), a, b)


def test_a_wall_a_micrometre_thin_is_never_tunnelled_through() -> None:
    wall = Environment(ROOM, (box(0, -4, 1e-6, 4),))
    world = CollisionWorld.build(wall, rectangle(0.05, 3.0))
    assert not is_line_free(world, Pose(-2, 0, 0), Pose(2, 0, 0))
    assert not is_line_free(world, Pose(-2, 0, 0), Pose(2, 0, 40 * math.pi))
    assert not is_twist_free(world, Pose(-2, 0, 0), Twist(4, 0, 0))


@given(
    st.floats(0.6, 1.9), st.floats(-math.pi, math.pi), st.sampled_from([-1, 1]), st.sampled_from([0.01, 1.0])
)
@settings(max_examples=100, deadline=None, derandomize=True)
def test_a_pin_in_the_way_of_a_turning_bar_is_hit(
    distance: float, angle: float, way: int, width: float
) -> None:
    pin = Circle(distance * math.cos(angle), distance * math.sin(angle), 1e-6)
    world = CollisionWorld.build(Environment(ROOM, (pin,)), rectangle(4.0, width))
    half = math.asin(width / 2 / distance) + 0.05
    before, after = Pose(0, 0, angle - way * half), Pose(0, 0, angle + way * half)
    again = Pose(0, 0, angle + way * (math.pi - half))
    assert not is_line_free(world, before, after)
    assert not is_twist_free(world, before, Twist(0, 0, 2 * half * way))
    assert is_line_free(world, after, again)
    assert is_twist_free(world, again, Twist(0, 0, -way * (math.pi - 2 * half)))


def test_a_tip_that_runs_close_round_a_drum_still_hits_the_pin_beside_it() -> None:
    pin = Circle(1.95 * math.cos(5.0), 1.95 * math.sin(5.0), 1e-6)
    for tip, drum in ((np.array([[1.9, 0], [2.1, -0.1], [2.1, 0.1]]), 1.88), (np.array([[1.9, 0.0]]), 1.78)):
        radius = 0.1 if len(tip) == 1 else 0.0
        world = CollisionWorld.build(Environment(ROOM, (Circle(0, 0, drum), pin)), Footprint(tip, radius))
        assert is_line_free(world, ORIGIN, Pose(0, 0, 4.9))
        assert not is_line_free(world, ORIGIN, Pose(0, 0, 5.2))
        assert not is_twist_free(world, Pose(0, 0, 5.2), Twist(0, 0, -5.2))


@given(st.sampled_from(WORLDS), poses, st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3), st.booleans())
@settings(max_examples=600, deadline=None, derandomize=True)
def test_no_single_step_along_an_edge_passes_a_contact(
    case: tuple[Footprint, CollisionWorld], a: Pose, vx: float, vy: float, turn: float, arc: bool
) -> None:
    world = case[1]
    if not world.is_free(a):
        return
    x, y, theta = to_local(world.kernel, *a)
    c, s = math.cos(theta), math.sin(theta)
    time = _advance(world.kernel, x, y, c, s, vx, vy, turn, turn if arc else 0.0, 1.0)
    assert time > 0
    if arc:
        path = on_arc(a, Twist(vx * time, vy * time, turn * time), 100)
    else:
        path = on_line(
            a,
            Pose(a.x + (c * vx - s * vy) * time, a.y + (s * vx + c * vy) * time, a.theta + turn * time),
            100,
        )
    assert world.clearance(path).min() > -1e-8  # contact itself it may reach


def test_a_loop_that_returns_is_checked_at_its_far_side() -> None:
    # Held at one heading, the footprint goes once round a circle of 0.02 m.
    for y, fits in ((0.1401, True), (0.1399, False)):
        world = CollisionWorld.build(
            Environment(ROOM, (box(-1, y, 1, 1),)), rectangle(1.0, 0.2), fixed_heading=0.0
        )
        assert is_twist_free(world, ORIGIN, Twist(0.04 * math.pi, 0, 2 * math.pi)) is fits


def test_a_square_turns_on_the_spot_exactly_where_its_diagonal_fits() -> None:
    for slack, fits in ((2e-4, True), (-2e-4, False)):
        half = math.sqrt(0.5) + slack
        world = CollisionWorld.build(Environment(Bounds(-half, -half, half, half)), rectangle(1, 1))
        assert world.is_free(ORIGIN)
        assert is_line_free(world, ORIGIN, Pose(0, 0, 2 * math.pi)) is fits
        assert is_twist_free(world, ORIGIN, Twist(0, 0, -math.pi / 2)) is fits


def test_an_arc_clears_or_touches_what_stands_inside_and_outside_it() -> None:
    # About (0, 2) the rectangle's near side runs at radius 2 - 0.3, its far corners at hypot(2.3, 0.5).
    for slack, fits in ((2e-4, True), (-2e-4, False)):
        inside = CollisionWorld.build(Environment(ROOM, (Circle(0, 2, 1.7 - slack),)), rectangle(1, 0.6))
        start = compose(Pose(0, 2, 0.5), Pose(0, -2, 0))
        assert is_twist_free(inside, start, Twist(2.0, 0, 1.0)) is fits
        below = Environment(ROOM, (box(-4, -3, 4, 2 - math.hypot(2.3, 0.5) - slack),))
        start = compose(Pose(0, 2, -0.6), Pose(0, -2, 0))
        assert (
            is_twist_free(CollisionWorld.build(below, rectangle(1, 0.6)), start, Twist(2.4, 0, 1.2)) is fits
        )


def test_theta_is_taken_as_given_and_not_wrapped() -> None:
    post = Environment(ROOM, (Circle(1.0, 0.0, 0.1),))
    world = CollisionWorld.build(post, rectangle(2.4, 0.2))
    assert is_line_free(world, Pose(0, 0, 0.3), Pose(0, 0, math.pi - 0.3))
    assert not is_line_free(world, Pose(0, 0, 0.3), Pose(0, 0, -math.pi - 0.3))


def test_with_a_fixed_heading_the_footprint_slides_along_an_arc_unturned() -> None:
    footprint, a, twist = (
        rectangle(1.0, 0.2),
        Pose(-2.0, 0.5, math.pi / 2),
        Twist(math.pi / 2, 0, -math.pi / 2),
    )
    tops = Environment(ROOM, (box(-5, 1.7, 5, 4), box(-5, -4, 5, 0.3)))  # the origin rises from 0.5 to 1.5
    held = CollisionWorld.build(tops, footprint, fixed_heading=0.0)
    assert is_twist_free(held, a, twist)
    assert not is_twist_free(CollisionWorld.build(tops, footprint), a, twist)
    assert is_line_free(held, Pose(-2, 0.5, 0), Pose(2, 0.5, 9.0))
    assert not is_line_free(held, Pose(-2, 0.5, 0), Pose(2, 0.39, 0))
    low = CollisionWorld.build(Environment(ROOM, (box(-5, 1.599, 5, 4),)), footprint, fixed_heading=0.0)
    assert not is_twist_free(low, a, twist)


def test_a_turned_map_is_crossed_through_its_own_passage(tmp_path: Path) -> None:
    cells = np.zeros((60, 100), dtype=np.int8)
    cells[:, 48:52] = 1
    cells[20:26, 48:52] = 0  # 0.6 m
    np.save(tmp_path / "cells.npy", cells)
    layer = MapLayer("passage", tmp_path, 0.1, Pose(2.0, 1.0, 0.7))
    a, b = (compose(layer.origin, Pose(x, 2.3, 0.0)) for x in (2.0, 8.0))
    fits = CollisionWorld.build(Environment(map=layer), rectangle(1.0, 0.6 - 2e-4))
    assert is_line_free(fits, a, b)
    assert is_twist_free(fits, a, Twist(6, 0, 0))
    assert not is_line_free(fits, a, compose(b, Pose(0, 2e-4, 0)))
    assert not is_line_free(CollisionWorld.build(Environment(map=layer), rectangle(1.0, 0.6 + 1e-6)), a, b)


def test_a_polyline_names_its_first_bad_edge() -> None:
    world = CollisionWorld.build(gap(1.0), rectangle(0.8, 0.6))
    way = np.array([[-3, 0, 0], [0, 0, 0], [3, 0, 0], [3, 1, 0], [-3, 1, 0]], dtype=np.float64)
    assert world.polyline_free(way) == 3
    assert world.polyline_free(way[:4]) == -1
    assert world.polyline_free(way[:1]) == -1
    assert world.polyline_free(way[::-1]) == 0


@given(st.sampled_from(WORLDS), poses)
@settings(max_examples=200, deadline=None, derandomize=True)
def test_an_edge_of_no_length_is_valid_where_its_pose_is_free(
    case: tuple[Footprint, CollisionWorld], pose: Pose
) -> None:
    world = case[1]
    assert is_line_free(world, pose, pose) == world.is_free(pose)
    assert is_twist_free(world, pose, Twist(0, 0, 0)) == world.is_free(pose)


@pytest.mark.parametrize("wild", [1e6, 1e300, -1e308, math.inf, math.nan])
def test_wild_edges_end_and_are_refused(wild: float) -> None:
    world = WORLDS[0][1]
    free = Pose(-3.5, 2.5, 0.0)
    assert world.is_free(free)
    assert not is_line_free(world, free, Pose(wild, 0, 0))
    assert not is_line_free(world, Pose(0, wild, 0), free)
    assert not is_twist_free(world, free, Twist(wild, 0, 0))
    assert not is_twist_free(world, free, Twist(1, 0, wild))
    assert not is_line_free(world, free, Pose(-3.5, 2.5, wild))


def test_kernels_compose_in_compiled_code_and_agree_with_the_methods() -> None:
    answer: Callable[[Array], int] = njit(_compose)
    world = WORLDS[0][1]
    assert answer(world.kernel) == 1 + 2 * 0 + 4 + 8
    assert world.is_free(Pose(-3.5, 2.5, 0.0))
    assert not is_line_free(world, Pose(-3.5, 2.5, 0.0), Pose(3.5, 2.5, 0.0)) or world.is_free(
        Pose(3.5, 2.5, 0.0)
    )


def _compose(world: Array) -> int:
    found = 1 if pose_free(world, -3.5, 2.5, 0.0) else 0
    found += 2 if linear_free(world, -3.5, 2.5, 0.0, -3.5, -3.5, 0.0) else 0
    found += 4 if twist_free(world, -3.5, 2.5, 0.0, 1.0, 0.0, 0.1) else 0
    found += 8 if pose_clearance_at_least(world, -3.5, 2.5, 0.0, 0.5) else 0
    return found


@pytest.mark.parametrize(("count", "size"), [(0, 1.0), (1, 3.0), (25, 1.0), (900, 0.03)])
def test_the_field_holds_the_distance_to_the_nearest_boundary_at_every_cell(count: int, size: float) -> None:
    """By shapely, negative in what is closed. Of the last, more lie about a block than it looks at singly."""
    random = np.random.default_rng(3)
    spread = 4.0 if size > 0.1 else 0.4
    obstacles: list[Polygon] = []
    for x, y in random.uniform(-spread, spread, (count, 2)) * (1, 0.8):
        turns = (
            np.sort(random.uniform(0, math.tau, 5)) if random.random() < 0.5 else np.arange(4) * math.pi / 2
        )
        corners = size * np.stack([np.cos(turns), np.sin(turns)], -1) * random.uniform(0.2, 1.0)
        obstacles.append(Polygon(corners + np.array([x, y])))
    world = CollisionWorld.build(Environment(ROOM, tuple(obstacles)), rectangle(0.2, 0.2)).kernel
    rows, columns, step = int(world[ROWS]), int(world[COLUMNS]), world[STEP]
    field = world[int(world[FIELD]) : int(world[END])].reshape(rows, columns)
    y, x = (np.mgrid[:rows, :columns] + 0.5) * step + np.array([-4.0, -5.0])[:, None, None]
    cells = shapely.points(x, y)
    shapes = np.array([shapely.Polygon(o.vertices) for o in obstacles])
    sides = [*(shape.boundary for shape in shapes), shapely.box(-5, -4, 5, 4).boundary]
    tree = shapely.STRtree(sides)
    distance = shapely.distance(cells, np.array(sides)[tree.nearest(cells.ravel())].reshape(cells.shape))
    closed = (np.abs(x) > 5) | (np.abs(y) > 4)
    hit = shapely.STRtree(shapes).query(cells.ravel(), "within")[0] if count else []
    closed.ravel()[hit] = True
    np.testing.assert_allclose(field, np.where(closed, -distance, distance), atol=1e-9)
