"""Drives whose wheels never steer: the rate of every wheel is a constant row on the twist, w = J·ξ."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import ClassVar

import numpy as np

from drives.checks import refuse_sideways
from drives.drive import (
    ActuatorPath,
    BodyPath,
    Drive,
    Holonomic,
    Limits,
    Mobility,
    Rolling,
    Unicycle,
    WheelState,
)
from drives.se2 import Array, Twist
from drives.wheel import fixed_motion

__all__ = ["FixedWheels"]


class FixedWheels(Drive):
    """A drive of m unsteered wheels, given by `rolling`."""

    sideways: ClassVar[bool] = True
    """Whether the wheels let the body origin move along y."""

    @abstractmethod
    def rolling(self) -> tuple[Array, Array]:
        """Rows (m, 3) and travel (m,) m/rad of the rolling equations rows·ξ = travel·rate, in m/s."""

    @cached_property
    def _equations(self) -> tuple[Array, Array, Array, Array]:
        """J (m, 3); all equations' rows (e, 3), the sideways one last; their pseudo-inverse (3, e); the
        travel (m,)."""
        rows, travel = self.rolling()
        every = rows if self.sideways else np.vstack([rows, [0.0, 1.0, 0.0]])
        jacobian = rows / travel[:, None]
        jacobian.setflags(write=False)
        return jacobian, every, np.linalg.pinv(every), travel

    def rolling_law(self) -> Rolling:
        rows = self._equations[0]
        m = len(rows)
        return Rolling(rows, np.zeros(m, dtype=bool), np.zeros((m, 2)), np.ones(m))

    def mobility(self, limits: Limits) -> Mobility:
        return Holonomic() if self.sideways else Unicycle()

    def inverse(self, twist: Twist, steering: Array | None = None) -> WheelState:
        return WheelState(self._rates(np.array([twist], dtype=float))[0], np.zeros(0))

    def forward(self, rates: Array, steering: Array, steering_rates: Array) -> tuple[Array, Array]:
        _, rows, pseudo, travel = self._equations
        return fixed_motion(rows, pseudo, travel, rates)

    def actuators(
        self, path: BodyPath, steering: Array | None = None, steering_limit: float = np.inf
    ) -> ActuatorPath:
        none = np.zeros((len(path.s), 0))
        return ActuatorPath(
            self._rates(path.tangent), path.tangent_derivative @ self._equations[0].T, none, none.copy()
        )

    def _rates(self, twists: Array) -> Array:
        if not self.sideways:
            refuse_sideways(self.kind, twists)
        return twists @ self._equations[0].T
