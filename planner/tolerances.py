"""Every tolerance of the certificate. docs/certificate.md gives the reason for each.

Lengths are in m, angles in rad, speeds in m/s and rad/s. A share is relative to the limit.
"""

from __future__ import annotations

__all__ = [
    "BACKWARDS", "CLEARANCE", "CLEARANCE_ACCURACY", "CLEARANCE_SHARE", "COLUMN", "COPIED", "HEADING",
    "LONGEST", "POSITION", "POSITION_PER_METRE", "QUANTITIES", "REST", "SAME", "SATURATED", "SLIP", "TURNING",
    "TWIST",
]  # fmt: skip

POSITION, POSITION_PER_METRE, HEADING = 5e-4, 5e-5, 1e-3
"""Distance between the end of the rolled motion and the goal, and between rolled and stated poses: m, and m
per metre travelled; the same for headings, rad."""

COPIED, SAME = 5e-7, 1e-9
"""Error of a number that was copied; two numbers this close count as equal (rad, rad/s, m, s)."""

REST = 5e-7
"""Largest wheel rate and steering rate at both ends, as a share of its limit; twice this share of the fastest
twist for twists."""

COLUMN = 0.03
"""Gap between the stated wheel acceleration and that of the polynomial, as a share of the limit."""

SLIP = 8e-4, 8e-5
"""Slip: share of the largest speed (at least 0.05 m/s), and m/s."""

TWIST = 2.5e-3, 5e-4
"""Gap between the rolled and the stated twist: share of the largest speed, and m/s or rad/s."""

BACKWARDS = 5e-4
"""Speed backwards although reverse is false, m/s."""

TURNING = 5e-3, 1e-3
"""turning_radius · |omega| may exceed |vx| by this share of |vx|, and by this many m/s."""

CLEARANCE = 2e-4
"""Part of min_clearance that may be missing, m."""

CLEARANCE_ACCURACY, CLEARANCE_SHARE = 1e-4, 3e-3
"""Distance between the certified clearance, a lower bound, and the true one, at most: m, or this share of the
distance from min_clearance if that is more."""

LONGEST, SATURATED = 1.1e5, 1e6
"""Largest motion of the footprint that is checked, m; largest number in a certificate."""

QUANTITIES = {
    # key: (name in a sentence, unit, allowed excess of value / bound over 1)
    "closure_position": ("the distance from the goal after rolling", "m", 0.0),
    "closure_heading": ("the angle from the goal's heading after rolling", "rad", 0.0),
    "wheel_speed_ratio": ("the wheel speed", "rad/s", 1e-3),
    "wheel_speed_ratio between": ("the wheel speed between samples", "rad/s", 0.9e-2),
    "wheel_acceleration_ratio": ("the wheel acceleration", "rad/s²", 1e-2),
    "wheel_acceleration_ratio between": ("the wheel acceleration between samples", "rad/s²", 2.8e-2),
    "wheel_jerk_ratio": ("the wheel jerk", "rad/s³", 2e-2),
    "wheel acceleration column": (
        "the gap between the stated and the interpolated wheel acceleration", "rad/s²", 0.0,
    ),
    "steering_angle_ratio": ("the steering angle", "rad", 1e-4),
    "steering_angle_ratio between": ("the steering angle between samples", "rad", 0.9e-3),
    "steering_rate_ratio": ("the steering rate", "rad/s", 0.9e-2),
    "wheels at rest": ("the wheel speed at an end of the motion", "rad/s", 0.0),
    "steering at rest": ("the steering rate at an end of the motion", "rad/s", 0.0),
    "body at rest": ("the twist at an end of the motion", "m/s or rad/s", 0.0),
    "start": ("the distance from the start", "m or rad", 0.0),
    "present steering": ("the angle from the present steering", "rad", 0.0),
    "steered heading": ("the angle between the heading and that of the steered wheel", "rad", 0.0),
    "slip": ("the slip", "m/s", 0.0),
    "twist": ("the gap between the rolled and the stated twist", "m/s or rad/s", 0.0),
    "drift_position": ("the distance between the rolled and the stated position", "m", 0.0),
    "drift_heading": ("the angle between the rolled and the stated heading", "rad", 0.0),
    "linear_speed_ratio": ("the linear speed", "m/s", 1e-3),
    "angular_speed_ratio": ("the angular speed", "rad/s", 1e-3),
    "linear_acceleration_ratio": ("the linear acceleration", "m/s²", 2e-2),
    "lateral_acceleration_ratio": ("the lateral acceleration", "m/s²", 2e-2),
    "linear_speed_ratio between": ("the linear speed of the rolled motion", "m/s", 0.9e-2),
    "angular_speed_ratio between": ("the angular speed of the rolled motion", "rad/s", 0.9e-2),
    "linear_acceleration_ratio between": ("the linear acceleration of the rolled motion", "m/s²", 2.8e-2),
    "lateral_acceleration_ratio between": ("the lateral acceleration of the rolled motion", "m/s²", 2.8e-2),
    "backwards": ("the speed backwards although reverse is false", "m/s", 0.0),
    "turning": ("the turn rate times turning_radius", "m/s", 0.0),
}  # fmt: skip
"""Everything that is measured. A key that is a field of Certificate, less a trailing " between", is reported
there."""
