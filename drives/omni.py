"""Omnidirectional drive: n Swedish 90° wheels, evenly round a circle and tangential to it.

Wheel i stands at angle φᵢ and rolls clockwise: rate = (sin φᵢ·vx - cos φᵢ·vy -
robot_radius·omega)/wheel_radius (Konstantinov, Chivarov and Shivarov, eq. (4)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drives.checks import count, lengths, number
from drives.fixed import FixedWheels
from drives.se2 import Array
from drives.wheel import rolling_row

__all__ = ["Omni"]


@dataclass(frozen=True)
class Omni(FixedWheels):
    """wheel_radius m; robot_radius m, from the body origin to each contact; wheel_count >= 3; wheel_offset
    rad, the angle at which wheel_1 stands."""

    kind: ClassVar[str] = "omni"

    wheel_radius: float
    robot_radius: float
    wheel_count: int = 3
    wheel_offset: float = 0.0

    def __post_init__(self) -> None:
        lengths(wheel_radius=self.wheel_radius, robot_radius=self.robot_radius)
        count("wheel_count", self.wheel_count, 3)
        number("wheel_offset", self.wheel_offset)

    @property
    def wheel_names(self) -> tuple[str, ...]:
        return tuple(f"wheel_{i + 1}" for i in range(self.wheel_count))

    def rolling(self) -> tuple[Array, Array]:
        phi = self.wheel_offset + 2 * np.pi * np.arange(self.wheel_count) / self.wheel_count
        x, y = self.robot_radius * np.cos(phi), self.robot_radius * np.sin(phi)
        return rolling_row(x, y, phi - np.pi / 2), np.full(self.wheel_count, self.wheel_radius)
