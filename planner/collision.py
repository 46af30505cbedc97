"""Footprint against world at a pose, compiled.

A coarse field of signed distances settles most poses in a few nanoseconds. Where it does not, the footprint
polygon is measured against the boundary segments near it, exactly: near contact that costs a handful of segment
pairs, where covering the footprint's sides by discs would cost a length divided by a clearance.

Names that begin with an underscore take coordinates in the world's own frame. Kernels are deterministic, read
nothing but their arguments and never fail: a pose that cannot be judged, nan included, is a hit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.tree import Tree, edge_distance, foot, kernel, nearest, winding

__all__ = [
    "CONTACT", "Body", "Frame", "World", "clear", "clearances", "contained", "field_bounds", "fill_field",
    "footprint_heading", "pose_clearance", "pose_clearance_at_least", "pose_free", "solid", "to_local",
]  # fmt: skip

CONTACT = 1e-5
"""Gaps (m) up to this count as contact."""


class Frame(NamedTuple):
    """The pose of the world's own frame in the client's: m, rad, and the yaw's cosine and sine."""

    x: float
    y: float
    yaw: float
    cos: float
    sin: float


class Body(NamedTuple):
    """The footprint in the body frame, m.

    edges: counter-clockwise. discs (k, 4): x, y, radius and distance from the origin of discs that cover the
    polygon. x, y, half_x, half_y: its box's centre and half extents. inner: the largest disc found in it. reach:
    its farthest vertex. radius: what it is grown by. heading: nan, or the one (rad, own frame) that it keeps.
    """

    edges: Tree
    discs: Array
    x: float
    y: float
    half_x: float
    half_y: float
    inner_x: float
    inner_y: float
    inner_radius: float
    reach: float
    radius: float
    heading: float


class World(NamedTuple):
    """All that the kernels need, m.

    tree: every boundary; its first `solids` boxes hold polygons (counter-clockwise) and circles. walls (k, 3):
    (nx, ny, c), closed where n·p < c. cells (h, w): 1 where a map is closed, cell (0, 0) at the frame's origin;
    (0, 0) without a map. field (h, w): distance to the nearest boundary at the centres of cells of side `step`
    from (x0, y0), negative inside solids, where a boundary may lie deeper than it says, never nearer.
    """

    frame: Frame
    tree: Tree
    solids: int
    walls: Array
    cells: NDArray[np.uint8]
    resolution: float
    field: Array
    x0: float
    y0: float
    step: float
    body: Body
    min_clearance: float


@kernel
def solid(world: World, x: float, y: float) -> bool:
    """Whether a point of the own frame, not on any boundary and in no circle, is closed."""
    for k in range(len(world.walls)):
        if not world.walls[k, 0] * x + world.walls[k, 1] * y >= world.walls[k, 2]:
            return True
    if world.cells.size > 0:
        row, column = math.floor(y / world.resolution), math.floor(x / world.resolution)
        if not (0 <= row < world.cells.shape[0] and 0 <= column < world.cells.shape[1]):
            return True
        if world.cells[row, column] == 1:
            return True
    return winding(world.tree, world.solids, x, y) > 0


@kernel
def fill_field(world: World) -> None:
    """Lower `world.field`, which holds inf or what is known already, to the distances of the world's tree."""
    height, width = world.field.shape
    step = world.step
    for i in range(height):
        y = world.y0 + (i + 0.5) * step
        last = abs(world.field[i - 1, 0]) if i > 0 else np.inf
        closed = False
        for j in range(width):
            x = world.x0 + (j + 0.5) * step
            best = nearest(world.tree, x, y, min(world.field[i, j], last + 1.0000001 * step))
            if j == 0 or not last > step:  # else no boundary lies between the last centre and this one
                closed = solid(world, x, y)
            world.field[i, j] = -best if closed and best > 0.0 else best
            last = best


@kernel
def field_bounds(world: World, x: float, y: float) -> tuple[float, float]:
    """Lower and upper bound of a point's distance to the nearest closed point; (-inf, 0) off the field."""
    fy, fx = (y - world.y0) / world.step, (x - world.x0) / world.step
    height, width = world.field.shape
    if not (0.0 <= fy < height and 0.0 <= fx < width):
        return -np.inf, 0.0
    i, j = int(fy), int(fx)
    off = world.step * math.sqrt((fy - i - 0.5) ** 2 + (fx - j - 0.5) ** 2)
    d = world.field[i, j]
    return d - off, max(d, 0.0) + off


# ---------------------------------------------------------------- poses


@kernel
def to_local(world: World, x: float, y: float, theta: float) -> tuple[float, float, float]:
    dx, dy = x - world.frame.x, y - world.frame.y
    cos, sin = world.frame.cos, world.frame.sin
    return cos * dx + sin * dy, cos * dy - sin * dx, theta - world.frame.yaw


@kernel
def footprint_heading(world: World, theta: float) -> float:
    """The footprint's heading at a pose's, both in the own frame."""
    return theta if math.isnan(world.body.heading) else world.body.heading


@kernel
def _gap(world: World, x: float, y: float, c: float, s: float, best: float, enough: float) -> float:
    """Distance (m) from the footprint polygon, at (x, y) and heading (c, s), to the nearest segment less its
    radius, or `best` where that is smaller; at most 0 when they overlap. One up to `enough` ends the search."""
    body, tree = world.body, world.tree
    mx, my = x + c * body.x - s * body.y, y + s * body.x + c * body.y
    ex = abs(c) * body.half_x + abs(s) * body.half_y
    ey = abs(s) * body.half_x + abs(c) * body.half_y
    i = 0
    while i < len(tree.boxes):
        if (
            tree.boxes[i, 0] > mx + ex + best
            or tree.boxes[i, 2] < mx - ex - best
            or tree.boxes[i, 1] > my + ey + best
            or tree.boxes[i, 3] < my - ey - best
        ):
            i = tree.links[i, 0]
            continue
        first = tree.links[i, 1]
        for k in range(first, first + tree.links[i, 2]):
            r = tree.segments[k, 4]
            dx, dy = tree.segments[k, 0] - x, tree.segments[k, 1] - y
            ax, ay = c * dx + s * dy, c * dy - s * dx
            dx, dy = tree.segments[k, 2] - x, tree.segments[k, 3] - y
            bx, by = c * dx + s * dy, c * dy - s * dx
            wide, high = body.half_x + best + r, body.half_y + best + r
            if (
                min(ax, bx) - body.x > wide
                or body.x - max(ax, bx) > wide
                or min(ay, by) - body.y > high
                or body.y - max(ay, by) > high
            ):
                continue
            limit = best + r
            d = edge_distance(body.edges, ax, ay, bx, by, limit)
            if winding(body.edges, len(body.edges.boxes), ax, ay) > 0:
                d = 0.0
            if d < limit:
                best = d - r
                if best <= enough:
                    return best
        i += 1
    return best


@kernel
def _inner(world: World, x: float, y: float, c: float, s: float) -> tuple[float, float]:
    """The middle of the disc within the footprint."""
    px, py = world.body.inner_x, world.body.inner_y
    return x + c * px - s * py, y + s * px + c * py


@kernel
def clear(world: World, x: float, y: float, heading: float, distance: float) -> bool:
    """Whether the footprint polygon keeps more than a distance > 0 from everything closed."""
    body = world.body
    c, s = math.cos(heading), math.sin(heading)
    px, py = _inner(world, x, y, c, s)
    if not field_bounds(world, px, py)[1] > body.inner_radius + distance:
        return False
    for k in range(len(body.discs)):
        dx, dy, r = body.discs[k, 0], body.discs[k, 1], body.discs[k, 2]
        if not field_bounds(world, x + c * dx - s * dy, y + s * dx + c * dy)[0] > r + distance:
            break
    else:
        return True
    return not _gap(world, x, y, c, s, distance, distance) < distance and not solid(world, px, py)


@kernel
def pose_clearance_at_least(world: World, x: float, y: float, theta: float, threshold: float) -> bool:
    """Whether the footprint at a pose (client's frame) keeps more than `threshold` (m, > 0) from all closed."""
    px, py, heading = to_local(world, x, y, theta)
    return clear(world, px, py, footprint_heading(world, heading), world.body.radius + threshold)


@kernel
def pose_free(world: World, x: float, y: float, theta: float) -> bool:
    """Whether the footprint at a pose keeps more than the world's min_clearance, contact excluded."""
    return pose_clearance_at_least(world, x, y, theta, world.min_clearance + CONTACT)


@kernel
def contained(world: World, x: float, y: float, theta: float) -> bool:
    """Whether the footprint at a pose lies inside the bounds and the map's outline, whatever stands there."""
    px, py, heading = to_local(world, x, y, theta)
    c, s = math.cos(footprint_heading(world, heading)), math.sin(footprint_heading(world, heading))
    edges = world.body.edges.segments
    for k in range(len(world.walls)):
        nx, ny = world.walls[k, 0], world.walls[k, 1]
        for i in range(len(edges)):
            vx, vy = px + c * edges[i, 0] - s * edges[i, 1], py + s * edges[i, 0] + c * edges[i, 1]
            if not nx * vx + ny * vy >= world.walls[k, 2] + world.body.radius:
                return False
    return True


@kernel
def _depth(world: World, x: float, y: float, c: float, s: float) -> float:
    """How far, at least, the footprint polygon must be moved to leave what it overlaps: the depth of the deepest
    of its vertices inside solids, and of points on the boundaries inside it."""
    body, tree = world.body, world.tree
    boxes = len(body.edges.boxes)
    px, py = _inner(world, x, y, c, s)
    deepest = nearest(tree, px, py, np.inf) if solid(world, px, py) else 0.0
    for i in range(len(body.edges.segments)):
        vx, vy = body.edges.segments[i, 0], body.edges.segments[i, 1]
        qx, qy = x + c * vx - s * vy, y + s * vx + c * vy
        d = nearest(tree, qx, qy, np.inf)
        if d < 0.0 or solid(world, qx, qy):
            deepest = max(deepest, abs(d))
    reach = body.reach
    i = 0
    while i < len(tree.boxes):
        if (
            tree.boxes[i, 0] > x + reach
            or tree.boxes[i, 2] < x - reach
            or tree.boxes[i, 1] > y + reach
            or tree.boxes[i, 3] < y - reach
        ):
            i = tree.links[i, 0]
            continue
        first = tree.links[i, 1]
        for k in range(first, first + tree.links[i, 2]):
            ax, ay, bx, by, r = tree.segments[k]
            fx, fy = foot(px, py, ax, ay, bx, by)
            length = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
            for j in range(-8, 9):
                # the point of the segment nearest to the footprint's middle, and others within its reach
                shift = j * 0.25 * reach / length if length > 0.0 else 0.0
                gx, gy = foot(fx + shift * (bx - ax), fy + shift * (by - ay), ax, ay, bx, by)
                qx, qy = c * (gx - x) + s * (gy - y), c * (gy - y) - s * (gx - x)
                d = edge_distance(body.edges, qx, qy, qx, qy, np.inf)
                if winding(body.edges, boxes, qx, qy) > 0:
                    deepest = max(deepest, d + r)
                else:
                    deepest = max(deepest, r - d)
                if length == 0.0:
                    break
        i += 1
    return deepest


@kernel
def pose_clearance(world: World, x: float, y: float, theta: float) -> float:
    """Distance (m) from the footprint at a pose to what is closed; negative when they overlap: how far, at
    least, it must be moved to part them."""
    px, py, heading = to_local(world, x, y, theta)
    c, s = math.cos(footprint_heading(world, heading)), math.sin(footprint_heading(world, heading))
    qx, qy = _inner(world, px, py, c, s)
    low, high = field_bounds(world, qx, qy)
    best = max(high - world.body.inner_radius, 0.0) * (1 + 1e-9) + 1e-6 if low > -np.inf else np.inf
    best = _gap(world, px, py, c, s, best, 0.0)
    if best > 0.0 and not solid(world, qx, qy):
        return best - world.body.radius
    return -max(_depth(world, px, py, c, s), 1e-9) - world.body.radius


@kernel
def clearances(world: World, poses: Array) -> Array:
    """pose_clearance of poses (n, 3), m."""
    out = np.empty(len(poses))
    for i in range(len(poses)):
        out[i] = pose_clearance(world, poses[i, 0], poses[i, 1], poses[i, 2])
    return out
