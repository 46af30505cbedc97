"""The drives to plan for, two journeys, and what is asked of every plan."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict

import numpy as np
import pytest

from drives import DRIVES
from drives.se2 import Array, Pose
from planner.plan import Plan
from planner.problem import Problem

Ask = Callable[..., Problem]
PI = math.pi
KINDS = list(DRIVES)
NONHOLONOMIC = ["differential", "tracked", "skid_steer", "tricycle", "ackermann", "synchro"]
JOURNEYS = {
    "floor": ((-2.0, -1.0, 0.5), (2.0, 1.5, -1.0)),
    "clutter": ((-2.4, 0.0, 0.3), (2.2, -0.9, -0.5)),
}

every_drive = pytest.mark.parametrize("kind", KINDS)


def ratios(made: Plan) -> dict[str, float]:
    return {name: value for name, value in asdict(made.certificate).items() if name.endswith("_ratio")}


def keeps_limits(made: Plan) -> bool:
    return all(0.0 <= ratio <= 1.001 for ratio in ratios(made).values())


def closes(made: Plan) -> bool:
    """Whether whoever rolls the wheels ends on the goal, to what the audit allows: half a millimetre and a
    twentieth of one for every metre, and half a milliradian."""
    allowed = 5e-4 + 5e-5 * made.length
    return made.certificate.closure_position < allowed and made.certificate.closure_heading < 5e-4


def largest(used: Array, allowed: Array | float) -> float:
    """The largest share of what is allowed; what is less than rounding counts as nothing."""
    return float((np.maximum(np.abs(used) - 1e-9, 0.0) / allowed).max(initial=0.0))


def distance(a: Array | Pose, b: Array | Pose) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])
