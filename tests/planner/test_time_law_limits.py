"""The laws that hold for every drive: limits are kept, and used."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drives import DRIVES
from drives.drive import BodyPath, Car, Drive, Holonomic, Limits
from drives.se2 import Array, Pose, Twist
from planner.path import LinePiece, Path, Piece, TwistPiece
from planner.problem import Robot
from planner.schedule import WheelSchedule, sample_times
from planner.time_law import time_path

START = Pose(0.7, -0.4, 0.3)


def sampled(path: Path, example: Robot, period: float) -> WheelSchedule:
    """The motion along a path as a function of time, before it is put on a grid."""
    motion = time_path(path, example.drive, example.limits)
    return motion.sample(sample_times(motion.duration, period))


def used(made: WheelSchedule, limits: Limits) -> tuple[Array, Array]:
    """Used / allowed at each sample (n,): of speeds, and of accelerations, the wheel that uses most."""
    speed = (np.abs(made.wheel_velocity) / limits.wheel_speed).max(1)
    return speed, (np.abs(made.wheel_acceleration) / limits.wheel_acceleration).max(1)


LINES = [
    (Pose(0.0, 0.0, 0.0), Pose(2.0, 0.5, 2.0)),
    (Pose(0.0, 0.0, 1.0), Pose(-0.6, 0.3, -2.0)),
    (Pose(0.0, 0.0, 0.0), Pose(0.2, 0.0, 6.0)),
    (Pose(0.0, 0.0, 0.0), Pose(5.0, 0.0, 0.1)),
]


@pytest.mark.parametrize("ends", LINES)
@pytest.mark.parametrize("kind", ["omni", "mecanum", "swedish"])
def test_turning_on_a_line_keeps_every_limit_and_wastes_none(
    robot: Callable[..., Robot], kind: str, ends: tuple[Pose, Pose]
) -> None:
    example = robot(kind)
    made = sampled((LinePiece(*ends),), example, 1e-3)
    speed, acceleration = used(made, example.limits)
    assert speed.max() <= 1.001
    assert acceleration.max() <= 1.001
    # Time-optimal is bang-bang: some limit is active at almost every moment (Bobrow et al., 1985).
    assert np.mean(np.maximum(speed, acceleration) > 0.95) >= 0.9
    assert np.mean(np.maximum(speed, acceleration) > 0.97) >= 0.85


@pytest.mark.parametrize("ends", LINES)
@pytest.mark.parametrize("kind", ["swerve", "powered_caster"])
def test_steered_wheels_turning_on_a_line_keep_every_limit(
    robot: Callable[..., Robot], kind: str, ends: tuple[Pose, Pose]
) -> None:
    example = robot(kind)
    made = sampled((LinePiece(*ends),), example, 1e-3)
    speed, acceleration = used(made, example.limits)
    assert speed.max() <= 1.001
    assert acceleration.max() <= 1.001
    steering = np.abs(made.steering_rate).max(1) / example.limits.steering_rate
    assert steering.max() <= 1.001
    active = np.maximum(steering, np.maximum(speed, acceleration))
    assert np.mean(active > 0.95) >= 0.9


@pytest.mark.parametrize("ends", LINES)
@pytest.mark.parametrize("kind", ["omni", "mecanum", "swedish", "swerve", "powered_caster"])
def test_turning_on_a_line_keeps_the_jerk(
    robot: Callable[..., Robot], kind: str, ends: tuple[Pose, Pose]
) -> None:
    example = robot(kind, wheel_jerk=150.0)
    made = sampled((LinePiece(*ends),), example, 1e-3)
    assert all(share.max() <= 1.001 for share in used(made, example.limits))
    jerk = np.diff(made.wheel_acceleration, axis=0)[:-1] / 1e-3
    assert np.abs(jerk).max() <= 150.0 * 1.001


STEEP = [
    ("powered_caster", TwistPiece(Pose(0.0, 0.0, 0.0), Twist(0.0, 2.0, 3.0))),
    ("powered_caster", LinePiece(Pose(0.0, 0.0, 0.0), Pose(0.2, 2.6, -0.2))),
    ("swerve", LinePiece(Pose(0.0, 0.0, 0.0), Pose(0.3, 0.4, -2.6))),
    ("swerve", LinePiece(Pose(0.0, 0.0, 0.0), Pose(0.44, -0.06, 2.3))),
    ("swerve", LinePiece(Pose(0.0, 0.0, 0.0), Pose(-0.1, 0.1, 1.0))),
    ("swerve", LinePiece(Pose(0.0, 0.0, 0.0), Pose(-0.5, 1.0, 6.0))),
    ("swedish", LinePiece(Pose(0.0, 0.0, 0.0), Pose(-0.1, 2.0, 6.0))),
]
"""Pieces along which some wheel's law changes steeply, as the instantaneous centre passes close by it."""


@pytest.mark.parametrize(("kind", "piece"), STEEP)
def test_where_the_law_is_steep_there_is_a_motion_and_it_keeps_every_limit(
    robot: Callable[..., Robot], kind: str, piece: Piece
) -> None:
    example = robot(kind)
    made = sampled((piece,), example, 1e-3)
    speed, acceleration = used(made, example.limits)
    assert speed.max() <= 1.001
    assert acceleration.max() <= 1.001
    assert np.abs(made.steering_rate).max(initial=0.0) <= example.limits.steering_rate * 1.001


# ---------------------------------------------------------------- laws


def possible(drive: Drive, limits: Limits, ahead: float, aside: float, turn: float) -> list[Piece]:
    """Pieces that this drive can do, made from any three numbers."""
    match drive.mobility(limits):
        case Holonomic():
            return [
                TwistPiece(START, Twist(ahead, aside, turn)),
                LinePiece(START, Pose(START.x + ahead, START.y + aside, START.theta + turn)),
            ]
        case Car(radius):
            bend = math.copysign(min(abs(turn / ahead), 1 / radius), turn * ahead)
            return [TwistPiece(START, Twist(ahead, 0.0, bend * ahead))]
    return [TwistPiece(START, Twist(ahead, 0.0, turn)), TwistPiece(START, Twist(0.0, 0.0, turn))]


WAY = st.floats(0.01, 4.0).flatmap(lambda way: st.sampled_from([way, -way]))
LIMITS = ("wheel_speed", "wheel_acceleration", "steering_rate", "linear_speed", "linear_acceleration",
          "angular_speed", "lateral_acceleration")  # fmt: skip
BODY = {"linear_speed": 0.8, "angular_speed": 2.0, "linear_acceleration": 1.5, "lateral_acceleration": 0.9}
each_drive = pytest.mark.parametrize("kind", DRIVES)
few = settings(max_examples=12, deadline=None, derandomize=True)


def motion(path: Path, drive: Drive, limits: Limits) -> float:
    return time_path(path, drive, limits).duration


@each_drive
@given(ahead=WAY, aside=WAY, turn=WAY, which=st.sets(st.sampled_from(LIMITS), min_size=1))
@few
def test_doubling_limits_never_makes_it_slower(
    robot: Callable[..., Robot], kind: str, ahead: float, aside: float, turn: float, which: set[str]
) -> None:
    example = robot(kind, **BODY)
    doubled = replace(example.limits, **{name: 2 * getattr(example.limits, name) for name in which})
    for piece in possible(example.drive, example.limits, ahead, aside, turn):
        before = motion((piece,), example.drive, example.limits)
        assert motion((piece,), example.drive, doubled) <= before * (1 + 1e-3)


@each_drive
@given(ahead=WAY, aside=WAY, turn=WAY)
@few
def test_doubling_the_jerk_limit_never_makes_it_slower(
    robot: Callable[..., Robot], kind: str, ahead: float, aside: float, turn: float
) -> None:
    tight, loose, none = (robot(kind, wheel_jerk=jerk) for jerk in (60.0, 120.0, math.inf))
    for piece in possible(tight.drive, tight.limits, ahead, aside, turn):
        first, second, third = (motion((piece,), each.drive, each.limits) for each in (tight, loose, none))
        assert third * (1 - 1e-3) <= second <= first * (1 + 1e-3)


@each_drive
@given(ahead=WAY, aside=WAY, turn=WAY, factor=st.floats(0.2, 5.0))
@few
def test_time_scales_with_the_limits(
    robot: Callable[..., Robot], kind: str, ahead: float, aside: float, turn: float, factor: float
) -> None:
    """Speeds by k, accelerations by k²: the same motion, k times as fast."""
    example = robot(kind, **BODY)
    powers = {"wheel_acceleration": 2, "linear_acceleration": 2, "lateral_acceleration": 2}
    faster = replace(
        example.limits,
        **{name: factor ** powers.get(name, 1) * getattr(example.limits, name) for name in LIMITS},
    )
    for piece in possible(example.drive, example.limits, ahead, aside, turn):
        usual = motion((piece,), example.drive, example.limits)
        quick = motion((piece,), example.drive, faster)
        exact = isinstance(piece, TwistPiece) and kind != "powered_caster"
        assert quick * factor == pytest.approx(usual, rel=1e-6 if exact else 1e-2)


@each_drive
@given(ahead=WAY, aside=WAY, turn=WAY)
@few
def test_no_limit_is_passed_on_a_fine_grid(
    robot: Callable[..., Robot], kind: str, ahead: float, aside: float, turn: float
) -> None:
    example = robot(kind)
    for piece in possible(example.drive, example.limits, ahead, aside, turn):
        made = sampled((piece,), example, 2e-3)
        assert all(share.max() <= 1.001 for share in used(made, example.limits))
        if made.steering_rate.size:
            assert np.abs(made.steering_rate).max() <= example.limits.steering_rate * 1.001
            turned = np.abs(np.diff(made.steering_angle, axis=0)) / np.diff(made.time)[:, None]
            assert turned[:-1].max(initial=0.0) <= example.limits.steering_rate * 1.001


# a powered caster's wheels swing round on one of the two ways
@pytest.mark.parametrize("kind", [kind for kind in DRIVES if kind != "powered_caster"])
@given(ahead=WAY, turn=WAY)
@few
def test_backwards_takes_as_long_as_forwards(
    robot: Callable[..., Robot], kind: str, ahead: float, turn: float
) -> None:
    example = robot(kind)
    (piece, *_) = possible(example.drive, example.limits, ahead, 0.0, turn)
    assert isinstance(piece, TwistPiece)
    twist = piece.twist
    forwards = motion((piece,), example.drive, example.limits)
    backwards = motion(
        (TwistPiece(START, Twist(-twist.vx, -twist.vy, -twist.omega)),), example.drive, example.limits
    )
    assert backwards == pytest.approx(forwards, rel=1e-9)


def test_the_law_is_the_drives_own(robot: Callable[..., Robot]) -> None:
    """At each moment: wheel rate = w·ṡ, for the w that the drive gives along the piece."""
    for kind in ("omni", "swerve"):
        example = robot(kind)
        piece = LinePiece(*LINES[0])
        made = sampled((piece,), example, 0.01)
        s = (made.pose[:, 2] - piece.start.theta) / piece.turn
        inside = (s > 1e-6) & (s < 1 - 1e-6)
        path: BodyPath = piece.body_path(s[inside])
        rate = made.twist[inside, 2] / piece.turn
        law = example.drive.actuators(path)
        assert made.wheel_velocity[inside] == pytest.approx(law.wheel * rate[:, None], abs=1e-6)
