"""Routes for a search to follow: short ways, as roomy as may be, of the largest disc inside the footprint.

A* over a lattice of the disc's centres, walls kept at a distance where that costs little. A route guides;
what is free is decided elsewhere.
"""

from __future__ import annotations

import heapq
import math

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
from planner.route import Route
from planner.tree import kernel, nearest

__all__ = ["Guide"]

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
_SAME = 0.02
"""Share of the disc's radius by which a passage may widen and still be as narrow as anywhere."""
_LEAD = 12.0
"""How far a route may lead straight out of a passage, in reaches of the footprint."""


class Guide:
    """Routes from a start to a goal, each avoiding those before it where that costs little."""

    def __init__(self, world: World, start: Pose, goal: Pose) -> None:
        self.world, self.start, self.goal = world, start, goal
        reach = world[RADIUS] + world[MIN_CLEARANCE]
        self._radius = float(world[INNER_RADIUS] + reach)
        self._roomy = float(world[REACH] + reach)
        area = world[ROWS] * world[COLUMNS] * world[STEP] ** 2
        self._spacing = max(_SHARE * self._radius, math.sqrt(area / _NODES))
        self._aligned = False
        self._used: list[Array] = []

    def route(self, along: bool, backwards: bool = True) -> Route | None:
        """The next one, or None where the lattice has none, even one whose nodes keep off the walls."""
        world = self.world
        way = self._shortest()
        if len(way) < 2 and not self._aligned:
            self._aligned = True
            way = self._shortest()
        if len(way) < 2:
            return None
        self._used.append(way)
        way, tight = self._led(_smooth(world, way, self._radius, self._roomy, self._spacing), along)
        out = way @ np.array([[world[COS], world[SIN]], [-world[SIN], world[COS]]]) + world[[X, Y]]
        fixed = None if math.isnan(world[HEADING]) else float(world[HEADING] + world[YAW])
        point = float(world[INNER_X]), float(world[INNER_Y])
        return Route(out, point, self._roomy, fixed, self.start, along, tight, backwards)

    def _shortest(self) -> Array:
        """A new way (n, 2), own frame, of lattice nodes; none: empty."""
        ends = [_centre(self.world, pose) for pose in (self.start, self.goal)]
        used = np.concatenate(self._used) if self._used else np.zeros((0, 2))
        sizes = self._radius, self._roomy, self._spacing
        way: Array = _astar(self.world, *sizes, self._aligned, *ends[0], *ends[1], used)
        return way

    def _led(self, way: Array, along: bool) -> tuple[Array, bool]:
        """The way (n, 2), straight into passages and out of them until the footprint may turn, own frame, and
        whether there are any.

        Where headings go along, so is what leads out of the start and into the goal.
        """
        at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
        room = _rooms(self.world, way, self._roomy)
        begin, end, n = 0, len(way), len(way)
        parts, last, led = [], way[n:], False
        if along:
            first, last = self._straight(way, self.start), self._straight(way[::-1], self.goal)
            parts, led = [way[:1], first], len(first) + len(last) > 0
            begin = max(1, int(np.searchsorted(at, _long(first, way[0]))))
            end = min(n - 1, int(np.searchsorted(at, at[-1] - _long(last, way[-1]))))
        tight = np.concatenate([[False], room < self._radius + self._spacing / 2, [False]])
        for i, j in np.flatnonzero(np.diff(tight)).reshape(-1, 2).tolist():
            inmost = i + np.flatnonzero(room[i:j] < room[i:j].min() + _SAME * self._radius)
            i0, j0 = int(inmost[0]), int(inmost[-1])
            if i0 < max(begin, 1) or j0 >= min(end, n - 1):
                continue
            a, b = (i0, j0) if i0 < j0 else (i0 - 1, j0 + 1)
            into, out = self._out(way[i0], way[a] - way[a + 1]), self._out(way[j0], way[b] - way[b - 1])
            parts += [way[begin : np.searchsorted(at, at[i0] - _long(into, way[i0]))], into[::-1]]
            parts += [way[i0 : j0 + 1], out]
            begin, led = int(np.searchsorted(at, at[j0] + _long(out, way[j0]))), True
        parts += [way[begin:end], last[::-1], way[-1:]]
        return _apart(np.concatenate(parts)), led

    def _straight(self, way: Array, pose: Pose) -> Array:
        """What leads straight out of a pose (client's frame) where the way (n, 2) from there does."""
        theta = to_local(self.world, *pose)[2]
        at = np.cumsum(np.hypot(*np.diff(way, axis=0).T))
        for course in (theta, theta + math.pi):
            out = self._out(way[0], np.array([math.cos(course), math.sin(course)]))
            k = np.searchsorted(at, _long(out, way[0]))
            if len(out) and k < len(at) and np.hypot(*(way[k + 1] - out[-1])) < self._roomy:
                return out
        return way[:0]

    def _out(self, point: Array, course: Array) -> Array:
        """Points (n, 2) from one on, straight to where there is room for the footprint to turn, or most."""
        step = self._spacing / 2 * course / np.hypot(*course)
        count = math.ceil(2 * _LEAD * self._roomy / self._spacing)
        points = point + np.arange(count)[:, None] * step
        room = _rooms(self.world, points, self._roomy)
        closed = np.flatnonzero(room < self._radius)
        room = room[: closed[0]] if len(closed) else room
        out: Array = points[1 : np.argmax(room) + 1] if len(room) else points[:0]
        return out


def _long(out: Array, point: Array) -> float:
    """How far (m) points lead straight out from one."""
    return float(np.hypot(*(out[-1] - point))) if len(out) else 0.0


def _apart(way: Array) -> Array:
    """The way (n, 2) without points that repeat the one before."""
    kept: Array = way[np.concatenate([[True], np.hypot(*np.diff(way, axis=0).T) > 1e-9])]
    return kept


def _centre(world: World, pose: Pose) -> tuple[float, float]:
    """The disc's, own frame."""
    x, y, theta = to_local(world, *pose)
    heading = footprint_heading(world, theta)
    c, s = math.cos(heading), math.sin(heading)
    px, py = world[INNER_X], world[INNER_Y]
    return float(x + c * px - s * py), float(y + s * px + c * py)


@kernel
def _room(world: World, x: float, y: float, least: float, most: float) -> float:
    """Distance (m) from a point to what is closed: 0 where it is below `least`, at most about `most`."""
    low, high = field_bounds(world, x, y)
    if high < least:
        return 0.0
    if low < most:
        low = nearest(world, int(world[SOLIDS]), int(world[FIELD]), x, y, most)
        if low < least or solid(world, x, y, low):
            return 0.0
    return low


@kernel
def _rooms(world: World, points: Array, most: float) -> Array:
    """_room of points (n, 2), at most `most`."""
    found = np.empty(len(points))
    for k in range(len(points)):
        found[k] = min(_room(world, points[k, 0], points[k, 1], 0.0, most), most)
    return found


@kernel
def _aligned(
    world: World, x: float, y: float, room: float, least: float, most: float, spacing: float
) -> tuple[float, float, float]:
    """The point of a lattice's cell where there is most room, or about, and the room (m) that it has."""
    if room >= least + spacing / 2:
        return x, y, room
    room = _room(world, x, y, max(least - spacing, 0.0), most)
    step = spacing / 4
    for _ in range(6):
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            more = _room(world, x + dx * step, y + dy * step, room, most)
            if more > room + 1e-9:
                x, y, room = x + dx * step, y + dy * step, more
        step /= 2
    return x, y, room


@kernel
def _smooth(world: World, way: Array, radius: float, roomy: float, spacing: float) -> Array:
    """The way (n, 2) without the lattice's corners; its ends stay, and points in the middle of a passage
    that is hardly wider than the disc."""
    tight = radius + spacing / 2
    for _ in range(4):
        before = way.copy()
        for k in range(1, len(way) - 1):
            x = (before[k - 1, 0] + 2 * before[k, 0] + before[k + 1, 0]) / 4
            y = (before[k - 1, 1] + 2 * before[k, 1] + before[k + 1, 1]) / 4
            room = _room(world, x, y, 0.0, tight)
            if room >= tight or room >= _room(world, before[k, 0], before[k, 1], 0.0, tight):
                way[k, 0], way[k, 1] = x, y
    return way


@kernel
def _astar(
    world: World,
    radius: float,
    roomy: float,
    spacing: float,
    aligned: bool,
    sx: float,
    sy: float,
    gx: float,
    gy: float,
    used: Array,
) -> Array:
    """Points (n, 2) from s to g, own frame, none nearer to what is closed than the radius; none: empty.

    roomy: the clearance (m) beyond which more is worth nothing. aligned: whether nodes keep off the walls as
    far as their cells allow, so that there are some in a passage hardly wider than the disc. used (k, 2):
    points that were passed before.
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
                    room = _room(world, px, py, radius, roomy)
                    if aligned:
                        room = _aligned(world, px, py, room, radius, roomy, spacing)[2]
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
        x, y = ox + (node % width) * spacing, oy + (node // width) * spacing
        room = _room(world, x, y, radius, roomy)
        points[k, 0], points[k, 1], _ = _aligned(world, x, y, room, radius, roomy, spacing)
        node = parent[node]
    points[0, 0], points[0, 1] = sx, sy
    return points
