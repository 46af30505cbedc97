"""A robot for each drive, a floor and a clutter, and short ways to ask for plans among them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drives import DRIVES, Module, SwedishWheel
from drives.drive import Limits
from drives.se2 import Pose
from planner.problem import Bounds, Circle, Environment, Footprint, Goal, Options, Polygon, Problem, Robot

_MODULES = (
    Module("front_left", 0.15, 0.12), Module("front_right", 0.15, -0.12), Module("rear", -0.15, 0.0),
)  # fmt: skip
PARAMETERS: dict[str, dict[str, Any]] = {
    "differential": {"wheel_radius": 0.1, "track_width": 0.4},
    "tracked": {"wheel_radius": 0.1, "track_width": 0.4, "slip_coefficient": 1.4},
    "skid_steer": {"wheel_radius": 0.1, "track_width": 0.4, "wheelbase": 0.3, "slip_coefficient": 1.6},
    "omni": {"wheel_radius": 0.05, "robot_radius": 0.2},
    "mecanum": {"wheel_radius": 0.08, "track_width": 0.3, "wheelbase": 0.35},
    "swedish": {
        "wheels": (
            SwedishWheel("nose", 0.2, 0.0, 1.57, 0.0, 0.05),
            SwedishWheel("left", -0.15, 0.15, 0.1, 0.785, 0.06),
            SwedishWheel("right", -0.15, -0.15, 0.0, -0.785, 0.07),
        )
    },
    "tricycle": {"wheel_radius": 0.1, "wheelbase": 0.35, "track_width": 0.3},
    "ackermann": {"wheel_radius": 0.1, "wheelbase": 0.35, "track_width": 0.3},
    "synchro": {"wheel_radius": 0.1, "body_heading": 0.4},
    "swerve": {"wheel_radius": 0.05, "modules": _MODULES},
    "powered_caster": {"wheel_radius": 0.05, "caster_offset": 0.04, "modules": _MODULES},
}
_CAR_LIKE = ("tricycle", "ackermann")


def _robot(kind: str, **limits: Any) -> Robot:
    drive = DRIVES[kind](**PARAMETERS[kind])
    m = len(drive.wheel_names)
    sane = Limits(
        np.full(m, 10.0), np.full(m, 20.0), np.full(m, np.inf),
        steering_angle=0.7 if kind in _CAR_LIKE else math.inf,
        steering_rate=3.0 if drive.steered_names else math.inf,
    )  # fmt: skip
    for name in ("wheel_speed", "wheel_acceleration", "wheel_jerk"):
        if name in limits:
            limits[name] = np.broadcast_to(np.asarray(limits[name], dtype=float), m).copy()
    outline = np.array([[0.3, 0.0], [0.2, 0.2], [-0.25, 0.2], [-0.25, -0.2], [0.2, -0.2]])
    return Robot(drive, Footprint(outline), replace(sane, **limits))


@pytest.fixture(scope="session")
def robot() -> Callable[..., Robot]:
    """robot(kind, **limits): the example of a drive, 0.55 m long and 0.4 m wide; per wheel limits may be one
    number. Sane limits where none are given."""
    return _robot


@pytest.fixture(scope="session")
def floor() -> Environment:
    """Ten metres square, empty, the origin in the middle."""
    return Environment(Bounds(-5.0, -5.0, 5.0, 5.0))


@pytest.fixture(scope="session")
def clutter() -> Environment:
    """A room of 6 m by 4 m about the origin: a wall at x = 0 with a gap 0.9 m wide, a box, a post."""
    wall = [
        [[-0.1, -2.0], [0.1, -2.0], [0.1, 0.2], [-0.1, 0.2]],
        [[-0.1, 1.1], [0.1, 1.1], [0.1, 2.0], [-0.1, 2.0]],
        [[-1.6, 0.5], [-1.1, 0.4], [-1.0, 0.9], [-1.5, 1.0]],
    ]
    obstacles = (*(Polygon(np.array(vertices)) for vertices in wall), Circle(1.3, 0.2, 0.25))
    return Environment(Bounds(-3.0, -2.0, 3.0, 2.0), obstacles)


@pytest.fixture(scope="session")
def ask(floor: Environment) -> Callable[..., Problem]:
    """ask(kind, start, goal, environment, steering=, limits={...}, **options): a problem. Unless told
    otherwise on the open floor, of effort "first", with time to spare, even to compile."""

    def problem(
        kind: str,
        start: tuple[float, float, float],
        goal: tuple[float, float, float | None],
        environment: Environment = floor,
        steering: float | list[float] | None = None,
        limits: dict[str, Any] | None = None,
        **options: Any,
    ) -> Problem:
        made = _robot(kind, **(limits or {}))
        wheels = len(made.drive.steered_names)
        return Problem(
            made, Pose(*start), Goal(*goal), environment,
            Options(**{"time_budget": 60.0, "effort": "first", "seed": 3} | options),
            None if steering is None else np.broadcast_to(np.asarray(steering, dtype=float), wheels).copy(),
        )  # fmt: skip

    return problem
