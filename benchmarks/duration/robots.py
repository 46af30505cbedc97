"""One robot a drive, of the sizes and limits that such bases have."""

from __future__ import annotations

import math

import numpy as np

import drives
from drives.drive import Drive, Limits
from drives.wheel import Module, SwedishWheel
from planner.problem import Footprint, Robot

__all__ = ["ROBOTS"]


def _disc(radius: float) -> Footprint:
    return Footprint(np.zeros((1, 2)), radius)


def _rectangle(length: float, width: float, ahead: float = 0.0) -> Footprint:
    x = ahead + length / 2 * np.array([-1.0, 1.0, 1.0, -1.0])
    return Footprint(np.stack([x, width / 2 * np.array([-1.0, -1.0, 1.0, 1.0])], -1))


def _robot(drive: Drive, footprint: Footprint, speed: float, acceleration: float, **more: float) -> Robot:
    m = len(drive.wheel_names)
    limits = Limits(np.full(m, speed), np.full(m, acceleration), np.full(m, np.inf), **more)
    return Robot(drive, footprint, limits)


def _corners(x: float, y: float) -> tuple[Module, ...]:
    names = ("front_left", "front_right", "rear_left", "rear_right")
    return tuple(Module(n, a, b) for n, a, b in zip(names, (x, x, -x, -x), (y, -y, y, -y), strict=True))


_SWEDISH = (
    SwedishWheel("nose", 0.28, 0.0, math.pi / 2, 0.0, 0.05),
    SwedishWheel("left", -0.18, 0.24, 0.0, math.pi / 4, 0.06),
    SwedishWheel("right", -0.18, -0.24, 0.0, -math.pi / 4, 0.06),
)
_WEDGE = Footprint(np.array([[0.38, -0.08], [0.38, 0.08], [-0.28, 0.34], [-0.28, -0.34]]))

ROBOTS: dict[str, Robot] = {
    robot.drive.kind: robot
    for robot in (
        _robot(drives.Differential(0.09, 0.46), _rectangle(0.7, 0.56), 16.0, 16.0),
        _robot(drives.Tracked(0.11, 0.55, 1.4), _rectangle(0.85, 0.66), 11.0, 14.0),
        _robot(drives.SkidSteer(0.15, 0.52, 0.48, 1.6), _rectangle(0.9, 0.64), 7.0, 13.0),
        _robot(drives.Omni(0.05, 0.19), _disc(0.24), 28.0, 90.0),
        _robot(drives.Mecanum(0.05, 0.32, 0.44), _rectangle(0.6, 0.42), 17.0, 42.0),
        _robot(drives.Swedish(_SWEDISH), _WEDGE, 26.0, 75.0),
        _robot(drives.Tricycle(0.14, 1.1, 0.75), _rectangle(1.6, 0.95, 0.45), 11.0, 9.0,
               steering_angle=1.15, steering_rate=1.1),
        _robot(drives.Ackermann(0.14, 0.75, 0.48), _rectangle(1.1, 0.6, 0.37), 14.0, 15.0,
               steering_angle=0.6, steering_rate=1.1),
        _robot(drives.Synchro(0.06, 3), _disc(0.3), 16.0, 22.0, steering_rate=2.0),
        _robot(drives.Swerve(0.05, _corners(0.24, 0.22)), _rectangle(0.68, 0.64), 36.0, 75.0,
               steering_rate=8.0),
        _robot(drives.PoweredCaster(0.055, 0.04, _corners(0.2, 0.2)), _disc(0.32), 20.0, 42.0,
               steering_rate=14.0),
    )
}  # fmt: skip
"""By the contract's name of the drive."""
