"""Poses against the world, with shapely for an oracle."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from drives.se2 import Array, Pose
from planner.environment import CollisionWorld
from planner.errors import InvalidGeometry
from planner.polygon import check_simple_polygon, footprint_polygon
from planner.problem import Bounds, Circle, Environment, Footprint, MapLayer, Polygon
from tests.planner.worlds import ROOM, box, rectangle, star

ORIGIN = Pose(0.0, 0.0, 0.0)


def write_map(
    folder: Path, cells: Array, resolution: float, origin: Pose, unknown: str = "occupied"
) -> MapLayer:
    folder.mkdir(exist_ok=True)
    np.save(folder / "cells.npy", cells.astype(np.int8))
    return MapLayer(str(folder), folder, resolution, origin, unknown)  # type: ignore[arg-type]


@dataclass
class Oracle:
    """The same environment as shapely geometry; circles as centres, so that they are exact."""

    environment: Environment
    footprint: Footprint
    fixed: float | None = None

    def __post_init__(self) -> None:
        layer, bounds = self.environment.map, self.environment.bounds
        self.body = (
            shapely.Polygon(self.footprint.vertices)
            if len(self.footprint.vertices) > 1
            else shapely.Point(self.footprint.vertices[0])
        )
        shapes = [shapely.Polygon(o.vertices) for o in self.environment.obstacles if isinstance(o, Polygon)]
        self.circles = [o for o in self.environment.obstacles if isinstance(o, Circle)]
        self.inside = []
        if bounds is not None:
            self.inside.append(shapely.box(bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max))
        if layer is not None:
            cells = np.load(layer.directory / "cells.npy")
            rows, columns = np.nonzero(cells != 0 if layer.unknown == "occupied" else cells == 1)
            c, s = math.cos(layer.origin.theta), math.sin(layer.origin.theta)
            turn = np.array([[c, s], [-s, c]])
            square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
            corners = (np.stack([columns, rows], 1)[:, None] + square) * layer.resolution
            shapes += list(shapely.polygons(corners @ turn + layer.origin[:2]))
            outline = square * (cells.shape[1], cells.shape[0]) * layer.resolution
            self.inside.append(shapely.Polygon(outline @ turn + layer.origin[:2]))
        self.solids = shapely.union_all(shapes) if shapes else shapely.Polygon()

    def at(self, pose: Pose) -> shapely.Geometry:
        theta = pose[2] if self.fixed is None else self.fixed
        turned = affinity.rotate(self.body, theta, origin=(0, 0), use_radians=True)
        return affinity.translate(turned, pose[0], pose[1])

    def clearance(self, pose: Pose) -> float:
        """Distance, or a number <= 0 where they overlap."""
        body = self.at(pose)
        near = [body.distance(shapely.Point(o.x, o.y)) - o.radius for o in self.circles]
        near += [body.distance(b.exterior) if b.contains(body) else 0.0 for b in self.inside]
        if not self.solids.is_empty:
            near.append(body.distance(self.solids))
        return float(min(near)) - self.footprint.radius


def crowded(rng: np.random.Generator, layer: MapLayer | None = None) -> Environment:
    obstacles: list[Polygon | Circle] = []
    for _ in range(rng.integers(0, 12)):
        x, y = rng.uniform(-5, 5), rng.uniform(-4, 4)
        if rng.random() < 0.4:
            obstacles.append(Circle(x, y, rng.uniform(0.01, 0.8)))
        else:
            obstacles.append(Polygon(star(rng, rng.uniform(0.05, 1.5), x, y)))
    return Environment(ROOM if layer is None or rng.random() < 0.5 else None, tuple(obstacles), layer)


def agree(world: CollisionWorld, oracle: Oracle, poses: Array, min_clearance: float) -> None:
    for pose, found in zip(poses, world.clearance(poses), strict=True):
        true = oracle.clearance(Pose(*pose))
        if true > 0:
            assert found == pytest.approx(true, abs=1e-9)
        else:
            assert found <= 1e-9
        if abs(true - min_clearance) > 2e-5:
            assert world.is_free(Pose(*pose)) == (true > min_clearance)


@pytest.mark.parametrize("seed", range(12))
def test_clearance_is_the_exact_distance_to_obstacles_and_bounds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    environment = crowded(rng)
    footprint = Footprint(
        footprint_polygon(star(rng, rng.uniform(0.1, 1)) + rng.uniform(-0.2, 0.2, 2)), seed % 3 * 0.05
    )
    min_clearance = seed % 2 * 0.07
    fixed = 0.7 if seed % 4 == 3 else None
    world = CollisionWorld.build(environment, footprint, min_clearance, fixed)
    poses = np.column_stack(
        [rng.uniform(-5.5, 5.5, 100), rng.uniform(-4.5, 4.5, 100), rng.uniform(-7, 7, 100)]
    )
    agree(world, Oracle(environment, footprint, fixed), poses, min_clearance)


@pytest.mark.parametrize("seed", range(8))
def test_a_turned_maps_cells_are_exact_squares_and_its_outside_is_closed(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    cells = rng.choice([0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 2], (30, 50))
    cells[5:9, 5:40] = 1
    layer = write_map(tmp_path, cells, 0.2, Pose(-3.0, -4.0, 0.4 * seed), "free" if seed % 2 else "occupied")
    environment = crowded(rng, layer)
    footprint = Footprint(footprint_polygon(star(rng, 0.4)), seed % 3 * 0.02)
    world = CollisionWorld.build(environment, footprint)
    c, s = math.cos(layer.origin.theta), math.sin(layer.origin.theta)
    local = np.column_stack([rng.uniform(-0.5, 10.5, 120), rng.uniform(-0.5, 6.5, 120)])
    xy = local @ np.array([[c, s], [-s, c]]) + layer.origin[:2]
    agree(world, Oracle(environment, footprint), np.column_stack([xy, rng.uniform(-4, 4, 120)]), 0.0)


def test_a_map_gives_the_same_world_with_obstacles_or_without_them_before(tmp_path: Path) -> None:
    cells = np.zeros((40, 40))
    cells[20, :] = 1
    layer = write_map(tmp_path, cells, 0.1, ORIGIN)
    pose = np.array([[1.0, 1.0, 0.0]])
    bare = CollisionWorld.build(Environment(map=layer), rectangle(0.2, 0.2)).clearance(pose)
    more = CollisionWorld.build(
        Environment(map=layer, obstacles=(Circle(1.0, 0.5, 0.1),)), rectangle(0.2, 0.2)
    )
    assert more.clearance(pose)[0] == pytest.approx(0.3)
    again = CollisionWorld.build(Environment(map=layer), rectangle(0.2, 0.2)).clearance(pose)
    assert bare[0] == again[0] == pytest.approx(0.9)


def test_unknown_cells_are_closed_unless_the_map_says_free(tmp_path: Path) -> None:
    cells = np.zeros((20, 20))
    cells[10, 10] = 2
    pose = Pose(1.05, 1.05, 0.0)
    for unknown, free in (("occupied", False), ("free", True)):
        layer = write_map(tmp_path, cells, 0.1, ORIGIN, unknown)
        assert CollisionWorld.build(Environment(map=layer), rectangle(0.3, 0.3)).is_free(pose) is free


@pytest.mark.parametrize(
    "obstacle", [Circle(0.1, 0.05, 1e-6), box(0.1, 0.1, 0.1001, 0.1001), box(-4, -4, 4, 4)]
)
def test_nothing_hides_inside_the_footprint_nor_the_footprint_inside_it(obstacle: Polygon | Circle) -> None:
    world = CollisionWorld.build(Environment(ROOM, (obstacle,)), rectangle(2.0, 1.0))
    assert not world.is_free(ORIGIN)
    assert world.clearance(np.array([ORIGIN]))[0] < -0.1


def test_a_footprint_deep_in_a_solid_is_hit_however_coarse_the_world() -> None:
    island = box(100, 100, 200, 200)
    vast = CollisionWorld.build(Environment(Bounds(-1e6, -1e6, 1e6, 1e6), (island,)), rectangle(0.8, 0.4))
    assert not vast.is_free(Pose(150.0, 150.0, 1.0))
    assert vast.clearance(np.array([[150.0, 150.0, 0.0], [250.0, 150.0, 0.0]])) == pytest.approx(
        [-50.2, 49.6], abs=0.3
    )
    assert vast.is_free(Pose(250.0, 150.0, 1.0))


def test_overlapping_obstacles_are_closed_where_both_are() -> None:
    environment = Environment(ROOM, (box(-3, -3, 3, 3), box(-1, -1, 1, 1), Circle(0.0, 0.0, 2.0)))
    world = CollisionWorld.build(environment, rectangle(0.2, 0.2))
    for x in (0.0, 0.8, 1.5, 2.5):
        assert not world.is_free(Pose(x, 0.3, 0.0))
    assert world.is_free(Pose(3.2, 0.3, 0.0))


def test_a_concave_footprint_is_free_around_what_stands_in_its_mouth() -> None:
    fork = np.array([[0, -0.5], [1, -0.5], [1, -0.4], [0.1, -0.4], [0.1, 0.4], [1, 0.4], [1, 0.5], [0, 0.5]])
    world = CollisionWorld.build(Environment(ROOM, (box(0.5, -0.39, 4, 0.39),)), Footprint(fork))
    assert world.is_free(ORIGIN)
    assert world.clearance(np.array([ORIGIN]))[0] == pytest.approx(0.01)
    assert not world.is_free(Pose(0.41, 0.0, 0.0))
    assert not world.is_free(Pose(0.0, 0.02, 0.0))


def test_a_round_robot_is_round() -> None:
    world = CollisionWorld.build(Environment(ROOM, (box(1, 1, 2, 2),)), Footprint(np.zeros((1, 2)), 0.5))
    toward = 1 - 0.5 / math.sqrt(2)
    assert world.is_free(Pose(toward - 1e-4, toward - 1e-4, 0.3))
    assert not world.is_free(Pose(toward + 1e-4, toward + 1e-4, 0.3))


def test_min_clearance_is_kept_from_obstacles_and_bounds_and_not_subtracted() -> None:
    world = CollisionWorld.build(Environment(ROOM, (Circle(0.0, 0.0, 0.5),)), rectangle(1, 1), 0.3)
    assert world.is_free(Pose(1.3001, 0, 0))
    assert not world.is_free(Pose(1.2999, 0, 0))
    assert not world.is_free(Pose(4.21, 0, 0))
    assert world.clearance(np.array([[1.3, 0, 0]]))[0] == pytest.approx(0.3)


def test_a_fixed_heading_is_kept_in_a_turned_map(tmp_path: Path) -> None:
    cells = np.zeros((40, 40))
    layer = write_map(tmp_path, cells, 0.1, Pose(0.0, 0.0, math.pi / 2))
    world = CollisionWorld.build(Environment(map=layer), rectangle(1.0, 0.2), fixed_heading=0.0)
    for theta in (0.0, 1.0, 2.0):
        assert world.clearance(np.array([[-0.8, 2.0, theta]]))[0] == pytest.approx(0.3)


def test_it_lies_beyond_bounds_or_map_by_so_much_whatever_the_obstacles(tmp_path: Path) -> None:
    layer = write_map(tmp_path, np.ones((40, 40)), 0.1, Pose(0.0, 0.0, math.pi / 4))
    world = CollisionWorld.build(Environment(Bounds(-9, -9, 9, 3), map=layer), rectangle(1.0, 1.0))
    assert world.beyond(Pose(0.0, 2.0, 0.0)) <= 0
    assert world.beyond(Pose(0.0, 2.51, 0.0)) == pytest.approx(0.01)  # past the bounds
    assert world.beyond(Pose(1.8, 2.0, 0.0)) > 0  # past the map


@pytest.mark.parametrize("far", [6.0, 1e6, 1e300])
def test_poses_far_outside_are_hits_with_a_finite_clearance(far: float) -> None:
    world = CollisionWorld.build(Environment(ROOM, (Circle(0, 0, 1),)), rectangle(1, 0.5))
    for x, y in ((far, 0.0), (0.0, -far), (-far, far)):
        assert not world.is_free(Pose(x, y, 1.0))
        assert world.beyond(Pose(x, y, 1.0)) > 0
        assert world.clearance(np.array([[x, y, 1.0]]))[0] < -0.4


def test_a_million_metres_cost_no_exactness() -> None:
    x, y = 1e6, -1e6
    bounds = Bounds(-2e6, -2e6, 2e6, 2e6)
    world = CollisionWorld.build(
        Environment(bounds, (box(x + 0.5, y - 1, x + 1, y + 1),)), rectangle(0.8, 0.4)
    )
    assert world.clearance(np.array([[x, y, 0.0]]))[0] == pytest.approx(0.1, abs=1e-6)
    assert world.is_free(Pose(x + 0.0999, y, 0.0))
    assert not world.is_free(Pose(x + 0.1001, y, 0.0))


@pytest.mark.parametrize("seed", range(6))
def test_a_negative_clearance_is_a_move_that_does_not_yet_part_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    environment, footprint = crowded(rng), Footprint(footprint_polygon(star(rng, 0.8)), 0.05 * (seed % 2))
    world, oracle = CollisionWorld.build(environment, footprint), Oracle(environment, footprint)
    poses = np.column_stack([rng.uniform(-5.5, 5.5, 80), rng.uniform(-4.5, 4.5, 80), rng.uniform(-7, 7, 80)])
    depths = world.clearance(poses)
    assert (depths < -0.02).any()
    for (x, y, theta), depth in zip(poses[depths < 0], depths[depths < 0], strict=True):
        for angle in np.arange(12) * math.pi / 6:
            moved = Pose(x - 0.999 * depth * math.cos(angle), y - 0.999 * depth * math.sin(angle), theta)
            assert oracle.clearance(moved) <= 1e-9


# ---------------------------------------------------------------- degenerate input


@pytest.mark.parametrize(
    ("vertices", "says"),
    [
        ([[0, 0], [1, 1], [1, 0], [0, 1]], "cross"),
        ([[0, 0], [1, 0], [2, 0]], "cross"),
        ([[0, 0], [1, 0], [0, 0], [1, 0]], "cross"),
        ([[0, 0], [1, 0]], "three distinct"),
        ([[0, 0], [0, 0], [1, 0], [1, 0], [0, 0]], "three distinct"),
        ([[0, 0], [2, 0], [2, 1], [1, 0], [0, 1]], "touch"),
        ([[0, 0], [1, 0], [1, 1], [1, 2], [1, 0.5], [0, 1]], "cross"),
        ([[0, 0], [1, 0], [math.nan, 1]], "finite"),
        ([[0, 0], [1, 0], [1, math.inf]], "finite"),
    ],
)
def test_what_is_no_simple_polygon_is_said_and_refused(vertices: list[list[float]], says: str) -> None:
    points = np.array(vertices, dtype=np.float64)
    assert says in (check_simple_polygon(points) or "")
    with pytest.raises(InvalidGeometry) as error:
        CollisionWorld.build(Environment(ROOM), Footprint(points))
    assert error.value.details["errors"][0]["pointer"] == "/robot/footprint"
    with pytest.raises(InvalidGeometry) as error:
        CollisionWorld.build(Environment(ROOM, (Circle(1, 1, 1), Polygon(points))), rectangle(1, 1))
    assert error.value.details["errors"][0]["pointer"] == "/environment/obstacles/1"


def test_of_many_obstacles_the_first_that_is_wrong_is_named() -> None:
    fine = Polygon(np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]]))
    bow = Polygon(np.array([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]))
    flat = Polygon(np.array([[0.0, 0.0], [1.0, 0.0]]))
    disc, point, nowhere = Circle(0.5, 0.5, 0.1), Circle(0.5, 0.5, 0.0), Circle(math.nan, 0.5, 0.1)
    for obstacles, first, says in (
        ((disc, fine, bow, point, flat), 2, "cross"),
        ((fine, disc, nowhere, bow), 2, "not finite"),
        ((disc, disc, fine, flat, bow), 3, "three distinct"),
        ((point, bow), 0, "not positive"),
    ):
        with pytest.raises(InvalidGeometry) as error:
            CollisionWorld.build(Environment(ROOM, obstacles), rectangle(1, 1))
        assert says in str(error.value)
        assert error.value.details["errors"][0]["pointer"] == f"/environment/obstacles/{first}"


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=3, max_size=8))
@settings(max_examples=400, deadline=None, derandomize=True)
def test_check_simple_polygon_is_shapelys_validity(corners: list[tuple[int, int]]) -> None:
    points = np.array(corners, dtype=np.float64)
    shape = shapely.Polygon(points)
    assert (check_simple_polygon(points) is None) == bool(shape.is_valid and shape.area > 0)


def test_repeated_vertices_are_dropped_and_the_winding_is_counter_clockwise() -> None:
    square = np.array([[0, 0], [0, 1], [0, 1], [1, 1], [1, 0], [0, 0]], dtype=np.float64)
    assert check_simple_polygon(square) is None
    found = footprint_polygon(square)
    assert len(found) == 4
    assert shapely.LinearRing(found).is_ccw


def test_ten_thousand_vertices_are_checked_in_well_under_a_second() -> None:
    angle = np.linspace(0, 2 * math.pi, 10_000, endpoint=False)
    reach = np.where(np.arange(10_000) % 2, 1.0, 0.1)  # spikes, whose boxes all overlap near the middle
    points = np.column_stack([reach * np.cos(angle), reach * np.sin(angle)])
    check_simple_polygon(points[:10])
    start = time.perf_counter()
    assert check_simple_polygon(points) is None
    assert time.perf_counter() - start < 2


@pytest.mark.parametrize(
    "obstacle", [Circle(0, 0, 0), Circle(0, 0, -1), Circle(math.nan, 0, 1), Circle(0, 0, math.inf)]
)
def test_circles_without_a_size_or_place_are_refused(obstacle: Circle) -> None:
    with pytest.raises(InvalidGeometry):
        CollisionWorld.build(Environment(ROOM, (obstacle,)), rectangle(1, 1))


def test_a_point_robot_empty_bounds_and_no_world_are_refused() -> None:
    with pytest.raises(InvalidGeometry):
        CollisionWorld.build(Environment(ROOM), Footprint(np.zeros((1, 2))))
    with pytest.raises(InvalidGeometry):
        CollisionWorld.build(Environment(Bounds(1, 0, 1, 2)), rectangle(1, 1))
    with pytest.raises(ValueError, match="bounds or a map"):
        CollisionWorld.build(Environment(), rectangle(1, 1))
    with pytest.raises(ValueError, match="min_clearance"):
        CollisionWorld.build(Environment(ROOM), rectangle(1, 1), -0.1)
