"""Poses and twists of the plane.

World frame: x, y on the floor, theta counter-clockwise from +x (ROS REP-103). Body frame: x forward, y left.
A twist (vx, vy, omega) is always in the body frame. Arrays of poses and twists have shape (n, 3).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Pose", "Twist", "between", "compose", "exp", "wrap"]

Array = NDArray[np.float64]


class Pose(NamedTuple):
    """Position (m) and heading (rad) of a body in the world frame."""

    x: float
    y: float
    theta: float


class Twist(NamedTuple):
    """Velocity (m/s) and yaw rate (rad/s) of a body in its own frame."""

    vx: float
    vy: float
    omega: float


def wrap(angle: float) -> float:
    """The same angle in (-π, π]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)


def compose(a: Pose, b: Pose) -> Pose:
    """The pose b, given in the frame of a, in the frame that a is given in. Headings add, unwrapped."""
    c, s = math.cos(a.theta), math.sin(a.theta)
    return Pose(a.x + c * b.x - s * b.y, a.y + s * b.x + c * b.y, a.theta + b.theta)


def between(a: Pose, b: Pose) -> Pose:
    """The pose b in the frame of a: compose(a, between(a, b)) = b."""
    c, s = math.cos(a.theta), math.sin(a.theta)
    dx, dy = b.x - a.x, b.y - a.y
    return Pose(c * dx + s * dy, -s * dx + c * dy, b.theta - a.theta)


def exp(twist: Twist) -> Pose:
    """The displacement of holding a twist for one second, in the frame where it began.

    For omega ≠ 0 it is an arc about the instantaneous centre of curvature (Lynch and Park, 2017, eq. 13.35).
    """
    vx, vy, omega = twist
    half = omega / 2
    sinc = math.sin(half) / half if abs(half) > 1e-9 else 1 - half * half / 6
    c, s = math.cos(half) * sinc, math.sin(half) * sinc
    return Pose(c * vx - s * vy, s * vx + c * vy, omega)
