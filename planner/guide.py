"""Routes for a search to follow: short ways, as roomy as may be, of the largest disc inside the footprint.

A* over a lattice of the disc's centres, walls kept at a distance where that costs little. A route guides;
what is free is decided elsewhere.
"""

from __future__ import annotations

import heapq
import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drives.se2 import Array, Pose
from planner.collision import (
    COLUMNS,
    COS,
    FIELD,
    HEADING,
    INNER_RADIUS,
    INNER_X,
    INNER_Y,
    MIN_CLEARANCE,
    RADIUS,
    REACH,
    ROWS,
    SIN,
    SOLIDS,
    STEP,
    YAW,
    World,
    X,
    Y,
    field_bounds,
    footprint_heading,
    solid,
    to_local,
)
from planner.tree import kernel, nearest

__all__ = ["Guide", "Route"]

_NODES = 2_000_000
_EXPANDED = 400_000
"""Lattice nodes at most, and how many of them may be looked at."""
_SHARE = 0.7
"""Lattice spacing over the disc's radius."""
_SHYNESS = 3.0
"""How much dearer a metre is where the disc only just fits than where the footprint may turn."""
_USED = 4.0
"""How much dearer it is where an earlier route went."""
_HASTE = 2.0
"""How much heavier the way still to go weighs than what is behind: fewer nodes are looked at."""
_CALM = 0.8
"""How strongly headings are drawn to the route's, 0 to 1."""


@dataclass(frozen=True, eq=False)
class Route:
    """Coordinates of body poses along a way (n, 2) m of a point of the footprint, world frame: how far along
    (m), how far to the left of it (m), and an angle.

    point: body frame, m. fixed: the footprint's heading (rad, world frame) where it keeps one. along: whether
    headings count from the way's, and many are near it or against it; else from first to last, evenly.
    """

    way: Array
    point: tuple[float, float]
    fixed: float | None
    start: Pose
    along: bool

    @cached_property
    def length(self) -> float:
        """m."""
        return self._at[-1]

    @cached_property
    def _at(self) -> list[float]:
        steps = np.hypot(*np.diff(self.way, axis=0).T)
        return [0.0, *np.cumsum(steps).tolist()]

    @cached_property
    def _rows(self) -> list[tuple[float, float, float, float]]:
        """x, y and direction of every leg."""
        step = np.diff(self.way, axis=0) / np.diff(self._at)[:, None]
        rows: list[tuple[float, float, float, float]] = np.column_stack([self.way[:-1], step]).tolist()
        return rows

    def _leg(self, s: float) -> tuple[float, float, float, float]:
        """x, y and direction where the way is s long."""
        i = min(max(bisect_right(self._at, s) - 1, 0), len(self._rows) - 1)
        x, y, c, d = self._rows[i]
        ds = s - self._at[i]
        return x + ds * c, y + ds * d, c, d

    def _offset(self, theta: float) -> tuple[float, float]:
        heading = theta if self.fixed is None else self.fixed
        c, d = math.cos(heading), math.sin(heading)
        x, y = self.point
        return c * x - d * y, d * x + c * y

    def pose(self, s: float, left: float, angle: float) -> Pose:
        """The body's pose at these coordinates."""
        x, y, c, d = self._leg(s)
        theta = self.start.theta + angle
        if self.along:
            theta = math.atan2(d, c) + angle - _CALM / 2 * math.sin(2 * angle)
        ox, oy = self._offset(theta)
        return Pose(x - left * d - ox, y + left * c - oy, theta)

    def coordinates(self, pose: Pose, s: float) -> tuple[float, float, float]:
        """Those of a pose whose point is on the way, s along it."""
        _, _, c, d = self._leg(s)
        if not self.along:
            return s, 0.0, math.remainder(pose.theta - self.start.theta, math.tau)
        relative = math.remainder(pose.theta - math.atan2(d, c), math.tau)
        low, high = -math.pi, math.pi
        for _ in range(60):
            angle = (low + high) / 2
            low, high = (angle, high) if angle - _CALM / 2 * math.sin(2 * angle) < relative else (low, angle)
        return s, 0.0, (low + high) / 2


class Guide:
    """Routes from a start to a goal, each avoiding those before it where that costs little."""

    def __init__(self, world: World, start: Pose, goal: Pose) -> None:
        self.world, self.start, self.goal = world, start, goal
        reach = world[RADIUS] + world[MIN_CLEARANCE]
        self._radius = float(world[INNER_RADIUS] + reach)
        self._roomy = float(world[REACH] + reach)
        area = world[ROWS] * world[COLUMNS] * world[STEP] ** 2
        self._spacing = max(_SHARE * self._radius, math.sqrt(area / _NODES))
        self._used: list[Array] = []

    def route(self, along: bool) -> Route | None:
        """The next one, or None where the lattice has none."""
        world = self.world
        ends = [_centre(world, pose) for pose in (self.start, self.goal)]
        used = np.concatenate(self._used) if self._used else np.zeros((0, 2))
        way = _astar(world, self._radius, self._roomy, self._spacing, *ends[0], *ends[1], used)
        if len(way) < 2:
            return None
        self._used.append(way)
        way = _smooth(way)
        out = way @ np.array([[world[COS], world[SIN]], [-world[SIN], world[COS]]]) + world[[X, Y]]
        fixed = None if math.isnan(world[HEADING]) else float(world[HEADING] + world[YAW])
        return Route(out, (float(world[INNER_X]), float(world[INNER_Y])), fixed, self.start, along)


def _centre(world: World, pose: Pose) -> tuple[float, float]:
    """The disc's, own frame."""
    x, y, theta = to_local(world, *pose)
    heading = footprint_heading(world, theta)
    c, s = math.cos(heading), math.sin(heading)
    px, py = world[INNER_X], world[INNER_Y]
    return float(x + c * px - s * py), float(y + s * px + c * py)


def _smooth(way: Array) -> Array:
    """The way (n, 2) without the lattice's corners; its ends stay."""
    for _ in range(4):
        if len(way) > 2:
            way = np.concatenate([way[:1], (way[:-2] + 2 * way[1:-1] + way[2:]) / 4, way[-1:]])
    apart: Array = way[np.concatenate([[True], np.hypot(*np.diff(way, axis=0).T) > 1e-9])]
    return apart


@kernel
def _astar(
    world: World,
    radius: float,
    roomy: float,
    spacing: float,
    sx: float,
    sy: float,
    gx: float,
    gy: float,
    used: Array,
) -> Array:
    """Points (n, 2) from s to g, own frame, none nearer to what is closed than the radius; none: empty.

    roomy: the clearance (m) beyond which more is worth nothing. used (k, 2): points that were passed before.
    """
    # Node (i, j) is at ((i + fx) * spacing, (j + fy) * spacing): the start is one of them.
    width = int(world[COLUMNS] * world[STEP] / spacing) + 2
    height = int(world[ROWS] * world[STEP] / spacing) + 2
    i0, j0 = int(sx / spacing), int(sy / spacing)
    ox, oy = sx - i0 * spacing, sy - j0 * spacing
    best = np.full(width * height, np.inf)
    parent = np.full(width * height, -1, np.int32)
    price = np.zeros(width * height, np.float32)  # of a metre; 0: not known yet, inf: closed
    passed = np.zeros(width * height, np.bool_)
    spread = max(1, int(roomy / spacing))
    for k in range(len(used)):
        ui, uj = int((used[k, 0] - ox) / spacing + 0.5), int((used[k, 1] - oy) / spacing + 0.5)
        for a in range(max(ui - spread, 0), min(ui + spread + 1, width)):
            for b in range(max(uj - spread, 0), min(uj + spread + 1, height)):
                passed[b * width + a] = True
    solids, field = int(world[SOLIDS]), int(world[FIELD])
    first = j0 * width + i0
    best[first] = 0.0
    queue = [(math.hypot(gx - sx, gy - sy), first)]
    looked = 0
    last = -1
    while len(queue) > 0 and looked < _EXPANDED:
        _, node = heapq.heappop(queue)
        if price[node] < 0.0:
            continue  # looked at already, on a shorter way
        looked += 1
        i, j = node % width, node // width
        x, y = ox + i * spacing, oy + j * spacing
        mine = abs(price[node]) if price[node] != 0.0 else np.float32(1.0)
        price[node] = -mine
        if (x - gx) ** 2 + (y - gy) ** 2 <= 2 * spacing * spacing:
            last = node
            break
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if (di == 0 and dj == 0) or a < 0 or b < 0 or a >= width or b >= height:
                    continue
                k = b * width + a
                if price[k] < 0.0 or price[k] == np.inf:
                    continue
                if price[k] == 0.0:
                    px, py = ox + a * spacing, oy + b * spacing
                    low, high = field_bounds(world, px, py)
                    room = low
                    if high < radius:
                        room = 0.0
                    elif low < roomy:
                        room = nearest(world, solids, field, px, py, roomy)
                        if solid(world, px, py, room):
                            room = 0.0
                    if room < radius:
                        price[k] = np.inf
                        continue
                    dear = 1.0
                    if room < roomy:
                        dear += _SHYNESS * (roomy - room) / (roomy - radius)
                    price[k] = dear * _USED if passed[k] else dear
                cost = best[node] + spacing * math.sqrt(di * di + dj * dj) * 0.5 * (mine + price[k])
                if cost < best[k]:
                    best[k] = cost
                    parent[k] = node
                    ahead = math.hypot(ox + a * spacing - gx, oy + b * spacing - gy)
                    heapq.heappush(queue, (cost + _HASTE * ahead, k))
    if last < 0:
        return np.empty((0, 2))
    count = 1
    node = last
    while node != first:
        node = parent[node]
        count += 1
    points = np.empty((count + 1, 2))
    points[count, 0], points[count, 1] = gx, gy
    node = last
    for k in range(count - 1, -1, -1):
        points[k, 0], points[k, 1] = ox + (node % width) * spacing, oy + (node // width) * spacing
        node = parent[node]
    points[0, 0], points[0, 1] = sx, sy
    return points
