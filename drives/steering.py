"""Steered wheels: the direction of each wheel's own velocity, on one continuous branch along a path.

With p(s) the velocity of the wheel's axis per unit of s, e = (cos δ, sin δ) along p and n = (-sin δ, cos δ):

    δ = ∠p (mod π)      δ′ = n·p′ / e·p      w = e·p / r      w′ = e·p′ / r

Where p runs through zero its direction has a limit, ±p′: δ stays continuous and w changes sign.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drives.checks import STEERING_TOLERANCE
from drives.drive import ActuatorPath, BodyPath, InadmissibleTwist, WheelState
from drives.se2 import Array, Twist
from drives.wheel import velocity_at

__all__ = ["aim", "steer"]

AT_REST = 1e-6
"""Share of the body's speed below which p counts as zero: its direction is taken from p′, as round-off in δ′
grows with 1/|p|² while the error of taking p′ falls with |p|²."""

NEAR_MISS = 1e-4
"""Share of the body's speed: a p that comes so near to zero between samples is taken to run through it."""


def aim(x: Array, y: Array, radius: float, twist: Twist, near: Array | None) -> WheelState:
    """Rates and steering of wheels at (x, y) (m,) for one twist.

    near (m,) rad: take of the two directions, π apart, the nearest. None: angles in (-π, π], rates >= 0. A
    wheel whose own velocity is zero keeps its angle (0 without `near`).
    """
    row = np.array([twist], dtype=float)
    p = velocity_at(x, y, row)[0]
    standing = np.hypot(p[:, 0], p[:, 1]) <= 1e-12 * _size(x, y, row)
    angle = np.arctan2(p[:, 1] + 0.0, p[:, 0])  # + 0.0 turns -0.0, whose angle would be -π, into 0.0
    hold = np.zeros(len(x)) if near is None else np.asarray(near, dtype=float)
    if near is not None:
        angle = angle + np.pi * np.round((hold - angle) / np.pi)
    angle = np.where(standing, hold, angle)
    rates = np.where(standing, 0.0, (p[:, 0] * np.cos(angle) + p[:, 1] * np.sin(angle)) / radius)
    return WheelState(rates, angle, np.zeros(len(x)))


def steer(
    x: Array, y: Array, radius: float, path: BodyPath, near: Array | None, limit: float
) -> ActuatorPath:
    """The actuator law of steered wheels at (x, y) (m,) along a path.

    near (m,) rad: start on the branch (mod π) nearest to it that keeps |δ| <= limit; None: with w >= 0 and δ
    in (-π, π], unless the limit asks for another. Raises InadmissibleTwist where no branch is within it.
    """
    p, dp = velocity_at(x, y, path.tangent), velocity_at(x, y, path.tangent_derivative)
    size = _size(x, y, path.tangent)
    delta, slope = np.empty(p.shape[:2]), np.empty(p.shape[:2])
    for j in range(len(x)):
        hold = 0.0 if near is None else float(near[j])
        delta[:, j], slope[:, j] = _direction(path.s, p[:, j], dp[:, j], float(size[j]), hold)
    delta = delta + np.pi * _half_turns(delta, near, limit)
    e = np.stack([np.cos(delta), np.sin(delta)], axis=-1)
    return ActuatorPath((p * e).sum(-1) / radius, (dp * e).sum(-1) / radius, delta, slope)


def _size(x: Array, y: Array, twists: Array) -> Array:
    """The largest speed (m,) that each point could have at these twists, whichever way they point."""
    speed = np.hypot(twists[:, :1], twists[:, 1:2]) + np.hypot(x, y) * np.abs(twists[:, 2:])
    return np.asarray(speed.max(axis=0))


def _half_turns(delta: Array, near: Array | None, limit: float) -> Array:
    """How many half turns (m,) to add to delta (n, m) for the branch nearest to `near` within ±limit."""
    wanted = np.zeros(delta.shape[1]) if near is None else np.round((near - delta[0]) / np.pi)
    reach = limit + STEERING_TOLERANCE
    least, most = np.ceil((-reach - delta.min(0)) / np.pi), np.floor((reach - delta.max(0)) / np.pi)
    if not (least <= most).all():
        raise InadmissibleTwist(f"the steering does not stay within ±{limit:g} rad, on any branch")
    return np.clip(wanted, least, most)


def _direction(s: Array, p: Array, dp: Array, size: float, hold: float) -> tuple[Array, Array]:
    """The angle (n,) of p (n, 2), continuous modulo the half turns at its zeros, and its slope (n,)."""
    speed, growth = np.hypot(p[:, 0], p[:, 1]), np.hypot(dp[:, 0], dp[:, 1])
    moving = speed > AT_REST * size
    if not moving.any():
        return np.full(len(s), hold), np.zeros(len(s))
    known = np.flatnonzero(moving | (growth > AT_REST * growth.max()))
    v = np.where(moving[:, None], p, dp)[known]
    angle = np.arctan2(v[:, 1] + 0.0, v[:, 0])
    # A direction taken from p′, or on the far side of a zero of p, is known up to a half turn only.
    free = ~moving[known]
    half = free[1:] | free[:-1] | _runs_through_zero(s[known], p[known], dp[known], NEAR_MISS * size)
    period = np.where(half, np.pi, 2 * np.pi)
    angle[1:] -= np.cumsum(period * np.round(np.diff(angle) / period))
    delta = np.interp(s, s[known], angle)
    slope = np.zeros(len(s))
    if not moving.all():  # more than one sample, as one of them moves
        slope = np.gradient(delta, s, edge_order=2 if len(s) > 2 else 1)
    c, n = np.cos(delta), np.sin(delta)
    along, across = p[:, 0] * c + p[:, 1] * n, dp[:, 1] * c - dp[:, 0] * n
    np.divide(across, along, out=slope, where=moving)
    return delta, slope


def _runs_through_zero(s: Array, p: Array, dp: Array, near: float) -> NDArray[np.bool_]:
    """Whether p (n, 2), a cubic between samples, comes within `near` of zero in each interval (n - 1,)."""
    found = np.zeros(len(s) - 1, dtype=bool)
    i = np.flatnonzero((p[1:] * p[:-1]).sum(-1) < 0)
    if not len(i):
        return found
    h = (s[i + 1] - s[i])[:, None]
    p0, p1, m0, m1 = p[i], p[i + 1], h * dp[i], h * dp[i + 1]
    b, a = 3 * (p1 - p0) - 2 * m0 - m1, 2 * (p0 - p1) + m0 + m1
    u = np.full((len(i), 1), 0.5)
    for _ in range(6):  # Gauss-Newton on |p|², from the chord's own nearest point on
        value, rate = p0 + u * (m0 + u * (b + u * a)), m0 + u * (2 * b + u * 3 * a)
        down, steep = (value * rate).sum(-1, keepdims=True), (rate * rate).sum(-1, keepdims=True)
        u = np.clip(u - down / np.maximum(steep, 1e-300), 0.0, 1.0)
    value = p0 + u * (m0 + u * (b + u * a))
    found[i] = np.hypot(value[:, 0], value[:, 1]) < near
    return found
