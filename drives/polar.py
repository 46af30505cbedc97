"""A unicycle seen from its goal, in polar coordinates, and the wheel rates that take it there in two moves.

Source: Szoke, Negrean, Schonstein and Kacso, "Kinematic control" of a mobile robot, eq. (25)-(45). Their
wheels are 1 = right, 2 = left, l is half the track width; a (v, omega) becomes wheel rates by the drive's own
inverse().
"""

from __future__ import annotations

import math
from typing import NamedTuple

from drives.se2 import Pose, Twist, wrap

__all__ = ["Polar", "polar", "polar_rates", "rotation", "translation"]


class Polar(NamedTuple):
    """rho m: distance to the goal; alpha rad in (-π, π]: its bearing from the body; beta: -theta - alpha."""

    rho: float
    alpha: float
    beta: float


def polar(pose: Pose, goal: tuple[float, float]) -> Polar:
    """Polar coordinates of a body at `pose` about the goal (x, y) m, world frame: eq. (25), (26), (38).

    On the goal itself alpha is 0.
    """
    dx, dy = goal[0] - pose.x, goal[1] - pose.y
    rho = math.hypot(dx, dy)
    alpha = wrap(math.atan2(dy, dx) - pose.theta) if rho > 0.0 else 0.0
    return Polar(rho, alpha, -pose.theta - alpha)


def polar_rates(at: Polar, twist: Twist) -> Polar:
    """Rates of rho (m/s), alpha and beta (rad/s) of a body moving with (v, 0, omega): eq. (34).

    Raises ValueError on the goal itself, where alpha has no rate.
    """
    if at.rho == 0.0:
        raise ValueError("rho is 0: on the goal itself alpha and beta have no rate")
    swing = twist.vx * math.sin(at.alpha) / at.rho
    return Polar(-twist.vx * math.cos(at.alpha), swing - twist.omega, -swing)


def rotation(angle: float, duration: float) -> Twist:
    """The twist that turns on the spot by `angle` (rad) in `duration` (s): eq. (44), φ̇₁,₂ = ±(l/r)·Δθ/Δt."""
    return Twist(0.0, 0.0, angle / duration)


def translation(distance: float, alpha: float, duration: float) -> Twist:
    """The twist that covers `distance` (m) straight to a goal at bearing alpha, 0 or π, in `duration` (s).

    Eq. (45), φ̇₁,₂ = -(1/Δt)·Δρ/(r·cos α), where Δρ is the change of rho, -distance: eq. (43) prints it with
    the sign of the distance, which drives away from the goal. Raises ValueError at any other bearing.
    """
    if abs(math.sin(alpha)) > 1e-9:
        raise ValueError(
            f"alpha is {alpha:g}: turn to the goal first, a straight move reaches it at 0 or π only"
        )
    return Twist(distance / (math.cos(alpha) * duration), 0.0, 0.0)
