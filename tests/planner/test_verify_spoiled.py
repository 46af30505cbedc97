"""The certificate tells each way of spoiling a schedule from the others."""

from __future__ import annotations

import math
import re
from dataclasses import fields, replace

import numpy as np
import pytest

from drives import Differential
from drives.se2 import Array
from planner.problem import Goal
from planner.schedule import WheelSchedule
from tests.planner.schedules import AFTER, KINDS, PERIOD, Case, Spoil, column, drive_of, moving

OVERDETERMINED = ["ackermann", "mecanum", "powered_caster", "skid_steer", "swerve", "synchro", "tricycle"]
ALL = slice(None)


def fast_wheel(case: Case) -> Case:
    j = int(np.argmax(np.abs(case.schedule.wheel_velocity).max(0)))
    gain = np.ones(case.schedule.wheel_angle.shape[1])
    gain[j] = 1.01
    columns = ("wheel_angle", "wheel_velocity", "wheel_acceleration")
    return case.schedules(**{name: getattr(case.schedule, name) * gain for name in columns}).limits(
        wheel_speed=case.problem.robot.limits.wheel_speed * 1.02,
        wheel_acceleration=case.problem.robot.limits.wheel_acceleration * 1.02,
    )


def goal_off(x: float, theta: float) -> Spoil:
    def spoil(case: Case) -> Case:
        goal = case.problem.goal
        assert goal.theta is not None
        return replace(case, problem=replace(case.problem, goal=Goal(goal.x + x, goal.y, goal.theta + theta)))

    return spoil


def start_off(case: Case) -> Case:
    start = case.problem.start
    return replace(case, problem=replace(case.problem, start=start._replace(y=start.y + 1e-4)))


def limit_under(name: str, share: float) -> Spoil:
    return lambda case: case.limits(**{name: getattr(case.problem.robot.limits, name) * share})


def jerk_over(case: Case) -> Case:
    used = np.abs(np.diff(case.schedule.wheel_acceleration, axis=0)).max() / PERIOD
    return case.limits(wheel_jerk=np.full(case.schedule.wheel_angle.shape[1], used / 1.04))


SPOILS: dict[str, tuple[Spoil, str]] = {
    "a wheel 1 % fast": (fast_wheel, r"after rolling is|the slip is|rolled and the stated"),
    "goal 5 mm off": (
        goal_off(5e-3, 0),
        r"distance from the goal after rolling is 0\.00[45]\d* m at t = 3\.13",
    ),
    "goal 4 mrad off": (
        goal_off(0, 4e-3),
        r"goal's heading after rolling is 0\.00[34]\d* rad .* allowed 0\.001",
    ),
    "start off": (start_off, r"the distance from the start of y is 0\.0001 .* at t = 0\.0000 s"),
    "speed 2 % over": (
        limit_under("wheel_speed", 0.98),
        r"the wheel speed of \w+ is [\d.]+ rad/s at t = 1\.",
    ),
    "acceleration 2 % over": (limit_under("wheel_acceleration", 0.98), r"the wheel acceleration of \w+ is"),
    "jerk 4 % over": (jerk_over, r"the wheel jerk of \w+ is [\d.]+ rad/s³"),
    "rolling at the end": (column("wheel_velocity", (-1, 0), 1e-3), r"wheel speed at an end .* at t = 3\.13"),
    "rolling at the start": (
        column("wheel_velocity", (0, 1), 1e-3),
        r"wheel speed at an end .* at t = 0\.00",
    ),
    "an angle out of step": (
        column("wheel_angle", (AFTER, 0), 0.01),
        r"the wheel (speed|acceleration) between samples of \w+ is .* at t = 1\.(38|39|40)",
    ),
    "a stated twist off": (column("twist", (70, 2), 0.02), r"rolled and the stated twist of omega is 0\.0"),
    "a stated pose off": (column("pose", (70, 0), 2e-3), r"the rolled and the stated position is 0\.00"),
    "a stated heading off": (column("pose", (70, 2), 2e-3), r"the rolled and the stated heading is 0\.00"),
    "a stated theta a turn off": (column("pose", (ALL, 2), 2 * math.pi), r"from the start of theta is 6\.28"),
    "a longer step": (column("time", AFTER, 1e-3), r"^the time grid is not 0, 0\.02, 0\.04"),
    "a late start": (column("time", 0, 1e-3), r"^the time grid"),
    "a last step backwards": (column("time", -1, -0.05), r"^the time grid"),
    "a last step too long": (column("time", -1, 0.05), r"^the time grid"),
}


@pytest.mark.parametrize("name", SPOILS)
@pytest.mark.parametrize("kind", KINDS)
def test_one_thing_spoiled_is_named(kind: str, name: str) -> None:
    spoil, sentence = SPOILS[name]
    found = spoil(moving(drive_of(kind))).sentences()
    assert any(re.search(sentence, each) for each in found), found


@pytest.mark.parametrize("name", [f.name for f in fields(WheelSchedule)])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused(name: str, value: float) -> None:
    case = moving(drive_of("swerve"))
    error = column(name, 30, value)(case).refused()
    assert error.details == {"certificate": {}, "violations": [f"{name} is not finite in sample 30"]}


@pytest.mark.parametrize("name", [f.name for f in fields(WheelSchedule)])
def test_a_column_of_another_shape_is_refused(name: str) -> None:
    case = moving(drive_of("swerve"))
    spoiled = case.schedules(**{name: getattr(case.schedule, name)[:-1]})
    assert any("has shape" in s for s in spoiled.sentences())


@pytest.mark.parametrize("answer", ["twist", "slip"])
def test_kinematics_that_answer_nan_are_refused(answer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    case = moving(drive_of("differential"))
    true = Differential.forward

    def broken(drive: Differential, *state: Array) -> tuple[Array, Array]:
        twist, slip = true(drive, *state)
        (twist if answer == "twist" else slip)[80] = math.nan
        return twist, slip

    monkeypatch.setattr(Differential, "forward", broken)
    assert any("is nan" in s for s in case.sentences())


def test_no_sample_at_all_is_refused() -> None:
    case = moving(drive_of("swerve"))
    nothing = WheelSchedule(*(getattr(case.schedule, f.name)[:0] for f in fields(WheelSchedule)))
    assert replace(case, schedule=nothing).sentences() == ["the schedule has no sample"]


@pytest.mark.parametrize("name", ["wheel_angle", "wheel_velocity", "wheel_acceleration", "pose", "twist"])
def test_numbers_near_overflow_are_refused(name: str) -> None:
    case = moving(drive_of("ackermann"))
    column(name, 70, 1e308)(case).refused()
    case.schedules(**{name: getattr(case.schedule, name) * 0 + 1e308}).refused()


@pytest.mark.parametrize("kind", OVERDETERMINED)
def test_wheels_that_disagree_slip(kind: str) -> None:
    found = column("wheel_velocity", (70, 0), 0.1)(moving(drive_of(kind))).sentences()
    assert any(re.match(r"the slip is 0\.00.* at t = 1\.(38|40)00 s", s) for s in found), found
