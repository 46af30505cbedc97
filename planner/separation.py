"""A proof that there is no path: the largest disc inside the footprint cannot get from the start to the goal.

Grow every boundary by the disc's radius. Each grown segment is convex, so their union parts start from goal
exactly when some ring of segments, each less than the disc's width from the next, crosses the line from start
to goal an odd number of times. That needs no grid: it is a union-find over pairs of segments that also keeps
the parity of those crossings. Taking the pairs narrowest first gives the widest passage, still too narrow.

Most often there is nothing to prove, and a search over a lattice finds so first. Where it does not, it has
seen all that can be reached from the start or from the goal, and the ring is about that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array, Pose
from planner.collision import (
    BODY,
    COS,
    DISCS,
    FIELD,
    HEADING,
    INNER_RADIUS,
    INNER_X,
    INNER_Y,
    MIN_CLEARANCE,
    RADIUS,
    SIN,
    SOLIDS,
    World,
    X,
    Y,
    body_point,
    solid,
)
from planner.kernels import kernel
from planner.lattice import shortest
from planner.problem import Goal
from planner.tree import HEAD, SIZE, closest, edge_distance, nearest, plant, winding

__all__ = ["Separation", "separate"]

_MAX_PAIRS = 2_000_000
_TOLERANCE = 1e-6  # m: what is this close to fitting is taken to fit
_SHARES = (2.0, 0.5)
"""Spacings of lattices, tried in turn, over the disc's radius."""
_HASTE = 10.0
"""How much heavier the way still to go weighs there than what is behind: any way will do."""
_WORK_START, _WORK_STRAIGHT, _WORK_MAX = 1_000, 2.0, 64_000
"""How many of its nodes are looked at from either end: at first, or for each between them as the crow flies
if that is more, and at most."""
_MARGIN = 4.0
"""How far, in radii, a ring may be from what it goes round."""
_SMALL = 1 << 16
"""Numbers in a tree, all of which are examined at once."""


Point: TypeAlias = tuple[float, float]
Box: TypeAlias = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Separation:
    """No path: a disc of `radius` (m) inside the footprint would have to pass a gap of `width` around (x, y),
    and needs `width_needed` with the clearance asked for. No other way is wider (in a large world: no other
    way out of what surrounds the start or the goal); width 0 is a closed wall. Where the disc does not even
    fit at the start or the goal, (x, y) is its centre there. World frame, m."""

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
    ends = [body_point(world, pose, x, y) for pose in (start, Pose(goal.x, goal.y, goal.theta or 0.0))]
    for px, py in ends:
        d = nearest(world, solids, field, px, py, reach)
        shut = solid(world, px, py, 0.0)
        if shut or d < reach - _TOLERANCE:
            return _proof(world, radius, px, py, 0.0 if shut else 2 * max(d, 0.0))
    joined, box = _explored(world, reach, ends)
    if joined:
        return None
    tree = world[solids:field]
    found = None
    if box is not None and len(tree) > _SMALL:
        found = _narrow(plant(_within(tree, *box, _MARGIN * reach), ordered=True), reach, ends)
    found = found or _narrow(tree, reach, ends)
    return found and _proof(world, radius, *found)


def _narrow(tree: Array, reach: float, ends: list[Point]) -> tuple[float, float, float] | None:
    """The middle and the width (m) of the widest gap of a ring of segments that parts two points."""
    pairs, gaps = _near_pairs(tree, 2 * (reach - _TOLERANCE), _MAX_PAIRS)
    if len(gaps) == _MAX_PAIRS or _first_ring(tree, pairs, *ends[0], *ends[1]) < 0:
        return None
    order = np.argsort(gaps, kind="stable")
    k = order[_first_ring(tree, pairs[order], *ends[0], *ends[1])]
    a, b = (tree[i : i + SIZE] for i in pairs[k])
    square, px, py, qx, qy = closest(*a[:4], *b[:4])
    # halfway between the two surfaces
    along = 0.5 + 0.5 * (a[4] - b[4]) / math.sqrt(square) if square > 0 else 0.5
    return px + along * (qx - px), py + along * (qy - py), float(gaps[k])


def _proof(world: World, radius: float, x: float, y: float, width: float) -> Separation:
    return Separation(
        float(radius),
        float(2 * (radius + world[MIN_CLEARANCE])),
        float(world[X] + world[COS] * x - world[SIN] * y),
        float(world[Y] + world[SIN] * x + world[COS] * y),
        float(width),
    )


def _explored(world: World, reach: float, ends: list[Point]) -> tuple[bool, Box | None]:
    """Whether a disc of radius `reach` surely gets from one point to the other; if not, the box of all places
    to which it gets from one of them, as far as is known."""
    box = None
    for share in _SHARES:
        joined, box = _over_lattice(world, reach, share * reach, ends)
        if joined:
            break
    return joined, box


def _over_lattice(world: World, reach: float, spacing: float, ends: list[Point]) -> tuple[bool, Box | None]:
    # Between neighbours with so much room, the disc passes.
    least = math.hypot(reach, spacing / math.sqrt(2))
    work = min(max(_WORK_START, int(_WORK_STRAIGHT * math.dist(*ends) / spacing)), _WORK_MAX)
    while work <= _WORK_MAX:
        for a, b in (ends, ends[::-1]):
            way, whole, box = shortest(
                world, a, b, least, least, spacing, False, np.empty((0, 2)), _HASTE, work
            )
            if len(way) > 0:
                # The start and the goal themselves may have less room.
                return _passes(world, way[:2], reach) and _passes(world, way[-2:], reach), None
            if whole:
                return False, box
        work *= 4
    return False, None


@kernel
def _passes(world: World, leg: Array, reach: float) -> bool:
    """Whether all of a leg (2, 2) keeps `reach` from the boundaries."""
    solids, field = int(world[SOLIDS]), int(world[FIELD])
    return edge_distance(world, solids, field, leg[0, 0], leg[0, 1], leg[1, 0], leg[1, 1], reach) >= reach


@kernel
def _within(tree: Array, x_min: float, y_min: float, x_max: float, y_max: float, beyond: float) -> Array:
    """The segments (n, 5) of a tree that come within `beyond` (m) of a box."""
    found = np.empty((len(tree) // SIZE, SIZE))
    n, i = 0, 0
    while i < len(tree):
        if (
            tree[i] > x_max + beyond
            or tree[i + 2] < x_min - beyond
            or tree[i + 1] > y_max + beyond
            or tree[i + 3] < y_min - beyond
        ):
            i += int(tree[i + 4])
            continue
        count = int(tree[i + 5])
        i += HEAD
        for _ in range(count):
            for k in range(SIZE):
                found[n, k] = tree[i + k]
            n += 1
            i += SIZE
    return found[:n].copy()


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
