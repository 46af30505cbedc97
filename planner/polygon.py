"""Simple polygons: whether one is, which way round it goes, and the largest disc inside it."""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array
from planner.tree import Tree, kernel, nearest, plant, winding

__all__ = ["check_simple_polygon", "footprint_polygon", "inner_disc", "outline"]


def _distinct(vertices: Array) -> Array:
    """Vertices (n, 2) without those that repeat the one before them, the first following the last."""
    points = np.ascontiguousarray(vertices, dtype=np.float64).reshape(-1, 2)
    return points[(points != np.roll(points, 1, axis=0)).any(axis=1)] if len(points) > 1 else points


def _twice_area(points: Array) -> float:
    x, y = (points - points[0]).T
    return float(x @ np.roll(y, -1) - np.roll(x, -1) @ y)


def footprint_polygon(vertices: Array) -> Array:
    """The same polygon counter-clockwise, each vertex once: (n, 2) m. A closing repetition of the first is dropped."""
    points = _distinct(vertices)
    return points[::-1].copy() if len(points) > 2 and _twice_area(points) < 0 else points


def outline(vertices: Array, radius: float = 0.0) -> Array:
    """The sides (n, 5) of a polygon (n, 2), for a tree: x0, y0, x1, y1, radius, m."""
    return np.column_stack([vertices, np.roll(vertices, -1, axis=0), np.full(len(vertices), radius)])


def check_simple_polygon(vertices: Array) -> str | None:
    """What is wrong with vertices (n, 2) as a simple polygon, in a sentence, or None.

    Either winding; vertices that repeat the one before, and a last that repeats the first, are tolerated. Sides
    that touch count as crossing. O(n log n) for outlines whose sides are short beside the whole.
    """
    if not np.isfinite(vertices).all():
        return "a vertex is not finite"
    points = _distinct(vertices)
    if len(np.unique(points, axis=0)) < 3:
        return "fewer than three distinct vertices"
    size = float(np.ptp(points, axis=0).max())
    if not size < 1e9:
        return "it is larger than 1e9 m"
    first, second = _first_crossing(plant(outline(points - points[0])))
    if first >= 0:
        (ax, ay), (bx, by) = points[first], points[second]
        return f"the sides that begin at ({ax:g}, {ay:g}) and ({bx:g}, {by:g}) cross or touch"
    if abs(_twice_area(points)) <= 1e-12 * size * size:
        return "it has no area"
    return None


@kernel
def _turn(ax: float, ay: float, bx: float, by: float, cx: float, cy: float) -> float:
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


@kernel
def _meet(p: Array, q: Array) -> bool:
    """Whether two segments have a point in common."""
    a = _turn(p[0], p[1], p[2], p[3], q[0], q[1])
    b = _turn(p[0], p[1], p[2], p[3], q[2], q[3])
    c = _turn(q[0], q[1], q[2], q[3], p[0], p[1])
    d = _turn(q[0], q[1], q[2], q[3], p[2], p[3])
    if (a > 0.0 and b > 0.0) or (a < 0.0 and b < 0.0) or (c > 0.0 and d > 0.0) or (c < 0.0 and d < 0.0):
        return False
    # the signs allow it; on one line only the extents tell
    return (
        min(p[0], p[2]) <= max(q[0], q[2])
        and min(q[0], q[2]) <= max(p[0], p[2])
        and min(p[1], p[3]) <= max(q[1], q[3])
        and min(q[1], q[3]) <= max(p[1], p[3])
    )


@kernel
def _first_crossing(tree: Tree) -> tuple[int, int]:
    """Two sides of a closed outline, in order, that meet elsewhere than at a vertex they share, or (-1, -1)."""
    sides = tree.segments
    n = len(sides)
    for i in range(n):
        p = sides[i]
        x_min, x_max, y_min, y_max = min(p[0], p[2]), max(p[0], p[2]), min(p[1], p[3]), max(p[1], p[3])
        after = sides[(i + 1) % n]
        if _turn(p[0], p[1], p[2], p[3], after[2], after[3]) == 0.0:
            if (p[2] - p[0]) * (after[2] - after[0]) + (p[3] - p[1]) * (after[3] - after[1]) < 0.0:
                return i, (i + 1) % n
        b = 0
        while b < len(tree.boxes):
            box = tree.boxes[b]
            if box[0] > x_max or box[2] < x_min or box[1] > y_max or box[3] < y_min:
                b = tree.links[b, 0]
                continue
            first = tree.links[b, 1]
            for j in range(max(first, i + 2), first + tree.links[b, 2]):
                if (i > 0 or j < n - 1) and _meet(p, sides[j]):
                    return i, j
            b += 1
    return -1, -1


@kernel
def _inside(tree: Tree, x: float, y: float) -> float:
    """Distance (m) from a point to the sides of a polygon, negative outside."""
    d = nearest(tree, x, y, np.inf)
    return d if winding(tree, len(tree.boxes), x, y) > 0 else -d


@kernel
def inner_disc(tree: Tree) -> tuple[float, float, float]:
    """Centre and radius (m) of a disc in the polygon of counter-clockwise sides, at most 0.1 % less than the largest.

    The one about the frame's origin is preferred to others of its size. Square cells are halved as long as
    they may hold a better centre (the pole of inaccessibility; Garcia-Castellanos and Lombardo, 2007).
    """
    box = tree.boxes[0]
    best_x, best_y = 0.0, 0.0
    best = _inside(tree, 0.0, 0.0)
    x, y = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    side = max(box[2] - box[0], box[3] - box[1])
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
