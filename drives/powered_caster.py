"""Powered caster drive: every wheel is driven and steered, its contact trailing the steering axis.

With p the velocity of the axis, e and n along and to the left of the wheel (Holmberg and Khatib, 2000):

    e·p = r·rate        n·p - b·omega = b·β̇        b = caster_offset

Any twist is possible at any steering: the offset turns what would slide into steering.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drives.caster import caster_law
from drives.checks import lengths, refuse_beyond
from drives.drive import ActuatorPath, BodyPath, Drive, WheelState
from drives.modules import SteeredModules
from drives.se2 import Array, Twist
from drives.swerve import Swerve
from drives.wheel import Module, velocity_at

__all__ = ["PoweredCaster"]


@dataclass(frozen=True)
class PoweredCaster(SteeredModules):
    """wheel_radius m; caster_offset m, by which each contact trails its axis; modules: at least two."""

    kind: ClassVar[str] = "powered_caster"

    wheel_radius: float
    caster_offset: float
    modules: tuple[Module, ...]

    def __post_init__(self) -> None:
        lengths(caster_offset=self.caster_offset)
        super().__post_init__()

    @property
    def trail(self) -> float:
        return self.caster_offset

    @property
    def settled(self) -> Drive:
        return Swerve(self.wheel_radius, self.modules)

    def inverse(self, twist: Twist, steering: Array | None = None) -> WheelState:
        beta = np.zeros(len(self.modules)) if steering is None else np.array(steering, dtype=float)
        along, across = self._seen_by_wheels(np.array([twist], dtype=float), beta[None])
        return WheelState(along[0] / self.wheel_radius, beta, across[0] / self.caster_offset - twist.omega)

    def actuators(
        self, path: BodyPath, steering: Array | None = None, steering_limit: float = np.inf
    ) -> ActuatorPath:
        start = np.zeros(len(self.modules)) if steering is None else np.array(steering, dtype=float)
        law = caster_law(path, *self._axes, self.wheel_radius, self.caster_offset, start)
        refuse_beyond(law.steering, steering_limit, self.wheel_names)
        return law

    def _seen_by_wheels(self, twists: Array, beta: Array) -> tuple[Array, Array]:
        """Velocities (n, m) of the axes at twists (n, 3), along and to the left of wheels at beta (n, m)."""
        p = velocity_at(*self._axes, twists)
        c, s = np.cos(beta), np.sin(beta)
        return p[..., 0] * c + p[..., 1] * s, p[..., 1] * c - p[..., 0] * s
