"""The certificate knows each limit, by what the wheels, their steering and the body do."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from drives.drive import Holonomic
from drives.se2 import Pose, Twist, compose
from planner.schedule import WheelSchedule
from tests.planner.schedules import (
    AFTER,
    DURATION,
    KINDS,
    PERIOD,
    START,
    asking_for,
    changed,
    column,
    drive_of,
    moving,
    tangent_of,
)

STEERED = ["ackermann", "powered_caster", "swerve", "synchro", "tricycle"]


@pytest.mark.parametrize("kind", STEERED)
def test_steering_spoiled_is_named(kind: str) -> None:
    case = moving(drive_of(kind), weave=0.25)
    schedule, limits = case.schedule, case.problem.robot.limits
    first = drive_of(kind).steered_names[0]
    used = float(np.abs(schedule.steering_rate).max())
    case = case.limits(steering_rate=used * 1.001)
    assert case.verify().steering_rate_ratio == pytest.approx(1 / 1.001, abs=2e-3)
    assert case.problem.steering is not None
    turned = replace(case, problem=replace(case.problem, steering=changed(case.problem.steering, 0, 1e-3)))
    largest = float(np.abs(schedule.steering_angle).max())
    # At the samples the rates are within the limit; the cubics between them are not.
    bent = schedule.steering_angle.copy()
    bent[70, 0] += used * PERIOD
    for spoiled, sentence in (
        (case.limits(steering_rate=used / 1.02), r"^the steering rate of \w+ is [\d.]+ rad/s at"),
        (
            column("steering_rate", (70, 0), 2.1 * used)(case),
            rf"^the steering rate of {first} .* t = 1\.4000 s",
        ),
        (
            column("steering_angle", (AFTER, 0), used / 10)(case),
            rf"^the steering rate of {first} .* t = 1\.3[89]",
        ),
        (case.limits(steering_angle=largest / 1.001), r"^the steering angle of \w+ is [\d.]+ rad at"),
        (turned, rf"^the angle from the present steering of {first} is 0\.001 rad at t = 0\.0000 s"),
        (
            column("steering_rate", (-1, 0), 0.01)(case),
            rf"^the steering rate at an end of the motion of {first}",
        ),
        (
            case.schedules(steering_angle=bent),
            rf"^the steering rate of {first} is [\d.]+ rad/s at t = 1\.[34]",
        ),
    ):
        found = spoiled.sentences()
        assert any(re.search(sentence, s) for s in found), (sentence, found)
    assert limits.steering_angle == math.inf
    exactly = case.limits(steering_angle=largest).verify()
    assert exactly.steering_angle_ratio == pytest.approx(1)


@pytest.mark.parametrize("kind", KINDS)
def test_driving_backwards_where_that_is_forbidden(kind: str) -> None:
    drive = drive_of(kind)
    vx, vy, omega = tangent_of(drive)
    assert moving(drive).options(reverse=False).verify()
    backwards = moving(drive, Twist(-vx, vy, omega))
    assert backwards.verify()
    assert any("the speed backwards" in s for s in backwards.options(reverse=False).sentences())


@pytest.mark.parametrize("kind", KINDS)
def test_turning_tighter_than_asked(kind: str) -> None:
    case = moving(drive_of(kind))
    vx, _, omega = tangent_of(drive_of(kind))
    assert case.options(turning_radius=vx / omega).verify()
    tighter = case.options(turning_radius=1.03 * vx / omega)
    if isinstance(drive_of(kind).mobility(case.problem.robot.limits), Holonomic):
        assert tighter.verify()
    else:
        assert any("the turn rate times turning_radius" in s for s in tighter.sentences())


@pytest.mark.parametrize(
    "name", ["linear_speed", "angular_speed", "linear_acceleration", "lateral_acceleration"]
)
@pytest.mark.parametrize("kind", KINDS)
def test_the_limits_of_the_body(kind: str, name: str) -> None:
    case = moving(drive_of(kind))
    vx, vy, omega = tangent_of(drive_of(kind))
    speed = math.hypot(vx, vy)
    used = {
        "linear_speed": speed,
        "angular_speed": omega,
        "linear_acceleration": speed * math.pi / DURATION,
        "lateral_acceleration": speed * omega,
    }[name]
    found = case.limits(**{name: used * 1.001}).verify()
    assert getattr(found, f"{name}_ratio") == pytest.approx(1, abs=2e-3)
    found_out = case.limits(**{name: used * 0.96}).sentences()
    for motion in ("", " of the rolled motion"):
        sentence = f"the {name.replace('_', ' ')}{motion} is "
        assert any(s.startswith(sentence) for s in found_out), found_out


def test_a_corner_taken_at_rest_is_no_lateral_acceleration() -> None:
    """Two straight legs at a right angle, and a stop at a sample between them."""
    drive, ramp = drive_of("omni"), 0.54
    time = np.append(np.arange(0.0, 4 * ramp, PERIOD), 4 * ramp)
    s, speed, change = np.zeros((3, 2, len(time)))
    for leg in (0, 1):
        t = np.clip(time - 2 * leg * ramp, 0, 2 * ramp)
        s[leg] = np.where(t < ramp, t**2 / 2, ramp**2 - (2 * ramp - t) ** 2 / 2)
        speed[leg] = np.minimum(t, 2 * ramp - t)
        slope = np.diff(speed[leg]) / np.diff(time)
        change[leg] = np.append(slope, slope[-1])
    rows = np.array([drive.inverse(Twist(*e)).rates for e in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))])
    pose = np.array([compose(START, Pose(x, y, 0.0)) for x, y in s.T])
    none = np.zeros((len(time), 0))
    twist = np.column_stack([speed.T, np.zeros(len(time))])
    schedule = WheelSchedule(time, s.T @ rows, speed.T @ rows, change.T @ rows, none, none, pose, twist)
    found = (
        asking_for(drive, schedule).limits(wheel_speed=np.full(3, 11.0), lateral_acceleration=0.05).verify()
    )
    assert found.lateral_acceleration_ratio < 1e-6
