"""Mecanum drive: four Swedish 45° wheels whose rollers form an X, seen from above.

r·rate = vx ∓ vy ∓ k·omega with k = (track_width + wheelbase)/2. Four wheels measure three velocities: what
they disagree by is the slip, |v_error| of the locomotion lecture: v_error = ¼(v0 - v1 - v2 + v3), its wheels
0…3 being front-left, rear-left, rear-right, front-right, and v their rates times the radius.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drives.checks import lengths
from drives.fixed import FixedWheels
from drives.se2 import Array

__all__ = ["Mecanum"]


@dataclass(frozen=True)
class Mecanum(FixedWheels):
    """wheel_radius m; track_width m and wheelbase m between the wheels' middles, the origin amid them."""

    kind: ClassVar[str] = "mecanum"

    wheel_radius: float
    track_width: float
    wheelbase: float

    def __post_init__(self) -> None:
        lengths(wheel_radius=self.wheel_radius, track_width=self.track_width, wheelbase=self.wheelbase)

    @property
    def wheel_names(self) -> tuple[str, ...]:
        return ("front_left", "front_right", "rear_left", "rear_right")

    def rolling(self) -> tuple[Array, Array]:
        # A Swedish wheel's row over cos γ, with γ = -π/4 on front_left and rear_right and π/4 on the others.
        k = (self.track_width + self.wheelbase) / 2
        rows = np.array([[1.0, -1.0, -k], [1.0, 1.0, k], [1.0, 1.0, -k], [1.0, -1.0, k]])
        return rows, np.full(4, self.wheel_radius)
