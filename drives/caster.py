"""How a caster swings as its axis is led along a path.

With P = px + i·py the velocity of the steering axis in the body frame, per unit of s, and z = exp(iβ), the
law b·β′ = n·p - b·ω reads z′ = Q - iω·z - Q̄·z², Q = P/2b: a Riccati equation. Its flow is the Möbius map of
a linear system in 2×2 matrices,

    z(s) = (α·z0 + γ)/(γ̄·z0 + ᾱ),    [α γ; γ̄ ᾱ]′ = [-iω/2 Q; Q̄ iω/2]·[α γ; γ̄ ᾱ],

solved by one matrix exponential where the tangent is constant (straights, arcs), however long the step, and
to fourth order by the Magnus series elsewhere (Iserles et al., 2000, sect. 4). Written on the angle,

    β = β0 + 2 arg(α + γ·exp(-iβ0)),    |γ| < |α|,

it never leaves the circle and, as arg α stays small in every step, never loses a turn.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.drive import ActuatorPath, BodyPath
from drives.kernels import kernel
from drives.se2 import Array

__all__ = ["caster_law"]

FINEST = 64
"""Most steps an interval is cut into: a grid that needs more does not resolve the caster."""

ACCURACY = 5e-10
"""What the steps over an interval may err by, rad."""


def caster_law(
    path: BodyPath, x: Array, y: Array, radius: float, offset: float, start: Array
) -> ActuatorPath:
    """The actuator law along a path of casters whose steering axes are at (x, y) (m,), of this wheel radius
    and offset (m), and which stand at start (m,) rad as it begins.

    The angles are accurate to 1e-8 where the path's samples resolve the offset.
    """
    tangent, change = np.ascontiguousarray(path.tangent), np.ascontiguousarray(path.tangent_derivative)
    return ActuatorPath(*_law(path.s, tangent, change, x, y, radius, offset, start))


@kernel
def _law(
    s: Array, tangent: Array, change: Array, x: Array, y: Array, radius: float, offset: float, start: Array
) -> tuple[Array, Array, Array, Array]:
    """w, w′, β and β′ (n, m)."""
    n, m = len(s), len(x)
    w, dw, beta, slope = np.empty((n, m)), np.empty((n, m)), np.empty((n, m)), np.empty((n, m))
    p, dp = np.empty(n, np.complex128), np.empty(n, np.complex128)
    for j in range(m):
        axis = complex(x[j], y[j]) * 1j
        for i in range(n):
            p[i] = complex(tangent[i, 0], tangent[i, 1]) + tangent[i, 2] * axis
            dp[i] = complex(change[i, 0], change[i, 1]) + change[i, 2] * axis
        angle = start[j]
        back = complex(math.cos(angle), -math.sin(angle))
        for i in range(n):
            speed, rate = p[i] * back, dp[i] * back
            beta[i, j], slope[i, j] = angle, speed.imag / offset - tangent[i, 2]
            w[i, j], dw[i, j] = speed.real / radius, (rate.real + slope[i, j] * speed.imag) / radius
            if i < n - 1:
                angle, back = _swung(i, s, tangent, change, p, dp, offset, angle, back)
    return w, dw, beta, slope


@kernel
def _swung(
    i: int,
    s: Array,
    tangent: Array,
    change: Array,
    p: NDArray[np.complex128],
    dp: NDArray[np.complex128],
    offset: float,
    angle: float,
    back: complex,
) -> tuple[float, complex]:
    """The angle β and exp(-iβ) where interval i ends, given those where it begins. p, dp (n,): velocity of
    the steering axis, body frame, per unit of s, and its derivative."""
    h = s[i + 1] - s[i]
    # Of Hermite's cubics of q and t = -ω/2 over the interval: where they begin, slopes, and rise.
    half = h / (2 * offset)
    q, q_rise, q0, q1 = p[i] * half, (p[i + 1] - p[i]) * half, dp[i] * (half * h), dp[i + 1] * (half * h)
    t, t_rise = -h / 2 * tangent[i, 2], -h / 2 * (tangent[i + 1, 2] - tangent[i, 2])
    t0, t1 = -h * h / 2 * change[i, 2], -h * h / 2 * change[i + 1, 2]
    pieces = 1
    if q_rise != 0.0 or t_rise != 0.0 or q0 != 0.0 or q1 != 0.0 or t0 != 0.0 or t1 != 0.0 or abs(t) > 1.0:
        pieces = _steps(
            max(_size(q, t), _size(q + q_rise, t + t_rise)),
            max(_size(q_rise, t_rise), _size(q0, t0), _size(q1, t1)),
            max(abs(t), abs(t + t_rise)),
        )
    for k in range(pieces):
        u, v = (k + 0.5 - _GAUSS) / pieces, (k + 0.5 + _GAUSS) / pieces
        ta, tb = _cubic(t, t_rise, t0, t1, u), _cubic(t, t_rise, t0, t1, v)
        qa, qb = _cubic(q, q_rise, q0, q1, u), _cubic(q, q_rise, q0, q1, v)
        gain = _magnus(ta.real, tb.real, qa, qb, 1.0 / pieces, back)
        half_turn = gain.imag / gain.real  # its tangent; the real part is positive
        square = half_turn * half_turn
        if square < 1e-3:  # to the last bit
            angle += 2 * half_turn * (1 - square * (1 / 3 - square * (1 / 5 - square * (1 / 7 - square / 9))))
        else:
            angle += 2 * math.atan(half_turn)
        back *= complex(1.0 - square, -2.0 * half_turn) / (1.0 + square)
        back *= 1.5 - 0.5 * (back.real * back.real + back.imag * back.imag)  # stays on the circle
    return angle, back


_GAUSS = math.sqrt(3) / 6


@kernel
def _size(q: complex, t: float) -> float:
    return math.sqrt(q.real * q.real + q.imag * q.imag) + abs(t)


@kernel
def _steps(size: float, change: float, turn: float) -> int:
    """How many steps an interval takes, over which the linear system's matrix, of this size, changes by
    `change`: what the fourth-order series leaves out goes with its commutators. In one step the body turns by
    2 rad at most."""
    left_out = size * change * (size * size / 45 + change / 30)
    needed = max(math.sqrt(math.sqrt(left_out / ACCURACY)), turn)
    return int(min(max(math.ceil(needed), 1), FINEST)) if math.isfinite(needed) else 1


@kernel
def _cubic(begin: complex, rise: complex, first: complex, last: complex, u: float) -> complex:
    """Hermite's cubic over [0, 1] at u, its slopes at the ends `first` and `last`."""
    return begin + u * (first + u * (3 * rise - 2 * first - last + u * (first + last - 2 * rise)))


@kernel
def _magnus(t1: float, t2: float, q1: complex, q2: complex, h: float, back: complex) -> complex:
    """α + γ·back, up to a positive factor, of the step over h of [i·t q; q̄ -i·t], given t and q at the
    interval's two Gauss points."""
    skew = math.sqrt(3) / 12 * h * h
    t = h / 2 * (t1 + t2) - 2 * skew * (q1 * q2.conjugate()).imag
    q = h / 2 * (q1 + q2) - 2j * skew * (t1 * q2 - t2 * q1)
    square = q.real * q.real + q.imag * q.imag - t * t
    if (
        abs(square) < 0.1
    ):  # tanh(√x)/√x, or tan where x < 0, to the last bit: Padé's approximant [5/6] of tanh
        factor = (10395 + square * (1260 + square * 21)) / (10395 + square * (4725 + square * (210 + square)))
    else:
        root = math.sqrt(abs(square))
        factor = (math.tanh(root) if square >= 0 else math.tan(root)) / root
    return 1.0 + factor * (q * back + complex(0.0, t))
