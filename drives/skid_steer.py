"""Skid-steer drive: four fixed wheels, those of a side turning alike and skidding as the body turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drives.checks import lengths, number
from drives.fixed import FixedWheels
from drives.se2 import Array
from drives.wheel import rolling_row

__all__ = ["SkidSteer"]


@dataclass(frozen=True)
class SkidSteer(FixedWheels):
    """wheel_radius m; track_width m; wheelbase m; slip_coefficient (>= 1): effective track width / track
    width, measured by turning on the spot. The body origin is the middle of the four contacts."""

    kind: ClassVar[str] = "skid_steer"
    sideways: ClassVar[bool] = False

    wheel_radius: float
    track_width: float
    wheelbase: float
    slip_coefficient: float = 1.0

    def __post_init__(self) -> None:
        lengths(wheel_radius=self.wheel_radius, track_width=self.track_width, wheelbase=self.wheelbase)
        number("slip_coefficient", self.slip_coefficient, low=1.0)

    @property
    def wheel_names(self) -> tuple[str, ...]:
        return ("front_left", "front_right", "rear_left", "rear_right")

    def rolling(self) -> tuple[Array, Array]:
        # The wheelbase is not in the rates: the sliding it causes is what slip_coefficient stands for.
        y = np.array([1.0, -1.0, 1.0, -1.0]) * self.slip_coefficient * self.track_width / 2
        return rolling_row(0.0, y, 0.0), np.full(4, self.wheel_radius)
