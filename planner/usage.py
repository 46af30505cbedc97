"""How much of its limits a motion uses, as a client interpolates its samples. Compiled."""

from __future__ import annotations

import math

import numpy as np

from drives.drive import Drive, Limits
from drives.se2 import Array
from planner.kernels import kernel
from planner.schedule import WheelSchedule

__all__ = ["rolled", "slow_factors"]

_ROOTS, _SHARES = np.polynomial.legendre.leggauss(3)
_NODES, _WEIGHTS = (1 + _ROOTS) / 2, _SHARES / 2
_PARTS = _NODES[:, None] ** [1, 2, 3] / [1, 2, 3] @ np.linalg.inv(np.vander(_NODES, increasing=True))
"""Gauss's rule over [0, 1]: nodes, weights, and weights of the integrals up to each node."""
_AT = np.array([0.0, 0.5, 1.0])
_BASIS = np.linalg.inv(np.vander(_NODES, increasing=True))
_VALUES, _SLOPES = (
    np.vander(_AT, 3, increasing=True) @ _BASIS,
    np.outer(2 * _AT, [0, 0, 1]) @ _BASIS + _BASIS[1],
)
"""Weights of the values at the nodes for values and slopes of the quadratic where an interval begins, in its
middle, and where it ends."""
_SLIP, _SLOW = 7e-4, 0.05
"""Slip that is allowed, over the largest speed, which counts as this (m/s) at least."""
_SLOW_SHARE = 0.05
"""Share of the largest speed in an interval below which all acceleration counts as along the velocity."""


def slow_factors(made: WheelSchedule, drive: Drive, limits: Limits) -> Array:
    """By what factor a motion must be slowed over each interval (n,) between samples to keep all limits."""
    steering_rate = np.full(made.steering_rate.shape[1], limits.steering_rate)
    factors = np.zeros(len(made.time) - 1)
    _rates(made.time, made.steering_angle, made.steering_rate, steering_rate, factors)
    _rates(made.time, made.wheel_angle, made.wheel_velocity, limits.wheel_speed, factors)
    _changes(made.time, made.wheel_angle, made.wheel_velocity, limits.wheel_acceleration, limits.wheel_jerk,
             factors)  # fmt: skip
    _speeds(made.twist, limits.linear_speed, limits.angular_speed, factors)
    along, across = limits.linear_acceleration, limits.lateral_acceleration
    if min(along, across) < math.inf:
        _pushes(np.diff(made.time), _twists(made, drive)[0], along, across, factors)
    return factors


def rolled(made: WheelSchedule, drive: Drive) -> tuple[Array, Array]:
    """The largest slip over each interval (n,) between samples, as a share of what is allowed; and the poses
    (n + 1, 3) at the samples that rolling the interpolated wheels leads to."""
    twist, slip = _twists(made, drive)
    speed = max(float(np.hypot(*twist[:, :2].T).max()), _SLOW)
    shares: Array = slip.reshape(-1, len(_NODES)).max(1) / (_SLIP * speed)
    return shares, _poses(made.pose[0].copy(), np.diff(made.time), twist)


def _twists(made: WheelSchedule, drive: Drive) -> tuple[Array, Array]:
    """Twists (3n, 3) and slip (3n,) of the interpolated wheels at the nodes of intervals."""
    step = np.diff(made.time)
    rates = _interpolated(step, made.wheel_angle, made.wheel_velocity)[1]
    twist, slip = drive.forward(rates, *_interpolated(step, made.steering_angle, made.steering_rate))
    return np.ascontiguousarray(twist), slip


@kernel
def _interpolated(step: Array, angle: Array, rate: Array) -> tuple[Array, Array]:
    """Angles and rates (3n, m) at Gauss's nodes of n intervals, on the cubics through samples."""
    n, m = len(step), angle.shape[1]
    value, slope = np.empty((3 * n, m)), np.empty((3 * n, m))
    for i in range(n):
        h = step[i]
        for j in range(m):
            first, begin, end = angle[i, j], rate[i, j], rate[i + 1, j]
            rise = (angle[i + 1, j] - first) / h
            square, cube = 3.0 * rise - 2.0 * begin - end, begin + end - 2.0 * rise
            for a in range(3):
                u = _NODES[a]
                value[3 * i + a, j] = first + h * u * (begin + u * (square + u * cube))
                slope[3 * i + a, j] = begin + u * (2.0 * square + 3.0 * u * cube)
    return value, slope


@kernel
def _poses(start: Array, step: Array, twist: Array) -> Array:
    """Poses (n + 1, 3) at the ends of intervals, given the twists (3n, 3) at their nodes."""
    poses = np.empty((len(step) + 1, 3))
    poses[0] = start
    for i in range(len(step)):
        poses[i + 1] = poses[i]
        omega = twist[3 * i : 3 * i + 3, 2]
        for a in range(3):
            turn = 0.0
            for b in range(3):
                turn += _PARTS[a, b] * omega[b]
            heading, h = poses[i, 2] + step[i] * turn, step[i] * _WEIGHTS[a]
            c, s, vx, vy = math.cos(heading), math.sin(heading), twist[3 * i + a, 0], twist[3 * i + a, 1]
            poses[i + 1, 0] += h * (c * vx - s * vy)
            poses[i + 1, 1] += h * (s * vx + c * vy)
            poses[i + 1, 2] += h * omega[a]
    return poses


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
def _rates(time: Array, angle: Array, rate: Array, limit: Array, factors: Array) -> None:
    """Raise factors (n,) to the largest share of a limit (m,) that rates reach between samples."""
    for i in range(len(factors)):
        h = time[i + 1] - time[i]
        for j in range(angle.shape[1]):
            mean = (angle[i + 1, j] - angle[i, j]) / h
            factors[i] = max(factors[i], _peak(rate[i, j], rate[i + 1, j], mean) / limit[j])


@kernel
def _changes(
    time: Array, angle: Array, rate: Array, acceleration: Array, jerk: Array, factors: Array
) -> None:
    """Raise factors (n,) to what the accelerations and jerks of wheels ask for, given their limits (m,)."""
    for j in range(angle.shape[1]):
        before = 0.0
        for i in range(len(factors)):
            h = time[i + 1] - time[i]
            mean = (angle[i + 1, j] - angle[i, j]) / h
            first = (6.0 * mean - 4.0 * rate[i, j] - 2.0 * rate[i + 1, j]) / h
            last = (4.0 * rate[i + 1, j] + 2.0 * rate[i, j] - 6.0 * mean) / h
            factors[i] = max(factors[i], math.sqrt(max(abs(first), abs(last)) / acceleration[j]))
            if jerk[j] < np.inf:
                jerked = max(abs(last - first), abs(last - before)) / (h * jerk[j])
                factors[i] = max(factors[i], np.cbrt(jerked))
            before = last


@kernel
def _speeds(twist: Array, linear: float, angular: float, factors: Array) -> None:
    """Raise factors (n,) to the largest share of the body's speeds, given its twists (n + 1, 3)."""
    for i in range(len(factors)):
        for k in (i, i + 1):
            vx, vy, omega = twist[k]
            factors[i] = max(factors[i], math.sqrt(vx * vx + vy * vy) / linear, abs(omega) / angular)


@kernel
def _pushes(step: Array, twist: Array, along: float, across: float, factors: Array) -> None:
    """Raise factors (n,) to what the body's accelerations along and across its velocity ask for, where
    intervals begin, end, and are halfway: of the quadratics through the twists (3n, 3) at their nodes."""
    for i in range(len(factors)):
        fastest = 0.0
        for a in range(3):
            fastest = max(fastest, math.sqrt(twist[3 * i + a, 0] ** 2 + twist[3 * i + a, 1] ** 2))
        for k in range(len(_VALUES)):
            vx = vy = omega = dx = dy = 0.0
            for a in range(3):
                x, y, turn = twist[3 * i + a]
                vx, vy = vx + _VALUES[k, a] * x, vy + _VALUES[k, a] * y
                omega += _VALUES[k, a] * turn
                dx, dy = dx + _SLOPES[k, a] * x, dy + _SLOPES[k, a] * y
            dx, dy, size = dx / step[i], dy / step[i], math.sqrt(vx * vx + vy * vy)
            if size <= _SLOW_SHARE * fastest:
                pushed = math.sqrt(dx * dx + dy * dy) / along
            else:
                bend = vx * dy - vy * dx + omega * size * size
                pushed = max(abs(dx * vx + dy * vy) / along, abs(bend) / across) / size
            factors[i] = max(factors[i], math.sqrt(pushed))
