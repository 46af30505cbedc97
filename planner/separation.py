"""A proof that there is no path: the largest disc inside the footprint cannot get from the start to the goal.

Grow every boundary by the disc's radius. Each grown segment is convex, so their union parts start from goal
exactly when some ring of segments, each less than the disc's width from the next, crosses the line from start
to goal an odd number of times. That needs no grid: it is a union-find over pairs of segments that also keeps
the parity of those crossings. Taking the pairs narrowest first gives the widest passage, still too narrow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from drives.se2 import Array, Pose
from planner.collision import (
    BODY,
    COLUMNS,
    COS,
    DISCS,
    END,
    FIELD,
    HEADING,
    INNER_RADIUS,
    INNER_X,
    INNER_Y,
    MIN_CLEARANCE,
    RADIUS,
    ROWS,
    SIN,
    SOLIDS,
    STEP,
    World,
    X,
    Y,
    footprint_heading,
    solid,
    to_local,
)
from planner.problem import Goal
from planner.tree import HEAD, SIZE, closest, kernel, nearest, winding

__all__ = ["Separation", "separate"]

_MAX_PAIRS = 2_000_000
_TOLERANCE = 1e-6  # m: what is this close to fitting is taken to fit


@dataclass(frozen=True, slots=True)
class Separation:
    """No path: a disc of `radius` (m) inside the footprint would have to pass a gap of `width` around (x, y),
    and needs `width_needed` with the clearance asked for. No other way is wider; width 0 is a closed wall.
    Where the disc does not even fit at the start or the goal, (x, y) is its centre there. World frame, m."""

    radius: float
    width_needed: float
    x: float
    y: float
    width: float


def separate(world: World, start: Pose, goal: Goal) -> Separation | None:
    """The proof, or None where there is none. Milliseconds.

    For a goal of any heading the disc is the largest about the body's origin, else the largest that
    the footprint holds. Worlds with more than 2,000,000 pairs of segments that close are not examined.
    """
    body, discs, solids, field = (int(world[k]) for k in (BODY, DISCS, SOLIDS, FIELD))
    x, y, inner = world[INNER_X], world[INNER_Y], world[INNER_RADIUS]
    if goal.theta is None and math.isnan(world[HEADING]) and math.hypot(x, y) > 0:
        if winding(world, body, discs, 0.0, 0.0, np.inf) <= 0:
            return None
        x, y, inner = 0.0, 0.0, nearest(world, body, discs, 0.0, 0.0, np.inf)
    radius = inner + world[RADIUS]
    reach = radius + world[MIN_CLEARANCE]
    ends = []
    for px, py, theta in (start, (goal.x, goal.y, goal.theta or 0.0)):
        px, py, theta = to_local(world, float(px), float(py), float(theta))
        theta = footprint_heading(world, theta)
        c, s = math.cos(theta), math.sin(theta)
        ends.append((px + c * x - s * y, py + s * x + c * y))
    for px, py in ends:
        d = nearest(world, solids, field, px, py, np.inf)
        shut = solid(world, px, py, 0.0)
        if shut or d < reach - _TOLERANCE:
            return _proof(world, radius, px, py, 0.0 if shut else 2 * max(d, 0.0))
    if _joined(world, reach, ends):
        return None
    tree = world[solids:field]
    pairs, gaps = _near_pairs(tree, 2 * (reach - _TOLERANCE), _MAX_PAIRS)
    if len(gaps) == _MAX_PAIRS or _first_ring(tree, pairs, *ends[0], *ends[1]) < 0:
        return None
    order = np.argsort(gaps, kind="stable")
    k = order[_first_ring(tree, pairs[order], *ends[0], *ends[1])]
    a, b = (tree[i : i + SIZE] for i in pairs[k])
    square, px, py, qx, qy = closest(*a[:4], *b[:4])
    # halfway between the two surfaces
    along = 0.5 + 0.5 * (a[4] - b[4]) / math.sqrt(square) if square > 0 else 0.5
    return _proof(world, radius, px + along * (qx - px), py + along * (qy - py), float(gaps[k]))


def _proof(world: World, radius: float, x: float, y: float, width: float) -> Separation:
    return Separation(
        float(radius),
        float(2 * (radius + world[MIN_CLEARANCE])),
        float(world[X] + world[COS] * x - world[SIN] * y),
        float(world[Y] + world[SIN] * x + world[COS] * y),
        float(width),
    )


def _joined(world: World, reach: float, ends: list[tuple[float, float]]) -> bool:
    """Whether cells of the field that are wholly `reach` from all closed join two points: no proof then."""
    rows, columns, step = int(world[ROWS]), int(world[COLUMNS]), float(world[STEP])
    field = world[int(world[FIELD]) : int(world[END])].reshape(rows, columns)
    labels, _ = ndimage.label(field >= reach + step * math.sqrt(0.5))
    first, second = (
        int(labels[min(int(y / step), rows - 1), min(int(x / step), columns - 1)]) for x, y in ends
    )
    return first == second != 0


@kernel
def _near_pairs(tree: Array, width: float, most: int) -> tuple[NDArray[np.int64], Array]:
    """Places (n, 2) of segments less than `width` apart and those gaps (n,), m; at most `most`."""
    pairs, gaps = np.empty((1024, 2), np.int64), np.empty(1024)
    n, i = 0, 0
    while i < len(tree):
        mine = i + HEAD
        i = mine + SIZE * int(tree[i + 5])
        for p in range(mine, i, SIZE):
            ax, ay, bx, by, r = tree[p], tree[p + 1], tree[p + 2], tree[p + 3], tree[p + 4]
            x_min, x_max = min(ax, bx) - r - width, max(ax, bx) + r + width
            y_min, y_max = min(ay, by) - r - width, max(ay, by) + r + width
            j = 0
            while j < len(tree):
                past = j + int(tree[j + 4]) <= mine  # every pair once, from its first
                if (
                    past
                    or tree[j] > x_max
                    or tree[j + 2] < x_min
                    or tree[j + 1] > y_max
                    or tree[j + 3] < y_min
                ):
                    j += int(tree[j + 4])
                    continue
                first = j + HEAD
                j = first + SIZE * int(tree[j + 5])
                for q in range(max(first, p + SIZE), j, SIZE):
                    square = closest(ax, ay, bx, by, tree[q], tree[q + 1], tree[q + 2], tree[q + 3])[0]
                    gap = max(math.sqrt(square) - r - tree[q + 4], 0.0)
                    if gap < width:
                        if n == most:
                            return pairs[:n].copy(), gaps[:n].copy()
                        if n == len(gaps):
                            pairs = np.concatenate((pairs, np.empty_like(pairs)))
                            gaps = np.concatenate((gaps, np.empty_like(gaps)))
                        pairs[n, 0], pairs[n, 1], gaps[n] = p, q, gap
                        n += 1
    return pairs[:n].copy(), gaps[:n].copy()


@kernel
def _crosses(ax: float, ay: float, bx: float, by: float, sx: float, sy: float, gx: float, gy: float) -> bool:
    """Whether ab crosses the segment from s to g, neither of which is on it."""
    a = (gx - sx) * (ay - sy) - (gy - sy) * (ax - sx) >= 0.0
    b = (gx - sx) * (by - sy) - (gy - sy) * (bx - sx) >= 0.0
    if a == b:
        return False
    s = (bx - ax) * (sy - ay) - (by - ay) * (sx - ax) > 0.0
    g = (bx - ax) * (gy - ay) - (by - ay) * (gx - ax) > 0.0
    return s != g


@kernel
def _first_ring(tree: Array, pairs: NDArray[np.int64], sx: float, sy: float, gx: float, gy: float) -> int:
    """The first pair that, with those before it, closes a ring round one of two points only, or -1."""
    parent = np.arange(len(tree))  # by place
    odd = np.zeros(len(tree), np.bool_)  # whether the way to the parent crosses an odd number of times
    ends = np.empty(2, np.int64)
    flips = np.empty(2, np.bool_)
    for k in range(len(pairs)):
        p, q = pairs[k, 0], pairs[k, 1]
        ax, ay, bx, by = tree[p], tree[p + 1], tree[p + 2], tree[p + 3]
        cx, cy, dx, dy = tree[q], tree[q + 1], tree[q + 2], tree[q + 3]
        _, px, py, qx, qy = closest(ax, ay, bx, by, cx, cy, dx, dy)
        flip = _crosses((ax + bx) / 2, (ay + by) / 2, px, py, sx, sy, gx, gy)
        flip ^= _crosses(px, py, qx, qy, sx, sy, gx, gy)
        flip ^= _crosses(qx, qy, (cx + dx) / 2, (cy + dy) / 2, sx, sy, gx, gy)
        for e in range(2):
            i, flips[e] = pairs[k, e], False
            while parent[i] != i:
                up = parent[i]
                if parent[up] != up:  # halve the path
                    odd[i] ^= odd[up]
                    parent[i] = parent[up]
                flips[e] ^= odd[i]
                i = parent[i]
            ends[e] = i
        if ends[0] == ends[1]:
            if flip ^ flips[0] ^ flips[1]:
                return k
        else:
            parent[ends[0]] = ends[1]
            odd[ends[0]] = flip ^ flips[0] ^ flips[1]
    return -1
