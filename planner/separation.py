"""A proof that there is no path: the largest disc inside the footprint cannot get from the start to the goal.

Grow every boundary by the disc's radius. Each grown segment is convex, so their union parts start from goal
exactly when some ring of segments, each less than the disc's width from the next, crosses the line from start to
goal an odd number of times. That needs no grid: it is a union-find over pairs of segments which also keeps the
parity of those crossings. Taking the pairs narrowest first gives the widest passage that is still too narrow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from drives.se2 import Array, Pose
from planner.collision import World, footprint_heading, solid, to_local
from planner.polygon import inner_disc
from planner.problem import Goal
from planner.tree import Tree, closest, kernel, nearest, winding

__all__ = ["Separation", "separate"]

_MAX_PAIRS = 2_000_000
_TOLERANCE = 1e-6  # m: what is this close to fitting is taken to fit


@dataclass(frozen=True, slots=True)
class Separation:
    """No path: a disc of `radius` (m) inside the footprint would have to pass a gap of `width`, around (x, y) in the
    world frame, and needs `width_needed` with the clearance asked for. No other way is wider. width 0: a closed
    wall. Where the disc does not even fit at the start or the goal, (x, y) is its centre there."""

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
    body = world.body
    x, y, inner = body.inner_x, body.inner_y, body.inner_radius
    if goal.theta is None and math.isnan(body.heading):
        held = winding(body.edges, len(body.edges.boxes), 0.0, 0.0) > 0
        x, y, inner = 0.0, 0.0, nearest(body.edges, 0.0, 0.0, np.inf) if held else 0.0
        if not held and (len(body.edges.segments) > 1 or body.reach > 0.0):
            return None
    radius = inner + body.radius
    reach = radius + world.min_clearance
    ends = []
    for pose in (start, Pose(goal.x, goal.y, goal.theta or 0.0)):
        px, py, heading = to_local(world, *pose)
        heading = footprint_heading(world, heading)
        c, s = math.cos(heading), math.sin(heading)
        ends.append((px + c * x - s * y, py + s * x + c * y))
    (sx, sy), (gx, gy) = ends
    for px, py in ends:
        d = nearest(world.tree, px, py, np.inf)
        if d < reach - _TOLERANCE or solid(world, px, py):
            return _proof(world, radius, px, py, 0.0 if solid(world, px, py) else 2 * max(d, 0.0))
    if _joined(world, reach, sx, sy, gx, gy):
        return None
    pairs, gaps = _near_pairs(world.tree, 2 * (reach - _TOLERANCE), _MAX_PAIRS)
    if len(gaps) == _MAX_PAIRS:
        return None
    if _first_ring(world.tree, pairs, sx, sy, gx, gy) < 0:
        return None
    order = np.argsort(gaps, kind="stable")
    k = order[_first_ring(world.tree, pairs[order], sx, sy, gx, gy)]
    a, b = world.tree.segments[pairs[k, 0]], world.tree.segments[pairs[k, 1]]
    d2, px, py, qx, qy = closest(*a[:4], *b[:4])
    # halfway between the two surfaces
    along = 0.5 + 0.5 * (a[4] - b[4]) / math.sqrt(d2) if d2 > 0 else 0.5
    return _proof(world, radius, px + along * (qx - px), py + along * (qy - py), float(gaps[k]))


def _proof(world: World, radius: float, x: float, y: float, width: float) -> Separation:
    frame = world.frame
    return Separation(
        radius,
        2 * (radius + world.min_clearance),
        frame.x + frame.cos * x - frame.sin * y,
        frame.y + frame.sin * x + frame.cos * y,
        width,
    )


def _joined(world: World, reach: float, sx: float, sy: float, gx: float, gy: float) -> bool:
    """Whether cells of the field that are wholly `reach` from everything closed join two points: no proof then."""
    labels, _ = ndimage.label(world.field >= reach + world.step * math.sqrt(0.5))
    found = []
    for x, y in ((sx, sy), (gx, gy)):
        i, j = int((y - world.y0) // world.step), int((x - world.x0) // world.step)
        inside = 0 <= i < labels.shape[0] and 0 <= j < labels.shape[1]
        found.append(int(labels[i, j]) if inside else 0)
    return found[0] == found[1] != 0


@kernel
def _near_pairs(tree: Tree, width: float, most: int) -> tuple[NDArray[np.int64], Array]:
    """Pairs (n, 2) of segments with a gap less than `width` between them and those gaps (n,), m; at most `most`."""
    pairs = np.empty((1024, 2), np.int64)
    gaps = np.empty(1024)
    n = 0
    for i in range(len(tree.segments)):
        s = tree.segments[i]
        reach = s[4] + width
        x_min, x_max = min(s[0], s[2]) - reach, max(s[0], s[2]) + reach
        y_min, y_max = min(s[1], s[3]) - reach, max(s[1], s[3]) + reach
        b = 0
        while b < len(tree.boxes):
            box = tree.boxes[b]
            if box[0] > x_max or box[2] < x_min or box[1] > y_max or box[3] < y_min:
                b = tree.links[b, 0]
                continue
            first = tree.links[b, 1]
            for j in range(max(first, i + 1), first + tree.links[b, 2]):
                o = tree.segments[j]
                square = closest(s[0], s[1], s[2], s[3], o[0], o[1], o[2], o[3])[0]
                gap = max(math.sqrt(square) - s[4] - o[4], 0.0)
                if gap < width:
                    if n == most:
                        return pairs[:n].copy(), gaps[:n].copy()
                    if n == len(gaps):
                        pairs = np.concatenate((pairs, np.empty_like(pairs)))
                        gaps = np.concatenate((gaps, np.empty_like(gaps)))
                    pairs[n, 0], pairs[n, 1], gaps[n] = i, j, gap
                    n += 1
            b += 1
    return pairs[:n].copy(), gaps[:n].copy()


@kernel
def _crosses(ax: float, ay: float, bx: float, by: float, sx: float, sy: float, gx: float, gy: float) -> bool:
    """Whether ab crosses the segment from s to g, neither of which is on it. Every point is on one side or other."""
    a = (gx - sx) * (ay - sy) - (gy - sy) * (ax - sx) >= 0.0
    b = (gx - sx) * (by - sy) - (gy - sy) * (bx - sx) >= 0.0
    if a == b:
        return False
    s = (bx - ax) * (sy - ay) - (by - ay) * (sx - ax) > 0.0
    g = (bx - ax) * (gy - ay) - (by - ay) * (gx - ax) > 0.0
    return s != g


@kernel
def _first_ring(tree: Tree, pairs: NDArray[np.int64], sx: float, sy: float, gx: float, gy: float) -> int:
    """The first pair that, with those before it, closes a ring round one of two points and not the other, or -1."""
    parent = np.arange(len(tree.segments))
    odd = np.zeros(
        len(tree.segments), np.bool_
    )  # whether the way to the parent crosses an odd number of times
    ends = np.empty(2, np.int64)
    flips = np.empty(2, np.bool_)
    for k in range(len(pairs)):
        a, b = tree.segments[pairs[k, 0]], tree.segments[pairs[k, 1]]
        _, px, py, qx, qy = closest(a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3])
        flip = _crosses((a[0] + a[2]) / 2, (a[1] + a[3]) / 2, px, py, sx, sy, gx, gy)
        flip ^= _crosses(px, py, qx, qy, sx, sy, gx, gy)
        flip ^= _crosses(qx, qy, (b[0] + b[2]) / 2, (b[1] + b[3]) / 2, sx, sy, gx, gy)
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
