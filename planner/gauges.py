"""Measures the columns of a schedule and the cubics between its samples, compiled.

A gauge returns a table with a row for each quantity: the largest value / bound (inf if it is not a number),
time and column of its first occurrence, value and bound there. The first number is -1 if nothing was
measured. Infinite bounds are skipped.

On an interval of length h, with angles q0, q1 and rates v0, v1 at its ends, a client's rate is

    v(u) = v0 + 2b·u + 3c·u²,  b = 3r - 2·v0 - v1,  c = v0 + v1 - 2r,  r = (q1 - q0) / h,  0 <= u <= 1.

Its acceleration runs linearly from 2b/h to (2b + 6c)/h, and its rate is extreme at u = -b/3c.
"""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array
from planner.kernels import kernel

__all__ = ["agreement", "ends", "keep", "steering", "table", "wheels"]

_ROUNDING = 1e-11
"""What angles (rad) and rates (rad/s) of a schedule may be off by rounding, besides their last two digits.
Differences over a very short last step multiply it, so each measure is reduced by what it can explain."""


@kernel
def table(rows: int) -> Array:
    """An empty table of a gauge."""
    found = np.zeros((rows, 5))
    found[:, 0] = -1.0
    return found


@kernel
def keep(found: Array, row: int, value: float, bound: float, when: float, j: int) -> None:
    """Enter a value >= 0 and its bound if their ratio is the row's largest so far."""
    if value <= found[row, 0] * bound or bound == np.inf:
        return
    used = value / bound
    if math.isnan(used):
        used = np.inf
    if used > found[row, 0]:
        found[row, 0], found[row, 1], found[row, 2], found[row, 3], found[row, 4] = (
            used,
            when,
            j,
            value,
            bound,
        )


@kernel
def _cubic(h: float, q0: float, q1: float, v0: float, v1: float) -> tuple[float, float, float]:
    """b and c of an interval's cubic, and by how much b may be off by rounding."""
    r = (q1 - q0) / h
    rounding = _ROUNDING + 5e-16 * (abs(q0) + abs(q1))
    return 3 * r - 2 * v0 - v1, v0 + v1 - 2 * r, 6 * rounding / h + 3 * rounding


@kernel
def _less(value: float, rounding: float) -> float:
    """|value| reduced by rounding, at least 0; not a number stays so."""
    return abs(value) - rounding if not abs(value) <= rounding else 0.0


@kernel
def wheels(
    time: Array,
    period: float,
    angle: Array,
    speed: Array,
    change: Array,
    top_speed: Array,
    top_acceleration: Array,
    top_jerk: Array,
    disagree: float,
) -> Array:
    """Of wheels (n, m) and their limits (m,): speed at the samples; speed between them; stated acceleration
    and its mean over each interval; acceleration between samples; jerk; gap between the stated acceleration
    and that of the cubics, its bound the share `disagree` of the limit.

    At a sample any acceleration between those of the two adjacent intervals may be stated; at the first and
    the last sample that of the one interval. Jerk is the change of acceleration within one period, over it:
    within an interval, at a sample, and from the begin or end of an interval to that of the next. Before the
    start and after the end the acceleration is zero.
    """
    found = table(6)
    n, m = angle.shape
    for j in range(m):
        most, rise, jerk = top_speed[j], top_acceleration[j], top_jerk[j]
        begin_before = end_before = off_before = 0.0
        for i in range(n):
            keep(found, 0, abs(speed[i, j]), most, time[i], j)
            keep(found, 2, abs(change[i, j]), rise, time[i], j)
            begin = end = off = 0.0
            if i < n - 1:
                h, v0, v1 = time[i + 1] - time[i], speed[i, j], speed[i + 1, j]
                b, c, error = _cubic(h, angle[i, j], angle[i + 1, j], v0, v1)
                begin, end, off = 2 * b / h, (2 * b + 6 * c) / h, 2 * error / h
                if c != 0.0 and 0.0 < -b / (3 * c) < 1.0:
                    u = -b / (3 * c)
                    keep(found, 1, _less(v0 + b * u, error), most, time[i] + u * h, j)
                keep(found, 2, _less((v1 - v0) / h, off), rise, time[i], j)
                keep(found, 3, _less(begin, off), rise, time[i], j)
                keep(found, 3, _less(end, off), rise, time[i + 1], j)
                keep(found, 4, _less(end - begin, 2 * off) / period, jerk, time[i], j)
            left, right = end_before, begin
            if i == 0:
                left = right
            elif i == n - 1:
                right = left
            gap = max(min(left, right) - change[i, j], change[i, j] - max(left, right), 0.0)
            keep(found, 5, gap, disagree * rise + off + off_before, time[i], j)
            if jerk < np.inf:
                both = off + off_before
                keep(found, 4, _less(begin - end_before, both) / period, jerk, time[i], j)
                keep(found, 4, _less(begin - begin_before, both) / period, jerk, time[i], j)
                keep(found, 4, _less(end - end_before, both) / period, jerk, time[i], j)
                if i > 0:
                    keep(found, 4, abs(change[i, j] - change[i - 1, j]) / period, jerk, time[i], j)
            begin_before, end_before, off_before = begin, end, off
    return found


@kernel
def steering(time: Array, angle: Array, rate: Array, top_angle: float, top_rate: float) -> Array:
    """Of steered wheels (n, k): angle at the samples; angle between them; rate."""
    found = table(3)
    n, k = angle.shape
    for j in range(k):
        for i in range(n):
            keep(found, 0, abs(angle[i, j]), top_angle, time[i], j)
            keep(found, 2, abs(rate[i, j]), top_rate, time[i], j)
            if i == n - 1:
                break
            h, v0 = time[i + 1] - time[i], rate[i, j]
            b, c, error = _cubic(h, angle[i, j], angle[i + 1, j], v0, rate[i + 1, j])
            if c != 0.0 and 0.0 < -b / (3 * c) < 1.0:
                u = -b / (3 * c)
                keep(found, 2, _less(v0 + b * u, error), top_rate, time[i] + u * h, j)
            # The angle is extreme where its rate v0 + 2b·u + 3c·u² is zero.
            root = math.sqrt(max(b * b - 3 * c * v0, 0.0))
            q = -(b + math.copysign(root, b))
            for above, below in ((q, 3 * c), (v0, q)):
                if below != 0.0 and 0.0 < above / below < 1.0:
                    u = above / below
                    extreme = angle[i, j] + h * u * (v0 + u * (b + u * c))
                    keep(found, 1, abs(extreme), top_angle, time[i] + u * h, j)
    return found


@kernel
def ends(time: Array, rate: Array, bound: Array) -> Array:
    """Of rates (n, c), bounded by (c,): the first and the last."""
    found = table(1)
    for i in (0, len(rate) - 1):
        for j in range(rate.shape[1]):
            keep(found, 0, abs(rate[i, j]), bound[j], time[i], j)
    return found


@kernel
def agreement(
    time: Array,
    twist: Array,
    pose: Array,
    stated_twist: Array,
    stated_pose: Array,
    apart: float,
    near: float,
    turn: float,
) -> Array:
    """Of twists and poses (n, 3), rolled and stated: the gap between the twists, allowed `apart`; between the
    positions, allowed `near` (m); between the headings, allowed `turn` (rad)."""
    found = table(3)
    for i in range(len(time)):
        for j in range(3):
            keep(found, 0, abs(twist[i, j] - stated_twist[i, j]), apart, time[i], j)
        gap = math.sqrt((pose[i, 0] - stated_pose[i, 0]) ** 2 + (pose[i, 1] - stated_pose[i, 1]) ** 2)
        keep(found, 1, gap, near, time[i], 0)
        keep(found, 2, abs(pose[i, 2] - stated_pose[i, 2]), turn, time[i], 0)
    return found
