"""Footprint against world at a pose, compiled.

A coarse field of signed distances settles most poses in a few nanoseconds. Where it does not, the footprint
polygon is measured against the boundary segments near it, exactly: near contact that costs a handful of
segment pairs, where covering the footprint's sides by discs would cost a length divided by a clearance.

A world is one flat array, because a kernel takes one array at a tenth of the price of a dozen: numbers at
the places named below, then tables. It has a frame of its own (a map's, or one at the bounds' corner), in
which boundaries are kept and, but for the public questions, poses are given. Kernels are deterministic, read
nothing but their arguments and never fail: a pose that cannot be judged, nan included, is a hit.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from drives.se2 import Array, Pose
from planner.kernels import kernel
from planner.tree import HEAD, SIZE, edge_distance, foot, nearest, winding, within

__all__ = [
    "CONTACT", "World", "beyond", "body_point", "clear", "clearances", "field_bounds", "fill_field",
    "footprint_heading", "in_body", "pose_clearance_at_least", "pose_free", "solid", "surely_hits",
    "to_local",
]  # fmt: skip

World: TypeAlias = Array
"""A world and the footprint in it, (n,): what CollisionWorld.build lays out and every kernel takes."""

CONTACT = 1e-5
"""Gaps (m) up to this count as contact."""

# The own frame's pose in the client's, with the yaw's cosine and sine.
X, Y, YAW, COS, SIN = 0, 1, 2, 3, 4
# The footprint polygon, body frame: its box's centre and half extents, the largest disc in it, its farthest
# vertex; what it is grown by; nan, or the heading (own frame) that it keeps; how far it stays from all.
BOX_X, BOX_Y, HALF_X, HALF_Y, INNER_X, INNER_Y, INNER_RADIUS, REACH = 5, 6, 7, 8, 9, 10, 11, 12
RADIUS, HEADING, MIN_CLEARANCE = 13, 14, 15
# The field's cells, square, the first corner at the frame's origin: their side and how many.
STEP, ROWS, COLUMNS = 16, 17, 18
# Where tables begin; each ends where the next begins.
BODY = 19  # tree of the footprint's sides, body frame, counter-clockwise
DISCS = 20  # x, y, radius, distance from the origin (body frame): together they cover the polygon
WALLS = 21  # nx, ny, c: closed where n·p < c
SOLIDS = 22  # tree of what is solid: outlines, counter-clockwise round what is closed, and circles
FENCES = 23  # more of that tree: the sides of the bounds
FIELD = 24  # at each cell's centre the distance to the nearest boundary, or less; negative in what is closed
END = 25
TABLES = 26  # the first table's place

_BLOCK, _NEAR = 4, 64  # cells of the field's blocks along a side; boundaries looked at for each of a block


@kernel
def solid(world: World, x: float, y: float, apart: float) -> bool:
    """Whether a point that lies at least `apart` from every boundary is closed."""
    for k in range(int(world[WALLS]), int(world[SOLIDS]), 3):
        if not world[k] * x + world[k + 1] * y >= world[k + 2]:
            return True
    step = world[STEP]
    i, j = y / step, x / step
    if 0.0 <= i < world[ROWS] and 0.0 <= j < world[COLUMNS]:
        off = step * math.sqrt((i - int(i) - 0.5) ** 2 + (j - int(j) - 0.5) ** 2)
        d = world[int(world[FIELD] + int(i) * world[COLUMNS]) + int(j)]
        if off < max(apart, abs(d)):  # no boundary between the cell's centre and the point
            return bool(d < 0.0)
    return winding(world, int(world[SOLIDS]), int(world[FENCES]), x, y, np.inf) > 0


@kernel
def fill_field(world: World) -> None:
    """Lower the field, which holds inf or what is known already, to the distances of the world's trees.

    Block by block: what is nearest to any cell of a block is within that of its middle and twice its reach.
    """
    solids, fences, field = int(world[SOLIDS]), int(world[FENCES]), int(world[FIELD])
    rows, columns = int(world[ROWS]), int(world[COLUMNS])
    step = world[STEP]
    reach = 0.7071068 * (_BLOCK - 1) * step
    near, turns, before = np.empty(_NEAR, np.int64), np.zeros(_BLOCK, np.int64), np.zeros(_BLOCK)
    for i0 in range(0, rows, _BLOCK):
        last = np.inf
        for j0 in range(0, columns, _BLOCK):
            x, y = (j0 + 0.5 * _BLOCK) * step, (i0 + 0.5 * _BLOCK) * step
            last = nearest(world, solids, field, x, y, last + 1.0000001 * _BLOCK * step)
            count = within(world, solids, field, x, y, last + 2.0000001 * reach, near) if last < np.inf else 0
            for i in range(i0, min(i0 + _BLOCK, rows)):
                row, y = i - i0, (i + 0.5) * step
                for j in range(j0, min(j0 + _BLOCK, columns)):
                    k, x = field + i * columns + j, (j + 0.5) * step
                    if j == 0:
                        turns[row] = winding(world, solids, fences, x, y, np.inf)
                        best = world[k]
                    else:
                        if not before[row] > 1.0000001 * step:  # a boundary may lie between the last and this
                            turns[row] -= winding(world, solids, fences, (j - 0.5) * step, y, x)
                        best = min(world[k], before[row] + 1.0000001 * step)
                    if count > _NEAR:
                        best = nearest(world, solids, field, x, y, best)
                    for n in range(min(count, _NEAR)):
                        p = near[n]
                        fx, fy = foot(x, y, world[p], world[p + 1], world[p + 2], world[p + 3])
                        best = min(best, math.sqrt((x - fx) ** 2 + (y - fy) ** 2) - world[p + 4])
                    before[row] = best
                    closed = turns[row] > 0
                    for w in range(int(world[WALLS]), solids, 3):
                        closed |= not world[w] * x + world[w + 1] * y >= world[w + 2]
                    world[k] = -best if closed and best > 0.0 else best


@kernel
def field_bounds(world: World, x: float, y: float) -> tuple[float, float]:
    """Lower and upper bound of a point's distance to the nearest closed point; (-inf, 0) off the field."""
    step = world[STEP]
    i, j = y / step, x / step
    if not (0.0 <= i < world[ROWS] and 0.0 <= j < world[COLUMNS]):
        return -np.inf, 0.0
    off = step * math.sqrt((i - int(i) - 0.5) ** 2 + (j - int(j) - 0.5) ** 2)
    d = world[int(world[FIELD] + int(i) * world[COLUMNS]) + int(j)]
    return d - off, max(d, 0.0) + off


@kernel
def surely_hits(world: World, x: float, y: float, theta: float) -> bool:
    """Whether the field alone tells that the footprint at a client's pose hits; false says nothing."""
    px, py, heading = to_local(world, x, y, theta)
    heading = footprint_heading(world, heading)
    px, py = _inner(world, px, py, math.cos(heading), math.sin(heading))
    step = world[STEP]
    i, j = py / step, px / step
    if not (0.0 <= i < world[ROWS] and 0.0 <= j < world[COLUMNS]):
        return False
    off = step * math.sqrt((i - int(i) - 0.5) ** 2 + (j - int(j) - 0.5) ** 2)
    d = world[int(world[FIELD] + int(i) * world[COLUMNS]) + int(j)]
    return bool(d + off < world[INNER_RADIUS] + world[RADIUS] + world[MIN_CLEARANCE])


@kernel
def to_local(world: World, x: float, y: float, theta: float) -> tuple[float, float, float]:
    """A pose of the client's in the own frame."""
    dx, dy = x - world[X], y - world[Y]
    return world[COS] * dx + world[SIN] * dy, world[COS] * dy - world[SIN] * dx, theta - world[YAW]


@kernel
def footprint_heading(world: World, theta: float) -> float:
    """The footprint's heading at a pose's, both in the own frame."""
    return theta if math.isnan(world[HEADING]) else world[HEADING]


def body_point(world: World, pose: Pose, x: float, y: float) -> tuple[float, float]:
    """Where a point (m, body frame) of the footprint is at a client's pose, own frame."""
    px, py, theta = to_local(world, float(pose.x), float(pose.y), float(pose.theta))
    heading = footprint_heading(world, theta)
    c, s = math.cos(heading), math.sin(heading)
    return float(px + c * x - s * y), float(py + s * x + c * y)


@kernel
def _inner(world: World, x: float, y: float, c: float, s: float) -> tuple[float, float]:
    """The middle of the disc within the footprint."""
    px, py = world[INNER_X], world[INNER_Y]
    return x + c * px - s * py, y + s * px + c * py


@kernel
def in_body(
    world: World, i: int, x: float, y: float, c: float, s: float
) -> tuple[float, float, float, float]:
    """Both ends of the segment at place i, seen from a body at (x, y) and heading (c, s)."""
    ax, ay, bx, by = world[i] - x, world[i + 1] - y, world[i + 2] - x, world[i + 3] - y
    return c * ax + s * ay, c * ay - s * ax, c * bx + s * by, c * by - s * bx


@kernel
def _gap(world: World, x: float, y: float, c: float, s: float, best: float, enough: float) -> float:
    """Distance (m) from the footprint polygon, at (x, y) and heading (c, s), to the nearest segment less its
    radius, or `best` if smaller; at most 0 when they overlap. One up to `enough` ends the search."""
    body, end = int(world[BODY]), int(world[DISCS])
    box_x, box_y, half_x, half_y = world[BOX_X], world[BOX_Y], world[HALF_X], world[HALF_Y]
    mx, my = x + c * box_x - s * box_y, y + s * box_x + c * box_y
    ex, ey = abs(c) * half_x + abs(s) * half_y, abs(s) * half_x + abs(c) * half_y
    i, stop = int(world[SOLIDS]), int(world[FIELD])
    while i < stop:
        if (
            world[i] > mx + ex + best
            or world[i + 2] < mx - ex - best
            or world[i + 1] > my + ey + best
            or world[i + 3] < my - ey - best
        ):
            i += int(world[i + 4])
            continue
        count = int(world[i + 5])
        i += HEAD
        for _ in range(count):
            ax, ay, bx, by = in_body(world, i, x, y, c, s)
            radius = world[i + 4]
            i += SIZE
            limit = best + radius
            if (
                min(ax, bx) - box_x > half_x + limit
                or box_x - max(ax, bx) > half_x + limit
                or min(ay, by) - box_y > half_y + limit
                or box_y - max(ay, by) > half_y + limit
            ):
                continue
            d = edge_distance(world, body, end, ax, ay, bx, by, limit)
            if winding(world, body, end, ax, ay, np.inf) > 0:
                d = 0.0
            if d < limit:
                best = d - radius
                if best <= enough:
                    return best
    return best


@kernel
def clear(world: World, x: float, y: float, heading: float, distance: float) -> bool:
    """Whether the footprint polygon at just this heading keeps more than a distance > 0 from all closed."""
    c, s = math.cos(heading), math.sin(heading)
    px, py = _inner(world, x, y, c, s)
    inner = world[INNER_RADIUS]
    if not field_bounds(world, px, py)[1] > inner + distance:
        return False
    covered = True
    for k in range(int(world[DISCS]), int(world[WALLS]), 4):
        dx, dy = world[k], world[k + 1]
        room = field_bounds(world, x + c * dx - s * dy, y + s * dx + c * dy)[0]
        if not room > world[k + 2] + distance:
            covered = False
            break
    if covered:
        return True
    if _gap(world, x, y, c, s, distance, distance) < distance:
        return False
    return not solid(world, px, py, inner + distance)


@kernel
def pose_clearance_at_least(world: World, x: float, y: float, theta: float, threshold: float) -> bool:
    """Whether the footprint at a client's pose keeps more than `threshold` (m, > 0) from all closed."""
    px, py, heading = to_local(world, x, y, theta)
    return clear(world, px, py, footprint_heading(world, heading), world[RADIUS] + threshold)


@kernel
def pose_free(world: World, x: float, y: float, theta: float) -> bool:
    """Whether the footprint at a pose keeps more than the world's min_clearance, contact excluded."""
    return pose_clearance_at_least(world, x, y, theta, world[MIN_CLEARANCE] + CONTACT)


@kernel
def beyond(world: World, x: float, y: float, theta: float) -> float:
    """How far (m) the footprint at a pose sticks out of the bounds and the map's outline; negative: how far
    it stays inside, whatever stands there."""
    px, py, heading = to_local(world, x, y, theta)
    heading = footprint_heading(world, heading)
    c, s = math.cos(heading), math.sin(heading)
    i, stop = int(world[BODY]), int(world[DISCS])
    most = -np.inf
    while i < stop:
        count = int(world[i + 5])
        i += HEAD
        for _ in range(count):
            vx, vy = px + c * world[i] - s * world[i + 1], py + s * world[i] + c * world[i + 1]
            i += SIZE
            for k in range(int(world[WALLS]), int(world[SOLIDS]), 3):
                most = max(most, world[k + 2] + world[RADIUS] - world[k] * vx - world[k + 1] * vy)
    return most


@kernel
def _sunk(world: World, x: float, y: float, c: float, s: float) -> float:
    """How deep the deepest of the footprint's vertices and its middle lies in what is closed, m."""
    solids, field = int(world[SOLIDS]), int(world[FIELD])
    px, py = _inner(world, x, y, c, s)
    d = nearest(world, solids, field, px, py, np.inf)
    deepest = abs(d) if d < 0.0 or solid(world, px, py, 0.0) else 0.0
    i, stop = int(world[BODY]), int(world[DISCS])
    while i < stop:
        count = int(world[i + 5])
        i += HEAD
        for _ in range(count):
            qx, qy = x + c * world[i] - s * world[i + 1], y + s * world[i] + c * world[i + 1]
            i += SIZE
            d = nearest(world, solids, field, qx, qy, np.inf)
            if abs(d) > deepest and (d < 0.0 or solid(world, qx, qy, 0.0)):
                deepest = abs(d)
    return deepest


@kernel
def _pierced(world: World, x: float, y: float, c: float, s: float) -> float:
    """How deep the deepest of sampled points on the boundaries lies in the footprint polygon, m."""
    body, end = int(world[BODY]), int(world[DISCS])
    px, py = _inner(world, x, y, c, s)
    reach, deepest = world[REACH], 0.0
    i, stop = int(world[SOLIDS]), int(world[FIELD])
    while i < stop:
        if (
            world[i] > x + reach
            or world[i + 2] < x - reach
            or world[i + 1] > y + reach
            or world[i + 3] < y - reach
        ):
            i += int(world[i + 4])
            continue
        count = int(world[i + 5])
        i += HEAD
        for _ in range(count):
            ax, ay, bx, by, radius = world[i], world[i + 1], world[i + 2], world[i + 3], world[i + 4]
            i += SIZE
            fx, fy = foot(px, py, ax, ay, bx, by)
            length = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
            spread = reach / (8 * length) if length > 0.0 else 0.0
            for k in range(
                -16, 17
            ):  # the point nearest to the footprint's middle, and those within its reach
                gx, gy = foot(fx + k * spread * (bx - ax), fy + k * spread * (by - ay), ax, ay, bx, by)
                qx, qy = c * (gx - x) + s * (gy - y), c * (gy - y) - s * (gx - x)
                d = nearest(world, body, end, qx, qy, np.inf)
                if winding(world, body, end, qx, qy, np.inf) <= 0:
                    d = -d
                deepest = max(deepest, radius + d)
                if length == 0.0:
                    break
    return deepest


@kernel
def pose_clearance(world: World, x: float, y: float, theta: float) -> float:
    """Distance (m) from the footprint at a pose to what is closed; negative when they overlap: how far, at
    least, it must be moved to part them."""
    px, py, heading = to_local(world, x, y, theta)
    heading = footprint_heading(world, heading)
    c, s = math.cos(heading), math.sin(heading)
    qx, qy = _inner(world, px, py, c, s)
    low, high = field_bounds(world, qx, qy)
    # a bound with room for rounding, so that the segment which attains it is found
    best = max(high - world[INNER_RADIUS], 0.0) * (1 + 1e-9) + 1e-6 if low > -np.inf else np.inf
    best = _gap(world, px, py, c, s, best, 0.0)
    if best > 0.0 and not solid(world, qx, qy, world[INNER_RADIUS]):
        return float(best - world[RADIUS])
    depth = max(_sunk(world, px, py, c, s), _pierced(world, px, py, c, s), 1e-9)
    return float(-depth - world[RADIUS])


@kernel
def clearances(world: World, poses: Array) -> Array:
    """pose_clearance of poses (n, 3), m."""
    out = np.empty(len(poses))
    for i in range(len(poses)):
        out[i] = pose_clearance(world, poses[i, 0], poses[i, 1], poses[i, 2])
    return out
