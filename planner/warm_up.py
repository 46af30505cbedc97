"""What the first plan of a process would otherwise wait for."""

from __future__ import annotations

from contextlib import suppress
from typing import Literal

import numpy as np

from drives import Ackermann, Differential, Mecanum, PoweredCaster
from drives.drive import Drive, Limits
from drives.se2 import Pose
from drives.wheel import Module
from planner.errors import NoPathExists
from planner.plan import plan
from planner.problem import Bounds, Circle, Environment, Footprint, Goal, Options, Polygon, Problem, Robot

__all__ = ["warm_up"]

_CASTERS = Module("left", 0.0, 0.2), Module("right", 0.0, -0.2)
_DRIVES: tuple[tuple[Drive, float], ...] = (
    (Mecanum(0.05, 0.3, 0.4), np.inf),
    (Differential(0.05, 0.3), np.inf),
    (Ackermann(0.05, 0.4, 0.3), 0.7),
    (PoweredCaster(0.05, 0.04, _CASTERS), np.inf),
)
"""A drive of each kind of motion, and how far it steers, rad."""


def warm_up() -> None:
    """Import and compile whatever the first plan would otherwise wait for, by planning a little of
    everything: round a wall, by a detour round two, and where there is no way."""
    for drive, steering in _DRIVES:
        plan(_problem(drive, steering, "good", _wall(0.0, -4.0, 1.0)))
        plan(_problem(drive, steering, "first", _wall(-1.0, -4.0, 2.0), _wall(1.0, -2.0, 4.0)))
    with suppress(NoPathExists):
        plan(_problem(*_DRIVES[0], "first", _wall(0.0, -4.0, 4.0)))


def _wall(x: float, y_min: float, y_max: float) -> Polygon:
    return Polygon(np.array([[x - 0.1, y_min], [x + 0.1, y_min], [x + 0.1, y_max], [x - 0.1, y_max]]))


def _problem(drive: Drive, steering: float, effort: Literal["first", "good"], *walls: Polygon) -> Problem:
    m = len(drive.wheel_names)
    limits = Limits(np.full(m, 20.0), np.full(m, 40.0), np.full(m, np.inf), steering, 5.0)
    footprint = Footprint(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]))
    return Problem(
        Robot(drive, footprint, limits),
        Pose(-2.0, 0.0, 0.0),
        Goal(2.0, 0.0, 0.5),
        Environment(Bounds(-4.0, -4.0, 4.0, 4.0), (*walls, Circle(0.0, 1.0, 0.1))),
        Options(time_budget=60.0, effort=effort),  # compiling counts as planning time here
        np.zeros(len(drive.steered_names)),
    )
