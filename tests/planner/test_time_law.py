"""Single pieces against closed forms, wheels that steer first, and short cuts against the long way."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from toppra.algorithm import TOPPRA
from toppra.constraint import LinearConstraint

from drives import DRIVES, Differential, Mecanum
from drives.drive import Car, Drive, Limits
from drives.se2 import Array, Pose, Twist
from planner import time_law
from planner.errors import LimitsInfeasible
from planner.path import LinePiece, Piece, TwistPiece
from planner.problem import Robot
from planner.schedule import schedule
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
