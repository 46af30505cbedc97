"""Measures the motion of the body, compiled: rolled, at five instants of every interval, and stated.

Tables are those of planner.gauges. Between the instants a smooth quantity is bounded by `peak`. Accelerations
are exact for twists that are quartics of time: those of wheels that do not steer are quadratics.
"""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array
from planner.gauges import keep, table
from planner.kernels import kernel
from planner.rolling import DERIVATIVE, INSTANTS

__all__ = ["peak", "rolled", "stated"]

_AIMLESS = 1e-3
"""Speed (m/s) by which a velocity may be off before its direction is looked at: at rest it has none."""
_ROUNDING = 2e-10
"""Error of an acceleration by rounding times the square of the interval, m or rad."""

_SPAN = np.linspace(0.0, 1.0, 2001)
_CUBICS = [np.abs(np.prod(_SPAN[:, None] - INSTANTS[a : a + 3], axis=1)) for a in range(3)]
_REMAINDER = np.array(
    [c[(INSTANTS[a] <= _SPAN) & (INSTANTS[a + 2] >= _SPAN)].max() for a, c in enumerate(_CUBICS)]
)
"""Of each three neighbouring instants the largest |(u - u0)(u - u1)(u - u2)| between first and last."""
_THIRD = 1 / np.array([np.prod([u - v for v in INSTANTS[:4] if v != u]) for u in INSTANTS[:4]])
"""Weights of the first four values in their third divided difference. The instants are symmetric: those of
the last four are these in reverse order with the other sign."""


@kernel
def peak(f: Array) -> float:
    """A bound of the maximum of a function over an interval from its values (5,) at the instants.

    It is the top of the parabola through the largest value and its neighbours, plus what the larger of the
    two third divided differences may add: exact for a quadratic, a bound for a cubic.
    """
    m, top = 0, f[0]
    for k in range(1, 5):
        if not f[k] <= top:
            m, top = k, f[k]
    a = min(max(m - 1, 0), 2)
    u0, u1, u2 = INSTANTS[a], INSTANTS[a + 1], INSTANTS[a + 2]
    slope = (f[a + 1] - f[a]) / (u1 - u0)
    bend = ((f[a + 2] - f[a + 1]) / (u2 - u1) - slope) / (u2 - u0)
    if bend < 0.0:
        u = (u0 + u1 - slope / bend) / 2
        if u0 < u < u2:
            top = max(top, f[a] + (u - u0) * (slope + bend * (u - u1)))
    early = late = 0.0
    for k in range(4):
        early += _THIRD[k] * (f[k] - f[0])
        late -= _THIRD[k] * (f[4 - k] - f[0])
    return float(top + _REMAINDER[a] * max(abs(early), abs(late)))


@kernel
def rolled(
    path: Array,
    twist: Array,
    slip: Array,
    speed: float,
    turn: float,
    acceleration: float,
    side: float,
    holonomic: bool,
    forwards: bool,
    radius: float,
    tolerances: Array,
) -> tuple[Array, Array]:
    """Of a rolled motion, path (4n - 3, 4), twist (4n - 3, 3) and slip (4n - 3,), and the limits of the body:
    speed, turn rate, acceleration along the direction of travel, lateral acceleration, speed backwards (if it
    must be `forwards`), turn rate · radius (m, if > 0) against the speed, slip. And bounds (n - 1, 2) of the
    speed and the turn rate in every interval.

    Lateral acceleration is vx·omega unless the drive is holonomic. tolerances (5,): the speed backwards that
    is allowed, m/s; the shares and speeds of turning and of slip.
    """
    found = table(7)
    n = (len(path) + 3) // 4
    bounds = np.zeros((n - 1, 2))
    f, change = np.empty(5), np.zeros((5, 2))
    fastest = 0.05
    for k in range(len(twist)):
        fastest = max(fastest, math.sqrt(twist[k, 0] ** 2 + twist[k, 1] ** 2))
    slipping = tolerances[3] * fastest + tolerances[4]
    keep(found, 6, slip[0], slipping, path[0, 3], 0)
    for i in range(n - 1):
        at = 4 * i
        when, h = path[at, 3], path[at + 4, 3] - path[at, 3]
        for k in range(5):
            f[k] = twist[at + k, 0] ** 2 + twist[at + k, 1] ** 2
        bounds[i, 0] = math.sqrt(max(peak(f), 0.0))
        keep(found, 0, bounds[i, 0], speed, when, 0)
        for sign in (1.0, -1.0):
            for k in range(5):
                f[k] = sign * twist[at + k, 2]
            bounds[i, 1] = max(bounds[i, 1], peak(f))
        keep(found, 1, bounds[i, 1], turn, when, 0)
        keep(found, 6, peak(slip[at : at + 5]), slipping, when, 0)
        if forwards:
            for k in range(5):
                f[k] = -twist[at + k, 0]
            keep(found, 4, max(peak(f), 0.0), tolerances[0], when, 0)
        if radius > 0.0:
            _turning(found, twist[at : at + 5], radius, tolerances[1], tolerances[2], when, f)
        if not holonomic and side < np.inf:
            for sign in (1.0, -1.0):
                for k in range(5):
                    f[k] = sign * twist[at + k, 0] * twist[at + k, 2]
                keep(found, 3, max(peak(f), 0.0), side, when, 0)
        if acceleration < np.inf or (holonomic and side < np.inf):
            for k in range(5):
                for c in range(2):
                    change[k, c] = 0.0
                    for b in range(5):
                        change[k, c] += DERIVATIVE[k, b] * twist[at + b, c]
                change[k, 0] = change[k, 0] / h - twist[at + k, 2] * twist[at + k, 1]
                change[k, 1] = change[k, 1] / h + twist[at + k, 2] * twist[at + k, 0]
            _accelerations(
                found, path[at : at + 5], twist[at : at + 5], change, acceleration, side, holonomic, h
            )
    return found, bounds


@kernel
def _turning(
    found: Array, twist: Array, radius: float, share: float, room: float, when: float, f: Array
) -> None:
    """|omega|·radius against |vx|, its bound, in one interval: twists (5, 3). f (5,) is scratch."""
    worst, value, allowed, omega, ahead = -np.inf, 0.0, 1.0, 1.0, 1.0
    for k in range(5):
        turning, may = abs(twist[k, 2]) * radius, abs(twist[k, 0]) * (1 + share) + room
        if not turning - may <= worst:
            worst, value, allowed = turning - may, turning, may
            omega, ahead = math.copysign(radius, twist[k, 2]), math.copysign(1 + share, twist[k, 0])
    for k in range(5):
        f[k] = omega * twist[k, 2] - ahead * twist[k, 0] - room
    keep(found, 5, value + max(peak(f) - worst, 0.0), allowed, when, 0)


@kernel
def _accelerations(
    found: Array,
    path: Array,
    twist: Array,
    change: Array,
    acceleration: float,
    side: float,
    holonomic: bool,
    h: float,
) -> None:
    """Acceleration along the direction of travel and lateral, in one interval, from poses and times (5, 4),
    twists (5, 3) and accelerations in the body's axes (5, 2). At speed 0 all counts as along.

    Between two instants the velocity is taken to be linear in time. Then the lateral acceleration is largest
    at one of them or when the robot is slowest, and there it is the whole acceleration.
    """
    error = _ROUNDING / (h * h)
    for k in range(5):
        vx, vy, ax, ay = twist[k, 0], twist[k, 1], change[k, 0], change[k, 1]
        v, a, when = math.sqrt(vx * vx + vy * vy), math.sqrt(ax * ax + ay * ay), path[k, 3]
        along = abs(vx * ax + vy * ay) / v if v > 1e-9 else a
        keep(found, 2, max(along - error, 0.0), acceleration, when, 0)
        if not holonomic or side == np.inf:
            continue
        cross = vx * ay - vy * ax
        if v > _AIMLESS:
            keep(found, 3, max((abs(cross) - a * _AIMLESS) / v - error, 0.0), side, when, 0)
        if k == 4:
            continue
        c, s = math.cos(path[k + 1, 2] - path[k, 2]), math.sin(path[k + 1, 2] - path[k, 2])
        wx = twist[k + 1, 0] * c - twist[k + 1, 1] * s - vx
        wy = twist[k + 1, 0] * s + twist[k + 1, 1] * c - vy
        square = wx * wx + wy * wy
        if 0.0 < -(vx * wx + vy * wy) < square:
            slowest = abs(vx * wy - vy * wx) / math.sqrt(square)
            if slowest > _AIMLESS:
                keep(found, 3, max(a * (1 - _AIMLESS / slowest) - error, 0.0), side, when, 0)


@kernel
def stated(
    time: Array,
    least: float,
    twist: Array,
    pose: Array,
    speed: float,
    turn: float,
    acceleration: float,
    side: float,
    holonomic: bool,
    forwards: bool,
    radius: float,
    tolerances: Array,
) -> Array:
    """Of stated twists and poses (n, 3) the first six rows of `rolled`, at the samples.

    Accelerations are means over each interval (or `least` s, if that is more) of the velocity's change along
    and across the direction of travel.
    """
    found = table(6)
    n = len(twist)
    for i in range(n):
        v, omega, when = math.sqrt(twist[i, 0] ** 2 + twist[i, 1] ** 2), abs(twist[i, 2]), time[i]
        keep(found, 0, v, speed, when, 0)
        keep(found, 1, omega, turn, when, 0)
        if not holonomic:
            keep(found, 3, v * omega, side, when, 0)
        if forwards:
            keep(found, 4, max(-twist[i, 0], 0.0), tolerances[0], when, 0)
        if radius > 0.0:
            allowed = abs(twist[i, 0]) * (1 + tolerances[1]) + tolerances[2]
            keep(found, 5, omega * radius, allowed, when, 0)
        if i == n - 1:
            break
        h = max(time[i + 1] - time[i], least)
        c, s = math.cos(pose[i + 1, 2] - pose[i, 2]), math.sin(pose[i + 1, 2] - pose[i, 2])
        wx = twist[i + 1, 0] * c - twist[i + 1, 1] * s
        wy = twist[i + 1, 0] * s + twist[i + 1, 1] * c
        gx, gy, mx, my = wx - twist[i, 0], wy - twist[i, 1], wx + twist[i, 0], wy + twist[i, 1]
        mean = math.sqrt(mx * mx + my * my)
        gained = math.sqrt(gx * gx + gy * gy)
        # If it reverses, the mean velocity says nothing of the direction of travel.
        along = abs(gx * mx + gy * my) / mean if mean > gained else gained
        keep(found, 2, along / h, acceleration, when, 0)
        if holonomic and mean > max(gained, _AIMLESS):
            keep(found, 3, abs(mx * gy - my * gx) / (mean * h), side, when, 0)
    return found
