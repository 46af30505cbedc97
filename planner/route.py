"""Coordinates along a route: what a search samples instead of poses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drives.se2 import Array, Pose
from planner.kernels import kernel

__all__ = ["Route", "route_pose", "route_poses"]

_OPEN, _TIGHT = (0.1, 1.5), (0.3, 2.0)
"""Where a way leads through open ground, and where through passages: the share of all draws that lie on the
way itself (and, of headings, just along it or against it), and the power by which the others, from 0 to 1,
are drawn to it."""
_BESIDE = 2.0
"""Room for poses beside a route, in reaches of the footprint."""

# Of a route's shape: the point; the fixed heading or nan; the start's; whether headings go along; how far off
# those favoured they may be; the share and the power of draws; how far off the way poses may be.
_X, _Y, _FIXED, _START, _ALONG, _MOST, _ON, _POWER, _OFF = range(9)


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

    @property
    def beside(self) -> float:
        """How far off the way poses may be, m."""
        return _BESIDE * self.reach

    @property
    def length(self) -> float:
        """m."""
        return float(self.legs[-1, 0])

    @cached_property
    def legs(self) -> Array:
        """Of every leg how far along it begins, x, y and direction (n, 5); the last is where the way ends."""
        step = np.diff(self.way, axis=0)
        long = np.hypot(*step.T)
        step /= long[:, None]
        at = np.concatenate([[0.0], np.cumsum(long)])
        return np.column_stack([at, self.way, np.concatenate([step, step[-1:]])])

    @cached_property
    def shape(self) -> Array:
        """Numbers (9,) that route_pose takes."""
        fixed = math.nan if self.fixed is None else self.fixed
        most = math.pi / 2 if self.backwards else math.pi
        draws = _TIGHT if self.tight else _OPEN
        return np.array([*self.point, fixed, self.start.theta, self.along, most, *draws, self.beside])

    def pose(self, s: float, left: float, angle: float) -> Pose:
        """The body's pose at these coordinates."""
        return Pose(*route_pose(self.legs, self.shape, float(s), float(left), float(angle)))

    def coordinates(self, pose: Pose, s: float) -> tuple[float, float, float]:
        """Those of a pose whose point is on the way, s along it."""
        if not self.along:
            return s, 0.0, math.remainder(pose.theta - self.start.theta, math.tau)
        c, d = self.legs[_leg(self.legs, s), 3:]
        most, on, power = self.shape[[_MOST, _ON, _POWER]].tolist()
        angle = math.remainder(pose.theta - math.atan2(d, c), math.tau)
        nearest = round(angle / (2 * most)) * 2 * most
        off = (angle - nearest) / most
        even = on + (1 - on) * abs(off) ** (1 / power)
        return s, 0.0, nearest + math.copysign(even, off) * most


@kernel
def _leg(legs: Array, s: float) -> int:
    """The leg on which the way is s long."""
    low, high = 0, len(legs) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if legs[middle, 0] <= s:
            low = middle
        else:
            high = middle
    return low


@kernel
def _drawn(even: float, on: float, power: float) -> float:
    """From -1 to 1, of even draws from -1 to 1: none where they are small."""
    return math.copysign(max(0.0, (abs(even) - on) / (1 - on)) ** power, even)


@kernel
def route_pose(legs: Array, shape: Array, s: float, left: float, angle: float) -> tuple[float, float, float]:
    """The body's pose at coordinates of a route, of which legs and shape are given."""
    _, x, y, c, d = legs[_leg(legs, s)]
    ds = s - legs[_leg(legs, s), 0]
    theta = shape[_START] + angle
    if shape[_ALONG]:
        most = shape[_MOST]
        nearest = round(angle / (2 * most)) * 2 * most
        theta = (
            math.atan2(d, c) + nearest + most * _drawn((angle - nearest) / most, shape[_ON], shape[_POWER])
        )
    left = shape[_OFF] * _drawn(left / shape[_OFF], shape[_ON], shape[_POWER])
    heading = theta if math.isnan(shape[_FIXED]) else shape[_FIXED]
    e, f = math.cos(heading), math.sin(heading)
    return (
        x + ds * c - left * d - (e * shape[_X] - f * shape[_Y]),
        y + ds * d + left * c - (f * shape[_X] + e * shape[_Y]),
        theta,
    )


@kernel
def route_poses(legs: Array, shape: Array, count: int, turn: float) -> Array:
    """So many poses (count, 3), evenly from where the way begins to where it ends, the angle from none to
    `turn`."""
    poses = np.empty((count, 3))
    for k in range(count):
        share = k / (count - 1)
        poses[k] = route_pose(legs, shape, share * legs[-1, 0], 0.0, share * turn)
    return poses
