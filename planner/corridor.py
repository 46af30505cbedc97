"""Room to move: half-planes that keep a robot's convex parts clear of what is nearest to them, compiled."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import ConvexHull

from drives.se2 import Array
from planner.collision import (
    COS,
    FIELD,
    HEADING,
    MIN_CLEARANCE,
    RADIUS,
    SIN,
    SOLIDS,
    World,
    X,
    Y,
    footprint_heading,
    in_body,
    to_local,
)  # fmt: skip
from planner.kernels import kernel
from planner.tree import HEAD, SIZE, closest

__all__ = ["cover", "half_planes", "hull"]

_ELONGATED = 1.2
"""Length over width from which on a footprint takes several discs, and has half-planes for either half."""
_DISCS = 4
"""So many."""
_ASIDE = 0.3
"""Cosine of the angle between the half-planes on either side, at most."""
_SHARE = 0.45
"""Of the room between obstacles on either side, how much may be spared for one."""
_HELD = 1e-4
"""Distance (m) by which a pose keeps to half-planes that are moved to where it does."""


def hull(vertices: Array) -> Array:
    """Corners (m, 2), counter-clockwise, of the convex hull of vertices (n, 2)."""
    return vertices if len(vertices) < 3 else vertices[ConvexHull(vertices).vertices]


def cover(corners: Array) -> tuple[Array, float]:
    """Centres (k, 2) and radius of discs in a row that cover the box around corners (n, 2)."""
    low, high = corners.min(0), corners.max(0)
    size = high - low
    along = int(size[1] > size[0])
    count = _DISCS if size[along] > _ELONGATED * size[1 - along] else 1
    centres = np.tile((low + high) / 2, (count, 1))
    centres[:, along] += size[along] * ((np.arange(count) + 0.5) / count - 0.5)
    return centres, math.hypot(size[along] / count, size[1 - along]) / 2


@kernel
def half_planes(
    world: World, corners: Array, radius: float, poses: Array, relaxed: bool, spare: float
) -> Array:
    """Planes (n, k, 5) for a convex part of the robot at free poses (n, 3): nx, ny, x, y, d (m, world frame).

    The part has corners (m, 2), counter-clockwise, body frame, and is grown by a radius. There is a plane for
    what is nearest to it, and one for what is nearest in another direction; of a long part, for either half.
    The point (x, y) of the body keeps clear where n·point >= d: one of the two corners that are nearest to
    the obstacle, or the origin for a footprint that keeps its heading. Where `relaxed`, planes that the pose
    itself does not keep to are moved to where it does. spare m: room asked for beyond what is needed, where
    there is as much.
    """
    fixed = not math.isnan(world[HEADING])
    m = len(corners)
    x_min, x_max = corners[:, 0].min(), corners[:, 0].max()
    y_min, y_max = corners[:, 1].min(), corners[:, 1].max()
    middle = ((x_min + x_max) / 2, (y_min + y_max) / 2)
    along = 0 if x_max - x_min >= y_max - y_min else 1
    longer, shorter = max(x_max - x_min, y_max - y_min), min(x_max - x_min, y_max - y_min)
    halves = 2 if longer > _ELONGATED * shorter else 1
    points = 1 if fixed else min(m, 2)
    planes = np.zeros((len(poses), 2 * halves * points, 5))
    planes[:, :, 4] = -1.0
    reach = radius + world[RADIUS] + world[MIN_CLEARANCE]
    # Of each half and side: distance, direction from the obstacle, how far it reaches in that direction.
    found = np.empty((halves, 2, 4))
    for i in range(len(poses)):
        x, y, theta = to_local(world, poses[i, 0], poses[i, 1], poses[i, 2])
        heading = footprint_heading(world, theta)
        c, s = math.cos(heading), math.sin(heading)
        found[:, :, 0] = np.inf
        for side in range(2):
            _find(world, corners, x, y, c, s, middle, along, side, found)
        for half in range(halves):
            between = found[half, 0, 0] + found[half, 1, 0] - 2 * reach
            room = max(min(spare, _SHARE * between), 0.0)
            for side in range(2):
                distance, ax, ay, d = found[half, side]
                if distance == np.inf:
                    continue
                towards = corners[:, 0] * ax + corners[:, 1] * ay
                order = np.argsort(towards)
                least = towards[order[0]]
                needed = d + reach + room
                if relaxed:
                    needed = min(needed, least - _HELD)
                nx, ny = c * ax - s * ay, s * ax + c * ay
                # n·(point of the own frame), written for the point in the client's frame.
                wx, wy = world[COS] * nx - world[SIN] * ny, world[SIN] * nx + world[COS] * ny
                for point in range(points):
                    row = planes[i, (2 * half + side) * points + point]
                    row[0], row[1] = wx, wy
                    row[4] = needed + nx * x + ny * y + wx * world[X] + wy * world[Y]
                    if fixed:
                        row[4] -= least
                    else:
                        row[2:4] = corners[order[point]]
    return planes


@kernel
def _find(
    world: World, corners: Array, x: float, y: float, c: float, s: float, middle: tuple[float, float],
    along: int, side: int, found: Array,
) -> None:  # fmt: skip
    """What is nearest to a part at a pose, or to its halves; on side 1, of what lies in another direction."""
    m, halves = len(corners), len(found)
    mx, my = x + c * middle[0] - s * middle[1], y + s * middle[0] + c * middle[1]
    size = 0.0
    for k in range(m):
        size = max(size, math.hypot(corners[k, 0] - middle[0], corners[k, 1] - middle[1]))
    i, stop = int(world[SOLIDS]), int(world[FIELD])
    while i < stop:
        best = size + found[:, side, 0].max()
        dx = max(world[i] - mx, 0.0, mx - world[i + 2])
        dy = max(world[i + 1] - my, 0.0, my - world[i + 3])
        if dx * dx + dy * dy >= best * best and best < np.inf:
            i += int(world[i + 4])
            continue
        count = int(world[i + 5])
        i += HEAD
        for _ in range(count):
            ax, ay, bx, by = in_body(world, i, x, y, c, s)
            thick = world[i + 4]
            i += SIZE
            square, px, py, fx, fy = np.inf, 0.0, 0.0, 0.0, 0.0
            for k in range(m):
                end = corners[k + 1 if k + 1 < m else 0]
                pair = closest(corners[k, 0], corners[k, 1], end[0], end[1], ax, ay, bx, by)
                if pair[0] < square:
                    square, px, py, fx, fy = pair
            way = math.sqrt(square)
            half = 1 if halves > 1 and (fx if along == 0 else fy) > middle[along] else 0
            if way < 1e-12 or way - thick >= found[half, side, 0]:
                continue
            nx, ny = (px - fx) / way, (py - fy) / way
            if side == 1 and nx * found[half, 0, 1] + ny * found[half, 0, 2] > _ASIDE:
                continue
            found[half, side, 0], found[half, side, 1], found[half, side, 2] = way - thick, nx, ny
            found[half, side, 3] = nx * fx + ny * fy + thick
