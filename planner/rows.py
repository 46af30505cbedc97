"""Limits of wheels, steering and body as rows along a path: |a·s̈ + b·ṡ²| <= 1 and ṡ² <= x_max. Compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.drive import ActuatorPath, BodyPath, Limits
from drives.se2 import Array
from planner.kernels import kernel

__all__ = ["holding", "is_constant", "limit_rows", "most_used"]


def limit_rows(path: BodyPath, law: ActuatorPath, limits: Limits) -> tuple[Array, Array, Array]:
    """a, b (n, r) and x_max (n,): |a·s̈ + b·ṡ²| <= 1 and ṡ² <= x_max say all the limits but jerk."""
    body = (
        limits.linear_speed, limits.angular_speed, limits.linear_acceleration, limits.lateral_acceleration,
        limits.steering_rate,
    )  # fmt: skip
    # Copies, so that one kernel serves them all.
    a, b, x_max = _all_rows(*(np.array(each, dtype=np.float64, order="C") for each in (
        path.tangent, path.tangent_derivative, law.wheel, law.wheel_derivative, law.steering_derivative,
        limits.wheel_speed, limits.wheel_acceleration, body,
    )))  # fmt: skip
    return a, b, x_max


@kernel
def _all_rows(
    along: Array,
    change: Array,
    wheel: Array,
    wheel_change: Array,
    steering_change: Array,
    wheel_speed: Array,
    wheel_acceleration: Array,
    body: Array,
) -> tuple[Array, Array, Array]:
    speed, turn, acceleration, side, steering_rate = body
    n, m = wheel.shape
    a, b, x_max = np.empty((n, m + 1)), np.empty((n, m + 1)), np.empty(n)
    for i in range(n):
        vx, vy, omega = along[i, 0], along[i, 1], along[i, 2]
        v = math.sqrt(vx * vx + vy * vy)
        tangential = bend = 0.0
        if v > 0.0:
            tangential = (vx * change[i, 0] + vy * change[i, 1]) / v
            bend = (vx * change[i, 1] - vy * change[i, 0]) / v
        # Turn of the direction of travel in the world: of the body, and of the velocity in the body.
        slowest = max(v / speed, abs(omega) / turn, math.sqrt(abs(omega * v + bend) / side))
        for j in range(m):
            a[i, j] = wheel[i, j] / wheel_acceleration[j]
            b[i, j] = wheel_change[i, j] / wheel_acceleration[j]
            slowest = max(slowest, abs(wheel[i, j]) / wheel_speed[j])
        a[i, m], b[i, m] = v / acceleration, tangential / acceleration
        for j in range(steering_change.shape[1]):
            slowest = max(slowest, abs(steering_change[i, j]) / steering_rate)
        x_max[i] = 1.0 / (slowest * slowest) if slowest > 0.0 else np.inf
    return a, b, x_max


@kernel
def is_constant(a: Array, b: Array) -> bool:
    """Whether the rows a, b (n, r) of limits are the same all along."""
    most = spread = 0.0
    for j in range(a.shape[1]):
        low = high = a[0, j]
        for i in range(len(a)):
            low, high = min(low, a[i, j]), max(high, a[i, j])
            if abs(b[i, j]) > 1e-9:
                return False
        most, spread = max(most, abs(low), abs(high)), max(spread, high - low)
    return bool(spread <= 1e-9 * most)


@kernel
def most_used(a: Array, b: Array, x_max: Array, x: Array, acceleration: Array) -> float:
    """The largest share of a limit that ṡ² and s̈ (n,) use, at least 1."""
    most = 1.0
    for i in range(len(a)):
        most = max(most, x[i] / x_max[i])
        for j in range(a.shape[1]):
            most = max(most, abs(a[i, j] * acceleration[i] + b[i, j] * x[i]))
    return most


@kernel
def holding(a: Array, b: Array, x_max: Array, step: Array) -> tuple[Array, NDArray[np.bool_]]:
    """s̈ (n - 1,) that keeps ṡ² at its bound from one point to the next, and whether the rows allow it."""
    u, free = np.empty(len(step)), np.empty(len(step), np.bool_)
    for i in range(len(step)):
        u[i], free[i] = (x_max[i + 1] - x_max[i]) / step[i], True
        for k in (i, i + 1):
            for j in range(a.shape[1]):
                free[i] &= abs(a[k, j] * u[i] + b[k, j] * x_max[k]) <= 1.0
    return u, free
