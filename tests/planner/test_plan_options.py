"""What a request asks for is kept: clearance, directions, radii, periods, and every limit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drives.drive import Holonomic
from planner.plan import plan
from planner.problem import Environment
from tests.planner.plans import (
    JOURNEYS,
    NONHOLONOMIC,
    Ask,
    closes,
    distance,
    every_drive,
    keeps_limits,
    largest,
    ratios,
)

# ---------------------------------------------------------------- options


@pytest.mark.parametrize("kind", ["differential", "omni", "ackermann", "synchro"])
@pytest.mark.parametrize("clearance", [0.05, 0.15])
def test_min_clearance_is_kept(ask: Ask, clutter: Environment, kind: str, clearance: float) -> None:
    made = plan(ask(kind, *JOURNEYS["clutter"], clutter, min_clearance=clearance))
    assert made.certificate.clearance >= clearance - 1e-9


@pytest.mark.parametrize("kind", NONHOLONOMIC)
@pytest.mark.parametrize("place", JOURNEYS)
def test_without_reverse_it_never_drives_backwards(
    ask: Ask, floor: Environment, clutter: Environment, kind: str, place: str
) -> None:
    problem = ask(kind, *JOURNEYS[place], {"floor": floor, "clutter": clutter}[place], reverse=False)
    made = plan(problem)
    assert made.schedule.twist[:, 0].min() >= -1e-12
    assert closes(made)


@pytest.mark.parametrize("kind", NONHOLONOMIC)
def test_with_reverse_it_backs_up_where_that_is_quicker(ask: Ask, kind: str) -> None:
    backwards = plan(ask(kind, (0.0, 0.0, 0.2), (-math.cos(0.2), -math.sin(0.2), 0.2)))
    forwards = plan(ask(kind, (0.0, 0.0, 0.2), (-math.cos(0.2), -math.sin(0.2), 0.2), reverse=False))
    assert backwards.schedule.twist[:, 0].max() <= 1e-12
    assert backwards.length == pytest.approx(1.0)
    assert backwards.duration < forwards.duration


@pytest.mark.parametrize("kind", NONHOLONOMIC)
@pytest.mark.parametrize("reverse", [True, False])
def test_turning_radius_is_a_floor(ask: Ask, kind: str, reverse: bool) -> None:
    radius = 1.1
    made = plan(ask(kind, *JOURNEYS["floor"], turning_radius=radius, reverse=reverse))
    vx, _, omega = made.schedule.twist.T
    assert (np.abs(omega) * radius <= np.abs(vx) * (1 + 1e-3) + 1e-6).all()
    assert np.abs(np.diff(made.schedule.pose[:, 2])).sum() > 0.1
    assert closes(made)


@every_drive
@pytest.mark.parametrize("period", [0.005, 0.1])
def test_another_sample_period_changes_the_duration_by_a_few_periods(
    ask: Ask, kind: str, period: float
) -> None:
    usual, asked = (plan(ask(kind, *JOURNEYS["floor"], sample_period=p)) for p in (0.02, period))
    assert abs(asked.duration - usual.duration) < 1.5 * max(period, 0.02) * (usual.planning["stops"] + 2)
    assert asked.schedule.time[:-1] == pytest.approx(np.arange(len(asked.schedule.time) - 1) * period)
    assert keeps_limits(asked)
    assert distance(asked.schedule.pose[-1], usual.schedule.pose[-1]) < 1e-5


# ---------------------------------------------------------------- limits


@every_drive
@pytest.mark.parametrize("place", JOURNEYS)
def test_wheel_jerk_is_kept(
    ask: Ask, floor: Environment, clutter: Environment, kind: str, place: str
) -> None:
    jerk = 80.0
    problem = ask(
        kind, *JOURNEYS[place], {"floor": floor, "clutter": clutter}[place], limits={"wheel_jerk": jerk}
    )
    made = plan(problem)
    assert keeps_limits(made), ratios(made)
    change = np.diff(made.schedule.wheel_acceleration, axis=0)
    over = np.maximum(np.diff(made.schedule.time)[:, None], 1e-4)
    assert np.abs(change / over).max() <= jerk * (1 + 1e-3)
    assert np.abs(made.schedule.wheel_acceleration[[0, -1]]).max() < 1e-6


@every_drive
def test_each_wheel_keeps_its_own_limits(ask: Ask, kind: str) -> None:
    wheels = len(ask(kind, *JOURNEYS["floor"]).robot.drive.wheel_names)
    speed, acceleration = np.full(wheels, 10.0), np.full(wheels, 20.0)
    speed[0], acceleration[-1] = 3.0, 4.0
    made = plan(
        ask(kind, *JOURNEYS["floor"], limits={"wheel_speed": speed, "wheel_acceleration": acceleration})
    )
    columns = made.schedule
    assert largest(columns.wheel_velocity, speed) <= 1.001
    assert largest(columns.wheel_acceleration, acceleration) <= 1.001
    assert keeps_limits(made)
    assert made.duration > plan(ask(kind, *JOURNEYS["floor"])).duration


@every_drive
@pytest.mark.parametrize(
    ("name", "limit"),
    [
        ("linear_speed", 0.2), ("angular_speed", 0.3), ("linear_acceleration", 0.15),
        ("lateral_acceleration", 0.05),
    ],
)  # fmt: skip
def test_body_limits_are_kept(ask: Ask, kind: str, name: str, limit: float) -> None:
    problem = ask(kind, *JOURNEYS["floor"], limits={name: limit})
    made = plan(problem)
    assert keeps_limits(made), ratios(made)
    time, (vx, vy, omega) = made.schedule.time, made.schedule.twist.T
    speed, over = np.hypot(vx, vy), np.maximum(np.diff(time), 1e-4)
    if name == "linear_speed":
        assert speed.max() <= limit * 1.001
    if name == "angular_speed":
        assert np.abs(omega).max() <= limit * 1.001
    if name == "linear_acceleration":
        assert np.abs(np.diff(speed) / over).max() <= limit * 1.001
    if name == "lateral_acceleration":
        holonomic = isinstance(problem.robot.drive.mobility(problem.robot.limits), Holonomic)
        assert holonomic or np.abs(speed * omega).max() <= limit * 1.001
