"""Swerve drive: every wheel steers about its own contact, and points along its own velocity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drives.drive import ActuatorPath, BodyPath, WheelState
from drives.modules import SteeredModules
from drives.se2 import Array, Twist
from drives.steering import aim, steer
from drives.wheel import Module

__all__ = ["Swerve"]


@dataclass(frozen=True)
class Swerve(SteeredModules):
    """wheel_radius m; modules: at least two, not all in one place."""

    kind: ClassVar[str] = "swerve"
    steers_at_rest: ClassVar[bool] = True

    wheel_radius: float
    modules: tuple[Module, ...]

    def inverse(self, twist: Twist, steering: Array | None = None) -> WheelState:
        return aim(*self._axes, self.wheel_radius, twist, steering)

    def actuators(
        self, path: BodyPath, steering: Array | None = None, steering_limit: float = np.inf
    ) -> ActuatorPath:
        return steer(*self._axes, self.wheel_radius, path, steering, steering_limit)
