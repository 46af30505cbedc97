"""Motion at a constant twist: a straight line, or a circle about the instantaneous centre of curvature.

It holds for every drive; which twist the wheels' rates make is the drive's own forward(). Sources: locomotion
lecture, "Differential drive" and "Generalized kinematics equation"; Konstantinov et al., sect. 3.
"""

from __future__ import annotations

import math

from drives.se2 import Pose, Twist, compose, exp

__all__ = ["centre_of_curvature", "follow", "radius_of_curvature"]

STRAIGHT = 1e12
"""A radius (m) beyond which a twist that comes out of wheel rates turns by round-off alone."""


def centre_of_curvature(pose: Pose, twist: Twist) -> tuple[float, float] | None:
    """The point (m, world) that a body at `pose` turns about; None where it does not turn.

    For vy = 0 it is (x - R sin θ, y + R cos θ) with R = vx/omega.
    """
    if math.isinf(radius_of_curvature(twist)):
        return None
    centre = compose(pose, Pose(-twist.vy / twist.omega, twist.vx / twist.omega, 0.0))
    return centre.x, centre.y


def radius_of_curvature(twist: Twist) -> float:
    """Radius (m) of the circle that the body origin runs on; inf where the body does not turn.

    R = a·2Ω₁/|Ω| for a three-wheel omni drive (printed as half of that), l(v_l + v_r)/2(v_r - v_l) up to its
    sign for a differential drive (printed with v_l - v_r below).
    """
    speed, turn = math.hypot(twist.vx, twist.vy), abs(twist.omega)
    return speed / turn if speed < STRAIGHT * turn else math.inf


def follow(pose: Pose, twist: Twist, duration: float) -> Pose:
    """The pose that a body at `pose` reaches by holding `twist` for `duration` (s); theta is unwrapped."""
    return compose(pose, exp(Twist(twist.vx * duration, twist.vy * duration, twist.omega * duration)))
