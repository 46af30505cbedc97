"""Estimates of how long steps take are what the time law makes of them, where that is one law throughout."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from drives.drive import Car, Holonomic
from drives.se2 import Pose, Twist
from planner.estimate import pace, step_duration
from planner.path import LinePiece, TwistPiece
from planner.problem import Robot
from planner.time_law import time_path

KINDS = [
    "differential", "tracked", "skid_steer", "omni", "mecanum", "swedish", "tricycle", "ackermann", "synchro",
    "swerve",
]  # fmt: skip
BODY = {"linear_speed": 0.9, "angular_speed": 1.1, "lateral_acceleration": 0.4, "linear_acceleration": 0.7}


def twists(robot: Robot) -> list[Twist]:
    match robot.drive.mobility(robot.limits):
        case Holonomic():
            return [
                Twist(0.02, 0.01, 0.03),
                Twist(1.0, -2.0, 0.0),
                Twist(3.0, 1.0, -0.9),
                Twist(0.0, 0.0, 2.0),
            ]
        case Car():
            return [Twist(0.03, 0.0, 0.0), Twist(-3.0, 0.0, 1.1), Twist(2.0, 0.0, 1.0)]
        case _:
            return [
                Twist(0.03, 0.0, 0.02),
                Twist(-3.0, 0.0, 1.1),
                Twist(2.0, 0.0, 0.0),
                Twist(0.0, 0.0, -2.0),
            ]


@pytest.mark.parametrize("limits", [{}, BODY], ids=["wheels", "body"])
@pytest.mark.parametrize("kind", KINDS)
def test_from_rest_to_rest_a_constant_twist_takes_as_long_as_the_time_law_says(
    robot: Callable[..., Robot], kind: str, limits: dict[str, float]
) -> None:
    given = robot(kind, **limits)
    start = Pose(0.3, -0.2, 0.4)
    for twist in twists(given):
        timed = time_path((TwistPiece(start, twist),), given.drive, given.limits, None)
        driving = sum(phase.duration for phase in timed.phases if type(phase).__name__ != "Steer")
        found = step_duration(pace(given.drive, given.limits), start.theta, *twist, False, False)
        assert found == pytest.approx(driving, rel=1e-6)


@pytest.mark.parametrize("kind", ["omni", "mecanum", "swedish", "swerve"])
def test_a_line_that_turns_takes_about_as_long_as_the_time_law_says(
    robot: Callable[..., Robot], kind: str
) -> None:
    given = robot(kind)
    a, b = Pose(0.0, 0.0, 0.2), Pose(2.0, 1.0, 1.4)
    timed = time_path((LinePiece(a, b),), given.drive, given.limits, None)
    step = (np.array(b) - np.array(a)).tolist()
    found = step_duration(pace(given.drive, given.limits), a.theta, *step, True, False)
    assert 0.8 * timed.duration < found < 1.5 * timed.duration


def test_in_passing_it_is_the_way_at_full_speed(robot: Callable[..., Robot]) -> None:
    given = robot("differential")  # wheels of 0.1 m, 10 rad/s
    known = pace(given.drive, given.limits)
    steps = [(3.0, 0.0, 0.0), (-0.01, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)]
    found = [step_duration(known, 0.0, *step, False, True) for step in steps]
    assert found == pytest.approx([3.0, 0.01, 0.2, 0.0])
