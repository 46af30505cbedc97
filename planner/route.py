"""Coordinates along a route: what a search samples instead of poses."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drives.se2 import Array, Pose

__all__ = ["Route"]

_OPEN, _TIGHT = (0.1, 1.5), (0.3, 2.0)
"""Where a way leads through open ground, and where through passages: the share of all draws that lie on the
way itself (and, of headings, just along it or against it), and the power by which the others, from 0 to 1,
are drawn to it."""
_BESIDE = 2.0
"""Room for poses beside a route, in reaches of the footprint."""


@dataclass(frozen=True, eq=False)
class Route:
    """Coordinates of body poses along a way (n, 2) m of a point of the footprint, world frame: how far along
    (m), one for how far to the left of it, and an angle. Of even draws many are just on the way, and the
    others the rarer the farther off.

    point: body frame, m. reach: how far the footprint reaches, m. fixed: the footprint's heading (rad, world
    frame) where it keeps one. along: whether headings count from the way's, and many are just its or against
    it; else from first to last, evenly. tight: whether the way leads through passages in which the footprint
    cannot turn. backwards: whether many head against it, too.
    """

    way: Array
    point: tuple[float, float]
    reach: float
    fixed: float | None
    start: Pose
    along: bool
    tight: bool
    backwards: bool = True

    @cached_property
    def beside(self) -> float:
        """How far off the way poses may be, m."""
        return _BESIDE * self.reach

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
            nearest = round(angle / (2 * self._most)) * 2 * self._most
            theta = math.atan2(d, c) + nearest + self._most * self._drawn((angle - nearest) / self._most)
        left = self.beside * self._drawn(left / self.beside)
        ox, oy = self._offset(theta)
        return Pose(x - left * d - ox, y + left * c - oy, theta)

    def coordinates(self, pose: Pose, s: float) -> tuple[float, float, float]:
        """Those of a pose whose point is on the way, s along it."""
        _, _, c, d = self._leg(s)
        if not self.along:
            return s, 0.0, math.remainder(pose.theta - self.start.theta, math.tau)
        angle = math.remainder(pose.theta - math.atan2(d, c), math.tau)
        nearest = round(angle / (2 * self._most)) * 2 * self._most
        off = (angle - nearest) / self._most
        on, power = self._draws
        even = on + (1 - on) * abs(off) ** (1 / power)
        return s, 0.0, nearest + math.copysign(even, off) * self._most

    @property
    def _most(self) -> float:
        """How far (rad) headings may be off the nearest of those that are favoured."""
        return math.pi / 2 if self.backwards else math.pi

    @property
    def _draws(self) -> tuple[float, float]:
        return _TIGHT if self.tight else _OPEN

    def _drawn(self, even: float) -> float:
        """From -1 to 1, of even draws from -1 to 1: none where they are small."""
        on, power = self._draws
        return math.copysign(max(0.0, (abs(even) - on) / (1 - on)) ** power, even)
