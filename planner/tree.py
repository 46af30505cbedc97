"""Segments in a bounding box tree: building it, and measuring points and segments against it. Compiled.

A segment is x0, y0, x1, y1, radius (m): a circle is a segment of no length. A tree is one flat array of
records in depth-first order, so that a walk needs no stack, trees put end to end are a tree, and a tree can
lie inside a larger array, from `start` to `stop`. A record holds

    x_min, y_min, x_max, y_max     the box of all that follows up to the jump, radii included
    jump                           how far on to go when the box is missed
    count                          the segments that follow, five numbers each; 0 where records follow
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.kernels import kernel

__all__ = [
    "HEAD",
    "SIZE",
    "build_tree",
    "closest",
    "edge_distance",
    "foot",
    "nearest",
    "places",
    "plant",
    "winding",
    "within",
]

HEAD = 6
"""Numbers in a record, its segments left out."""

SIZE = 5
"""Numbers in a segment."""

_LEAF = 4


def plant(segments: Array, ordered: bool = False) -> Array:
    """The tree over segments (m, 5), in their order where `ordered`, for neighbours that stand together."""
    segments = np.ascontiguousarray(segments, dtype=np.float64)
    if not ordered and len(segments) > _LEAF:
        segments = segments[np.argsort(_hilbert(segments), kind="stable")]
    return build_tree(segments)


@kernel
def build_tree(segments: Array) -> Array:
    """The tree over segments (m, 5), in their order."""
    m = len(segments)
    low, high = np.empty(2 * m + 1, np.int64), np.empty(2 * m + 1, np.int64)
    place = np.empty(2 * m + 1, np.int64)
    stack = np.empty((128, 2), np.int64)
    n, top, size = 0, 0, 0
    if m > 0:
        stack[0, 0], stack[0, 1], top = 0, m, 1
    while top > 0:
        top -= 1
        a, b = stack[top, 0], stack[top, 1]
        low[n], high[n], place[n] = a, b, size
        n += 1
        size += HEAD
        if b - a > _LEAF:
            middle = (a + b) // 2
            stack[top, 0], stack[top, 1] = middle, b
            stack[top + 1, 0], stack[top + 1, 1] = a, middle
            top += 2
        else:
            size += SIZE * (b - a)
    tree = np.empty(size)
    for r in range(n - 1, -1, -1):
        i = place[r]
        tree[i], tree[i + 1], tree[i + 2], tree[i + 3] = np.inf, np.inf, -np.inf, -np.inf
        if high[r] - low[r] > _LEAF:
            left = i + HEAD
            right = left + int(tree[left + 4])
            for k in range(2):
                tree[i + k] = min(tree[left + k], tree[right + k])
                tree[i + 2 + k] = max(tree[left + 2 + k], tree[right + 2 + k])
            tree[i + 4], tree[i + 5] = right - i + tree[right + 4], 0.0
            continue
        j = i + HEAD
        for s in range(low[r], high[r]):
            radius = segments[s, 4]
            for k in range(SIZE):
                tree[j + k] = segments[s, k]
            for k in range(2):
                tree[i + k] = min(tree[i + k], tree[j + k] - radius, tree[j + k + 2] - radius)
                tree[i + 2 + k] = max(tree[i + 2 + k], tree[j + k] + radius, tree[j + k + 2] + radius)
            j += SIZE
        tree[i + 4], tree[i + 5] = j - i, high[r] - low[r]
    return tree


@kernel
def _hilbert(segments: Array) -> NDArray[np.int64]:
    """Places (m,) of the segments' middles along a Hilbert curve of 2^16 × 2^16 cells over all of them."""
    keys = np.empty(len(segments), np.int64)
    x_min = y_min = np.inf
    x_max = y_max = -np.inf
    for k in range(len(segments)):
        x, y = segments[k, 0] + segments[k, 2], segments[k, 1] + segments[k, 3]
        x_min, x_max, y_min, y_max = min(x_min, x), max(x_max, x), min(y_min, y), max(y_max, y)
    size = max(x_max - x_min, y_max - y_min)
    scale = 65535.0 / size if size > 0 else 0.0
    for k in range(len(segments)):
        x = int((segments[k, 0] + segments[k, 2] - x_min) * scale)
        y = int((segments[k, 1] + segments[k, 3] - y_min) * scale)
        key, side = 0, 32768
        while side > 0:
            right, upper = int((x & side) > 0), int((y & side) > 0)
            key += side * side * ((3 * right) ^ upper)
            if upper == 0:
                if right == 1:
                    x, y = 65535 - x, 65535 - y
                x, y = y, x
            side //= 2
        keys[k] = key
    return keys


@kernel
def places(tree: Array) -> NDArray[np.int64]:
    """Where each segment (m,) of a tree begins."""
    found = np.empty(len(tree) // SIZE, np.int64)
    n, i = 0, 0
    while i < len(tree):
        count = int(tree[i + 5])
        i += HEAD
        for _ in range(count):
            found[n] = i
            n += 1
            i += SIZE
    return found[:n].copy()


@kernel
def foot(px: float, py: float, ax: float, ay: float, bx: float, by: float) -> tuple[float, float]:
    """The point of segment ab nearest to p."""
    ux, uy = bx - ax, by - ay
    square = ux * ux + uy * uy
    if square == 0.0:
        return ax, ay
    t = min(1.0, max(0.0, ((px - ax) * ux + (py - ay) * uy) / square))
    return ax + t * ux, ay + t * uy


@kernel
def closest(
    ax: float, ay: float, bx: float, by: float, cx: float, cy: float, dx: float, dy: float
) -> tuple[float, float, float, float, float]:
    """Squared distance of segments ab and cd, and the points of ab and of cd where it is attained."""
    ux, uy, vx, vy = bx - ax, by - ay, dx - cx, dy - cy
    wx, wy = cx - ax, cy - ay
    best, px, py, qx, qy = np.inf, ax, ay, cx, cy
    det = ux * vy - uy * vx
    if det != 0.0:
        t, k = (wx * vy - wy * vx) / det, (wx * uy - wy * ux) / det
        if 0.0 <= t <= 1.0 and 0.0 <= k <= 1.0:
            # Measured rather than taken for zero: for segments on one line t and k are noise.
            px, py, qx, qy = ax + t * ux, ay + t * uy, cx + k * vx, cy + k * vy
            best = (qx - px) ** 2 + (qy - py) ** 2
            if best < 1e-24:
                return 0.0, px, py, px, py
    fx, fy = foot(ax, ay, cx, cy, dx, dy)
    d = (fx - ax) ** 2 + (fy - ay) ** 2
    if d < best:
        best, px, py, qx, qy = d, ax, ay, fx, fy
    fx, fy = foot(bx, by, cx, cy, dx, dy)
    d = (fx - bx) ** 2 + (fy - by) ** 2
    if d < best:
        best, px, py, qx, qy = d, bx, by, fx, fy
    fx, fy = foot(cx, cy, ax, ay, bx, by)
    d = (fx - cx) ** 2 + (fy - cy) ** 2
    if d < best:
        best, px, py, qx, qy = d, fx, fy, cx, cy
    fx, fy = foot(dx, dy, ax, ay, bx, by)
    d = (fx - dx) ** 2 + (fy - dy) ** 2
    if d < best:
        best, px, py, qx, qy = d, fx, fy, dx, dy
    return best, px, py, qx, qy


@kernel
def nearest(tree: Array, start: int, stop: int, x: float, y: float, best: float) -> float:
    """Distance (m) from a point to the nearest segment less its radius, or `best` where that is smaller."""
    i = start
    while i < stop and best > 0.0:
        dx = max(tree[i] - x, 0.0, x - tree[i + 2])
        dy = max(tree[i + 1] - y, 0.0, y - tree[i + 3])
        if dx * dx + dy * dy >= best * best:
            i += int(tree[i + 4])
            continue
        count = int(tree[i + 5])
        i += HEAD
        for _ in range(count):
            fx, fy = foot(x, y, tree[i], tree[i + 1], tree[i + 2], tree[i + 3])
            best = min(best, math.sqrt((x - fx) ** 2 + (y - fy) ** 2) - tree[i + 4])
            i += SIZE
    return best


@kernel
def within(
    tree: Array, start: int, stop: int, x: float, y: float, distance: float, found: NDArray[np.int64]
) -> int:
    """How many segments, less their radius, come within a distance (m) of a point, and into found (n,) their
    places in the tree; n + 1 where there is no room for them all."""
    i, n = start, 0
    while i < stop:
        dx = max(tree[i] - x, 0.0, x - tree[i + 2])
        dy = max(tree[i + 1] - y, 0.0, y - tree[i + 3])
        if dx * dx + dy * dy > max(distance, 0.0) ** 2:
            i += int(tree[i + 4])
            continue
        count = int(tree[i + 5])
        i += HEAD
        for _ in range(count):
            fx, fy = foot(x, y, tree[i], tree[i + 1], tree[i + 2], tree[i + 3])
            if math.sqrt((x - fx) ** 2 + (y - fy) ** 2) - tree[i + 4] <= distance:
                if n == len(found):
                    return n + 1
                found[n] = i
                n += 1
            i += SIZE
    return n


@kernel
def edge_distance(
    tree: Array, start: int, stop: int, ax: float, ay: float, bx: float, by: float, best: float
) -> float:
    """Distance (m) from segment ab to the nearest segment less its radius, or `best` >= 0 if smaller."""
    x_min, x_max, y_min, y_max = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
    i = start
    while i < stop:
        dx = max(tree[i] - x_max, 0.0, x_min - tree[i + 2])
        dy = max(tree[i + 1] - y_max, 0.0, y_min - tree[i + 3])
        if dx * dx + dy * dy >= best * best:
            i += int(tree[i + 4])
            continue
        count = int(tree[i + 5])
        i += HEAD
        for _ in range(count):
            square = closest(tree[i], tree[i + 1], tree[i + 2], tree[i + 3], ax, ay, bx, by)[0]
            best = min(best, math.sqrt(square) - tree[i + 4])
            i += SIZE
    return best


@kernel
def _left(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> bool:
    """Whether a point is left of where side ab, which is not level, passes its height."""
    if x < min(ax, bx) or x > max(ax, bx):  # as the boxes tell it, whatever rounding would
        return x < min(ax, bx)
    side = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    return side > 0.0 if by > ay else side < 0.0


@kernel
def winding(tree: Array, start: int, stop: int, x: float, y: float, until: float) -> int:
    """How many times more the outlines go counter-clockwise round (x, y) than round (until, y), neither of
    them on an outline. until = inf: round (x, y) alone."""
    count, i = 0, start
    while i < stop:
        if y < tree[i + 1] or y > tree[i + 3] or x > tree[i + 2] or until < tree[i]:
            i += int(tree[i + 4])
            continue
        sides = int(tree[i + 5])
        i += HEAD
        for _ in range(sides):
            ax, ay, bx, by = tree[i], tree[i + 1], tree[i + 2], tree[i + 3]
            i += SIZE
            if (ay <= y) != (by <= y) and _left(x, y, ax, ay, bx, by) and not _left(until, y, ax, ay, bx, by):
                count += 1 if by > ay else -1
    return count
