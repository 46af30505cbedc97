"""The certificate: true schedules pass."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, fields, replace

import numpy as np
import pytest

from drives.se2 import Array, Twist
from planner.problem import Goal
from planner.schedule import WheelSchedule
from tests.planner.schedules import (
    DURATION,
    KINDS,
    PERIOD,
    RADIUS,
    START,
    Discs,
    asking_for,
    drive_of,
    exact,
    moving,
    tangent_of,
)


@pytest.mark.parametrize("kind", KINDS)
def test_a_true_arc_passes(kind: str) -> None:
    found = moving(drive_of(kind)).verify()
    assert found.closure_position < 2e-6
    assert found.closure_heading < 2e-6
    assert found.drift_position < 2e-6
    assert found.drift_heading < 2e-6
    assert found.slip < 1e-6
    assert found.wheel_speed_ratio == pytest.approx(1 / 1.0001, abs=1e-4)
    assert found.wheel_acceleration_ratio == pytest.approx(1 / 1.001, abs=1e-3)
    assert found.wheel_jerk_ratio == found.steering_angle_ratio == found.linear_speed_ratio == 0
    assert found.steering_rate_ratio <= 1.001


@pytest.mark.parametrize("weave", [0.2, -0.3])
@pytest.mark.parametrize("kind", KINDS)
def test_a_true_weave_passes(kind: str, weave: float) -> None:
    found = moving(drive_of(kind), weave=weave).verify()
    assert found.closure_position < 2e-5
    assert found.closure_heading < 2e-5


@pytest.mark.parametrize("kind", KINDS)
def test_a_true_arc_passes_in_reverse(kind: str) -> None:
    drive = drive_of(kind)
    vx, vy, omega = tangent_of(drive)
    assert moving(drive, Twist(-vx, -vy, omega)).verify().closure_position < 2e-5


@pytest.mark.parametrize("period", [0.002, 0.1])
@pytest.mark.parametrize("kind", ["differential", "swerve", "ackermann"])
def test_other_periods_pass(kind: str, period: float) -> None:
    assert moving(drive_of(kind), period=period).verify().closure_position < 1e-4


@pytest.mark.parametrize("weave", [0.0, 0.3])
@pytest.mark.parametrize("period", [0.001, 0.005, 0.02, 0.1])
@pytest.mark.parametrize("kind", KINDS)
def test_accelerations_that_change_at_samples_only_pass_at_any_period(
    kind: str, period: float, weave: float
) -> None:
    case = exact(kind, period, 1.0031 if period == 0.001 else DURATION, weave=weave)
    # At 0.1 s a caster swings faster between samples than at them.
    used = float(np.abs(case.schedule.steering_rate).max(initial=0.1))
    found = case.limits(steering_rate=used * 1.05).verify()
    assert found.wheel_speed_ratio <= 1.0001
    assert found.wheel_acceleration_ratio == pytest.approx(1 / 1.001, abs=1e-3 if period < 0.1 else 3e-2)
    assert found.closure_position < 2e-5
    assert found.slip < 2e-4


@pytest.mark.parametrize("share", [0.9999, 0.5, 0.21, 1e-3, 1e-5])
@pytest.mark.parametrize("period", [0.001, 0.02, 0.1])
@pytest.mark.parametrize("kind", ["differential", "omni", "swerve", "synchro"])
def test_a_last_step_of_any_length_passes(kind: str, period: float, share: float) -> None:
    found = exact(kind, period, (40 + share) * period).verify()
    assert found.wheel_acceleration_ratio <= 1
    assert found.closure_position < 1e-9


@pytest.mark.parametrize("last", [1e-9, 1e-6, 1e-4])
def test_a_very_short_last_step_passes(last: float) -> None:
    case = moving(drive_of("differential"), duration=3.0)
    true = case.schedule

    def linger(column: Array) -> Array:
        return np.concatenate([column, column[-1:]])

    columns = {f.name: linger(getattr(true, f.name)) for f in fields(WheelSchedule)}
    # Rounding in the last sample but one, which a mean over so short a time would blow up.
    for name in ("wheel_velocity", "wheel_acceleration"):
        columns[name][-2] += 1e-7
    columns["time"][-1] += last
    found = case.limits(wheel_jerk=np.full(2, 40.0)).schedules(**columns).verify()
    assert found.wheel_jerk_ratio < 1


def test_any_heading_will_do_where_none_is_asked_for() -> None:
    case = moving(drive_of("differential"))
    goal = replace(case.problem.goal, theta=None)
    assert replace(case, problem=replace(case.problem, goal=goal)).verify().closure_heading == 0


@pytest.mark.parametrize("turns", [-2, -1, 1, 3])
def test_the_goal_heading_counts_modulo_full_turns(turns: int) -> None:
    case = moving(drive_of("ackermann"))
    theta = case.problem.goal.theta
    assert theta is not None
    goal = replace(case.problem.goal, theta=theta + 2 * math.pi * turns)
    assert replace(case, problem=replace(case.problem, goal=goal)).verify().closure_heading < 2e-6


def test_steering_first_at_rest_passes() -> None:
    """The steering rate rises and falls linearly from sample to sample."""
    case = moving(drive_of("ackermann"))
    true, steps = case.schedule, 10
    rate = 0.02 * np.minimum(np.arange(steps + 1), np.arange(steps, -1, -1))
    turn = np.append(0.0, np.cumsum(PERIOD * (rate[1:] + rate[:-1]) / 2))
    turn = (turn - turn[-1])[:-1, None]
    rates = np.concatenate([np.tile(rate[:-1, None], 2), true.steering_rate])

    def wait(column: Array) -> Array:
        return np.concatenate([np.tile(column[0], (steps, 1)), column])

    schedule = WheelSchedule(
        np.concatenate([np.arange(steps) * PERIOD, true.time + steps * PERIOD]),
        wait(true.wheel_angle), wait(true.wheel_velocity), wait(true.wheel_acceleration),
        np.concatenate([true.steering_angle[0] + turn, true.steering_angle]), rates,
        wait(true.pose), wait(true.twist),
    )  # fmt: skip
    assert asking_for(drive_of("ackermann"), schedule).verify().closure_position < 2e-6


@pytest.mark.parametrize("kind", KINDS)
def test_standing_still_is_certified_by_a_single_sample(kind: str) -> None:
    case = moving(drive_of(kind))
    first = WheelSchedule(*(getattr(case.schedule, f.name)[:1] for f in fields(WheelSchedule)))
    problem = replace(case.problem, goal=Goal(*START))
    found = replace(case, problem=problem, schedule=first).verify(Discs(((START.x, START.y + 1, 0.2),)))
    expected = dict.fromkeys(asdict(found), 0.0) | {"clearance": pytest.approx(1 - 0.2 - RADIUS)}
    assert asdict(found) == expected
    # … but only where the start is the goal.
    elsewhere = replace(
        case, problem=replace(problem, goal=Goal(START.x + 1e-6, START.y, None)), schedule=first
    )
    assert any("from the goal after rolling" in s for s in elsewhere.sentences())


def test_the_certificate_is_finite_json() -> None:
    found = moving(drive_of("differential")).verify(Discs(()))
    assert found.clearance == 1e6
    assert json.loads(json.dumps(asdict(found), allow_nan=False))["clearance"] == 1e6
