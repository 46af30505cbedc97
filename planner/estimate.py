"""How long motions take, roughly: from rest to rest, or in passing, under all limits but jerk. Compiled."""

from __future__ import annotations

import math

import numpy as np

from drives.drive import Drive, Limits
from drives.se2 import Array
from planner.kernels import kernel

__all__ = ["pace", "step_duration"]

_SAMPLES = 5
"""On a straight line that turns, at which it is estimated."""


def pace(drive: Drive, limits: Limits) -> Array:
    """What step_duration needs to know of a robot, (m + 1, 8); trailing wheels count as swung round.

    A row a wheel: p and q, (3,) each, such that it turns at hypot(p·ξ, q·ξ) rad/s at a twist ξ, and one over
    its largest rate and acceleration. The last: one over the body's largest linear speed, angular speed,
    lateral and linear acceleration.
    """
    law = drive.settled.rolling_law()
    m = len(law.rows)
    (x, y), one = law.points.T, np.ones(m)
    steered = law.steered[:, None] / law.radius[:, None]
    p = law.rows + steered * np.stack([one, 0 * one, -y], -1)
    q = steered * np.stack([0 * one, one, x], -1)
    turning = min(limits.angular_speed, limits.steering_rate if law.heading_steers else np.inf)
    body = 1 / np.array(
        [limits.linear_speed, turning, limits.lateral_acceleration, limits.linear_acceleration]
    )
    wheels = np.column_stack([p, q, 1 / limits.wheel_speed, 1 / limits.wheel_acceleration])
    return np.vstack([wheels, [*body, 0.0, 0.0, 0.0, 0.0]])


@kernel
def _slowness(pace: Array, vx: float, vy: float, turn: float) -> tuple[float, float]:
    """Least time (s) at a twist for what it does in unit time, and one over its largest acceleration."""
    m = len(pace) - 1
    speed = math.sqrt(vx * vx + vy * vy)
    slow = max(speed * pace[m, 0], abs(turn) * pace[m, 1], math.sqrt(abs(turn) * speed * pace[m, 2]))
    heavy = speed * pace[m, 3]
    for i in range(m):
        p = pace[i, 0] * vx + pace[i, 1] * vy + pace[i, 2] * turn
        q = pace[i, 3] * vx + pace[i, 4] * vy + pace[i, 5] * turn
        rate = math.sqrt(p * p + q * q)
        slow, heavy = max(slow, rate * pace[i, 6]), max(heavy, rate * pace[i, 7])
    return slow, heavy


@kernel
def step_duration(
    pace: Array, theta: float, dx: float, dy: float, turn: float, straight: bool, flows: bool
) -> float:
    """Estimate (s) of the time that a step takes: from rest to rest at the worst of each limit on the way, or
    where it flows, at full speed, as if the robot came by.

    A step is a twist held for unit time or, where `straight`, a displacement in the world, from a pose of
    heading theta.
    """
    samples = _SAMPLES if straight and turn != 0.0 else 1
    most, heavy, passing = 0.0, 0.0, 0.0
    for k in range(samples):
        heading = theta + turn * k / max(samples - 1, 1) if straight else 0.0
        c, s = math.cos(heading), math.sin(heading)
        slow, mass = _slowness(pace, c * dx + s * dy, c * dy - s * dx, turn)
        most, heavy, passing = max(most, slow), max(heavy, mass), passing + slow / samples
    if flows:
        return passing
    if most * most > heavy:
        return most + heavy / most
    return 2.0 * math.sqrt(heavy)
