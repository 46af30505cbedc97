"""Headings in which a footprint is free at a point: all of them, as intervals, and a few to head for.

Turning by δ moves no point of the footprint by more than reach·|δ|. So a clearance c at one heading decides
all headings within |c| / reach of it, free or not, and only intervals about the ends are halved.
"""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array, Pose
from planner.collision import CONTACT, HEADING, MIN_CLEARANCE, RADIUS, REACH
from planner.environment import CollisionWorld

__all__ = ["free_headings", "goal_headings"]

_FIRST, _FINEST = 8, 5e-5
"""Intervals to begin with, and the half width (rad) of the last: below it, the middle decides."""
_HEADINGS = 16
"""Headings to choose from, spread evenly from the course on."""
_INSIDE = 0.05
"""How far from the ends of an interval headings are chosen, as a share of its width."""


def free_headings(world: CollisionWorld, x: float, y: float) -> Array:
    """Intervals (n, 2) rad of headings at which the footprint is free, body origin at (x, y).

    Ascending and disjoint; the first begins in [0, 2π). If all are free: one, 2π wide. Free intervals
    narrower than 1e-4 rad may be missed.
    """
    kernel = world.kernel
    reach = float(kernel[REACH] + kernel[RADIUS]) if math.isnan(kernel[HEADING]) else 0.0
    half = math.pi / _FIRST
    middle = half * (2 * np.arange(_FIRST) + 1)
    parts = []
    while len(middle):
        poses = np.column_stack([np.full(len(middle), x), np.full(len(middle), y), middle])
        room = world.clearance(poses) - kernel[MIN_CLEARANCE] - CONTACT
        unsure = np.abs(room) <= reach * half
        if half <= _FINEST:
            unsure[:] = False
        sure = middle[(room > 0) & ~unsure]
        parts.append(np.column_stack([sure - half, sure + half]))
        half /= 2
        middle = (middle[unsure, None] + (-half, half)).ravel()
    return _merged(np.concatenate(parts))


def _merged(parts: Array) -> Array:
    """Intervals (m, 2) within [0, 2π], those that touch joined, also where 2π is 0."""
    parts = parts[np.argsort(parts[:, 0])]
    if len(parts) == 0:
        return parts
    apart = np.flatnonzero(parts[1:, 0] > parts[:-1, 1] + _FINEST / 2)
    joined = np.column_stack([parts[np.append(0, apart + 1), 0], parts[np.append(apart, -1), 1]])
    if len(joined) > 1 and joined[-1, 1] > math.tau - _FINEST / 2 and joined[0, 0] < _FINEST / 2:
        joined[-1, 1] = joined[0, 1] + math.tau
        joined = joined[1:]
    return joined


def goal_headings(world: CollisionWorld, start: Pose, x: float, y: float) -> list[float]:
    """Headings to try at a goal of any heading, the first ones probably the best; not all of them are free.

    The course to the goal, the start's heading and even steps from the course on. If some headings are not
    free, also the middle of each free interval and, in each, what is nearest to the course, its reverse and
    the start's heading.
    """
    course = math.atan2(y - start.y, x - start.x)
    wanted = [course, start.theta, *(course + math.tau * k / _HEADINGS for k in range(1, _HEADINGS))]
    intervals = free_headings(world, x, y)
    if len(intervals) == 1 and intervals[0, 1] - intervals[0, 0] > math.tau - _FINEST:
        return wanted
    for low, high in intervals.tolist():
        inset = _INSIDE * (high - low)
        middle = (low + high) / 2
        wanted.append(middle)
        for heading in (course, course + math.pi, start.theta):
            nearest = middle + math.remainder(heading - middle, math.tau)
            wanted.append(min(max(nearest, low + inset), high - inset))
    return wanted
