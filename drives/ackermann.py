"""Ackermann drive: a car, whose front wheels steer about one centre, on the line of the rear axle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from drives.carlike import CarLike

__all__ = ["Ackermann"]


@dataclass(frozen=True)
class Ackermann(CarLike):
    """tan δ = wheelbase/(R ∓ track_width/2), so that cot δ_outer - cot δ_inner = track_width/wheelbase."""

    kind: ClassVar[str] = "ackermann"

    @property
    def steered_names(self) -> tuple[str, ...]:
        return ("front_left", "front_right")

    @property
    def _front(self) -> tuple[float, ...]:
        return (self.track_width / 2, -self.track_width / 2)
