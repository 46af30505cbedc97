"""Retimed motions: along the same way, within every limit, never slower, and as fast as closed forms say."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from drives import DRIVES, Differential, Mecanum
from drives.drive import Car, Drive, Holonomic, Limits
from drives.se2 import Array, Pose, Twist
from planner.path import LinePiece, Piece, TwistPiece
from planner.problem import Robot
from planner.retime import excess, hastened, retimed
from planner.schedule import WheelSchedule
from planner.time_law import time_path
from planner.trajectory import Driven, Phase, Phases, Profile, Warped

R = 0.1
DIFFERENTIAL = Differential(R, 0.4)
START = Pose(0.7, -0.4, 0.3)
BODY = {"linear_speed": 0.7, "angular_speed": 1.5, "linear_acceleration": 1.0, "lateral_acceleration": 0.6}
each_drive = pytest.mark.parametrize("kind", DRIVES)


def limited(drive: Drive, speed: float, acceleration: float, jerk: float) -> Limits:
    return Limits(*(np.full(len(drive.wheel_names), each) for each in (speed, acceleration, jerk)))


def gentle(drive: Drive, piece: Piece, duration: float) -> Driven:
    """The piece by the polynomial 10 p³ - 15 p⁴ + 6 p⁵, a cubic between samples: at rest at both ends."""
    p = np.linspace(0.0, 1.0, 33)
    time, h = p * duration, duration / 32
    acceleration = (60 * p - 180 * p**2 + 120 * p**3) / duration**2
    jerk = np.diff(acceleration) / h
    rate = np.concatenate([[0.0], np.cumsum(h * (acceleration[:-1] + acceleration[1:]) / 2)])
    step = h * (rate[:-1] + h * (acceleration[:-1] / 2 + h * jerk / 6))
    way = np.concatenate([[0.0], np.cumsum(step)])
    profile = Profile(time, *(each / way[-1] for each in (way[:-1], rate[:-1], acceleration[:-1], jerk)))
    grid = np.linspace(0.0, 1.0, 200)
    steering = drive.actuators(piece.body_path(grid)).steering[0]
    return Driven(piece, profile, grid, steering)


def curved(robot: Robot) -> Piece:
    """A piece along which the drive's wheels turn neither alike nor evenly, where there is one."""
    match robot.drive.mobility(robot.limits):
        case Holonomic():
            return LinePiece(START, Pose(START.x + 1.2, START.y - 0.7, START.theta + 1.9))
        case Car(radius):
            return TwistPiece(START, Twist(1.5, 0.0, 1.2 / radius))
    return TwistPiece(START, Twist(1.5, 0.0, 1.7))


def sampled(phase: Phase, drive: Drive, count: int = 4001) -> WheelSchedule:
    return Phases(drive, (phase,)).sample(np.linspace(0.0, phase.duration, count))


def used(made: WheelSchedule, limits: Limits) -> dict[str, float]:
    """Largest shares of the limits, from differences between samples."""
    h = float(made.time[1])

    def slope(values: Array) -> Array:
        change: Array = np.diff(values, axis=0) / h
        return change

    vx, vy, omega = made.twist.T
    speed = np.hypot(vx, vy)
    fast = speed > 1e-2
    course = np.unwrap(np.arctan2(vy, vx))
    turning = np.gradient(course, h) + omega
    return {
        "wheel_speed": np.max(np.abs(slope(made.wheel_angle)) / limits.wheel_speed),
        "wheel_acceleration": np.max(np.abs(slope(made.wheel_velocity)) / limits.wheel_acceleration),
        "wheel_jerk": np.max(np.abs(slope(made.wheel_acceleration)) / limits.wheel_jerk),
        "steering_rate": np.max(np.abs(slope(made.steering_angle)) / limits.steering_rate, initial=0.0),
        "linear_speed": np.max(speed) / limits.linear_speed,
        "angular_speed": np.max(np.abs(omega)) / limits.angular_speed,
        "linear_acceleration": np.max(np.abs(slope(speed))) / limits.linear_acceleration,
        "lateral_acceleration": np.max(np.abs(turning * speed)[fast], initial=0.0)
        / limits.lateral_acceleration,
    }


def same_way(a: WheelSchedule, b: WheelSchedule) -> float:
    """How far the poses and wheel angles of one are from the polyline of the other's, at worst."""
    p, q = (np.hstack([each.pose, each.wheel_angle]) for each in (a, b))
    at, to = (np.concatenate([[0.0], np.cumsum(np.abs(np.diff(each, axis=0)).sum(1))]) for each in (p, q))
    off = [np.interp(at / at[-1], to / to[-1], column) for column in q.T]
    return float(np.abs(p - np.stack(off, -1)).max())


# ---------------------------------------------------------------- closed forms


@pytest.mark.parametrize(
    ("way", "share"), [(0.01, 7e-3), (0.1, 5e-3), (0.5, 3e-3), (2.0, 1e-3), (8.0, 1e-3)], ids=str
)
@pytest.mark.parametrize("slack", [1.2, 4.0])
def test_a_straight_line_becomes_as_fast_as_ruckigs(way: float, share: float, slack: float) -> None:
    limits = limited(DIFFERENTIAL, 10.0, 20.0, 200.0)
    piece = TwistPiece(START, Twist(way, 0.0, 0.0))
    exact = time_path((piece,), DIFFERENTIAL, limits).duration
    slow = gentle(DIFFERENTIAL, piece, slack * exact)
    faster = retimed(slow, slow.profile.time, DIFFERENTIAL, limits)
    again = faster
    for _ in range(2):
        assert isinstance(again, Warped)
        again = retimed(again, again.profile.time, DIFFERENTIAL, limits)
    assert exact * (1 - 1e-4) <= again.duration <= exact * (1 + share)


def test_what_is_as_fast_as_possible_stays_as_it_is() -> None:
    limits = limited(DIFFERENTIAL, 10.0, 20.0, 200.0)
    motion = time_path((TwistPiece(START, Twist(2.0, 0.0, 0.0)),), DIFFERENTIAL, limits)
    assert hastened(motion, limits).phases == motion.phases


# ---------------------------------------------------------------- laws


@each_drive
@pytest.mark.parametrize("body", [{}, BODY], ids=["wheels", "body"])
@pytest.mark.parametrize("jerk", [40.0, 200.0])
def test_a_retimed_motion_goes_the_same_way_faster_within_every_limit(
    robot: Callable[..., Robot], kind: str, body: dict[str, float], jerk: float
) -> None:
    example = robot(kind, wheel_jerk=jerk, **body)
    slow = gentle(example.drive, curved(example), 6.0)
    slow = replace(
        slow, profile=slow.profile.slowed(excess(slow, slow.profile.time, example.drive, example.limits))
    )
    faster = retimed(slow, slow.profile.time, example.drive, example.limits)
    assert faster.duration < 0.99 * slow.duration
    before, after = sampled(slow, example.drive), sampled(faster, example.drive)
    over = {name: share for name, share in used(after, example.limits).items() if share > 1.01}
    assert not over
    assert same_way(after, before) < 2e-3
    assert after.pose[-1] == pytest.approx(before.pose[-1], abs=1e-9)
    assert after.wheel_angle[-1] == pytest.approx(before.wheel_angle[-1], abs=1e-6)


@each_drive
def test_velocity_and_acceleration_are_the_derivatives_of_the_angle(
    robot: Callable[..., Robot], kind: str
) -> None:
    example = robot(kind, wheel_jerk=100.0)
    slow = gentle(example.drive, curved(example), 5.0)
    made = sampled(retimed(slow, slow.profile.time, example.drive, example.limits), example.drive)
    h = float(made.time[1])
    inner = slice(1, -1)
    scale = np.abs(made.wheel_velocity).max()
    assert np.gradient(made.wheel_angle, h, axis=0)[inner] == pytest.approx(
        made.wheel_velocity[inner], abs=1e-4 * scale
    )
    assert np.gradient(made.wheel_velocity, h, axis=0)[inner] == pytest.approx(
        made.wheel_acceleration[inner], abs=0.5 * 100.0 * h + 1e-3 * scale
    )
    assert np.gradient(made.steering_angle, h, axis=0)[inner] == pytest.approx(
        made.steering_rate[inner], abs=2e-3 * (1 + np.abs(made.steering_rate).max(initial=0.0))
    )


@each_drive
def test_a_curved_piece_under_a_jerk_limit_takes_little_longer_than_without(
    robot: Callable[..., Robot], kind: str
) -> None:
    tight, none = robot(kind, wheel_jerk=200.0), robot(kind)
    path = (curved(tight),)
    smoothed = time_path(path, tight.drive, tight.limits)
    least = time_path(path, none.drive, none.limits).duration
    made = hastened(smoothed, tight.limits)
    assert least <= made.duration <= smoothed.duration
    # Building acceleration up takes 0.1 s: that much longer at either end.
    assert made.duration <= 1.02 * least + 0.25


def test_the_order_of_many_knots_does_not_matter_where_they_are_too_many() -> None:
    drive = Mecanum(0.05, 0.3, 0.4)
    limits = limited(drive, 10.0, 20.0, 200.0)
    slow = gentle(drive, LinePiece(START, Pose(2.0, 1.0, 2.0)), 8.0)
    few, many = (
        retimed(slow, np.linspace(0.0, slow.duration, n + 1), drive, limits).duration for n in (32, 1600)
    )
    assert many == pytest.approx(few, rel=5e-3)


# ---------------------------------------------------------------- degenerate


def test_without_a_jerk_limit_nothing_changes(robot: Callable[..., Robot]) -> None:
    example = robot("mecanum")
    motion = time_path((curved(example),), example.drive, example.limits)
    assert hastened(motion, example.limits) is motion


def test_nothing_is_retimed_once_time_is_over(robot: Callable[..., Robot]) -> None:
    example = robot("differential", wheel_jerk=40.0)
    motion = Phases(example.drive, (gentle(example.drive, curved(example), 6.0),))
    assert hastened(motion, example.limits, lambda: True).phases == motion.phases
    assert hastened(motion, example.limits).duration < motion.duration


def test_a_wheel_that_does_not_turn_and_one_without_limit_are_no_trouble() -> None:
    drive = Mecanum(0.05, 0.3, 0.4)
    limits = replace(
        limited(drive, 10.0, 20.0, 200.0), wheel_jerk=np.array([200.0, math.inf, math.inf, 200.0])
    )
    diagonal = TwistPiece(START, Twist(1.0, 1.0, 0.0))
    slow = gentle(drive, diagonal, 9.0)
    faster = retimed(slow, slow.profile.time, drive, limits)
    assert faster.duration < slow.duration
    assert used(sampled(faster, drive), limits)["wheel_jerk"] <= 1.01


def test_a_turn_on_the_spot_of_a_synchro_drive_whose_wheels_stand_keeps_the_steering_rate(
    robot: Callable[..., Robot],
) -> None:
    example = robot("synchro", wheel_jerk=100.0)
    slow = gentle(example.drive, TwistPiece(START, Twist(0.0, 0.0, 1.5)), 4.0)
    faster = retimed(slow, slow.profile.time, example.drive, example.limits)
    assert faster.duration <= slow.duration
    assert used(sampled(faster, example.drive), example.limits)["steering_rate"] <= 1.01
