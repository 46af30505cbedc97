"""What a footprint may hit, built once for many questions: bounds, obstacles and map as one world for the kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array, Pose, Twist
from planner.collision import (
    Body, Frame, World, clearances, contained, fill_field, pose_clearance, pose_clearance_at_least, pose_free,
)  # fmt: skip
from planner.errors import InvalidGeometry
from planner.polygon import check_simple_polygon, footprint_polygon, inner_disc, outline
from planner.problem import Bounds, Circle, Environment, Footprint, Goal, MapLayer, Polygon
from planner.separation import Separation, separate
from planner.sweep import linear_free, polyline_free, twist_free
from planner.tree import Tree, hilbert, plant

__all__ = [
    "CollisionWorld", "Separation", "World", "check_simple_polygon", "footprint_polygon", "linear_free",
    "polyline_free", "pose_clearance", "pose_clearance_at_least", "pose_free", "twist_free", "warm_up",
]  # fmt: skip

_FIELD_CELLS = 2**14
_MAP_FIELD_CELLS = 2**17
_FIELD_SIDE = 512


@dataclass(frozen=True, slots=True, eq=False)
class CollisionWorld:
    """An environment and the footprint that moves in it. Poses are the body origin's, in the world frame (m, rad).

    `kernel` is what the compiled questions (pose_free, linear_free, …) take; the methods ask the same ones.
    Gaps up to 1e-5 m count as contact. Outside the bounds and outside the map everything is closed.
    """

    kernel: World

    @classmethod
    def build(
        cls,
        environment: Environment,
        footprint: Footprint,
        min_clearance: float = 0.0,
        fixed_heading: float | None = None,
    ) -> CollisionWorld:
        """The world of an environment. With fixed_heading (rad, world frame) the footprint keeps it whatever theta.

        Raises InvalidGeometry for a footprint, obstacle or bounds that are degenerate, ValueError where there
        are neither bounds nor a map, OSError where the map cannot be read.
        """
        if not (math.isfinite(min_clearance) and min_clearance >= 0):
            raise ValueError(f"min_clearance is {min_clearance}, not a finite number >= 0")
        if not 0 <= footprint.radius < math.inf:
            raise InvalidGeometry("the radius is negative or not finite", "/robot/footprint")
        base = _ground(environment)
        frame = base.frame
        heading = math.nan if fixed_heading is None else float(fixed_heading) - frame.yaw
        trees, walls = [], []
        segments = [_segments(o, frame, i) for i, o in enumerate(environment.obstacles)]
        if segments:
            trees.append(_planted(np.concatenate(segments)))
        if environment.bounds is not None:
            sides, inward = _fence(environment.bounds, frame)
            trees += [plant(side[None]) for side in sides]
            walls.append(inward)
        solids = len(trees[0].boxes) if segments else 0
        world = base._replace(
            tree=_chained(trees), solids=solids, walls=np.concatenate([base.walls, *walls]),
            body=_body(footprint, heading), min_clearance=float(min_clearance),
        )  # fmt: skip
        if trees:
            world = world._replace(field=base.field.copy())
            fill_field(world)
            world = world._replace(tree=_chained([world.tree, base.tree]))
        else:
            world = world._replace(tree=base.tree)
        return cls(world)

    def clearance(self, poses: Array) -> Array:
        """Distances (n,) m from the footprint at poses (n, 3) to the nearest obstacle or boundary, exact at any range.

        Negative where they overlap: how far, at least, the footprint would have to be moved to part them.
        min_clearance is not subtracted.
        """
        return clearances(self.kernel, np.array(poses, dtype=np.float64).reshape(-1, 3))

    def is_free(self, pose: Pose) -> bool:
        """Whether the clearance at a pose is more than min_clearance, contact (1e-5 m) excluded."""
        return bool(pose_free(self.kernel, float(pose[0]), float(pose[1]), float(pose[2])))

    def contained(self, pose: Pose) -> bool:
        """Whether the footprint at a pose lies inside the bounds and the map's outline, whatever stands there."""
        return bool(contained(self.kernel, float(pose[0]), float(pose[1]), float(pose[2])))

    def linear_free(self, a: Pose, b: Pose) -> bool:
        """Whether every pose from a to b, interpolated in x, y and theta as given (not wrapped), is free."""
        return bool(linear_free(self.kernel, *(float(v) for v in (*a, *b))))

    def twist_free(self, a: Pose, twist: Twist) -> bool:
        """Whether every pose from a is free while a twist is held for one second."""
        return bool(twist_free(self.kernel, *(float(v) for v in (*a, *twist))))

    def polyline_free(self, poses: Array) -> int:
        """The first i for which linear_free from poses[i] to poses[i + 1] is false, or -1. poses (n, 3)."""
        return int(polyline_free(self.kernel, np.array(poses, dtype=np.float64).reshape(-1, 3)))

    def separation(self, start: Pose, goal: Goal) -> Separation | None:
        """A proof that no path exists, or None: see planner.separation."""
        return separate(self.kernel, start, goal)


def warm_up() -> None:
    """Compile every kernel, or load it from the cache, with the types that production uses."""
    square = Footprint(np.array([[0.2, 0.2], [-0.2, 0.2], [-0.2, -0.2], [0.2, -0.2]]))
    wall = Polygon(np.array([[0.9, -1.0], [1.1, -1.0], [1.1, 1.0], [0.9, 1.0]]))
    world = CollisionWorld.build(Environment(Bounds(-2, -1, 2, 1), (wall, Circle(0.0, 0.7, 0.1))), square)
    a, b = Pose(0.0, 0.0, 0.0), Pose(1.0, 0.0, 0.5)
    world.clearance(np.array([a, b]))
    world.is_free(a)
    world.contained(a)
    world.linear_free(a, b)
    world.twist_free(a, Twist(1.0, 0.0, 0.5))
    world.polyline_free(np.array([a, b]))
    pose_clearance_at_least(world.kernel, 0.0, 0.0, 0.0, 0.1)
    pose_clearance(world.kernel, 0.0, 0.0, 0.0)
    world.separation(a, Goal(1.5, 0.0, 0.0))


# ---------------------------------------------------------------- the ground: a map, or empty bounds


def _empty() -> Tree:
    return Tree(np.empty((0, 5)), np.empty((0, 4)), np.empty((0, 3), np.int64))


_POINT = np.zeros((1, 5))


def _ground(environment: Environment) -> World:
    """The world before its bounds, obstacles and footprint: the map's, or an open field over the bounds."""
    bounds = environment.bounds
    if bounds is not None:
        values = (bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max)
        if not (
            all(map(math.isfinite, values)) and bounds.x_min < bounds.x_max and bounds.y_min < bounds.y_max
        ):
            raise InvalidGeometry("the bounds are empty or not finite", "/environment/bounds")
    if environment.map is not None:
        return _map_ground(environment.map)
    if bounds is None:
        raise ValueError("an environment needs bounds or a map")
    width, height = bounds.x_max - bounds.x_min, bounds.y_max - bounds.y_min
    step = max(math.sqrt(width / _FIELD_CELLS) * math.sqrt(height), max(width, height) / _FIELD_SIDE)
    frame = Frame(float(bounds.x_min), float(bounds.y_min), 0.0, 1.0, 0.0)
    field = np.full((math.ceil(height / step), math.ceil(width / step)), np.inf)
    return _bare(frame, _empty(), np.empty((0, 3)), np.empty((0, 0), np.uint8), 1.0, field, step)


def _bare(
    frame: Frame,
    tree: Tree,
    walls: Array,
    cells: NDArray[np.uint8],
    resolution: float,
    field: Array,
    step: float,
) -> World:
    body = Body(plant(_POINT), np.zeros((1, 4)), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan)
    return World(frame, tree, 0, walls, cells, resolution, field, 0.0, 0.0, float(step), body, 0.0)


@lru_cache(maxsize=8)
def _map_ground(layer: MapLayer) -> World:
    """The world of a map alone, in the map's frame. Not to be written to."""
    stored = np.load(layer.directory / "cells.npy", mmap_mode="r")
    cells = np.ascontiguousarray(stored != 0 if layer.unknown == "occupied" else stored == 1).astype(np.uint8)
    height, width = cells.shape
    resolution = float(layer.resolution)
    coarse = max(1, math.ceil(math.sqrt(cells.size / _MAP_FIELD_CELLS)))
    field = np.full((-(-height // coarse), -(-width // coarse)), np.inf)
    x, y, yaw = (float(v) for v in layer.origin)
    frame = Frame(x, y, yaw, math.cos(yaw), math.sin(yaw))
    right, top = width * resolution, height * resolution
    walls = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, -right], [0.0, 1.0, 0.0], [0.0, -1.0, -top]])
    tree = _planted(_outlines(cells, resolution))
    world = _bare(frame, tree, walls, cells, resolution, field, coarse * resolution)
    fill_field(world)
    return world


def _outlines(cells: NDArray[np.uint8], resolution: float) -> Array:
    """The sides (m, 5) between open and closed cells, whole runs of them as one; outside everything is closed."""
    closed = np.pad(cells, 1, constant_values=1)

    def runs(change: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        steps = np.diff(np.pad(change.view(np.int8), ((0, 0), (1, 1))), axis=1)
        line, begin = np.nonzero(steps == 1)
        return line, begin, np.nonzero(steps == -1)[1]

    y, x0, x1 = runs(closed[1:, 1:-1] != closed[:-1, 1:-1])
    x, y0, y1 = runs(np.ascontiguousarray((closed[1:-1, 1:] != closed[1:-1, :-1]).T))
    ends = np.concatenate([np.stack([x0, y, x1, y], 1), np.stack([x, y0, x, y1], 1)])
    return np.column_stack([ends * resolution, np.zeros(len(ends))])


# ---------------------------------------------------------------- obstacles, bounds and footprint


def _local(points: Array, frame: Frame) -> Array:
    return (points - (frame.x, frame.y)) @ np.array([[frame.cos, -frame.sin], [frame.sin, frame.cos]])


def _segments(obstacle: Polygon | Circle, frame: Frame, index: int) -> Array:
    """An obstacle's boundary (n, 5) in the own frame, counter-clockwise."""
    at = f"/environment/obstacles/{index}"
    if isinstance(obstacle, Polygon):
        wrong = check_simple_polygon(obstacle.vertices)
        if wrong is not None:
            raise InvalidGeometry(wrong, at)
        return outline(_local(footprint_polygon(obstacle.vertices), frame))
    if not (math.isfinite(obstacle.x + obstacle.y) and 0 < obstacle.radius < math.inf):
        raise InvalidGeometry("the radius is not positive or a number is not finite", at)
    return outline(_local(np.array([[obstacle.x, obstacle.y]], dtype=np.float64), frame), obstacle.radius)


def _fence(bounds: Bounds, frame: Frame) -> tuple[Array, Array]:
    """The sides (4, 5) of the bounds and their half planes (4, 3) in the own frame."""
    corners = np.array(
        [
            [bounds.x_min, bounds.y_min],
            [bounds.x_max, bounds.y_min],
            [bounds.x_max, bounds.y_max],
            [bounds.x_min, bounds.y_max],
        ],
        dtype=np.float64,
    )
    sides = outline(_local(corners, frame))
    along = sides[:, 2:4] - sides[:, :2]
    inward = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(along[:, 0], along[:, 1])[:, None]
    return sides, np.column_stack([inward, (inward * sides[:, :2]).sum(1)])


def _body(footprint: Footprint, heading: float) -> Body:
    wrong = None
    vertices = np.ascontiguousarray(footprint.vertices, dtype=np.float64)
    if len(vertices) != 1:
        wrong = check_simple_polygon(vertices)
        vertices = footprint_polygon(vertices)
    elif not (footprint.radius > 0 and np.isfinite(vertices).all()):
        wrong = "the radius is not positive or a number is not finite"
    if wrong is not None:
        raise InvalidGeometry(wrong, "/robot/footprint")
    edges = plant(outline(vertices))
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    (x, y), (half_x, half_y) = (low + high) / 2, (high - low) / 2
    if len(vertices) == 1:
        inner = (float(x), float(y), 0.0)
    else:
        inner = inner_disc(edges)
    reach = float(np.hypot(vertices[:, 0], vertices[:, 1]).max())
    return Body(
        edges, _cover(x, y, half_x, half_y), float(x), float(y), float(half_x), float(half_y), *inner,
        reach, float(footprint.radius), heading,
    )  # fmt: skip


def _cover(x: float, y: float, half_x: float, half_y: float) -> Array:
    """Discs (k, 4): x, y, radius and distance from the origin, that cover a box, in a row along its longer side."""
    longer, shorter = max(half_x, half_y), min(half_x, half_y)
    count = min(4, max(1, math.ceil(2 * longer / max(shorter, 1e-9 + longer / 4)))) if longer > 0 else 1
    along = longer * (2 * np.arange(count) + 1 - count) / count
    centres = np.column_stack([x + along, np.full(count, y)]) if half_x >= half_y else None
    if centres is None:
        centres = np.column_stack([np.full(count, x), y + along])
    radius = math.hypot(longer / count, shorter)
    return np.column_stack([centres, np.full(count, radius), np.hypot(centres[:, 0], centres[:, 1])])


def _planted(segments: Array) -> Tree:
    segments = np.ascontiguousarray(segments)
    return plant(segments[np.argsort(hilbert(segments), kind="stable")])


class _Offset(NamedTuple):
    boxes: int
    segments: int


def _chained(trees: list[Tree]) -> Tree:
    """Trees end to end as one."""
    links, offset = [], _Offset(0, 0)
    for tree in trees:
        links.append(tree.links + np.array([offset.boxes, offset.segments, 0]))
        offset = _Offset(offset.boxes + len(tree.boxes), offset.segments + len(tree.segments))
    if not trees:
        return _empty()
    return Tree(
        np.concatenate([t.segments for t in trees]),
        np.concatenate([t.boxes for t in trees]),
        np.concatenate(links),
    )
