"""Routes for a search to follow: short ways of the largest disc inside the footprint, straight into passages
and out of them. A route guides; what is free is decided elsewhere.
"""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array, Pose
from planner.collision import (
    COS,
    HEADING,
    INNER_RADIUS,
    INNER_X,
    INNER_Y,
    MIN_CLEARANCE,
    RADIUS,
    REACH,
    SIN,
    YAW,
    World,
    X,
    Y,
    body_point,
    to_local,
)
from planner.lattice import roomiest, rooms, shortest, smooth
from planner.route import Route

__all__ = ["Guide"]

_HASTE, _WORK = 2.0, 400_000
"""See planner.lattice.shortest."""
_SHARE, _ACROSS = 0.7, 3000
"""Lattice spacing over the disc's radius; nodes between start and goal, as the crow flies, at most."""
_LATTICES = ((2, False), (1, False), (1, True))
"""Lattices, tried in turn: how much coarser than that spacing, and whether nodes keep off the walls."""
_CLEAR = 0.85
"""The least room that there must be all along a way over a coarse one, over the disc's radius: about as much
as there always is between the nodes of a fine one."""
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
        self._point = float(world[INNER_X]), float(world[INNER_Y])
        self._ends = [body_point(world, pose, *self._point) for pose in (start, goal)]
        self._spacing = max(_SHARE * self._radius, math.dist(*self._ends) / _ACROSS)
        self._lattices = list(_LATTICES)
        self._used: list[Array] = []

    def route(self, along: bool, backwards: bool = True) -> Route | None:
        """The next one, or None where the lattice has none, even one whose nodes keep off the walls, or where
        there is no way to go, as from a pose to one turned on the spot."""
        world = self.world
        way = self._shortest()
        while len(way) < 2:
            if len(self._lattices) == 1:
                return None
            self._lattices = self._lattices[1:]
            way = self._shortest()
        self._used.append(way)
        way, tight = self._led(smooth(world, way, self._radius + self._spacing / 2), along)
        if len(way) < 2:
            return None
        out = way @ np.array([[world[COS], world[SIN]], [-world[SIN], world[COS]]]) + world[[X, Y]]
        fixed = None if math.isnan(world[HEADING]) else float(world[HEADING] + world[YAW])
        return Route(out, self._point, self._roomy, fixed, self.start, along, tight, backwards)

    def _shortest(self) -> Array:
        """A new way (n, 2), own frame, of lattice nodes where they have most room; none: empty."""
        used = np.concatenate(self._used) if self._used else np.zeros((0, 2))
        (start, goal), radius, roomy, spacing = self._ends, self._radius, self._roomy, self._spacing
        coarse, aligned = self._lattices[0]
        way, _, _ = shortest(
            self.world, start, goal, radius, roomy, coarse * spacing, aligned, used, _HASTE, _WORK
        )
        if len(way) < 2:
            return way
        between = np.linspace(0.0, 1.0, coarse, endpoint=False)[:, None]
        way = np.concatenate(
            [(way[:-1, None] + between * np.diff(way, axis=0)[:, None]).reshape(-1, 2), way[-1:]]
        )
        way = np.asarray(roomiest(self.world, way, radius, roomy, spacing))
        if coarse > 1 and rooms(self.world, way[1:-1], radius).min(initial=radius) < _CLEAR * radius:
            return way[:0]
        return way

    def _led(self, way: Array, along: bool) -> tuple[Array, bool]:
        """The way (n, 2), straight into passages and out of them until the footprint may turn, own frame, and
        whether there are any.

        Where headings go along, so is what leads out of the start and into the goal.
        """
        at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
        room = rooms(self.world, way, self._roomy)
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
        room = rooms(self.world, points, self._roomy)
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
