"""How much of its limits a motion uses, as a client interpolates its samples. Compiled."""

from __future__ import annotations

import math

import numpy as np

from drives.drive import Drive, Limits
from drives.se2 import Array
from planner.kernels import kernel
from planner.trajectory import Phase, Phases

__all__ = ["slow_factor"]

_FEW = 1e-9
"""Speed (m/s) below which the direction of travel is taken from the acceleration."""


def slow_factor(phase: Phase, time: Array, drive: Drive, limits: Limits) -> float:
    """By what factor a phase must be slowed to keep all limits, given its samples' times (n,)."""
    made = Phases(drive, (phase,)).sample(time)
    body = np.array([limits.linear_speed, limits.angular_speed, limits.linear_acceleration,
                     limits.lateral_acceleration])  # fmt: skip
    steering_rate = np.full(len(drive.steered_names), limits.steering_rate)
    return max(
        float(_rates(time, made.steering_angle, made.steering_rate, steering_rate)),
        float(_wheels(time, made.wheel_angle, made.wheel_velocity, made.wheel_acceleration,
                      limits.wheel_speed, limits.wheel_acceleration, limits.wheel_jerk)),
        float(_body(time, made.twist, made.pose, body)),
    )  # fmt: skip


@kernel
def _peak(begin: float, end: float, mean: float) -> float:
    """The largest |rate| of a quadratic with these values at the ends, and this mean."""
    peak = max(abs(begin), abs(end))
    bow, slope = 3.0 * (begin + end - 2.0 * mean), 6.0 * mean - 4.0 * begin - 2.0 * end
    if bow != 0.0:
        u = -slope / (2.0 * bow)
        if 0.0 < u < 1.0:
            peak = max(peak, abs(begin + u * (slope + u * bow)))
    return peak


@kernel
def _rates(time: Array, angle: Array, rate: Array, limit: Array) -> float:
    """The largest share of a limit (m,) that rates reach between samples."""
    most = 0.0
    for i in range(len(time) - 1):
        h = time[i + 1] - time[i]
        for j in range(angle.shape[1]):
            mean = (angle[i + 1, j] - angle[i, j]) / h
            most = max(most, _peak(rate[i, j], rate[i + 1, j], mean) / limit[j])
    return most


@kernel
def _wheels(
    time: Array, angle: Array, rate: Array, change: Array, speed: Array, acceleration: Array, jerk: Array
) -> float:
    """The factor that wheels ask for, (n, m) and their limits (m,)."""
    fastest, pushed, jerked = _rates(time, angle, rate, speed), 0.0, 0.0
    for i in range(len(time) - 1):
        h = time[i + 1] - time[i]
        for j in range(angle.shape[1]):
            mean = (angle[i + 1, j] - angle[i, j]) / h
            first = (6.0 * mean - 4.0 * rate[i, j] - 2.0 * rate[i + 1, j]) / h
            last = (4.0 * rate[i + 1, j] + 2.0 * rate[i, j] - 6.0 * mean) / h
            pushed = max(pushed, max(abs(first), abs(last)) / acceleration[j])
            jerked = max(jerked, abs(change[i + 1, j] - change[i, j]) / (h * jerk[j]))
    return float(max(fastest, math.sqrt(pushed), np.cbrt(jerked)))


@kernel
def _body(time: Array, twist: Array, pose: Array, limits: Array) -> float:
    """The factor that the body asks for, twists and poses (n, 3)."""
    fastest = pushed = 0.0
    for i in range(len(time)):
        vx, vy, omega = twist[i]
        speed = math.sqrt(vx * vx + vy * vy)
        fastest = max(fastest, speed / limits[0], abs(omega) / limits[1])
        if vy == 0.0:
            pushed = max(pushed, abs(vx * omega) / limits[3])
        if i == len(time) - 1 or (limits[2] == np.inf and limits[3] == np.inf):
            continue
        # The change of velocity in the frame of this sample, along and across the mean velocity.
        turn, h = pose[i + 1, 2] - pose[i, 2], time[i + 1] - time[i]
        c, s = math.cos(turn), math.sin(turn)
        wx, wy = c * twist[i + 1, 0] - s * twist[i + 1, 1], s * twist[i + 1, 0] + c * twist[i + 1, 1]
        ax, ay, mx, my = (wx - vx) / h, (wy - vy) / h, (vx + wx) / 2, (vy + wy) / 2
        size = math.sqrt(mx * mx + my * my)
        if size < _FEW:
            mx, my, size = ax, ay, math.sqrt(ax * ax + ay * ay)
        if size > 0.0:
            pushed = max(pushed, abs(ax * mx + ay * my) / (size * limits[2]))
            if vy != 0.0 or twist[i + 1, 1] != 0.0:
                pushed = max(pushed, abs(ax * my - ay * mx) / (size * limits[3]))
    return max(fastest, math.sqrt(pushed))
