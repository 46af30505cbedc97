"""Simple polygons: whether one is, which way round it goes, and the largest disc inside it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.tree import HEAD, SIZE, kernel, nearest, places, plant, winding

__all__ = ["check_simple_polygon", "footprint_polygon", "inner_disc", "outline"]


def _shifted(points: Array) -> Array:
    """Each vertex's successor; numpy.roll takes five times as long for a handful of them."""
    return np.concatenate([points[1:], points[:1]])


def _distinct(vertices: Array) -> Array:
    """Vertices (n, 2) without those that repeat the one after them, the last preceding the first."""
    points = np.ascontiguousarray(vertices, dtype=np.float64).reshape(-1, 2)
    if len(points) < 2:
        return points
    keep: NDArray[np.bool_] = (points != _shifted(points)).any(axis=1)
    return points if keep.all() else points[keep]


def _twice_area(points: Array) -> float:
    x, y = (points - points[0]).T
    return float(x[:-1] @ y[1:] - x[1:] @ y[:-1])  # what the last side adds is nought, the first being (0, 0)


def footprint_polygon(vertices: Array) -> Array:
    """The same polygon (n, 2) counter-clockwise, without vertices that repeat their neighbour."""
    points = _distinct(vertices)
    return points[::-1].copy() if len(points) > 2 and _twice_area(points) < 0 else points


def outline(vertices: Array, radius: float = 0.0) -> Array:
    """The sides (n, 5) of a polygon (n, 2), for a tree: x0, y0, x1, y1, radius, m."""
    sides = np.empty((len(vertices), SIZE))
    sides[:, :2], sides[:, 2:4], sides[:, 4] = vertices, _shifted(vertices), radius
    return sides


def check_simple_polygon(vertices: Array) -> str | None:
    """What is wrong with vertices (n, 2) as a simple polygon, in a sentence, or None.

    Either winding; vertices that repeat the one before, and a last that repeats the first, are tolerated.
    Sides that touch count as crossing. O(n log n) for outlines whose sides are short beside the whole.
    """
    if not np.isfinite(vertices).all():
        return "a vertex is not finite"
    points = _distinct(vertices)
    if len(points) < 3:
        return "fewer than three distinct vertices"
    size = float((points.max(axis=0) - points.min(axis=0)).max())
    if not size < 1e9:
        return "it is larger than 1e9 m"
    tree = plant(outline(points - points[0]), ordered=True)
    side, place = _first_crossing(tree, places(tree))
    if side >= 0:
        (ax, ay), (bx, by) = points[side], points[0] + tree[place : place + 2]
        return f"the sides that begin at ({ax:g}, {ay:g}) and ({bx:g}, {by:g}) cross or touch"
    if abs(_twice_area(points)) <= 1e-12 * size * size:
        return "it has no area"
    return None


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
