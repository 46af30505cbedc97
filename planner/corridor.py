"""Room to move: half-planes that keep discs over the footprint clear of the obstacle nearest to each,
compiled."""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array
from planner.collision import (
    COS,
    DISCS,
    FIELD,
    HEADING,
    MIN_CLEARANCE,
    RADIUS,
    SIN,
    SOLIDS,
    WALLS,
    World,
    X,
    Y,
    footprint_heading,
    solid,
    to_local,
)  # fmt: skip
from planner.tree import HEAD, SIZE, foot, kernel

__all__ = ["half_planes"]


@kernel
def half_planes(world: World, poses: Array, relaxed: bool, spare: float) -> Array:
    """Planes (n, 2k, 5) for the k discs that cover the footprint, at poses (n, 3): nx, ny, x, y, d (m, world
    frame): for what is nearest to each disc, and what is nearest on the other side of it.

    The point (x, y) of the body keeps clear of the obstacle nearest to its disc where n·point >= d. Where
    `relaxed`, planes that the pose itself does not keep to are moved to where it does. spare m: room asked
    for beyond what is needed. For a footprint that keeps its heading the point is the origin.
    """
    first, last = int(world[DISCS]), int(world[WALLS])
    count = (last - first) // 4
    planes = np.zeros((len(poses), 2 * count, 5))
    reach = world[RADIUS] + world[MIN_CLEARANCE] + spare
    for i in range(len(poses)):
        x, y, theta = to_local(world, poses[i, 0], poses[i, 1], poses[i, 2])
        heading = footprint_heading(world, theta)
        c, s = math.cos(heading), math.sin(heading)
        ax = ay = 0.0
        for j in range(2 * count):
            k = first + 4 * (j // 2)
            if j % 2 == 0:
                ax = ay = 0.0
            bx, by = world[k], world[k + 1]
            px, py = x + c * bx - s * by, y + s * bx + c * by
            distance, fx, fy, thick = _nearest_foot(world, px, py, ax, ay)
            if distance == np.inf:
                planes[i, j, 4] = -1.0
                continue
            way = math.hypot(px - fx, py - fy)
            sign = 1.0
            if thick == 0.0 and solid(world, px, py, way):
                sign = -1.0
            if way > 1e-12:
                ax, ay = (px - fx) / way, (py - fy) / way
            nx, ny = (sign * (px - fx) / way, sign * (py - fy) / way) if way > 1e-12 else (1.0, 0.0)
            needed = thick + world[k + 2] + reach
            if relaxed:
                needed = min(needed, sign * way - 1e-4)
            # n·(point of the own frame), written for the point in the client's frame.
            wx, wy = world[COS] * nx - world[SIN] * ny, world[SIN] * nx + world[COS] * ny
            planes[i, j, 0], planes[i, j, 1] = wx, wy
            planes[i, j, 4] = nx * fx + ny * fy + needed + wx * world[X] + wy * world[Y]
            if math.isnan(world[HEADING]):
                planes[i, j, 2], planes[i, j, 3] = bx, by
            else:
                planes[i, j, 4] -= nx * (px - x) + ny * (py - y)
    return planes


@kernel
def _nearest_foot(
    world: World, x: float, y: float, ax: float, ay: float
) -> tuple[float, float, float, float]:
    """Distance from a point to the nearest boundary in a direction, within 90 degrees, (0, 0: in any); the
    point of its segment it is measured to, its radius."""
    best, px, py, thick = np.inf, x, y, 0.0
    i, stop = int(world[SOLIDS]), int(world[FIELD])
    while i < stop:
        dx = max(world[i] - x, 0.0, x - world[i + 2])
        dy = max(world[i + 1] - y, 0.0, y - world[i + 3])
        if dx * dx + dy * dy >= best * best and best < np.inf:
            i += int(world[i + 4])
            continue
        count = int(world[i + 5])
        i += HEAD
        for _ in range(count):
            fx, fy = foot(x, y, world[i], world[i + 1], world[i + 2], world[i + 3])
            distance = math.hypot(x - fx, y - fy) - world[i + 4]
            if distance < best and ax * (fx - x) + ay * (fy - y) >= 0.0:
                best, px, py, thick = distance, fx, fy, world[i + 4]
            i += SIZE
    return best, px, py, thick
