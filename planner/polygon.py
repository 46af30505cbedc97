"""Simple polygons: whether one is, which way round it goes, and the largest disc inside it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.kernels import kernel
from planner.tree import HEAD, SIZE, build_tree, nearest, places, winding

__all__ = ["check_simple_polygon", "footprint_polygon", "inner_disc", "outline", "outlines"]


def footprint_polygon(vertices: Array) -> Array:
    """The same polygon (n, 2) counter-clockwise, without vertices that repeat their neighbour."""
    return _cleaned(_plain(vertices))


def outline(vertices: Array, radius: float = 0.0) -> Array:
    """The sides (n, 5) of a polygon (n, 2), for a tree: x0, y0, x1, y1, radius, m."""
    sides = np.empty((len(vertices), SIZE))
    # numpy.roll takes five times as long for a handful of them
    sides[:, :2], sides[:-1, 2:4], sides[-1:, 2:4], sides[:, 4] = vertices, vertices[1:], vertices[:1], radius
    return sides


def check_simple_polygon(vertices: Array) -> str | None:
    """What is wrong with vertices (n, 2) as a simple polygon, in a sentence, or None.

    Either winding; vertices that repeat the one before, and a last that repeats the first, are tolerated.
    Sides that touch count as crossing. O(n log n) for outlines whose sides are short beside the whole.
    """
    fault, side, x, y = _fault(_plain(vertices))
    if fault == _CROSSING:
        (ax, ay), (bx, by) = side, (x, y)
        return f"the sides that begin at ({ax:g}, {ay:g}) and ({bx:g}, {by:g}) cross or touch"
    return _FAULTS.get(fault)


def outlines(polygons: Sequence[Array]) -> tuple[Array, NDArray[np.int64], int]:
    """All vertices (n, 2) of polygons; between which two of them each side runs, (m, 2), counter-clockwise;
    and the first polygon that is not simple, or -1."""
    vertices = _plain(np.concatenate(polygons))
    return vertices, *_outlines(vertices, np.cumsum([0, *map(len, polygons)]))


def _plain(points: Array) -> Array:
    return np.array(points, dtype=np.float64, order="C").reshape(-1, 2)


_CROSSING = 4
_FAULTS = {
    1: "a vertex is not finite",
    2: "fewer than three distinct vertices",
    3: "it is larger than 1e9 m",
    5: "it has no area",
}


@kernel
def _distinct(points: Array) -> NDArray[np.int64]:
    """Which vertices (n, 2) do not repeat the one after them, the last preceding the first; a single one."""
    n = len(points)
    kept = np.empty(n, np.int64)
    m = 0
    for i in range(n):
        j = (i + 1) % n
        if n < 2 or points[i, 0] != points[j, 0] or points[i, 1] != points[j, 1]:
            kept[m] = i
            m += 1
    return kept[:m].copy()


@kernel
def _twice_area(points: Array) -> float:
    area = 0.0
    for i in range(1, len(points) - 1):
        area += _turn(
            points[0, 0], points[0, 1], points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1]
        )
    return area


@kernel
def _cleaned(points: Array) -> Array:
    points = points[_distinct(points)]
    return points[::-1].copy() if _twice_area(points) < 0.0 else points


@kernel
def _fault(vertices: Array) -> tuple[int, tuple[float, float], float, float]:
    """What is wrong, a key of _FAULTS or _CROSSING, 0 for nothing; and where two sides that cross begin."""
    none = (0.0, 0.0)
    if not np.isfinite(vertices).all():
        return 1, none, 0.0, 0.0
    points = vertices[_distinct(vertices)]
    n = len(points)
    if n < 3:
        return 2, none, 0.0, 0.0
    size = max(np.ptp(points[:, 0]), np.ptp(points[:, 1]))
    if not size < 1e9:
        return 3, none, 0.0, 0.0
    sides = np.zeros((n, SIZE))
    for i in range(n):
        j = (i + 1) % n
        sides[i, 0], sides[i, 1] = points[i, 0] - points[0, 0], points[i, 1] - points[0, 1]
        sides[i, 2], sides[i, 3] = points[j, 0] - points[0, 0], points[j, 1] - points[0, 1]
    tree = build_tree(sides)
    side, place = _first_crossing(tree, places(tree))
    if side >= 0:
        a, b = points[side], points[0] + tree[place : place + 2]
        return _CROSSING, (a[0], a[1]), b[0], b[1]
    if abs(_twice_area(points)) <= 1e-12 * size * size:
        return 5, none, 0.0, 0.0
    return 0, none, 0.0, 0.0


@kernel
def _outlines(vertices: Array, begin: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    ends = np.zeros((len(vertices), 2), np.int64)
    m = 0
    for k in range(len(begin) - 1):
        points = vertices[begin[k] : begin[k + 1]]
        if _fault(points)[0] != 0:
            return ends, k
        kept = _distinct(points)
        if _twice_area(points[kept]) < 0.0:
            kept = kept[::-1].copy()
        for i in range(len(kept)):
            ends[m, 0], ends[m, 1] = begin[k] + kept[i], begin[k] + kept[(i + 1) % len(kept)]
            m += 1
    return ends[:m].copy(), -1


@kernel
def _turn(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


@kernel
def _meet(tree: Array, p: int, q: int) -> bool:
    """Whether the segments at two places have a point in common."""
    ax, ay, bx, by = tree[p], tree[p + 1], tree[p + 2], tree[p + 3]
    cx, cy, dx, dy = tree[q], tree[q + 1], tree[q + 2], tree[q + 3]
    a, b = _turn(ax, ay, bx, by, cx, cy), _turn(ax, ay, bx, by, dx, dy)
    c, d = _turn(cx, cy, dx, dy, ax, ay), _turn(cx, cy, dx, dy, bx, by)
    if (a > 0.0 and b > 0.0) or (a < 0.0 and b < 0.0) or (c > 0.0 and d > 0.0) or (c < 0.0 and d < 0.0):
        return False
    # the signs allow it; on one line only the extents tell
    return bool(
        min(ax, bx) <= max(cx, dx)
        and min(cx, dx) <= max(ax, bx)
        and min(ay, by) <= max(cy, dy)
        and min(cy, dy) <= max(ay, by)
    )


@kernel
def _first_crossing(tree: Array, order: NDArray[np.int64]) -> tuple[int, int]:
    """A side of a closed outline, whose sides stand at the places `order`, and the place of one that it meets
    elsewhere than at a vertex they share, or (-1, -1)."""
    n = len(order)
    for k in range(n):
        p, q = order[k], order[(k + 1) % n]
        ax, ay, bx, by = tree[p], tree[p + 1], tree[p + 2], tree[p + 3]
        ahead = (bx - ax) * (tree[q + 2] - bx) + (by - ay) * (tree[q + 3] - by)
        if ahead < 0.0 and _turn(ax, ay, bx, by, tree[q + 2], tree[q + 3]) == 0.0:
            return k, q
        i = 0
        while i < len(tree):
            if (
                tree[i] > max(ax, bx)
                or tree[i + 2] < min(ax, bx)
                or tree[i + 1] > max(ay, by)
                or tree[i + 3] < min(ay, by)
            ):
                i += int(tree[i + 4])
                continue
            count = int(tree[i + 5])
            i += HEAD
            for _ in range(count):
                closing = k == 0 and i == order[n - 1]
                if i > q and p < q and not closing and _meet(tree, p, i):
                    return k, i
                i += SIZE
    return -1, -1


@kernel
def _inside(tree: Array, x: float, y: float) -> float:
    """Distance (m) from a point to the sides of a polygon, negative outside."""
    d = nearest(tree, 0, len(tree), x, y, np.inf)
    return d if winding(tree, 0, len(tree), x, y, np.inf) > 0 else -d


@kernel
def inner_disc(tree: Array) -> tuple[float, float, float]:
    """Centre and radius (m) of the largest disc, to 0.1 %, in the polygon whose sides the tree holds.

    One about the frame's origin is preferred to others of its size. Square cells are halved as long as they
    may hold a better centre (the pole of inaccessibility; Garcia-Castellanos and Lombardo, 2007).
    """
    best_x, best_y = 0.0, 0.0
    best = _inside(tree, 0.0, 0.0)
    x, y = (tree[0] + tree[2]) / 2, (tree[1] + tree[3]) / 2
    side = max(tree[2] - tree[0], tree[3] - tree[1])
    d = _inside(tree, x, y)
    if d > best * 1.001:
        best_x, best_y, best = x, y, d
    cells = np.empty((1, 2))
    cells[0, 0], cells[0, 1] = x, y
    while len(cells) > 0 and len(cells) < 100_000:
        side /= 2
        kept = np.empty((4 * len(cells), 2))
        depth = np.empty(4 * len(cells))
        n = 0
        for i in range(len(cells)):
            for k in range(4):
                x = cells[i, 0] + (0.5 if k & 1 else -0.5) * side
                y = cells[i, 1] + (0.5 if k & 2 else -0.5) * side
                d = _inside(tree, x, y)
                if d > max(best * 1.001, 0.0):
                    best_x, best_y, best = x, y, d
                if d + side * math.sqrt(0.5) > best * 1.001 and d + side * math.sqrt(0.5) > 0.0:
                    kept[n, 0], kept[n, 1], depth[n] = x, y, d
                    n += 1
        m = 0
        for i in range(n):
            if depth[i] + side * math.sqrt(0.5) > best * 1.001:
                kept[m, 0], kept[m, 1] = kept[i, 0], kept[i, 1]
                m += 1
        cells = kept[:m].copy()
    return best_x, best_y, max(best, 0.0)
