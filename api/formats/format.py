"""What every format is: a name, a media type, and a function that writes a plan down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from drives.se2 import Array
from planner.problem import Problem

__all__ = ["Format", "PlanDocument", "held_rate", "world_velocity"]

PlanDocument = dict[str, Any]
"""The contract's answer to a problem. Its columns are arrays, or lists where it was read from a file."""


@dataclass(frozen=True, slots=True)
class Format:
    """A way to write a plan down. write(plan, problem) gives the bytes, and raises Refusal: not-acceptable
    where a plan cannot be told in this format; drives: the only types it is for, empty: every one."""

    name: str
    media_type: str
    describes: str
    write: Callable[[PlanDocument, Problem], bytes]
    drives: tuple[str, ...] = ()

    def suits(self, drive: str | None) -> bool:
        """Whether it is for this type of drive; None: for some."""
        return not self.drives or drive is None or drive in self.drives


def held_rate(time: Array, values: Array) -> Array:
    """The mean rate of change (n,) or (n, k) of values over the step that begins at each sample: held over
    the step, it leads to the next sample. The last is 0, for a plan ends at rest."""
    rates = np.zeros_like(values, dtype=np.float64)
    rates[:-1] = np.diff(values, axis=0) / np.diff(time).reshape(-1, *[1] * (np.ndim(values) - 1))
    return rates


def world_velocity(plan: PlanDocument) -> Array:
    """The velocity (n, 2) of the body origin in the world frame, m/s."""
    vx, vy, theta = (np.asarray(plan["trajectory"][name], float) for name in ("vx", "vy", "theta"))
    c, s = np.cos(theta), np.sin(theta)
    return np.column_stack([c * vx - s * vy, s * vx + c * vy])
