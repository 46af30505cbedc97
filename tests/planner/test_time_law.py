"""Single pieces against closed forms, and the laws that hold for every drive: limits are kept, and used."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toppra.algorithm import TOPPRA
from toppra.constraint import LinearConstraint

from drives import DRIVES, Differential, Mecanum
from drives.drive import BodyPath, Car, Drive, Holonomic, Limits
from drives.se2 import Array, Pose, Twist
from planner import time_law
from planner.errors import LimitsInfeasible
from planner.path import LinePiece, Path, Piece, TwistPiece
from planner.problem import Robot
from planner.schedule import WheelSchedule, schedule
from planner.time_law import time_path
from planner.trajectory import Driven, Phases

R, TRACK = 0.1, 0.4
DIFFERENTIAL = Differential(R, TRACK)
START = Pose(0.7, -0.4, 0.3)


def limited(drive: Drive, speed: float, acceleration: float, jerk: float = math.inf, **more: float) -> Limits:
    return Limits(*(np.full(len(drive.wheel_names), each) for each in (speed, acceleration, jerk)), **more)


def duration(drive: Drive, piece: Piece, limits: Limits) -> float:
    return time_path((piece,), drive, limits).duration


def straight(length: float) -> TwistPiece:
    return TwistPiece(START, Twist(length, 0.0, 0.0))


def trapezoid(way: float, v: float, a: float) -> float:
    """Time (s) from rest to rest: speed up, cruise if there is room, slow down."""
    return way / v + v / a if way * a >= v * v else 2 * math.sqrt(way / a)


def s_curve(way: float, v: float, a: float, j: float) -> float:
    """Time (s) of the seven segments from rest to rest under a jerk limit, some of them empty."""

    def ramp(to: float) -> float:
        """Time to reach the speed `to` from rest, acceleration 0 at both ends."""
        return to / a + a / j if to * j >= a * a else 2 * math.sqrt(to / j)

    if way >= v * ramp(v):  # the mean speed of a ramp is half its last
        return way / v + ramp(v)
    if way >= 2 * a**3 / j**2:  # the acceleration is reached, the speed is not
        top = (-(a**2) / j + math.sqrt((a**2 / j) ** 2 + 4 * a * way)) / 2
        return 2 * ramp(top)
    return 4 * (way / (2 * j)) ** (1 / 3)


# ---------------------------------------------------------------- closed forms


@pytest.mark.parametrize("way", [1e-3, 0.1, 0.4, 0.5, 0.500001, 1.0, 3.0, 100.0, -2.0])
def test_straight_line_is_a_trapezoid_or_a_triangle(way: float) -> None:
    limits = limited(DIFFERENTIAL, 10.0, 20.0)
    expected = trapezoid(abs(way), 10.0 * R, 20.0 * R)
    assert duration(DIFFERENTIAL, straight(way), limits) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("turn", [1e-3, 0.5, math.pi, -2.0, 20.0])
def test_pivot_takes_what_the_wheels_need_for_their_arcs(turn: float) -> None:
    limits = limited(DIFFERENTIAL, 10.0, 20.0)
    piece = TwistPiece(START, Twist(0.0, 0.0, turn))
    wheel = abs(turn) * TRACK / 2 / R
    assert duration(DIFFERENTIAL, piece, limits) == pytest.approx(trapezoid(wheel, 10.0, 20.0), rel=1e-9)


@pytest.mark.parametrize("jerk", [5.0, 40.0, 200.0, 1e4])
@pytest.mark.parametrize("way", [1e-3, 0.05, 0.3, 0.6, 1.0, 5.0, 50.0])
def test_jerk_limited_line_is_the_s_curve_of_seven_segments(way: float, jerk: float) -> None:
    limits = limited(DIFFERENTIAL, 10.0, 20.0, jerk)
    expected = s_curve(way / R, 10.0, 20.0, jerk)
    assert duration(DIFFERENTIAL, straight(way), limits) == pytest.approx(expected, rel=1e-7)


def test_mecanum_diagonal_uses_two_wheels() -> None:
    drive = Mecanum(0.05, 0.3, 0.4)
    limits = limited(drive, 10.0, 20.0)
    # r·rate = vx ± vy: on the diagonal two wheels stand and two turn √2 times as fast as straight ahead.
    expected = trapezoid(3.0 * math.sqrt(2) / 0.05, 10.0, 20.0)
    ahead = TwistPiece(START, Twist(3.0 / math.sqrt(2), 3.0 / math.sqrt(2), 0.0))
    diagonal = LinePiece(
        Pose(0.0, 0.0, 0.5), Pose(3.0 * math.cos(0.5 + math.pi / 4), 3.0 * math.sin(0.5 + math.pi / 4), 0.5)
    )
    for piece in (ahead, diagonal):
        made = time_path((piece,), drive, limits)
        assert made.duration == pytest.approx(expected, rel=1e-9)
        turned = np.abs(schedule(made, 0.02).wheel_angle[-1])
        assert sorted(turned) == pytest.approx(
            [0.0, 0.0, 3.0 * math.sqrt(2) / 0.05, 3.0 * math.sqrt(2) / 0.05]
        )


@pytest.mark.parametrize("curvature", [0.5, -1.0, 4.0, -12.0])
def test_on_an_arc_the_outer_wheel_is_at_its_limit(curvature: float) -> None:
    limits = limited(DIFFERENTIAL, 10.0, 20.0)
    length = 4.0
    made = time_path((TwistPiece(START, Twist(length, 0.0, curvature * length)),), DIFFERENTIAL, limits)
    outer = length * (1 + abs(curvature) * TRACK / 2) / R
    assert made.duration == pytest.approx(trapezoid(outer, 10.0, 20.0), rel=1e-9)
    samples = schedule(made, 0.01)
    side, fastest = (1 if curvature > 0 else 0), np.abs(samples.wheel_velocity).max(0)
    assert fastest[side] == pytest.approx(10.0, rel=1e-9)
    assert fastest[1 - side] < 10.0
    assert samples.wheel_angle[-1, side] == pytest.approx(outer, rel=1e-9)


@pytest.mark.parametrize("slow", [0, 1])
def test_the_slowest_wheel_decides(slow: int) -> None:
    speed = np.array([10.0, 10.0])
    speed[slow] = 2.0
    limits = replace(limited(DIFFERENTIAL, 10.0, 20.0), wheel_speed=speed)
    assert duration(DIFFERENTIAL, straight(5.0), limits) == pytest.approx(
        trapezoid(50.0, 2.0, 20.0), rel=1e-9
    )


def test_body_limits_decide_where_they_are_tighter() -> None:
    wheels = limited(DIFFERENTIAL, 10.0, 20.0)
    line = straight(5.0)
    arc = TwistPiece(START, Twist(5.0, 0.0, 2.5))
    for piece, limits, expected in (
        (line, replace(wheels, linear_speed=0.5), trapezoid(5.0, 0.5, 2.0)),
        (line, replace(wheels, linear_acceleration=0.3), trapezoid(5.0, 1.0, 0.3)),
        (arc, replace(wheels, angular_speed=0.2), trapezoid(5.0 * 1.1, 0.4 * 1.1, 2.0)),
        (arc, replace(wheels, lateral_acceleration=0.125), trapezoid(5.0 * 1.1, 0.5 * 1.1, 2.0)),
    ):
        assert duration(DIFFERENTIAL, piece, limits) == pytest.approx(expected, rel=1e-9)


# ---------------------------------------------------------------- a curved path of the wheels


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
    made = schedule(time_path((LinePiece(*ends),), example.drive, example.limits), 1e-3)
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
    made = schedule(time_path((LinePiece(*ends),), example.drive, example.limits), 1e-3)
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
    made = schedule(time_path((LinePiece(*ends),), example.drive, example.limits), 1e-3)
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
    made = schedule(time_path((piece,), example.drive, example.limits), 1e-3)
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
        made = schedule(time_path((piece,), example.drive, example.limits), 2e-3)
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


# ---------------------------------------------------------------- steering


def test_wheels_steer_at_rest_to_where_the_motion_needs_them(robot: Callable[..., Robot]) -> None:
    example = robot("swerve")
    given_at = np.array([1.2, 0.0, -0.6])
    usual = time_path((straight(1.0),), example.drive, example.limits, np.zeros(3))
    made = time_path((straight(1.0),), example.drive, example.limits, given_at)
    assert made.duration == pytest.approx(usual.duration + 1.2 / example.limits.steering_rate, rel=1e-9)
    samples = schedule(made, 0.01)
    assert samples.steering_angle[0].tolist() == given_at.tolist()
    assert samples.steering_angle[-1] == pytest.approx(np.zeros(3), abs=1e-12)


def test_wheels_take_the_nearer_of_two_directions(robot: Callable[..., Robot]) -> None:
    example = robot("swerve")
    made = schedule(
        time_path((straight(1.0),), example.drive, example.limits, np.array([3.0, -3.0, 6.0])), 0.01
    )
    assert made.steering_angle[-1] == pytest.approx([math.pi, -math.pi, 2 * math.pi])
    assert np.sign(made.wheel_angle[-1]).tolist() == [-1, -1, 1]


def test_a_path_beyond_the_steering_limit_is_infeasible(robot: Callable[..., Robot]) -> None:
    for kind in ("tricycle", "ackermann"):
        example = robot(kind)
        match example.drive.mobility(example.limits):
            case Car(radius):
                tight = TwistPiece(START, Twist(1.0, 0.0, 1.2 / radius))
                with pytest.raises(LimitsInfeasible):
                    time_path((tight,), example.drive, example.limits)


def test_the_law_is_the_drives_own(robot: Callable[..., Robot]) -> None:
    """At each moment: wheel rate = w·ṡ, for the w that the drive gives along the piece."""
    for kind in ("omni", "swerve"):
        example = robot(kind)
        piece = LinePiece(*LINES[0])
        made = schedule(time_path((piece,), example.drive, example.limits), 0.01)
        s = (made.pose[:, 2] - piece.start.theta) / piece.turn
        inside = (s > 1e-6) & (s < 1 - 1e-6)
        path: BodyPath = piece.body_path(s[inside])
        rate = made.twist[inside, 2] / piece.turn
        law = example.drive.actuators(path)
        assert made.wheel_velocity[inside] == pytest.approx(law.wheel * rate[:, None], abs=1e-6)


# ---------------------------------------------------------------- short cuts


@pytest.mark.parametrize("kind", [k for k in sorted(DRIVES) if k != "powered_caster"])
@pytest.mark.parametrize("twist", [Twist(1.3, 0.0, 0.0), Twist(-0.9, 0.0, 0.35), Twist(0.0, 0.0, 2.0)])
def test_a_steady_piece_is_sampled_as_on_a_fine_grid(
    robot: Callable[..., Robot], kind: str, twist: Twist
) -> None:
    given = robot(kind)
    drive, limits = given.drive, given.limits
    if isinstance(drive.mobility(limits), Car) and twist.vx == 0.0:
        twist = Twist(0.5, 0.0, -0.1)
    driven = time_path((TwistPiece(START, twist),), drive, limits).phases[-1]
    assert isinstance(driven, Driven)
    assert len(driven.grid) == 2
    fine = replace(driven, grid=np.linspace(0.0, 1.0, 200))
    made, wanted = (schedule(Phases(drive, (phase,)), 0.01) for phase in (driven, fine))
    for name in ("wheel_angle", "wheel_velocity", "wheel_acceleration", "steering_angle", "steering_rate",
                 "pose", "twist"):  # fmt: skip
        np.testing.assert_allclose(getattr(made, name), getattr(wanted, name), atol=1e-9, err_msg=name)


@pytest.mark.parametrize("turn", [0.02, 1.0, -3.0])
def test_the_two_passes_find_what_toppra_finds(monkeypatch: pytest.MonkeyPatch, turn: float) -> None:
    found: list[tuple[Array, Array]] = []

    def both(rows: LinearConstraint, grid: Array) -> Array:
        path = SimpleNamespace(dof=1, path_interval=np.array([0.0, 1.0]))
        solver = TOPPRA([rows], path, gridpoints=grid, solver_wrapper="seidel")
        _, rate, *_ = solver.compute_parameterization(0.0, 0.0)
        found.append((x := controlled(rows, grid), rate**2))
        return x

    controlled = time_law._controlled
    monkeypatch.setattr(time_law, "_controlled", both)
    drive = Mecanum(0.05, 0.3, 0.4)
    duration(drive, LinePiece(START, Pose(3.0, 1.0, START.theta + turn)), limited(drive, 10.0, 20.0))
    ((x, wanted),) = found
    np.testing.assert_allclose(x, wanted, rtol=1e-9, atol=1e-9)
