"""What the certificate measures on columns of samples, compiled: numpy is slow at short rows.

A gauge gives a table with a row for each quantity: the largest value / bound (inf for what is no number), the
sample and the column where it is first reached, and the value and the bound there. The first number is -1
where nothing was measured. What is bounded by infinity is not.
"""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array
from planner.kernels import kernel

__all__ = ["agreement", "body", "ends", "route", "steering", "wheels"]


@kernel
def _table(rows: int) -> Array:
    found = np.zeros((rows, 5))
    found[:, 0] = -1.0
    return found


@kernel
def _keep(found: Array, row: int, value: float, bound: float, i: int, j: int) -> None:
    """Take down a value >= 0 and its bound, where there is no larger share yet."""
    if value <= found[row, 0] * bound or bound == np.inf:
        return
    used = value / bound
    if math.isnan(used):
        used = np.inf
    if used > found[row, 0]:
        found[row, 0], found[row, 1], found[row, 2], found[row, 3], found[row, 4] = used, i, j, value, bound


@kernel
def wheels(
    time: Array,
    least: float,
    angle: Array,
    speed: Array,
    change: Array,
    top_speed: Array,
    top_acceleration: Array,
    top_jerk: Array,
    copied: float,
) -> Array:
    """Of wheels (n, m) and their limits (m,): speed, its mean over each interval, acceleration, its mean, the
    mean jerk; the gaps between the angle and the integral of speed, and between speed and that of its own
    derivative.

    Means are over at least `least` (s). The trapezoid rule is off by a·h²/4 at most: where the rate rises,
    then falls, as fast as it may. copied: what may be lost where a number is copied.
    """
    found = _table(7)
    n, m = angle.shape
    for i in range(n):
        h = time[i + 1] - time[i] if i < n - 1 else 0.0
        over = max(h, least)
        for j in range(m):
            most, rise, jerk = top_speed[j], top_acceleration[j], top_jerk[j]
            _keep(found, 0, abs(speed[i, j]), most, i, j)
            _keep(found, 2, abs(change[i, j]), rise, i, j)
            if i == n - 1:
                continue
            gained = angle[i + 1, j] - angle[i, j]
            _keep(found, 1, abs(gained) / over, most, i, j)
            gap = abs(gained - h / 2 * (speed[i, j] + speed[i + 1, j]))
            _keep(found, 5, gap, h * h / 4 * 1.01 * rise + copied, i, j)
            gained = speed[i + 1, j] - speed[i, j]
            _keep(found, 3, abs(gained) / over, rise, i, j)
            if jerk < np.inf:
                _keep(found, 4, abs(change[i + 1, j] - change[i, j]) / over, jerk, i, j)
                gap = abs(gained - h / 2 * (change[i, j] + change[i + 1, j]))
                _keep(found, 6, gap, h * h / 4 * 1.02 * jerk + copied, i, j)
    return found


@kernel
def steering(
    time: Array, least: float, angle: Array, rate: Array, top_angle: float, top_rate: float, copied: float
) -> Array:
    """Of steered wheels (n, k): angle, rate, mean rate, and the gap between the angle and the integral of its
    rate. A rate may jump, so between samples nothing is sure but that it stays within its limit."""
    found = _table(4)
    n, k = angle.shape
    for i in range(n):
        h = time[i + 1] - time[i] if i < n - 1 else 0.0
        over = max(h, least)
        for j in range(k):
            _keep(found, 0, abs(angle[i, j]), top_angle, i, j)
            _keep(found, 1, abs(rate[i, j]), top_rate, i, j)
            if i == n - 1:
                continue
            gained, trapezoid = angle[i + 1, j] - angle[i, j], h / 2 * (rate[i, j] + rate[i + 1, j])
            _keep(found, 2, abs(gained) / over, top_rate, i, j)
            room = max(h * 1.01 * top_rate - abs(trapezoid), 0.0) + copied
            _keep(found, 3, abs(gained - trapezoid), room, i, j)
    return found


@kernel
def ends(rate: Array, bound: Array) -> Array:
    """Of rates (n, c), bounded by (c,): the first and the last."""
    found = _table(1)
    for i in (0, len(rate) - 1):
        for j in range(rate.shape[1]):
            _keep(found, 0, abs(rate[i, j]), bound[j], i, j)
    return found


@kernel
def agreement(
    twist: Array, slip: Array, pose: Array, stated_twist: Array, stated_pose: Array, near: float, turn: float
) -> Array:
    """Of twists and poses (n, 3), rolled and stated, and of slip (n,): slip, the gap between the twists, and
    between the poses: in position, allowed `near` (m), and in heading, allowed `turn` (rad)."""
    found = _table(4)
    linear = 0.05
    for i in range(len(twist)):
        linear = max(linear, math.sqrt(twist[i, 0] ** 2 + twist[i, 1] ** 2))
    fastest = linear
    for i in range(len(twist)):
        fastest = max(fastest, abs(twist[i, 2]))
    for i in range(len(twist)):
        _keep(found, 0, slip[i], 5e-4 * linear + 5e-5, i, 0)
        for j in range(3):
            _keep(found, 1, abs(twist[i, j] - stated_twist[i, j]), 2.5e-3 * fastest + 5e-4, i, j)
        apart = math.sqrt((pose[i, 0] - stated_pose[i, 0]) ** 2 + (pose[i, 1] - stated_pose[i, 1]) ** 2)
        _keep(found, 2, apart, near, i, 0)
        _keep(found, 3, abs(pose[i, 2] - stated_pose[i, 2]), turn, i, 0)
    return found


@kernel
def body(
    time: Array,
    least: float,
    twist: Array,
    pose: Array,
    speed: float,
    turn: float,
    acceleration: float,
    side: float,
    holonomic: bool,
) -> Array:
    """Of a motion, twists and poses (n, 3): its speed, turn rate, mean acceleration over each interval, and
    lateral acceleration, speed × turn rate of the direction of travel: of a holonomic body its mean, too."""
    found = _table(4)
    n = len(twist)
    rate = np.empty(n)
    for i in range(n):
        rate[i] = math.sqrt(twist[i, 0] ** 2 + twist[i, 1] ** 2)
        _keep(found, 0, rate[i], speed, i, 0)
        _keep(found, 1, abs(twist[i, 2]), turn, i, 0)
        if not holonomic:
            _keep(found, 3, rate[i] * abs(twist[i, 2]), side, i, 0)
    if acceleration < np.inf:
        for i in range(n - 1):
            _keep(
                found, 2, abs(rate[i + 1] - rate[i]) / max(time[i + 1] - time[i], least), acceleration, i, 0
            )
    if holonomic and side < np.inf:
        # A robot this slow may have stopped within the interval, and at rest the direction may jump.
        slow = 0.0
        for i in range(n - 1):
            slow = max(slow, 2 * abs(rate[i + 1] - rate[i]))
        for i in range(n - 1):
            both, lateral = rate[i] + rate[i + 1], 0.0
            if not both <= slow:
                c, s = math.cos(pose[i + 1, 2] - pose[i, 2]), math.sin(pose[i + 1, 2] - pose[i, 2])
                vx, vy = twist[i + 1, 0] * c - twist[i + 1, 1] * s, twist[i + 1, 0] * s + twist[i + 1, 1] * c
                cross = twist[i, 0] * vy - twist[i, 1] * vx
                lateral = abs(2 * cross) / (both * max(time[i + 1] - time[i], least))
            _keep(found, 3, lateral, side, i, 0)
    return found


@kernel
def route(twist: Array, forwards: bool, radius: float) -> Array:
    """Of twists (n, 3): the speed backwards, where it must be `forwards`; the turn rate times a radius (m, 0
    for none) against the speed."""
    found = _table(2)
    for i in range(len(twist)):
        if forwards:
            _keep(found, 0, max(-twist[i, 0], 0.0), 5e-4, i, 0)
        if radius > 0.0:
            _keep(found, 1, abs(twist[i, 2]) * radius, abs(twist[i, 0]) * 1.005 + 1e-3, i, 0)
    return found
