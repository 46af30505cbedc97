"""Segments in a bounding box tree: building it, and measuring points and segments against it. Compiled.

A segment may have a radius, so that a circle is a segment of no length. Boxes stand in depth-first order with
the place to go on at when one is missed, so a walk needs no stack, and two trees put end to end are a tree.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drives.se2 import Array

__all__ = ["Tree", "closest", "edge_distance", "foot", "hilbert", "kernel", "nearest", "plant", "winding"]

_LEAF = 4

_F = TypeVar("_F", bound=Callable[..., Any])


def kernel(function: _F) -> _F:
    """Compile on first use and keep the machine code beside the source."""
    return cast(_F, njit(cache=True, error_model="numpy")(function))


class Tree(NamedTuple):
    """Segments and the boxes over them, in depth-first order, so that two trees put end to end are a tree.

    segments (m, 5): x0, y0, x1, y1, radius, m. boxes (n, 4): x_min, y_min, x_max, y_max, radius included.
    links (n, 3): the next box when this one is missed, the first segment, the number of segments (0: inner).
    """

    segments: Array
    boxes: Array
    links: NDArray[np.int64]


@kernel
def plant(segments: Array) -> Tree:
    """The tree over segments (m, 5) in the order given, which should keep neighbours together."""
    m = len(segments)
    low = np.empty(2 * m + 1, np.int64)
    high = np.empty(2 * m + 1, np.int64)
    stack = np.empty((128, 2), np.int64)
    n, top = 0, 0
    if m > 0:
        stack[0, 0], stack[0, 1], top = 0, m, 1
    while top > 0:
        top -= 1
        a, b = stack[top, 0], stack[top, 1]
        low[n], high[n] = a, b
        n += 1
        if b - a > _LEAF:
            middle = (a + b) // 2
            stack[top, 0], stack[top, 1] = middle, b
            stack[top + 1, 0], stack[top + 1, 1] = a, middle
            top += 2
    boxes = np.empty((n, 4))
    links = np.empty((n, 3), np.int64)
    for i in range(n - 1, -1, -1):
        a, b = low[i], high[i]
        if b - a <= _LEAF:
            box = (np.inf, np.inf, -np.inf, -np.inf)
            for k in range(a, b):
                x0, y0, x1, y1, r = segments[k]
                box = (
                    min(box[0], x0 - r, x1 - r),
                    min(box[1], y0 - r, y1 - r),
                    max(box[2], x0 + r, x1 + r),
                    max(box[3], y0 + r, y1 + r),
                )
            boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3] = box
            links[i, 0], links[i, 1], links[i, 2] = i + 1, a, b - a
        else:
            left = i + 1
            right = links[left, 0]
            boxes[i, :2] = np.minimum(boxes[left, :2], boxes[right, :2])
            boxes[i, 2:] = np.maximum(boxes[left, 2:], boxes[right, 2:])
            links[i, 0], links[i, 1], links[i, 2] = links[right, 0], a, 0
    return Tree(segments, boxes, links)


@kernel
def hilbert(segments: Array) -> NDArray[np.int64]:
    """Places (m,) of the segments' middles along a Hilbert curve of 2^16 × 2^16 cells over all of them."""
    keys = np.empty(len(segments), np.int64)
    x_min = y_min = np.inf
    size = 0.0
    for k in range(len(segments)):
        x_min = min(x_min, segments[k, 0], segments[k, 2])
        y_min = min(y_min, segments[k, 1], segments[k, 3])
    for k in range(len(segments)):
        size = max(
            size,
            segments[k, 0] - x_min,
            segments[k, 2] - x_min,
            segments[k, 1] - y_min,
            segments[k, 3] - y_min,
        )
    scale = 65535.0 / size if size > 0 else 0.0
    for k in range(len(segments)):
        x = int(((segments[k, 0] + segments[k, 2]) / 2 - x_min) * scale)
        y = int(((segments[k, 1] + segments[k, 3]) / 2 - y_min) * scale)
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
def nearest(tree: Tree, x: float, y: float, best: float) -> float:
    """Distance (m) from a point to the nearest segment less its radius, or `best` where that is smaller."""
    i = 0
    while i < len(tree.boxes) and best > 0.0:
        dx = max(tree.boxes[i, 0] - x, 0.0, x - tree.boxes[i, 2])
        dy = max(tree.boxes[i, 1] - y, 0.0, y - tree.boxes[i, 3])
        if dx * dx + dy * dy >= best * best:
            i = tree.links[i, 0]
            continue
        first = tree.links[i, 1]
        for k in range(first, first + tree.links[i, 2]):
            fx, fy = foot(
                x, y, tree.segments[k, 0], tree.segments[k, 1], tree.segments[k, 2], tree.segments[k, 3]
            )
            best = min(best, math.sqrt((x - fx) ** 2 + (y - fy) ** 2) - tree.segments[k, 4])
        i += 1
    return best


@kernel
def winding(tree: Tree, stop: int, x: float, y: float) -> int:
    """How many counter-clockwise outlines among the first `stop` boxes go round a point that is on none."""
    count, i = 0, 0
    while i < stop:
        if y < tree.boxes[i, 1] or y > tree.boxes[i, 3] or x > tree.boxes[i, 2]:
            i = tree.links[i, 0]
            continue
        first = tree.links[i, 1]
        for k in range(first, first + tree.links[i, 2]):
            ax, ay, bx, by = (
                tree.segments[k, 0],
                tree.segments[k, 1],
                tree.segments[k, 2],
                tree.segments[k, 3],
            )
            if (ay <= y) != (by <= y):
                left = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
                if by > ay and left > 0.0:
                    count += 1
                elif by <= ay and left < 0.0:
                    count -= 1
        i += 1
    return count


@kernel
def edge_distance(tree: Tree, ax: float, ay: float, bx: float, by: float, best: float) -> float:
    """Distance (m) from segment ab to the nearest segment, radii left out, or `best` >= 0 if smaller."""
    x_min, x_max, y_min, y_max = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
    i = 0
    while i < len(tree.boxes):
        dx = max(tree.boxes[i, 0] - x_max, 0.0, x_min - tree.boxes[i, 2])
        dy = max(tree.boxes[i, 1] - y_max, 0.0, y_min - tree.boxes[i, 3])
        if dx * dx + dy * dy >= best * best:
            i = tree.links[i, 0]
            continue
        first = tree.links[i, 1]
        for k in range(first, first + tree.links[i, 2]):
            s = tree.segments[k]
            best = min(best, math.sqrt(closest(s[0], s[1], s[2], s[3], ax, ay, bx, by)[0]))
        i += 1
    return best
