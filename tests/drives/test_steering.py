"""Branches and limits of steered wheels along a path."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drives import Ackermann, Module, PoweredCaster, Swerve, Synchro, Tricycle
from drives.drive import BodyPath, Car, InadmissibleTwist, Limits
from drives.se2 import Twist

X, Y = 0.3, 0.2
SWERVE = Swerve(0.05, (Module("a", X, Y), Module("b", -X, Y), Module("c", 0.0, -X)))
TRICYCLE, ACKERMANN = Tricycle(0.1, 0.8, 0.5), Ackermann(0.1, 0.8, 0.5)
CARS = pytest.mark.parametrize("car", [TRICYCLE, ACKERMANN], ids=["tricycle", "ackermann"])


def body_path(s, tangent, derivative) -> BodyPath:
    """Columns may be numbers or arrays over s."""
    over = [
        np.stack([np.broadcast_to(c, s.shape) for c in columns], axis=1) for columns in (tangent, derivative)
    ]
    return BodyPath(s, np.zeros_like(s), *[np.array(a, dtype=float) for a in over])


def led_by_a(s, p, dp) -> BodyPath:
    """The path, turning at 1 rad per unit of s, on which module a moves with p(s)."""
    return body_path(s, (p[0] + Y, p[1] - X, 1.0), (dp[0], dp[1], 0.0))


@pytest.mark.parametrize("held", [None, 0.7, -2.0])
def test_a_module_that_the_body_turns_about_holds_its_angle_at_rest(held) -> None:
    s = np.linspace(0, 1, 11)
    start = None if held is None else np.array([held, 0.0, 0.0])
    law = SWERVE.actuators(led_by_a(s, (0.0, 0.0), (0.0, 0.0)), start)
    assert (law.steering[:, 0] == (held or 0.0)).all()
    for column in (law.wheel, law.wheel_derivative, law.steering_derivative):
        assert np.abs(column[:, 0]).max() < 1e-12
    assert SWERVE.inverse(Twist(Y, -X, 1.0), start).steering[0] == (held or 0.0)


@pytest.mark.parametrize(
    "first", [-20.0, -19.5, -19.7, -20.0 + 1e-12], ids=["on", "between", "askew", "beside"]
)
@pytest.mark.parametrize("fine", [1, 10])
def test_a_module_whose_velocity_runs_through_zero_keeps_its_angle_and_changes_its_sense(first, fine) -> None:
    s = (fine * first + np.arange(40 * fine + 1)) / (40 * fine)
    law = SWERVE.actuators(led_by_a(s, (s, 0.3 * s + s**2), (1.0, 0.3 + 2 * s)))
    angle = np.arctan(0.3 + s)  # the direction of s·(1, 0.3 + s), half turns apart
    half_turns = (law.steering[:, 0] - angle) / np.pi
    np.testing.assert_allclose(half_turns, np.round(half_turns[0]), atol=1e-9)
    sense = np.cos(np.pi * half_turns)
    np.testing.assert_allclose(law.wheel[:, 0], sense * s * np.hypot(1, 0.3 + s) / 0.05, atol=1e-12)
    exact = 1 / (1 + (0.3 + s) ** 2)
    grid = s[1] - s[0]
    np.testing.assert_allclose(law.steering_derivative[:, 0], exact, atol=2 * grid**2)
    away = np.abs(s) > grid / 4
    np.testing.assert_allclose(law.steering_derivative[away, 0], exact[away], atol=1e-9)


def test_a_module_whose_velocity_touches_zero_keeps_its_angle_and_its_sense() -> None:
    s = np.linspace(-0.5, 0.5, 101)
    law = SWERVE.actuators(led_by_a(s, (s**2, s**3), (2 * s, 3 * s**2)))
    np.testing.assert_allclose(law.steering[:, 0], np.arctan(s), atol=1e-12)
    assert (law.wheel[:, 0] >= 0).all()
    np.testing.assert_allclose(law.steering_derivative[:, 0], 1 / (1 + s**2), atol=1e-4)


@pytest.mark.parametrize("n", [40, 2001], ids=["coarse", "fine"])
def test_a_module_whose_velocity_passes_beside_zero_turns_round_with_it(n) -> None:
    s = np.linspace(-0.5, 0.5, n)
    law = SWERVE.actuators(led_by_a(s, (s, 0.01), (1.0, 0.0)))
    np.testing.assert_allclose(law.steering[:, 0], np.arctan2(0.01, s), atol=1e-12)
    assert (law.wheel[:, 0] > 0).all()


def test_a_module_that_stands_for_a_while_waits_in_the_direction_it_leaves_in() -> None:
    s = np.linspace(-1, 1, 201)
    u = np.maximum(s, 0)
    law = SWERVE.actuators(led_by_a(s, (u**3, -(u**3)), (3 * u**2, -3 * u**2)))
    np.testing.assert_allclose(law.steering[:, 0], -np.pi / 4, atol=1e-12)
    np.testing.assert_allclose(law.steering_derivative[:, 0], 0.0, atol=1e-9)


def test_swerve_rates_are_positive_and_angles_in_the_half_open_turn_without_a_start() -> None:
    for vx, vy in ((-1.0, 0.0), (-1.0, -0.0), (0.0, -1.0), (1.0, 1.0)):
        state = SWERVE.inverse(Twist(vx, vy, 0.0))
        np.testing.assert_allclose(state.rates, math.hypot(vx, vy) / 0.05)
        np.testing.assert_allclose(state.steering, math.atan2(vy + 0.0, vx))
        law = SWERVE.actuators(body_path(np.linspace(0, 1, 5), (vx, vy, 0.0), (0, 0, 0)))
        np.testing.assert_allclose(law.steering[0], state.steering)


def test_a_swerve_module_takes_the_nearer_of_two_opposite_directions() -> None:
    start = np.array([0.1, 3.0, 6.5])
    path = body_path(np.linspace(0, 1, 5), (-1.0, 0.0, 0.0), (0, 0, 0))
    law, state = SWERVE.actuators(path, start), SWERVE.inverse(Twist(-1.0, 0.0, 0.0), start)
    for steering, rates in ((law.steering[0], law.wheel[0]), (state.steering, state.rates)):
        np.testing.assert_allclose(steering, [0.0, np.pi, 2 * np.pi], atol=1e-12)
        np.testing.assert_allclose(rates, [-20.0, 20.0, -20.0])


def test_a_swerve_branch_that_would_pass_the_limit_gives_way_to_one_that_does_not() -> None:
    s = np.linspace(
        1.0, 2.5, 201
    )  # s is also the direction of travel: from 1 to 2.5 rad, or from -2.14 to -0.64
    path = body_path(s, (np.cos(s), np.sin(s), 0.0), (-np.sin(s), np.cos(s), 0.0))
    for limit, half_turns, rate in ((np.inf, 0, 20.0), (2.5, 0, 20.0), (2.2, -1, -20.0)):
        law = SWERVE.actuators(path, None, limit)
        np.testing.assert_allclose(law.steering[:, 0], s + half_turns * np.pi, atol=1e-12)
        np.testing.assert_allclose(law.wheel, rate, rtol=1e-12)
    with pytest.raises(InadmissibleTwist, match="2 rad"):
        SWERVE.actuators(path, None, 2.0)


@CARS
def test_a_car_that_reverses_keeps_its_steering_and_turns_its_wheels_round(car) -> None:
    ahead, back = car.inverse(Twist(1.0, 0.0, 0.4)), car.inverse(Twist(-1.0, 0.0, -0.4))
    np.testing.assert_allclose(back.steering, ahead.steering, atol=1e-15)
    np.testing.assert_allclose(back.rates, -ahead.rates, atol=1e-12)


@CARS
def test_round_off_in_vy_does_not_steer_a_car(car) -> None:
    s = np.linspace(0, 1, 5)
    exact = car.actuators(body_path(s, (1.0, 0.0, 0.5), (0.0, 0.0, 0.0)))
    noisy = car.actuators(body_path(s, (1.0, 5e-10, 0.5), (0.0, 0.0, 0.0)))
    assert (noisy.steering == exact.steering).all()
    assert (noisy.wheel == exact.wheel).all()


@CARS
@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("turn", [1.0, -1.0])
def test_the_tightest_curve_of_a_car_puts_its_inner_wheel_on_the_limit(car, sense, turn) -> None:
    limit = 0.6
    mobility = car.mobility(Limits(np.ones(1), np.ones(1), np.ones(1), steering_angle=limit))
    assert isinstance(mobility, Car)
    s = np.linspace(0, 1, 5)
    law = car.actuators(
        body_path(s, (sense * mobility.min_turning_radius, 0.0, turn), (0, 0, 0)), None, limit
    )
    assert np.abs(law.steering).max() == pytest.approx(limit, abs=1e-12)
    tighter = body_path(s, (sense * mobility.min_turning_radius * 0.9999, 0.0, turn), (0, 0, 0))
    with pytest.raises(InadmissibleTwist):
        car.actuators(tighter, None, limit)


@CARS
@pytest.mark.parametrize("limit", [0.5, 1.3, 1.5])
def test_a_car_does_not_pivot_about_its_rear_axle_below_a_right_angle_of_steering(car, limit) -> None:
    # An Ackermann car's two front angles of 1.268 rad, toes in, would pass a check wheel by wheel.
    with pytest.raises(InadmissibleTwist):
        car.actuators(body_path(np.linspace(0, 1, 5), (0.0, 0.0, 1.0), (0, 0, 0)), None, limit)


@CARS
@pytest.mark.parametrize("limit", [math.pi / 2, math.inf])
def test_a_car_whose_steering_reaches_a_right_angle_pivots(car, limit) -> None:
    law = car.actuators(body_path(np.linspace(0, 1, 5), (0.0, 0.0, 1.0), (0, 0, 0)), None, limit)
    twist, slip = car.forward(law.wheel, law.steering, law.steering_derivative)
    np.testing.assert_allclose(twist, [[0.0, 0.0, 1.0]] * 5, atol=1e-12)
    assert slip.max() < 1e-12


@CARS
@pytest.mark.parametrize("limit", [1.5707, math.pi / 2, 2.0, math.inf])
def test_the_turning_radius_stays_positive_where_the_steering_would_pivot(car, limit) -> None:
    mobility = car.mobility(Limits(np.ones(1), np.ones(1), np.ones(1), steering_angle=limit))
    assert isinstance(mobility, Car)
    radius = mobility.min_turning_radius
    assert radius == pytest.approx(0.8 / 20 + (0.25 if car is ACKERMANN else 0.0), abs=1e-12)
    car.actuators(body_path(np.linspace(0, 1, 5), (radius, 0.0, 1.0), (0, 0, 0)), None, limit)


@CARS
def test_a_car_of_unlimited_steering_passes_through_a_pivot_without_a_jump(car) -> None:
    s = np.linspace(-1, 1, 401)
    law = car.actuators(body_path(s, (s, 0.0, 1.0), (1.0, 0.0, 0.0)))
    assert np.abs(np.diff(law.steering, axis=0)).max() < 0.02
    assert car.forward(law.wheel, law.steering, law.steering_derivative)[1].max() < 1e-12


def test_synchro_wheels_start_where_they_stand_and_follow_the_heading() -> None:
    s = np.linspace(0, 1, 5)
    path = BodyPath(s, 1.0 + 2 * s, np.tile([0.5, 0.0, 2.0], (5, 1)), np.zeros((5, 3)))
    law = Synchro(0.1, 3, body_heading=0.4).actuators(path)
    np.testing.assert_allclose(law.steering, np.tile((0.6 + 2 * s)[:, None], 3), atol=1e-15)
    start = np.array([0.1, 0.2, 0.3])
    law = Synchro(0.1, 3).actuators(path, start)
    np.testing.assert_allclose(law.steering, start + 2 * s[:, None], atol=1e-15)


@pytest.mark.parametrize(
    "drive", [Synchro(0.1), PoweredCaster(0.1, 0.04, SWERVE.modules)], ids=["synchro", "powered_caster"]
)
def test_a_wheel_that_cannot_choose_its_branch_is_held_to_the_limit(drive) -> None:
    path = BodyPath(
        np.linspace(0, 1, 50), np.linspace(0, 1, 50), np.tile([0.0, 0.0, 1.0], (50, 1)), np.zeros((50, 3))
    )
    drive.actuators(path, None, 10.0)
    with pytest.raises(InadmissibleTwist, match="would steer"):
        drive.actuators(path, None, 0.5)
