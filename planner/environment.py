"""What a footprint may hit, built once for many questions: bounds, obstacles and map as one world."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array, Pose
from planner.collision import TABLES, World, beyond, clearances, fill_field, pose_free
from planner.errors import InvalidGeometry
from planner.kept import keep, recall
from planner.polygon import check_simple_polygon, footprint_polygon, inner_disc, outline, outlines
from planner.problem import Bounds, Circle, Environment, Footprint, Goal, MapLayer, Polygon
from planner.separation import Separation, separate
from planner.sweep import polyline_free
from planner.tree import plant

__all__ = ["CollisionWorld", "check_simple_polygon", "prepare_map"]

_FIELD_CELLS = 2**13  # at most about so many over bounds,
_FIELD_SIDE = 512  # in a row or column of them,
_MAP_FIELD_CELLS = 2**17  # and over a map


@dataclass(frozen=True, slots=True, eq=False)
class CollisionWorld:
    """An environment and the footprint that moves in it. Poses are the body origin's in the world, m and rad.

    `kernel` is what compiled questions (pose_free, twist_free, …) take; the methods ask some of them.
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
        """The world of an environment. With fixed_heading (rad) the footprint keeps it whatever theta is.

        Raises InvalidGeometry for a footprint, obstacle or bounds that are degenerate, ValueError where there
        are neither bounds nor a map, OSError where the map cannot be read.
        """
        if not (math.isfinite(min_clearance) and min_clearance >= 0):
            raise ValueError(f"min_clearance is {min_clearance}, not a finite number >= 0")
        if not 0 <= footprint.radius < math.inf:
            raise InvalidGeometry("the radius is negative or not finite", "/robot/footprint")
        ground = _ground(environment)
        solids = plant(_solids(environment.obstacles, ground))
        fences, walls = _fences(environment.bounds, ground)
        heading = math.nan if fixed_heading is None else float(fixed_heading) - ground.pose.theta
        body = _body(footprint, heading, float(min_clearance))
        world, field = _laid_out(ground, body, walls, solids, fences)
        if len(solids) + len(fences) > 0:
            fill_field(world)  # the map's boundaries are in the field already
            if len(ground.tree) > 0:
                ground = ground._replace(field=world[field:].reshape(ground.field.shape))
                world, _ = _laid_out(ground, body, walls, np.concatenate([solids, ground.tree]), fences)
        elif len(ground.tree) > 0:
            world, _ = _laid_out(ground, body, walls, ground.tree, fences)
        return cls(world)

    def clearance(self, poses: Array) -> Array:
        """Distances (n,) m from the footprint at poses (n, 3) to the nearest obstacle or bound, at any range.

        Negative where they overlap: how far, at least, the footprint would have to be moved to part them.
        min_clearance is not subtracted.
        """
        return clearances(self.kernel, np.array(poses, dtype=np.float64).reshape(-1, 3))

    def is_free(self, pose: Pose) -> bool:
        """Whether the clearance at a pose is more than min_clearance, contact (1e-5 m) excluded."""
        return bool(pose_free(self.kernel, float(pose[0]), float(pose[1]), float(pose[2])))

    def beyond(self, pose: Pose) -> float:
        """How far (m) the footprint at a pose sticks out of the bounds and the map's outline; not positive:
        it lies inside them, free or not."""
        return float(beyond(self.kernel, float(pose[0]), float(pose[1]), float(pose[2])))

    def polyline_free(self, poses: Array) -> int:
        """The first i for which a line from poses[i] to poses[i + 1] is not free, or -1. poses (n, 3),
        headings as given (not wrapped)."""
        return int(polyline_free(self.kernel, np.array(poses, dtype=np.float64).reshape(-1, 3)))

    def separation(self, start: Pose, goal: Goal) -> Separation | None:
        """A proof that no path exists, or None: see planner.separation."""
        return separate(self.kernel, start, goal)


# ---------------------------------------------------------------- the ground: a map, or empty bounds


class _Ground(NamedTuple):
    """The world's own frame, given in the client's, and what is known before obstacles: walls (k, 3), the
    tree of a map's outlines, and the field (rows, columns), cells of side `step`, inf where nothing is."""

    pose: Pose
    walls: Array
    tree: Array
    field: Array
    step: float


def _ground(environment: Environment) -> _Ground:
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
    field = np.full((math.ceil(height / step), math.ceil(width / step)), np.inf)
    return _Ground(Pose(bounds.x_min, bounds.y_min, 0.0), np.empty((0, 3)), np.empty(0), field, step)


@lru_cache(maxsize=8)
def _map_ground(layer: MapLayer) -> _Ground:
    """A map's, in the map's frame. Not to be written to."""
    cells = np.load(layer.directory / "cells.npy", mmap_mode="r")
    height, width = cells.shape
    resolution = float(layer.resolution)
    coarse = max(1, math.ceil(math.sqrt(cells.size / _MAP_FIELD_CELLS)))
    shape = -(-height // coarse), -(-width // coarse)
    right, top = width * resolution, height * resolution
    walls = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, -right], [0.0, 1.0, 0.0], [0.0, -1.0, -top]])
    kept = recall(layer, cells.shape, shape)
    if kept is not None:
        return _Ground(layer.origin, walls, *kept, coarse * resolution)
    closed = np.ascontiguousarray(cells != 0 if layer.unknown == "occupied" else cells == 1)
    tree, field = plant(_outlines(closed, resolution)), np.full(shape, np.inf)
    ground = _Ground(layer.origin, walls, tree, field, coarse * resolution)
    point = _body(Footprint(np.zeros((1, 2)), 1.0), math.nan, 0.0)
    world, start = _laid_out(ground, point, walls, tree, np.empty(0))
    fill_field(world)
    ground = ground._replace(field=world[start:].reshape(shape).copy())
    with suppress(OSError):  # the next process has it, where there is room
        keep(layer, cells.shape, ground.tree, ground.field)
    return ground


def prepare_map(layer: MapLayer) -> None:
    """Keep beside a map's cells what planning on it needs first, for both readings of its unknown cells.

    Whoever plans then maps it into memory. Raises OSError.
    """
    cells = np.load(layer.directory / "cells.npy", mmap_mode="r")
    readings = [replace(layer, unknown=unknown) for unknown in ("occupied", "free")]
    ground = _map_ground.__wrapped__(readings[0])
    for reading in readings:
        if reading is readings[1] and (cells == 2).any():
            ground = _map_ground.__wrapped__(reading)
        keep(reading, cells.shape, ground.tree, ground.field)


def _outlines(closed: NDArray[np.bool_], resolution: float) -> Array:
    """The sides (m, 5) between open and closed cells, counter-clockwise round these, whole runs as one.

    Outside the grid a ring of cells is closed, so that outlines close; what is beyond it never matters.
    """
    grid = np.pad(np.pad(closed, 1, constant_values=True), 1).view(np.int8)

    def runs(change: NDArray[np.int8]) -> list[tuple[NDArray[np.intp], ...]]:
        found: list[tuple[NDArray[np.intp], ...]] = []
        for sign in (1, -1):
            steps = np.diff(np.pad((change == sign).view(np.int8), ((0, 0), (1, 1))), axis=1)
            # of a flat array: of two dimensions, numpy takes ten times as long
            line, begin = np.divmod(np.flatnonzero(steps == 1), steps.shape[1])
            found.append((line, begin, np.flatnonzero(steps == -1) % steps.shape[1]))
        return found

    (y, x0, x1), (v, u0, u1) = runs(np.diff(grid, axis=0))  # closed above, then closed below
    (x, y0, y1), (u, v0, v1) = runs(
        np.ascontiguousarray(np.diff(grid, axis=1).T)
    )  # closed on the right, the left
    ends = [(x0, y + 1, x1, y + 1), (u1, v + 1, u0, v + 1), (x + 1, y1, x + 1, y0), (u + 1, v0, u + 1, v1)]
    corners = (np.concatenate([np.stack(e, axis=1) for e in ends]) - 2) * resolution
    return np.column_stack([corners, np.zeros(len(corners))])


# ---------------------------------------------------------------- obstacles, bounds and footprint


def _local(points: Array, pose: Pose) -> Array:
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    local: Array = (points - (pose.x, pose.y)) @ np.array([[c, -s], [s, c]])
    return local


def _solids(obstacles: Sequence[Polygon | Circle], ground: _Ground) -> Array:
    """The boundaries (n, 5) of obstacles in the own frame, counter-clockwise, those of polygons first."""
    where = {kind: [i for i, o in enumerate(obstacles) if isinstance(o, kind)] for kind in (Polygon, Circle)}
    discs = np.array([(o.x, o.y, o.radius) for o in obstacles if isinstance(o, Circle)]).reshape(-1, 3)
    sound = np.isfinite(discs).all(1) & (discs[:, 2] > 0)
    faults = [where[Circle][k] for k in np.flatnonzero(~sound)[:1].tolist()]
    corners, ends = np.empty((0, 2)), np.empty((0, 2), dtype=np.int64)
    if where[Polygon]:
        corners, ends, odd = outlines([o.vertices for o in obstacles if isinstance(o, Polygon)])
        faults += where[Polygon][odd : odd + 1] if odd >= 0 else []
    if faults:
        first = obstacles[min(faults)]
        wrong = check_simple_polygon(first.vertices) if isinstance(first, Polygon) else None
        raise InvalidGeometry(
            wrong or "the radius is not positive or a number is not finite",
            f"/environment/obstacles/{min(faults)}",
        )
    a, b = _local(corners, ground.pose)[ends.T]
    middles = _local(discs[:, :2], ground.pose)
    return np.concatenate([
        np.column_stack([a, b, np.zeros(len(ends))]), np.column_stack([middles, middles, discs[:, 2]])
    ])  # fmt: skip


def _fences(bounds: Bounds | None, ground: _Ground) -> tuple[Array, Array]:
    """The tree of the bounds' sides, and the walls (k, 3) of bounds and map, in the own frame."""
    if bounds is None:
        return np.empty(0), ground.walls
    x0, y0, x1, y1 = bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max
    sides = outline(_local(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), ground.pose))
    along = sides[:, 2:4] - sides[:, :2]
    inward = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(along[:, 0], along[:, 1])[:, None]
    walls = np.column_stack([inward, (inward * sides[:, :2]).sum(axis=1)])
    # a box each: one box over all four would be the world
    return np.concatenate([plant(side[None]) for side in sides]), np.concatenate([ground.walls, walls])


class _Body(NamedTuple):
    numbers: tuple[float, ...]  # planner.collision's from BOX_X to MIN_CLEARANCE
    sides: Array
    discs: Array


def _body(footprint: Footprint, heading: float, min_clearance: float) -> _Body:
    vertices = np.array(footprint.vertices, dtype=np.float64).reshape(-1, 2)
    wrong = None
    if not 0 <= footprint.radius < math.inf:
        wrong = "the radius is negative or not finite"
    elif len(vertices) != 1:
        wrong = check_simple_polygon(vertices)
    elif not (footprint.radius > 0 and np.isfinite(vertices).all()):
        wrong = "the radius is not positive or a number is not finite"
    if wrong is not None:
        raise InvalidGeometry(wrong, "/robot/footprint")
    vertices = footprint_polygon(vertices)
    sides = plant(outline(vertices), ordered=True)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    (x, y), (half_x, half_y) = (low + high) / 2, (high - low) / 2
    inner = (x, y, 0.0) if len(vertices) == 1 else inner_disc(sides)
    reach = np.hypot(vertices[:, 0], vertices[:, 1]).max()
    numbers = (x, y, half_x, half_y, *inner, reach, footprint.radius, heading, min_clearance)
    return _Body(numbers, sides, _cover(x, y, half_x, half_y))


def _cover(x: float, y: float, half_x: float, half_y: float) -> Array:
    """Discs (k, 4): x, y, radius, distance from the origin, that cover a box, in a row along it."""
    longer, shorter = max(half_x, half_y), min(half_x, half_y)
    count = 4 if longer >= 2 * shorter > 0 else 2 if longer > 1.2 * shorter > 0 else 1
    along = longer * (2 * np.arange(count) + 1 - count) / count
    xs, ys = (x + along, y + 0 * along) if half_x >= half_y else (x + 0 * along, y + along)
    radius = np.full(count, math.hypot(longer / count, shorter))
    return np.column_stack([xs, ys, radius, np.hypot(xs, ys)])


def _laid_out(ground: _Ground, body: _Body, walls: Array, solids: Array, fences: Array) -> tuple[World, int]:
    """A world as planner.collision describes it, and where its field begins."""
    pose, field = ground.pose, ground.field
    tables = [body.sides, body.discs.ravel(), walls.ravel(), solids, fences, field.ravel()]
    places = TABLES + np.cumsum([0, *map(len, tables)])
    numbers = [
        *pose,
        math.cos(pose.theta),
        math.sin(pose.theta),
        *body.numbers,
        ground.step,
        *field.shape,
        *places,
    ]
    return np.concatenate([np.array(numbers, dtype=np.float64), *tables]), int(places[-2])
