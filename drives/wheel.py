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
from numba import njit
from numpy.typing import NDArray

from drives.se2 import Array

__all__ = ["Module", "SwedishWheel", "explained", "rolling_row", "solve_twist", "velocity_at", "wheel_rows"]


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


def wheel_rows(x: Array, y: Array, heading: Array, trail: float = 0.0) -> Array:
    """Of m wheels at `heading` (n, m), (n, 2m, 3): the rolling rows, then the sliding rows.

    A sliding row takes a twist to the velocity, m/s, of the contact to the left of `heading`. The contact
    lies `trail` (m) behind (x, y); the wheel's own turning is left out.
    """
    return np.asarray(_wheel_rows(x, y, np.ascontiguousarray(heading), float(trail)))


@njit(cache=True, error_model="numpy")
def _wheel_rows(x: Array, y: Array, heading: Array, trail: float) -> Array:
    n, m = heading.shape
    rows = np.empty((n, 2 * m, 3))
    for i in range(n):
        for j in range(m):
            c, s = 1.0, 0.0
            if heading[i, j] != 0.0:  # of wheels that never steer it is
                c, s = math.cos(heading[i, j]), math.sin(heading[i, j])
            rows[i, j, 0], rows[i, j, 1], rows[i, j, 2] = c, s, x[j] * s - y[j] * c
            k = m + j
            rows[i, k, 0], rows[i, k, 1], rows[i, k, 2] = -s, c, x[j] * c + y[j] * s - trail
    return rows


def velocity_at(x: Array, y: Array, twists: Array) -> Array:
    """Velocities (n, m, 2), body frame, of the m points (x, y) (m,) of bodies moving with twists (n, 3)."""
    vx, vy, omega = twists[:, :1], twists[:, 1:2], twists[:, 2:]
    return np.stack([vx - omega * y, vy + omega * x], axis=-1)


def solve_twist(rows: Array, values: Array) -> tuple[Array, Array]:
    """Least-squares twists (n, 3) of rows (n, e, 3) · twist = values (n, e), and slip (n,).

    Slip is the largest residual. Where the rows leave a direction of motion open, the twist is the shortest.
    """
    # A length of the robot's own size makes vx, vy and omega comparable, so the normal equations stay well
    # conditioned.
    length = float(np.sqrt(np.mean(rows[..., 2] ** 2))) or 1.0
    twist, slip, left = _solve(rows, values, length)
    if left.any():
        twist[left], slip[left] = _solve_by_pinv(rows[left] / (1.0, 1.0, length), values[left])
        twist[left] /= (1.0, 1.0, length)
    return twist, slip


@njit(cache=True, error_model="numpy")
def explained(rows: Array, pseudo: Array, rates: Array, travel: Array) -> tuple[Array, Array]:
    """Least-squares twists (n, 3) of wheels at constant rows (e, 3), and slip (n,). rates (n, m) rad/s and
    travel (m,) m/rad: rows · twist = travel * rates, and 0 for rows beyond the m-th; pseudo (3, e): the rows'
    pseudo-inverse."""
    n, m = rates.shape
    twist, slip = np.empty((n, 3)), np.zeros(n)
    values = np.zeros(len(rows))
    for i in range(n):
        vx = vy = omega = 0.0
        for k in range(m):
            v = values[k] = travel[k] * rates[i, k]
            vx, vy, omega = vx + pseudo[0, k] * v, vy + pseudo[1, k] * v, omega + pseudo[2, k] * v
        for k in range(len(rows)):
            unmet = abs(rows[k, 0] * vx + rows[k, 1] * vy + rows[k, 2] * omega - values[k])
            if unmet > slip[i] or math.isnan(unmet):
                slip[i] = unmet
        twist[i, 0], twist[i, 1], twist[i, 2] = vx, vy, omega
    return twist, slip


_SINGULAR = 1e-9
"""det ≤ this · trace³ of the normal equations' matrix: a pseudo-inverse is taken. Else the rows' condition
number is below 12,200, as det / trace³ ≤ 4/27 · (smallest / largest eigenvalue)."""


@njit(cache=True, error_model="numpy")
def _solve(rows: Array, values: Array, length: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Twists (n, 3), slip (n,), and which of them (n,) are left open: their rows are next to singular."""
    n, e, _ = rows.shape
    twist, slip, left = np.zeros((n, 3)), np.zeros(n), np.zeros(n, np.bool_)
    for i in range(n):
        xx = xy = xz = yy = yz = zz = 0.0
        for k in range(e):
            x, y, z = rows[i, k, 0], rows[i, k, 1], rows[i, k, 2] / length
            xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
            yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
        # The inverse by cofactors.
        a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
        d, f, g = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
        det = xx * a + xy * b + xz * c
        if not det > _SINGULAR * (xx + yy + zz) ** 3:
            left[i] = True
            continue
        vx = vy = omega = 0.0
        # One step of refinement: the normal equations square the condition number, this undoes it.
        for _ in range(2):
            p = q = r = 0.0
            for k in range(e):
                x, y, z = rows[i, k, 0], rows[i, k, 1], rows[i, k, 2] / length
                rest = values[i, k] - (x * vx + y * vy + z * omega)
                p, q, r = p + x * rest, q + y * rest, r + z * rest
            vx += (a * p + b * q + c * r) / det
            vy += (b * p + d * q + f * r) / det
            omega += (c * p + f * q + g * r) / det
        for k in range(e):
            x, y, z = rows[i, k, 0], rows[i, k, 1], rows[i, k, 2] / length
            unmet = abs(x * vx + y * vy + z * omega - values[i, k])
            if unmet > slip[i] or math.isnan(unmet):
                slip[i] = unmet
        twist[i, 0], twist[i, 1], twist[i, 2] = vx, vy, omega / length
    return twist, slip, left


def _solve_by_pinv(rows: Array, values: Array) -> tuple[Array, Array]:
    """Twists (n, 3) and slip (n,) by the pseudo-inverse: of any rank, and slow."""
    transposed = rows.transpose(0, 2, 1)
    pseudo = np.linalg.pinv(transposed @ rows, rcond=1e-14, hermitian=True) @ transposed
    twist = (pseudo @ values[..., None])[..., 0]
    rest = values - (rows @ twist[..., None])[..., 0]
    twist = twist + (pseudo @ rest[..., None])[..., 0]
    return twist, np.abs((rows @ twist[..., None])[..., 0] - values).max(axis=1, initial=0.0)
