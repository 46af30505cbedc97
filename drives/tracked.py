"""Tracked drive: two tracks that skid as the body turns, a differential drive of a wider track in effect."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drives.checks import lengths, number
from drives.fixed import FixedWheels
from drives.se2 import Array
from drives.wheel import rolling_row

__all__ = ["Tracked"]


@dataclass(frozen=True)
class Tracked(FixedWheels):
    """wheel_radius m, of the sprocket; track_width m, between the tracks' middles; slip_coefficient (>= 1):
    effective track width / track width, measured by turning on the spot."""

    kind: ClassVar[str] = "tracked"
    sideways: ClassVar[bool] = False

    wheel_radius: float
    track_width: float
    slip_coefficient: float = 1.0

    def __post_init__(self) -> None:
        lengths(wheel_radius=self.wheel_radius, track_width=self.track_width)
        number("slip_coefficient", self.slip_coefficient, low=1.0)

    @property
    def wheel_names(self) -> tuple[str, ...]:
        return ("left", "right")

    def rolling(self) -> tuple[Array, Array]:
        y = np.array([1.0, -1.0]) * self.slip_coefficient * self.track_width / 2
        return rolling_row(0.0, y, 0.0), np.full(2, self.wheel_radius)
