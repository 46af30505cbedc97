"""Swedish drive: any three or more Swedish wheels, as long as together they reach every twist."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drives.checks import LONGEST, SHORTEST, count, distinct, number
from drives.drive import InvalidDrive
from drives.fixed import FixedWheels
from drives.se2 import Array
from drives.wheel import SwedishWheel, rolling_row

__all__ = ["Swedish"]

LEAST_COSINE = 1e-3
"""Below it a roller runs along the wheel's own rolling direction, and turning the wheel moves nothing."""

WORST_CONDITION = 1e4
"""Above it the wheels all but lose one direction of motion."""


@dataclass(frozen=True)
class Swedish(FixedWheels):
    """wheels: at least three, each as SwedishWheel says."""

    kind: ClassVar[str] = "swedish"

    wheels: tuple[SwedishWheel, ...]

    def __post_init__(self) -> None:
        count("wheels", len(self.wheels), 3)
        distinct("wheels", self.wheel_names)
        for w in self.wheels:
            for name in ("x", "y", "heading", "roller_angle"):
                number(f"wheels: {name} of {w.name!r}", getattr(w, name))
            number(f"wheels: radius of {w.name!r}", w.radius, SHORTEST, LONGEST)
            if abs(np.cos(w.roller_angle)) < LEAST_COSINE:
                raise InvalidDrive(
                    f"wheels: roller_angle of {w.name!r} is {w.roller_angle!r}: its cosine must not vanish",
                    "wheels",
                )
        x, y = np.array([[w.x, w.y] for w in self.wheels], dtype=float).T
        x, y = x - x.mean(), y - y.mean()
        size = max(float(np.hypot(x, y).max()), SHORTEST)
        # About the wheels' own middle and in units of their spread, so that the verdict does not hang on the
        # frame.
        condition = float(np.linalg.cond(rolling_row(x / size, y / size, self._directions())))
        if not condition <= WORST_CONDITION:
            raise InvalidDrive(
                f"wheels: together they do not reach every twist (condition {condition:.2g}, at most "
                f"{WORST_CONDITION:g})",
                "wheels",
            )

    @property
    def wheel_names(self) -> tuple[str, ...]:
        return tuple(w.name for w in self.wheels)

    def rolling(self) -> tuple[Array, Array]:
        x, y = np.array([[w.x, w.y] for w in self.wheels], dtype=float).T
        travel = np.array([w.radius * np.cos(w.roller_angle) for w in self.wheels])
        return rolling_row(x, y, self._directions()), travel

    def _directions(self) -> Array:
        """The angle (m,) of the one velocity at each contact that the wheel's rate decides."""
        return np.array([w.heading + w.roller_angle for w in self.wheels], dtype=float)
