"""How a caster swings as its axis is led along a path.

With P = px + i·py the velocity of the steering axis in the body frame, per unit of s, and z = exp(iβ), the
law b·β′ = n·p - b·ω reads z′ = Q - iω·z - Q̄·z², Q = P/2b: a Riccati equation. Its flow is the Möbius map of
a linear system in 2×2 matrices,

    z(s) = (α·z0 + γ)/(γ̄·z0 + ᾱ),    [α γ; γ̄ ᾱ]′ = [-iω/2 Q; Q̄ iω/2]·[α γ; γ̄ ᾱ],

solved by one matrix exponential where the tangent is constant (straights, arcs), however long the step, and
to fourth order by the Magnus series elsewhere (Iserles et al., 2000, sect. 4). Written on the angle,

    β = β0 + 2 arg α + 2 arg(1 + g·exp(-iβ0)),    g = γ/α,    |g| < 1,

it never leaves the circle and never loses a turn. So a step of the path is the pair (arg α, g); finding the
pairs is vectorised, and what remains to be done in sequence are a sine, a cosine and an arctangent a step.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drives.drive import BodyPath
from drives.se2 import Array

__all__ = ["swing"]

Complex = NDArray[np.complex128]

FINEST = 64
"""Most sub-steps an interval is cut into: a grid that needs more does not resolve the caster."""

TURN_PER_STEP = 0.1
"""Largest swing (rad) of a free caster in one sub-step."""


def swing(path: BodyPath, p: Array, dp: Array, start: Array, offset: float) -> Array:
    """Angles β (n, m) rad of casters of this offset (m) that stand at start (m,) as the path begins.

    p, dp (n, m, 2): velocity of each steering axis, body frame, per unit of s, and its derivative. Accurate
    to 1e-8 where the path's samples resolve the offset.
    """
    h = np.diff(path.s)[:, None]
    q, dq = _plane(p / (2 * offset)), _plane(dp / (2 * offset))
    t, dt = (-v[:, 2:].astype(np.complex128) / 2 for v in (path.tangent, path.tangent_derivative))
    swing_rate = 2 * np.abs(q) + np.abs(path.tangent[:, 2:])
    needed = float((h * np.maximum(swing_rate[1:], swing_rate[:-1])).max(initial=0.0)) / TURN_PER_STEP
    pieces = min(max(math.ceil(needed), 1), FINEST) if math.isfinite(needed) else 1
    q_at, t_at = _cubic(q, dq, h), _cubic(t, dt, h)
    step: tuple[Array, Complex] | None = None
    for k in range(pieces):
        early, late = (k + 0.5 - math.sqrt(3) / 6) / pieces, (k + 0.5 + math.sqrt(3) / 6) / pieces
        piece = _magnus(t_at(early).real, t_at(late).real, q_at(early), q_at(late), h / pieces)
        step = piece if step is None else _then(step, piece)
    assert step is not None
    turn, pull = step
    return np.asarray(_follow(np.array(start), np.ascontiguousarray(turn), np.ascontiguousarray(pull)))


def _plane(v: Array) -> Complex:
    """Vectors (..., 2) as complex numbers (...)."""
    return np.ascontiguousarray(v).view(np.complex128)[..., 0]


def _cubic(y: Complex, dy: Complex, h: Array) -> Callable[[float], Complex]:
    """Hermite's cubic through y (n, m) with slopes dy, as a function of the fraction of every interval."""
    y0, m0, m1 = y[:-1], h * dy[:-1], h * dy[1:]
    rise = y[1:] - y0
    b, a = 3 * rise - 2 * m0 - m1, m0 + m1 - 2 * rise
    return lambda u: y0 + u * (m0 + u * (b + u * a))


def _magnus(t1: Array, t2: Array, q1: Complex, q2: Complex, h: Array) -> tuple[Array, Complex]:
    """The step (arg α, g) over h of [i·t q; q̄ -i·t], given t and q at the interval's two Gauss points."""
    skew = math.sqrt(3) / 12 * h * h
    t = h / 2 * (t1 + t2) - 2 * skew * (q1 * q2.conj()).imag
    q = h / 2 * (q1 + q2) - 2j * skew * (t1 * q2 - t2 * q1)
    square = np.abs(q) ** 2 - t * t
    root = np.sqrt(np.abs(square))
    safe = np.maximum(root, 1e-9)  # below it both quotients are 1 to the last bit
    factor = np.where(square >= 0, np.tanh(safe), np.tan(safe)) / safe
    return np.arctan(t * factor), q * factor / (1 + 1j * t * factor)


def _then(first: tuple[Array, Complex], second: tuple[Array, Complex]) -> tuple[Array, Complex]:
    """One step after another as a single step, no turn lost."""
    (a1, g1), (a2, g2) = first, second
    back = np.exp(-2j * a1) * g2
    one = 1 + back * g1.conj()
    return a1 + a2 + np.angle(one), (g1 + back) / one


@njit(cache=True, error_model="numpy")
def _follow(start: Array, a: Array, g: Complex) -> Array:
    """The angles (n, m) after none, one, … all of the steps a, g (n - 1, m)."""
    beta = np.empty((len(a) + 1, len(start)))
    beta[0] = start
    for i in range(len(a)):
        for j in range(len(start)):
            angle = beta[i, j]
            beta[i + 1, j] = angle + 2 * a[i, j] + 2 * cmath.phase(1 + g[i, j] * cmath.rect(1.0, -angle))
    return beta
