"""Checks that drives share: of parameters, raising InvalidDrive with the name, the value and the bound; of
motions, raising InadmissibleTwist."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from drives.drive import InadmissibleTwist, InvalidDrive
from drives.kernels import kernel
from drives.se2 import Array

__all__ = ["count", "distinct", "lengths", "number", "refuse_beyond", "refuse_sideways"]

SHORTEST, LONGEST = 1e-6, 1e6
"""Lengths (m) that a robot is made of. Beyond them rates and levers leave the range of float64."""

MOST_WHEELS = 64

STEERING_TOLERANCE = 1e-9
"""How far (rad) a steering angle may pass its limit: round-off of a path driven at the limit itself."""


def number(name: str, value: float, low: float = -LONGEST, high: float = LONGEST) -> None:
    """Refuse a value that is not finite or lies outside [low, high]."""
    if not (math.isfinite(value) and low <= value <= high):
        raise InvalidDrive(f"{name} is {value!r}: it must lie between {low:g} and {high:g}", name)


def lengths(**values: float) -> None:
    """Refuse a length (m) that is not positive."""
    for name, value in values.items():
        number(name, value, SHORTEST, LONGEST)


def count(name: str, value: int, least: int) -> None:
    """Refuse a number of wheels below `least`, or too many to be a robot."""
    if not least <= value <= MOST_WHEELS:
        raise InvalidDrive(f"{name} is {value!r}: it must lie between {least} and {MOST_WHEELS}", name)


def distinct(parameter: str, names: Sequence[str]) -> None:
    """Refuse wheels that share a name, or have none."""
    seen: set[str] = set()
    for name in names:
        if not name or name in seen:
            fault = "is the name of two" if name else "is no name; each needs one"
            raise InvalidDrive(f"{parameter}: {name!r} {fault}", parameter)
        seen.add(name)


def refuse_sideways(kind: str, twists: Array) -> None:
    """Refuse twists (n, 3) whose vy (m/s) is more than round-off. Raises InadmissibleTwist."""
    i = _first_sideways(np.ascontiguousarray(twists))
    if i >= 0:
        raise InadmissibleTwist(f"vy is {twists[i, 1]:g}, but the {kind} drive does not move sideways")


@kernel
def _first_sideways(twists: Array) -> int:
    """The first of twists (n, 3) whose vy is more than round-off, or -1."""
    for i in range(len(twists)):
        # written so that NaN is refused too
        if not abs(twists[i, 1]) <= 1e-9 * (abs(twists[i, 0]) + abs(twists[i, 2])) + 1e-12:
            return i
    return -1


def refuse_beyond(steering: Array, limit: float, names: Iterable[str]) -> None:
    """Refuse steering (n, k) that passes ±limit (rad). Raises InadmissibleTwist."""
    for name, largest in zip(names, np.abs(steering).max(axis=0, initial=0.0), strict=True):
        if not largest <= limit + STEERING_TOLERANCE:
            raise InadmissibleTwist(f"{name} would steer to {largest:g} rad, past its limit of {limit:g}")
