"""The four mobilities, a robot each, and how native OMPL is told of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from benchmarks.duration.robots import ROBOTS
from drives.drive import Car
from drives.se2 import Array
from planner.problem import Options, Robot

__all__ = ["MOBILITIES", "Mobility"]

_PIVOT = 0.1
"""Turning radius (m) that native OMPL takes for a robot that turns on the spot: it has no such space."""


@dataclass(frozen=True, eq=False)
class Mobility:
    """A robot and its options; `space` and `radius` (m) are those of native OMPL."""

    name: str
    robot: Robot
    options: Options
    space: Literal["SE2", "ReedsShepp", "Dubins"]
    radius: float = 0.0

    @property
    def outline(self) -> Array:
        """The footprint's vertices (n, 2) m."""
        return self.robot.footprint.vertices

    @property
    def length(self) -> float:
        return float(np.ptp(self.outline[:, 0]))

    @property
    def width(self) -> float:
        return float(np.ptp(self.outline[:, 1]))

    @property
    def diagonal(self) -> float:
        """Diameter (m) of what the footprint sweeps when it turns about the body's origin."""
        return 2 * float(np.hypot(*self.outline.T).max())

    @property
    def pivots(self) -> bool:
        return self.radius <= _PIVOT

    def room_to_turn(self) -> float:
        """Side (m) of a square in which a right angle can be turned."""
        if self.pivots:
            return self.diagonal + 0.15
        return self.radius + self.length + self.width

    def asked(self, **options: float | str) -> Options:
        return replace(self.options, **options)  # type: ignore[arg-type]


def _car(name: str, reverse: bool) -> Mobility:
    robot = ROBOTS["ackermann"]
    mobility = robot.drive.mobility(robot.limits)
    assert isinstance(mobility, Car)
    space: Literal["ReedsShepp", "Dubins"] = "ReedsShepp" if reverse else "Dubins"
    return Mobility(name, robot, Options(reverse=reverse), space, mobility.min_turning_radius)


MOBILITIES: dict[str, Mobility] = {
    mobility.name: mobility
    for mobility in (
        Mobility("holonomic", ROBOTS["mecanum"], Options(), "SE2"),
        Mobility("unicycle", ROBOTS["differential"], Options(), "ReedsShepp", _PIVOT),
        _car("reeds-shepp", reverse=True),
        _car("dubins", reverse=False),
    )
}
