"""Differential drive: two wheels on one axle, the body origin at its middle.

v = r(φ̇_r + φ̇_l)/2, omega = r(φ̇_r - φ̇_l)/track_width (Szoke et al., eq. (20), (21); Chakarov, eq. (5)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drives.checks import lengths
from drives.fixed import FixedWheels
from drives.se2 import Array
from drives.wheel import rolling_row

__all__ = ["Differential", "no_sideways_motion"]


@dataclass(frozen=True)
class Differential(FixedWheels):
    """wheel_radius m; track_width m, between the two wheels' contacts."""

    kind: ClassVar[str] = "differential"
    sideways: ClassVar[bool] = False

    wheel_radius: float
    track_width: float

    def __post_init__(self) -> None:
        lengths(wheel_radius=self.wheel_radius, track_width=self.track_width)

    @property
    def wheel_names(self) -> tuple[str, ...]:
        return ("left", "right")

    def rolling(self) -> tuple[Array, Array]:
        y = np.array([self.track_width, -self.track_width]) / 2
        return rolling_row(0.0, y, 0.0), np.full(2, self.wheel_radius)

    def world_jacobian(self, theta: float) -> Array:
        """S (3, 2): world velocity (ẋ, ẏ, θ̇) = S·(left rate, right rate) at heading theta.

        Chakarov, eq. (8), (9), whose columns run right, left.
        """
        c, s, r, b = np.cos(theta), np.sin(theta), self.wheel_radius / 2, self.track_width / 2
        return r * np.array([[c, c], [s, s], [-1 / b, 1 / b]])

    def world_inverse(self, theta: float) -> Array:
        """S⁺ (2, 3): (left rate, right rate) = S⁺·(ẋ, ẏ, θ̇), S's pseudo-inverse. Chakarov, eq. (10), (15)."""
        c, s, b = np.cos(theta), np.sin(theta), self.track_width / 2
        return np.array([[c, s, -b], [c, s, b]]) / self.wheel_radius


def no_sideways_motion(theta: float) -> Array:
    """A (1, 3): motions at heading theta have A·(ẋ, ẏ, θ̇) = 0. Chakarov, eq. (16); Szoke et al., eq. (10)."""
    return np.array([[-np.sin(theta), np.cos(theta), 0.0]])
