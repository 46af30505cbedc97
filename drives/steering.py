"""Steered wheels: the direction of each wheel's own velocity, on one continuous branch along a path.

With p(s) the velocity of the wheel's axis per unit of s, e = (cos δ, sin δ) along p and n = (-sin δ, cos δ):

    δ = ∠p (mod π)      δ′ = n·p′ / e·p      w = e·p / r      w′ = e·p′ / r

Where p runs through zero its direction has a limit, ±p′: δ stays continuous and w changes sign.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.checks import STEERING_TOLERANCE
from drives.drive import ActuatorPath, BodyPath, InadmissibleTwist, WheelState
from drives.kernels import kernel
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
    hold = np.zeros(len(x)) if near is None else np.array(near, dtype=float)
    tangent, change = np.ascontiguousarray(path.tangent), np.ascontiguousarray(path.tangent_derivative)
    w, dw, delta, slope, standing = _steered(x, y, radius, path.s, tangent, change, hold)
    partly = np.flatnonzero(standing.any(0) & ~standing.all(0)) if standing.any() else ()
    for j in partly:
        there = standing[:, j]  # where p′ tells the direction, δ′ comes from δ
        slope[there, j] = np.gradient(delta[:, j], path.s, edge_order=2 if len(path.s) > 2 else 1)[there]
    wanted = np.zeros(len(x)) if near is None else np.round((hold - delta[0]) / np.pi)
    turns = _half_turns(delta, wanted, limit + STEERING_TOLERANCE)
    if np.isnan(turns).any():
        raise InadmissibleTwist(f"the steering does not stay within ±{limit:g} rad, on any branch")
    if not turns.any():
        return ActuatorPath(w, dw, delta, slope)
    sense = 1 - 2 * (turns % 2)
    return ActuatorPath(w * sense, dw * sense, delta + np.pi * turns, slope)


@kernel
def _steered(
    x: Array, y: Array, radius: float, s: Array, tangent: Array, change: Array, hold: Array
) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
    """w, w′, δ and δ′ (n, m), δ continuous modulo the half turns at the zeros of p; and where p counts as
    zero (n, m): there δ′ is 0. A wheel that never moves is at `hold` (m,)."""
    n, m = len(s), len(x)
    w, dw, delta, slope = np.empty((n, m)), np.empty((n, m)), np.empty((n, m)), np.zeros((n, m))
    standing = np.empty((n, m), np.bool_)
    p, dp = np.empty((n, 2)), np.empty((n, 2))
    for j in range(m):
        size = growth = 0.0
        lever = math.sqrt(x[j] * x[j] + y[j] * y[j])
        for i in range(n):
            p[i, 0], p[i, 1] = tangent[i, 0] - tangent[i, 2] * y[j], tangent[i, 1] + tangent[i, 2] * x[j]
            dp[i, 0], dp[i, 1] = change[i, 0] - change[i, 2] * y[j], change[i, 1] + change[i, 2] * x[j]
            body = math.sqrt(tangent[i, 0] ** 2 + tangent[i, 1] ** 2) + lever * abs(tangent[i, 2])
            size, growth = max(size, body), max(growth, math.sqrt(dp[i, 0] ** 2 + dp[i, 1] ** 2))
        moves = False
        for i in range(n):
            standing[i, j] = not math.sqrt(p[i, 0] ** 2 + p[i, 1] ** 2) > AT_REST * size
            moves |= not standing[i, j]
        last, raw, turns, known = -1, 0.0, 0.0, 0.0
        for i in range(n):
            still = standing[i, j]
            if not moves:
                delta[i, j] = hold[j]
            elif still and not math.sqrt(dp[i, 0] ** 2 + dp[i, 1] ** 2) > AT_REST * growth:
                # Nothing tells its direction here: from the last known one on to the next.
                delta[i, j] = known
                continue
            else:
                before = raw
                raw = math.atan2((dp if still else p)[i, 1] + 0.0, (dp if still else p)[i, 0])
                if last >= 0:
                    # Taken from p′, or on the far side of a zero of p, it is known up to a half turn only.
                    half = still or standing[last, j]
                    half = half or _runs_through_zero(s[i] - s[last], p, dp, last, i, NEAR_MISS * size)
                    period = 1 if half else 2
                    turns += period * round((raw - before) / (period * math.pi))
                delta[i, j] = raw - math.pi * turns
                for k in range(last + 1, i):
                    share = (s[k] - s[last]) / (s[i] - s[last]) if last >= 0 else 1.0
                    delta[k, j] = known + share * (delta[i, j] - known)
                last, known = i, delta[i, j]
            if not still:
                speed = math.sqrt(p[i, 0] ** 2 + p[i, 1] ** 2)
                signed = speed if turns % 2 == 0 else -speed
                w[i, j] = signed / radius
                dw[i, j] = (p[i, 0] * dp[i, 0] + p[i, 1] * dp[i, 1]) / (signed * radius)
                slope[i, j] = (p[i, 0] * dp[i, 1] - p[i, 1] * dp[i, 0]) / (speed * speed)
        for i in range(n):
            if standing[i, j]:
                c, q = math.cos(delta[i, j]), math.sin(delta[i, j])
                w[i, j], dw[i, j] = (
                    (p[i, 0] * c + p[i, 1] * q) / radius,
                    (dp[i, 0] * c + dp[i, 1] * q) / radius,
                )
    return w, dw, delta, slope, standing


def _size(x: Array, y: Array, twists: Array) -> Array:
    """The largest speed (m,) that each point could have at these twists, whichever way they point."""
    speed = np.hypot(twists[:, :1], twists[:, 1:2]) + np.hypot(x, y) * np.abs(twists[:, 2:])
    return np.asarray(speed.max(axis=0))


@kernel
def _half_turns(delta: Array, wanted: Array, reach: float) -> Array:
    """How many half turns (m,), as near to `wanted` (m,) as may be, to add to delta (n, m) so that it stays
    within ±reach. NaN: no number of them will do."""
    turns = wanted.copy()
    for j in range(len(turns)):
        low = high = delta[0, j]
        for i in range(len(delta)):
            low, high = min(low, delta[i, j]), max(high, delta[i, j])
        least, most = np.ceil((-reach - low) / math.pi), np.floor((reach - high) / math.pi)
        turns[j] = min(max(wanted[j], least), most) if least <= most else math.nan
    return turns


@kernel
def _runs_through_zero(h: float, p: Array, dp: Array, i: int, k: int, near: float) -> bool:
    """Whether p (n, 2), a cubic of length h between samples i and k, comes within `near` of zero there."""
    if not p[i, 0] * p[k, 0] + p[i, 1] * p[k, 1] < 0.0:
        return False
    value, rate, u = np.empty(2), np.empty(2), 0.5
    for step in range(7):  # Gauss-Newton on |p|², from the chord's own nearest point on
        for c in range(2):
            rise, begin, end = p[k, c] - p[i, c], h * dp[i, c], h * dp[k, c]
            b, a = 3 * rise - 2 * begin - end, begin + end - 2 * rise
            value[c] = p[i, c] + u * (begin + u * (b + u * a))
            rate[c] = begin + u * (2 * b + u * 3 * a)
        if step < 6:
            down, steep = value[0] * rate[0] + value[1] * rate[1], rate[0] ** 2 + rate[1] ** 2
            u = min(1.0, max(0.0, u - down / max(steep, 1e-300)))
    return math.sqrt(value[0] ** 2 + value[1] ** 2) < near
