"""One wheel: what it asks of the body's twist ξ = (vx, vy, omega), everything in the body frame.

The velocity of the body point (x, y) is p = (vx - y·omega, vy + x·omega). A wheel standing there with heading
β rolls along e = (cos β, sin β), and n = (-sin β, cos β) points to its left:

    fixed or steered    e·p = radius·rate                        n·p = 0
    caster              e·p = radius·rate                        n·p - trail·omega = trail·β̇
    Swedish, roller γ   e(β + γ)·p = radius·cos γ·rate           unconstrained

A caster's pivot stands at (x, y) and its contact trails the pivot by `trail`. Sources: Siegwart and
Nourbakhsh (2004), sect. 3.2.3, whose heading of the rolling direction is α + β - π/2 in ours; Swedish wheel
eq. (3.19).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drives.kernels import kernel
from drives.se2 import Array

__all__ = ["Module", "SwedishWheel", "fixed_motion", "rigid_motion", "rolling_row", "velocity_at"]


@dataclass(frozen=True, slots=True)
class Module:
    """A steered wheel: its name and the body point (m) of its steering axis."""

    name: str
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class SwedishWheel:
    """A wheel with rollers on its rim, standing at (x, y) m.

    heading rad: its rolling direction; roller_angle rad: 0 for rollers that run across it (Swedish 90°), ±π/4
    for Swedish 45°; radius m.
    """

    name: str
    x: float
    y: float
    heading: float
    roller_angle: float
    radius: float


def rolling_row(x: Array | float, y: Array | float, heading: Array | float) -> Array:
    """Rows (..., 3) that take a twist to the velocity of (x, y) along `heading`, m/s. Arguments broadcast."""
    c, s = np.cos(heading), np.sin(heading)
    return np.stack(np.broadcast_arrays(c, s, x * s - y * c), axis=-1)


def velocity_at(x: Array, y: Array, twists: Array) -> Array:
    """Velocities (n, m, 2), body frame, of the m points (x, y) (m,) of bodies moving with twists (n, 3)."""
    found = np.empty((len(twists), len(x), 2))
    found[..., 0] = twists[:, :1] - twists[:, 2:] * y
    found[..., 1] = twists[:, 1:2] + twists[:, 2:] * x
    return found


def rigid_motion(
    x: Array, y: Array, radius: float, trail: float, rates: Array, steering: Array, steering_rates: Array
) -> tuple[Array, Array]:
    """Least-squares twists (n, 3) of wheels at (x, y) (m,) that roll at rates (n, m), and slip (n,).

    The first k wheels are steered: steering and steering_rates (n, k); the others head along x. The contact
    of a steered wheel trails its axis by `trail` (m). Slip is the largest residual, m/s, of the rolling and
    sliding equations. Where all contacts are one point, the twist is the shortest, lengths in units of its
    distance from the origin.
    """
    columns = (np.ascontiguousarray(each.T, dtype=float) for each in (rates, steering, steering_rates))
    twist, slip = _rigid_motion(x, y, radius, trail, *columns)
    return twist.T, slip


_ONE_POINT = 1e-14
"""Σ|q - q̄|² ≤ this · Σ|q|² of contacts q: they count as one point."""


@kernel
def _rigid_motion(
    x: Array, y: Array, radius: float, trail: float, rates: Array, steering: Array, swing: Array
) -> tuple[Array, Array]:
    """rigid_motion of columns: rates (m, n), steering and its rates (k, n); twists (3, n).

    The equations of a wheel, rolling and sliding, say the velocity u of its contact q in two directions at
    right angles. So their least squares are those of a rigid motion v + ω × q = u, whose optimum is known:
    ω = Σ (q - q̄) × (u - ū) / Σ |q - q̄|² and v = ū - ω × q̄.
    """
    m, n = rates.shape
    k = len(steering)
    twist, slip = np.empty((3, n)), np.empty(n)
    c, s = np.ones(m), np.zeros(m)
    rolled, slid, angle = np.empty(m), np.zeros(m), np.full(k, np.nan)
    qx, qy, ux, uy = x.copy(), y.copy(), np.empty(m), np.empty(m)
    for i in range(n):
        px = py = vx = vy = 0.0
        for j in range(m):
            rolled[j] = radius * rates[j, i]
            if j < k:
                slid[j] = trail * swing[j, i]
                if steering[j, i] != angle[j]:  # on lines and arcs it stays what it was
                    angle[j] = steering[j, i]
                    c[j], s[j] = math.cos(angle[j]), math.sin(angle[j])
                    qx[j], qy[j] = x[j] - trail * c[j], y[j] - trail * s[j]
            ux[j], uy[j] = rolled[j] * c[j] - slid[j] * s[j], rolled[j] * s[j] + slid[j] * c[j]
            px, py, vx, vy = px + qx[j], py + qy[j], vx + ux[j], vy + uy[j]
        px, py, vx, vy = px / m, py / m, vx / m, vy / m
        cross = spread = size = 0.0
        for j in range(m):
            dx, dy = qx[j] - px, qy[j] - py
            cross += dx * (uy[j] - vy) - dy * (ux[j] - vx)
            spread += dx * dx + dy * dy
            size += qx[j] * qx[j] + qy[j] * qy[j]
        if spread > _ONE_POINT * size:
            omega = cross / spread
        else:
            # The shortest: half the mean of |q|² is the unit of length, squared.
            far = px * px + py * py
            omega = (px * vy - py * vx) / (1.5 * far) if far > 0.0 else 0.0
        vx, vy = vx + omega * py, vy - omega * px
        worst = 0.0
        for j in range(m):
            wx, wy = vx - omega * qy[j], vy + omega * qx[j]
            along, across = wx * c[j] + wy * s[j] - rolled[j], wy * c[j] - wx * s[j] - slid[j]
            # The other way round, what is no number would be lost.
            worst = worst if abs(along) <= worst else abs(along)
            worst = worst if abs(across) <= worst else abs(across)
        twist[0, i], twist[1, i], twist[2, i], slip[i] = vx, vy, omega, worst
    return twist, slip


def fixed_motion(rows: Array, pseudo: Array, travel: Array, rates: Array) -> tuple[Array, Array]:
    """Least-squares twists (n, 3) of wheels at constant rows (e, 3), and slip (n,). rates (n, m) rad/s and
    travel (m,) m/rad: rows · twist = travel * rates, and 0 for rows beyond the m-th; pseudo (3, e): the rows'
    pseudo-inverse."""
    twist, slip = _fixed_motion(rows, pseudo, travel, np.ascontiguousarray(rates.T, dtype=float))
    return twist.T, slip


@kernel
def _fixed_motion(rows: Array, pseudo: Array, travel: Array, rates: Array) -> tuple[Array, Array]:
    """fixed_motion of columns: rates (m, n), twists (3, n). The innermost loops are vectorized."""
    m, n = rates.shape
    twist, slip = np.zeros((3, n)), np.zeros(n)
    for a in range(3):
        for k in range(m):
            share = pseudo[a, k] * travel[k]
            for i in range(n):
                twist[a, i] += share * rates[k, i]
    for k in range(len(rows)):
        x, y, z = rows[k, 0], rows[k, 1], rows[k, 2]
        for i in range(n):
            said = travel[k] * rates[k, i] if k < m else 0.0
            unmet = abs(x * twist[0, i] + y * twist[1, i] + z * twist[2, i] - said)
            # The other way round, what is no number would be lost.
            slip[i] = slip[i] if unmet <= slip[i] else unmet
    return twist, slip
