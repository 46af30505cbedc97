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

from dataclasses import dataclass

import numpy as np

from drives.se2 import Array

__all__ = ["Module", "SwedishWheel", "rolling_row", "sliding_row", "solve_twist", "velocity_at"]


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


def sliding_row(x: Array | float, y: Array | float, heading: Array | float, trail: float = 0.0) -> Array:
    """Rows (..., 3) that take a twist to the velocity, m/s, of the contact to the left of `heading`.

    The contact lies `trail` (m) behind (x, y); the wheel's own turning is left out. Arguments broadcast.
    """
    c, s = np.cos(heading), np.sin(heading)
    return np.stack(np.broadcast_arrays(-s, c, x * c + y * s - trail), axis=-1)


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
    scaled = rows / (1.0, 1.0, length)
    transposed = scaled.transpose(0, 2, 1)
    pseudo = np.linalg.pinv(transposed @ scaled, rcond=1e-14, hermitian=True) @ transposed
    twist = (pseudo @ values[..., None])[..., 0]
    # One step of refinement: the normal equations square the condition number, this undoes it.
    rest = values - (scaled @ twist[..., None])[..., 0]
    twist = twist + (pseudo @ rest[..., None])[..., 0]
    slip = np.abs((scaled @ twist[..., None])[..., 0] - values).max(axis=1, initial=0.0)
    return twist / (1.0, 1.0, length), slip
