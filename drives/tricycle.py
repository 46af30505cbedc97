"""Tricycle: one steered and driven wheel in front, two fixed wheels behind, the body origin between those."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from drives.carlike import CarLike

__all__ = ["Tricycle"]


@dataclass(frozen=True)
class Tricycle(CarLike):
    """The front wheel stands on the x axis: tan δ = wheelbase/R (locomotion lecture, "Ackermann drive")."""

    kind: ClassVar[str] = "tricycle"

    @property
    def steered_names(self) -> tuple[str, ...]:
        return ("front",)

    @property
    def _front(self) -> tuple[float, ...]:
        return (0.0,)
