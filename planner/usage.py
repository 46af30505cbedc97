"""How much of its limits a motion uses, as a client interpolates its samples. Compiled."""

from __future__ import annotations

import math

import numpy as np

from drives.drive import Drive, Holonomic, Limits
from drives.se2 import Array
from planner.kernels import kernel
from planner.schedule import WheelSchedule
from planner.trajectory import Phases

__all__ = ["rolled", "slow_factor", "slow_factors"]

_ROOTS, _SHARES = np.polynomial.legendre.leggauss(3)
_NODES, _WEIGHTS = (1 + _ROOTS) / 2, _SHARES / 2
_PARTS = _NODES[:, None] ** [1, 2, 3] / [1, 2, 3] @ np.linalg.inv(np.vander(_NODES, increasing=True))
"""Gauss's rule over [0, 1]: nodes, weights, and weights of the integrals up to each node."""
_INSTANTS = np.concatenate([[0.0], _NODES, [1.0]])
_SLOPES = (np.arange(1.0, 5.0) * _INSTANTS[:, None] ** np.arange(4)) @ np.linalg.inv(
    np.vander(_INSTANTS, increasing=True)
)[1:]
"""The instants of an interval that are looked at, and weights of values there for the slopes of the quartic
through them."""
_STEP = len(_NODES) + 1
_THIRD = np.array([1 / np.prod([u - v for v in _INSTANTS[:4] if v != u]) for u in _INSTANTS[:4]])
"""Weights of the first four values for their third divided difference."""
_SPAN = np.linspace(0.0, 1.0, 2001)
_CUBIC = np.array([
    max(abs(np.prod(u - _INSTANTS[a : a + 3])) for u in _SPAN if _INSTANTS[a] <= u <= _INSTANTS[a + 2])
    for a in range(3)
])  # fmt: skip
"""The largest |(u - u0)(u - u1)(u - u2)| between the first and the last of three neighbouring instants."""
_SLIP, _SLOW = 7e-4, 0.05
"""Slip that is allowed, over the largest speed, which counts as this (m/s) at least."""
_SLIP_BOUND = 7.6e-4, 7.6e-5
"""What the bound of the slip between instants may be: share of the largest speed, and m/s."""
_TIGHTER = 4e-3, 7e-4
"""By what |omega| · turning_radius may exceed |vx|: share of |vx|, and m/s."""
_AIMLESS = 1e-3
"""Speed (m/s) below which a velocity has no direction."""
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
    speeds = limits.linear_speed, limits.angular_speed
    pushes = limits.linear_acceleration, limits.lateral_acceleration
    if min(*speeds, *pushes) < math.inf:
        twist, _ = _twists(made, drive)
        _speeds(twist, *speeds, factors)
        if min(pushes) < math.inf:
            turns_aside = isinstance(drive.mobility(limits), Holonomic)
            _pushes(np.diff(made.time), twist, *pushes, turns_aside, factors)
    return factors


def slow_factor(motion: Phases, knots: Array, limits: Limits) -> float:
    """By what factor a motion must be slowed to keep all limits; less than 1 if it may go faster.

    knots (n,) s: times between which it is smooth.
    """
    h = np.diff(knots)[:, None]
    # From just after each knot to just before the next. A slow body and a caster turn quickly: more points.
    points = 17 if motion.drive.rolling_law().trail > 0 or limits.lateral_acceleration < math.inf else 5
    inside = (knots[:-1, None] + h * np.linspace(1e-6, 1 - 1e-6, points)).ravel()
    sampled = motion.sample(np.concatenate([[0.0], inside, knots[-1:]]))
    # Velocity in the world, as complex numbers.
    travel = (sampled.twist[:, 0] + 1j * sampled.twist[:, 1]) * np.exp(1j * sampled.pose[:, 2])
    speed = np.abs(travel)
    step = np.diff(sampled.time)
    within = step > 0.01 * h.min()
    # Acceleration across the direction of travel: its means, and its exact value if the robot drives ahead.
    both = speed[:-1] + speed[1:] + 1e-9
    across = np.abs((np.conj(travel[:-1] + travel[1:]) * np.diff(travel)).imag) / both
    bend = np.where(sampled.twist[:, 1] == 0, np.abs(sampled.twist[:, 0] * sampled.twist[:, 2]), 0.0)

    def changes(values: Array) -> Array:
        slopes: Array = np.abs(np.diff(values, axis=0)[within].T / step[within])
        return slopes.T

    orders = (
        (1, np.abs(sampled.wheel_velocity) / limits.wheel_speed),
        (1, np.abs(sampled.steering_rate) / limits.steering_rate),
        (1, speed / limits.linear_speed),
        (1, np.abs(sampled.twist[:, 2]) / limits.angular_speed),
        (2, np.abs(sampled.wheel_acceleration[1:-1]) / limits.wheel_acceleration),
        (2, changes(speed) / limits.linear_acceleration),
        (2, bend / limits.lateral_acceleration),
        (2, across[within] / step[within] / limits.lateral_acceleration),
        (3, changes(sampled.wheel_acceleration) / limits.wheel_jerk),
    )
    return max(math.pow(np.max(over, initial=0.0), 1 / order) for order, over in orders)


def rolled(made: WheelSchedule, drive: Drive, turning_radius: float = 0.0) -> tuple[Array, Array]:
    """The largest slip over each interval (n,) between samples, as a share of what is allowed, or the largest
    excess of the curvature, if that is more; and the poses (n + 1, 3) at the samples that rolling the
    interpolated wheels leads to. turning_radius: the smallest (m) that is allowed, 0: any."""
    twist, slip = _twists(made, drive)
    speed = max(float(np.hypot(*twist[:, :2].T).max()), _SLOW)
    shares = np.empty(len(made.time) - 1)
    _slips(slip, _SLIP * speed, _SLIP_BOUND[0] * speed + _SLIP_BOUND[1], shares)
    if turning_radius > 0.0:
        _turns(twist, turning_radius, *_TIGHTER, shares)
    return shares, _poses(made.pose[0].copy(), np.diff(made.time), twist)


@kernel
def _slips(slip: Array, most: float, bound: float, shares: Array) -> None:
    """Set shares (n,) to the larger of slip / most at the nodes and its upper bound / bound between, given
    the slip (4n + 1,)."""
    for i in range(len(shares)):
        f, top = slip[_STEP * i : _STEP * (i + 1) + 1], 0.0
        for a in range(1, _STEP):
            top = max(top, f[a])
        shares[i] = max(top / most, _upper(f) / bound)


@kernel
def _turns(twist: Array, radius: float, share: float, room: float, shares: Array) -> None:
    """Raise shares (n,) to what |omega| · radius exceeds |vx| · (1 + share) by, over room, given twists
    (4n + 1, 3)."""
    for i in range(len(shares)):
        for k in range(_STEP * i, _STEP * (i + 1) + 1):
            excess = abs(twist[k, 2]) * radius - abs(twist[k, 0]) * (1.0 + share)
            shares[i] = max(shares[i], excess / room)


@kernel
def _upper(f: Array) -> float:
    """A bound of a function over an interval from its values (5,) at the instants: the top of the parabola
    through the largest value and its neighbours, and what a cubic may differ from that."""
    m = 0
    for a in range(len(f)):
        m = a if f[a] > f[m] else m
    first = min(max(m - 1, 0), len(f) - 3)
    u0, u1, u2 = _INSTANTS[first], _INSTANTS[first + 1], _INSTANTS[first + 2]
    top, slope = f[m], (f[first + 1] - f[first]) / (u1 - u0)
    bend = ((f[first + 2] - f[first + 1]) / (u2 - u1) - slope) / (u2 - u0)
    if bend < 0.0:
        u = (u0 + u1 - slope / bend) / 2.0
        if u0 < u < u2:
            top = max(top, f[first] + (u - u0) * (slope + bend * (u - u1)))
    early = late = 0.0
    for a in range(len(_THIRD)):
        early += _THIRD[a] * f[a]
        late += _THIRD[a] * f[len(f) - 1 - a]
    return float(top + _CUBIC[first] * max(abs(early), abs(late)))


def _twists(made: WheelSchedule, drive: Drive) -> tuple[Array, Array]:
    """Twists (4n + 1, 3) and slip (4n + 1,) of the interpolated wheels: where an interval begins, at its
    three nodes, where the next one begins, …"""
    step = np.diff(made.time)
    rates = _interpolated(step, made.wheel_angle, made.wheel_velocity)[1]
    twist, slip = drive.forward(rates, *_interpolated(step, made.steering_angle, made.steering_rate))
    return np.ascontiguousarray(twist), slip


@kernel
def _interpolated(step: Array, angle: Array, rate: Array) -> tuple[Array, Array]:
    """Angles and rates (4n + 1, m) of the cubics through samples, at the same instants."""
    n, m = len(step), angle.shape[1]
    value, slope = np.empty((_STEP * n + 1, m)), np.empty((_STEP * n + 1, m))
    value[-1], slope[-1] = angle[-1], rate[-1]
    for i in range(n):
        h = step[i]
        for j in range(m):
            first, begin, end = angle[i, j], rate[i, j], rate[i + 1, j]
            rise = (angle[i + 1, j] - first) / h
            square, cube = 3.0 * rise - 2.0 * begin - end, begin + end - 2.0 * rise
            for a in range(_STEP):
                u = _INSTANTS[a]
                value[_STEP * i + a, j] = first + h * u * (begin + u * (square + u * cube))
                slope[_STEP * i + a, j] = begin + u * (2.0 * square + 3.0 * u * cube)
    return value, slope


@kernel
def _poses(start: Array, step: Array, twist: Array) -> Array:
    """Poses (n + 1, 3) at the ends of intervals, given the twists (4n + 1, 3)."""
    poses = np.empty((len(step) + 1, 3))
    poses[0] = start
    for i in range(len(step)):
        poses[i + 1], at = poses[i], _STEP * i + 1
        for a in range(3):
            turn = 0.0
            for b in range(3):
                turn += _PARTS[a, b] * twist[at + b, 2]
            heading, h = poses[i, 2] + step[i] * turn, step[i] * _WEIGHTS[a]
            c, s, vx, vy = math.cos(heading), math.sin(heading), twist[at + a, 0], twist[at + a, 1]
            poses[i + 1, 0] += h * (c * vx - s * vy)
            poses[i + 1, 1] += h * (s * vx + c * vy)
            poses[i + 1, 2] += h * twist[at + a, 2]
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
        before = begin = 0.0
        for i in range(len(factors)):
            h = time[i + 1] - time[i]
            mean = (angle[i + 1, j] - angle[i, j]) / h
            first = (6.0 * mean - 4.0 * rate[i, j] - 2.0 * rate[i + 1, j]) / h
            last = (4.0 * rate[i + 1, j] + 2.0 * rate[i, j] - 6.0 * mean) / h
            factors[i] = max(factors[i], math.sqrt(max(abs(first), abs(last)) / acceleration[j]))
            if jerk[j] < np.inf:
                jerked = max(abs(last - first), abs(first - before), abs(last - before), abs(first - begin))
                factors[i] = max(factors[i], np.cbrt(jerked / (h * jerk[j])))
            before, begin = last, first


@kernel
def _speeds(twist: Array, linear: float, angular: float, factors: Array) -> None:
    """Raise factors (n,) to the largest share of the body's speeds, given its twists (4n + 1, 3)."""
    for i in range(len(factors)):
        for k in range(_STEP * i, _STEP * (i + 1) + 1):
            vx, vy, omega = twist[k]
            factors[i] = max(factors[i], math.sqrt(vx * vx + vy * vy) / linear, abs(omega) / angular)


@kernel
def _pushes(
    step: Array, twist: Array, along: float, across: float, turns_aside: bool, factors: Array
) -> None:
    """Raise factors (n,) to what the body's accelerations along and across its velocity ask for, given its
    twists (4n + 1, 3). turns_aside: whether the velocity may point anywhere: when it is smallest, the whole
    acceleration is across it."""
    side = np.empty(_STEP + 1)
    for i in range(len(factors)):
        at, fastest = _STEP * i, 0.0
        for a in range(_STEP + 1):
            fastest = max(fastest, math.sqrt(twist[at + a, 0] ** 2 + twist[at + a, 1] ** 2))
        for k in range(_STEP + 1):
            vx, vy, omega = twist[at + k]
            dx = dy = 0.0
            for a in range(_STEP + 1):
                dx, dy = dx + _SLOPES[k, a] * twist[at + a, 0], dy + _SLOPES[k, a] * twist[at + a, 1]
            dx, dy, size = dx / step[i], dy / step[i], math.sqrt(vx * vx + vy * vy)
            side[k] = 0.0
            if size <= _SLOW_SHARE * fastest:
                pushed = math.sqrt(dx * dx + dy * dy) / along
            else:
                side[k] = (vx * dy - vy * dx) / size + omega * size
                pushed = max(abs(dx * vx + dy * vy) / size / along, abs(side[k]) / across)
            if turns_aside and k < _STEP:
                turn = (_INSTANTS[k + 1] - _INSTANTS[k]) * step[i] * omega
                slowest = _slowest(twist[at + k], twist[at + k + 1], turn)
                if slowest > _AIMLESS:
                    whole = math.sqrt((dx - omega * vy) ** 2 + (dy + omega * vx) ** 2)
                    known = 1.0 if slowest > 2.0 * _AIMLESS else 1.0 - _AIMLESS / slowest
                    pushed = max(pushed, whole * known / across)
            factors[i] = max(factors[i], math.sqrt(pushed))
        # The mean of the parabola through where the interval begins, its middle, and where it ends.
        mean = (side[0] + 4.0 * side[2] + side[4]) / 6.0
        factors[i] = max(factors[i], math.sqrt(_peak(side[0], side[4], mean) / across))


@kernel
def _slowest(first: Array, last: Array, turn: float) -> float:
    """The smallest speed between two twists (3,) after the body turned by `turn`, if it is between; 0 if it
    is at either end."""
    c, s = math.cos(turn), math.sin(turn)
    wx = last[0] * c - last[1] * s - first[0]
    wy = last[0] * s + last[1] * c - first[1]
    square = wx * wx + wy * wy
    if not 0.0 < -(first[0] * wx + first[1] * wy) < square:
        return 0.0
    return float(abs(first[0] * wy - first[1] * wx) / math.sqrt(square))
