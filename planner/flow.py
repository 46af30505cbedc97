"""Motions whose coordinates are polynomials between knots: their values, headings and poses. Compiled.

Arguments as in trajectory.Flowing: time (n + 1,) of the knots, coefficients (n, d, c); times asked for ascend
within each call.
"""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array
from planner.kernels import kernel

__all__ = ["headings", "positions", "values"]

_NODES = (0.5 - math.sqrt(0.15), 0.5, 0.5 + math.sqrt(0.15))
_WEIGHTS = (5 / 18, 8 / 18, 5 / 18)


@kernel
def values(time: Array, coefficients: Array, t: Array) -> tuple[Array, Array]:
    """Coordinates and their rates (m, c) at times t (m,)."""
    n, d, c = coefficients.shape
    value, rate = np.empty((len(t), c)), np.empty((len(t), c))
    i = 0
    for k in range(len(t)):
        while i < n - 1 and time[i + 1] <= t[k]:
            i += 1
        u = t[k] - time[i]
        for j in range(c):
            q = r = 0.0
            for a in range(d - 1, -1, -1):
                r = q + u * r
                q = coefficients[i, a, j] + u * q
            value[k, j], rate[k, j] = q, r
    return value, rate


@kernel
def _turns(coefficients: Array, curves: bool) -> Array:
    """Coefficients (n, e) of the change of heading since each knot: a polynomial, as omega is one."""
    n, d, c = coefficients.shape
    turns = np.zeros((n, 2 * d if curves else d + 1))
    for i in range(n):
        for a in range(d):
            if curves:
                for b in range(d):
                    turns[i, a + b + 1] += coefficients[i, a, 0] * coefficients[i, b, 1]
            else:
                turns[i, a + 1] = coefficients[i, a, c - 1]
        for a in range(1, turns.shape[1]):
            turns[i, a] /= a
    return turns


@kernel
def _polynomial(coefficients: Array, u: float) -> float:
    value = 0.0
    for a in range(len(coefficients) - 1, -1, -1):
        value = coefficients[a] + u * value
    return value


@kernel
def headings(time: Array, coefficients: Array, curves: bool, t: Array) -> Array:
    """Changes of heading (m,) from the first knot to times t (m,)."""
    turns = _turns(coefficients, curves)
    turned = np.empty(len(t))
    i, begin = 0, 0.0
    for k in range(len(t)):
        while i < len(turns) - 1 and time[i + 1] <= t[k]:
            begin += _polynomial(turns[i], time[i + 1] - time[i])
            i += 1
        turned[k] = begin + _polynomial(turns[i], t[k] - time[i])
    return turned


@kernel
def positions(time: Array, coefficients: Array, curves: bool, theta: float, t: Array) -> Array:
    """Where (m, 2) the body origin is from where it was at the first knot, at times t (m,) among which are
    the knots, by Gauss's rule between these times. theta: heading at the first knot."""
    c = coefficients.shape[2]
    turns = _turns(coefficients, curves)
    place = np.zeros((len(t), 2))
    i, begin = 0, theta
    for k in range(len(t) - 1):
        while i < len(turns) - 1 and time[i + 1] <= t[k]:
            begin += _polynomial(turns[i], time[i + 1] - time[i])
            i += 1
        h = t[k + 1] - t[k]
        x = y = 0.0
        for node, weight in zip(_NODES, _WEIGHTS):  # noqa: B905 - compiled
            u = t[k] + node * h - time[i]
            heading = begin + _polynomial(turns[i], u)
            vx = vy = 0.0
            for a in range(coefficients.shape[1] - 1, -1, -1):
                vx = coefficients[i, a, 0] + u * vx
                if c == 3:
                    vy = coefficients[i, a, 1] + u * vy
            cos, sin = math.cos(heading), math.sin(heading)
            x += weight * (cos * vx - sin * vy)
            y += weight * (sin * vx + cos * vy)
        place[k + 1, 0], place[k + 1, 1] = place[k, 0] + h * x, place[k, 1] + h * y
    return place
