"""A schedule stands on the client's grid, is read-only, and its columns are each other's integrals."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drives import DRIVES
from drives.drive import Car, Holonomic
from drives.se2 import Array, Pose, Twist
from planner.path import LinePiece, Piece, TwistPiece
from planner.plan import plan
from planner.problem import Problem, Robot
from planner.schedule import WheelSchedule, schedule
from planner.time_law import time_path


@dataclass(frozen=True)
class Bump:
    """One wheel that speeds up and slows down again, whatever path and time law are."""

    duration: float

    def sample(self, time: Array) -> WheelSchedule:
        n, turn = len(time), math.pi / self.duration
        rate, change = np.sin(turn * time), turn * np.cos(turn * time)
        angle = (1 - np.cos(turn * time)) / turn
        return WheelSchedule(
            time.copy(), angle[:, None], rate[:, None], change[:, None], np.zeros((n, 0)), np.zeros((n, 0)),
            np.column_stack([angle, 0 * angle, 0 * angle]), np.column_stack([rate, 0 * rate, 0 * rate]),
        )  # fmt: skip


def columns(made: WheelSchedule) -> list[NDArray[np.float64]]:
    return [getattr(made, field.name) for field in fields(made)]


# ---------------------------------------------------------------- the grid


@pytest.mark.parametrize(
    ("duration", "period", "count"),
    [
        (1.0, 0.02, 51), (1.0, 0.1, 11), (0.3, 0.1, 4), (0.7, 0.1, 8), (2.0, 0.005, 401),
        (1.01, 0.02, 52), (0.25, 0.1, 4), (0.05, 0.1, 2), (0.02, 0.02, 2), (1e-9, 0.02, 2), (0.0199, 0.02, 2),
    ],
)  # fmt: skip
def test_grid_has_as_many_samples_as_fit(duration: float, period: float, count: int) -> None:
    made = schedule(Bump(duration), period)
    assert [len(column) for column in columns(made)] == [count] * 8
    assert made.time[0] == 0.0
    assert made.time[-1] == duration
    assert made.time[:-1].tolist() == [i * period for i in range(count - 1)]


@given(
    duration=st.floats(1e-6, 50.0),
    period=st.sampled_from([0.001, 0.005, 0.01, 0.02, 1 / 30, 0.1, 0.2]),
)
@settings(max_examples=200, deadline=None)
def test_grid_is_exact_at_any_duration(duration: float, period: float) -> None:
    time = schedule(Bump(duration), period).time
    assert (time[:-1] == np.arange(len(time) - 1) * period).all()
    assert time[0] == 0.0
    assert time[-1] == duration
    assert 0 < time[-1] - time[-2] <= period * (1 + 1e-6)


@given(steps=st.integers(1, 2000), period=st.sampled_from([0.005, 0.01, 0.02, 1 / 30, 0.1]))
@settings(max_examples=100, deadline=None)
def test_whole_periods_leave_no_sliver_at_the_end(steps: int, period: float) -> None:
    for duration in (steps * period, math.nextafter(steps * period, math.inf), period * steps * (1 - 1e-15)):
        assert len(schedule(Bump(duration), period).time) == steps + 1


# ---------------------------------------------------------------- read-only


def test_columns_cannot_be_written_to(robot: Callable[..., Robot]) -> None:
    example = robot("swerve")
    timed = time_path((LinePiece(Pose(0, 0, 0), Pose(1, 1, 1)),), example.drive, example.limits)
    for column in (*columns(schedule(timed, 0.02)), *columns(schedule(Bump(1.0), 0.02))):
        assert not column.flags.writeable


def test_columns_of_a_robot_that_stands_cannot_be_written_to(ask: Callable[..., Problem]) -> None:
    for steering in (None, 0.4):
        problem = ask("swerve", (0, 0, 0), (0, 0, 0), steering=steering)
        for column in columns(plan(problem).schedule):
            assert not column.flags.writeable
        assert problem.steering is None or problem.steering.flags.writeable


# ---------------------------------------------------------------- integrals


def pieces(robot: Robot) -> list[Piece]:
    """What this robot can do: along, along a curve, and sideways or on the spot where it may."""
    start, mobility = Pose(0.3, -0.2, 0.4), robot.drive.mobility(robot.limits)
    found: list[Piece] = [TwistPiece(start, Twist(1.0, 0.0, 0.0)), TwistPiece(start, Twist(-1.0, 0.0, 0.9))]
    if not isinstance(mobility, Car):
        found.append(TwistPiece(start, Twist(0.0, 0.0, 2.0)))
    if isinstance(mobility, Holonomic):
        found += [TwistPiece(start, Twist(0.4, -1.0, 1.2)), LinePiece(start, Pose(1.3, 1.0, 2.9))]
    return found


@pytest.mark.parametrize("kind", DRIVES)
@pytest.mark.parametrize("jerk", [math.inf, 200.0])
def test_angle_is_the_integral_of_velocity(robot: Callable[..., Robot], kind: str, jerk: float) -> None:
    example = robot(kind, wheel_jerk=jerk)
    for piece in pieces(example):
        made = schedule(time_path((piece,), example.drive, example.limits), 5e-4)
        h = np.diff(made.time)[:, None]
        for whole, rate in (
            (made.wheel_angle, made.wheel_velocity), (made.steering_angle, made.steering_rate),
        ):  # fmt: skip
            # rest is reported at both ends, where a rate of steering may jump: leave one interval each
            gained = np.cumsum((h * (rate[1:] + rate[:-1]) / 2)[1:-1], axis=0)
            assert whole[2:-1] - whole[1] == pytest.approx(gained, abs=2e-5)


@pytest.mark.parametrize("kind", DRIVES)
def test_velocity_is_the_integral_of_acceleration(robot: Callable[..., Robot], kind: str) -> None:
    example = robot(kind)
    for piece in pieces(example):
        made = schedule(time_path((piece,), example.drive, example.limits), 5e-4)
        h = np.diff(made.time)[:, None]
        change = made.wheel_acceleration
        gained = np.concatenate([0 * h[:1] * change[:1], np.cumsum(h * (change[1:] + change[:-1]) / 2, 0)])
        # an acceleration may jump within an interval: half of one interval's worth, at each of a few switches
        room = 4 * example.limits.wheel_acceleration.max() * 5e-4
        assert np.abs(made.wheel_velocity - gained).max() < room


@pytest.mark.parametrize("kind", DRIVES)
def test_poses_are_the_integral_of_twists(robot: Callable[..., Robot], kind: str) -> None:
    example = robot(kind)
    for piece in pieces(example):
        made = schedule(time_path((piece,), example.drive, example.limits), 5e-4)
        vx, vy, omega = made.twist.T
        c, s = np.cos(made.pose[:, 2]), np.sin(made.pose[:, 2])
        rates = np.column_stack([c * vx - s * vy, s * vx + c * vy, omega])
        h = np.diff(made.time)[:, None]
        # as above: a synchro drive turns as its wheels steer, at a rate that may jump at both ends
        gained = np.cumsum((h * (rates[1:] + rates[:-1]) / 2)[1:-1], axis=0)
        assert made.pose[2:-1] - made.pose[1] == pytest.approx(gained, abs=1e-5)
        assert made.pose[-1] == pytest.approx(piece.end, abs=1e-12)
