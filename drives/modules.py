"""Drives on independently steered modules."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from drives.checks import SHORTEST, count, distinct, lengths, number
from drives.drive import Drive, Holonomic, InvalidDrive, Limits, Mobility, Rolling
from drives.se2 import Array
from drives.wheel import Module, rigid_motion

__all__ = ["SteeredModules"]


class SteeredModules(Drive):
    """A drive whose m wheels all steer, each about its own axis. Subclasses hold the fields named here."""

    wheel_radius: float
    modules: tuple[Module, ...]

    @property
    def trail(self) -> float:
        """How far (m) the contact of each wheel trails its steering axis."""
        return 0.0

    def __post_init__(self) -> None:
        lengths(wheel_radius=self.wheel_radius)
        count("modules", len(self.modules), 2)
        distinct("modules", [m.name for m in self.modules])
        for m in self.modules:
            number(f"modules: x of {m.name!r}", m.x)
            number(f"modules: y of {m.name!r}", m.y)
        x, y = self._axes
        spread = float(np.hypot(x - x[0], y - y[0]).max())
        if spread < SHORTEST:
            raise InvalidDrive(f"modules: all within {spread:g} m, less than {SHORTEST:g}", "modules")

    @property
    def wheel_names(self) -> tuple[str, ...]:
        return tuple(m.name for m in self.modules)

    @property
    def steered_names(self) -> tuple[str, ...]:
        return self.wheel_names

    def rolling_law(self) -> Rolling:
        m = len(self.modules)
        steered, points = np.ones(m, dtype=bool), np.stack(self._axes, -1)
        return Rolling(np.zeros((m, 3)), steered, points, np.full(m, self.wheel_radius), trail=self.trail)

    def mobility(self, limits: Limits) -> Mobility:
        return Holonomic()

    def forward(self, rates: Array, steering: Array, steering_rates: Array) -> tuple[Array, Array]:
        x, y = self._axes
        return rigid_motion(x, y, self.wheel_radius, self.trail, rates, steering, steering_rates)

    @cached_property
    def _axes(self) -> tuple[Array, Array]:
        """Where the steering axes stand: x (m,) and y (m,)."""
        return np.array([float(m.x) for m in self.modules]), np.array([float(m.y) for m in self.modules])
