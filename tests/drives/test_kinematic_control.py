"""Szoke, Negrean, Schonstein and Kacso, "Kinematic control" of a differential robot, equation by equation.

Their wheels are 1 = right, 2 = left, and l is half the track width.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drives import Differential
from drives.arc import follow
from drives.differential import no_sideways_motion
from drives.polar import Polar, polar, polar_rates, rotation, translation
from drives.se2 import Pose, Twist, wrap

R, HALF = 0.1, 0.25
ROBOT = Differential(wheel_radius=R, track_width=2 * HALF)
rate = st.floats(-10.0, 10.0)
metre = st.floats(-5.0, 5.0)
angle = st.floats(-3.0, 3.0)
fast = settings(max_examples=60, deadline=None)


def right_left(twist: Twist) -> tuple[float, float]:
    left, right = ROBOT.inverse(twist).rates
    return float(right), float(left)


@fast
@given(rate, rate, angle)
def test_eq_20_to_23_direct_model(phi1, phi2, theta) -> None:
    """(23) with the zero in its column of three left out: a 3×2 matrix takes (v, omega)."""
    v, omega = R / 2 * (phi1 + phi2), R / (2 * HALF) * (phi1 - phi2)
    twist, _ = ROBOT.forward(np.array([[phi2, phi1]]), np.zeros((1, 0)), np.zeros((1, 0)))
    np.testing.assert_allclose(twist[0], (v, 0.0, omega), atol=1e-13, rtol=0)
    world = ROBOT.world_jacobian(theta) @ (phi2, phi1)
    np.testing.assert_allclose(world, (v * math.cos(theta), v * math.sin(theta), omega), atol=1e-13, rtol=0)


@fast
@given(rate, rate, angle)
def test_eq_9_10_corrected_no_motion_is_sideways(phi1, phi2, theta) -> None:
    """-ẋ sin θ + ẏ cos θ = 0: (10) has the sign that (9) lost."""
    velocity = ROBOT.world_jacobian(theta) @ (phi2, phi1)
    assert (no_sideways_motion(theta) @ velocity)[0] == pytest.approx(0.0, abs=1e-13)


@fast
@given(angle)
def test_eq_11_the_constraint_is_not_integrable(theta) -> None:
    """Frobenius: for P dx + Q dy + A dθ, P(A_y - Q_θ) + Q(P_θ - A_x) + A(Q_x - P_y) is nowhere zero."""
    h = 1e-6
    p, q, a = no_sideways_motion(theta)[0]
    slope = (no_sideways_motion(theta + h)[0] - no_sideways_motion(theta - h)[0]) / (2 * h)
    assert p * -slope[1] + q * slope[0] + a == pytest.approx(-1.0, abs=1e-9)


@fast
@given(metre, metre, angle, metre, metre)
def test_eq_25_26_37_38_polar_coordinates(x, y, theta, gx, gy) -> None:
    rho, alpha, beta = polar(Pose(x, y, theta), (gx, gy))
    assert rho == pytest.approx(math.hypot(gx - x, gy - y), abs=1e-15)
    seen = rho * np.array([math.cos(alpha + theta), math.sin(alpha + theta)])
    np.testing.assert_allclose(seen, (gx - x, gy - y), atol=1e-12)
    assert beta == -theta - alpha
    assert -math.pi < alpha <= math.pi


@fast
@given(metre, metre, angle, st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_eq_34_motion_in_polar_coordinates(x, y, theta, v, omega) -> None:
    """Against the derivative of (25), (26) along the exact arc; (29) and (32) err in sign and cancel out."""
    start, goal, twist = Pose(x, y, theta), (7.0, 6.0), Twist(v, 0.0, omega)
    h = 1e-4
    ahead, behind = polar(follow(start, twist, h), goal), polar(follow(start, twist, -h), goal)
    change = np.array(ahead) - np.array(behind)
    change[1:] = [wrap(change[1]), wrap(change[2])]
    np.testing.assert_allclose(change / (2 * h), polar_rates(polar(start, goal), twist), atol=1e-6)


@fast
@given(rate, rate, angle, st.floats(0.1, 5.0))
def test_eq_40_41_corrected_polar_motion_of_the_wheels(phi1, phi2, alpha, rho) -> None:
    """(40) prints φ̇₁ + φ̇₂ where α̇ needs the difference, and lost the r of β̇; (41) likewise."""
    twist, _ = ROBOT.forward(np.array([[phi2, phi1]]), np.zeros((1, 0)), np.zeros((1, 0)))
    rates = polar_rates(Polar(rho, alpha, 0.0), Twist(*twist[0]))
    total, difference = R / 2 * (phi1 + phi2), R / (2 * HALF) * (phi1 - phi2)
    corrected = (
        -total * math.cos(alpha),
        total / rho * math.sin(alpha) - difference,
        -total / rho * math.sin(alpha),
    )
    np.testing.assert_allclose(rates, corrected, atol=1e-12, rtol=0)
    assert rates.alpha + rates.beta == pytest.approx(-difference, abs=1e-11)


@fast
@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(-1.5, 1.5), st.floats(0.1, 5.0))
def test_eq_39_42_wheel_rates(v, omega, alpha, rho) -> None:
    """φ̇₁,₂ = (v ± l·θ̇)/r = -ρ̇/(r cos α) ± l·θ̇/r; (39) prints ρ̇₁,₂ for the rates."""
    twist = Twist(v, 0.0, omega)
    rho_rate = polar_rates(Polar(rho, alpha, 0.0), twist).rho
    for found, sign in zip(right_left(twist), (1, -1), strict=True):
        assert found == pytest.approx((v + sign * HALF * omega) / R, abs=1e-12)
        assert found == pytest.approx(-rho_rate / (R * math.cos(alpha)) + sign * HALF / R * omega, abs=1e-11)


@fast
@given(angle, st.floats(0.1, 9.0))
def test_eq_44_rotation_on_the_spot(turn, duration) -> None:
    twist = rotation(turn, duration)
    expected = HALF / R * turn / duration
    np.testing.assert_allclose(right_left(twist), (expected, -expected), atol=1e-11, rtol=0)
    np.testing.assert_allclose(follow(Pose(1, 2, 0.3), twist, duration), (1, 2, 0.3 + turn), atol=1e-12)


@fast
@given(metre, metre, angle, metre, metre, st.floats(0.1, 9.0), st.booleans())
def test_eq_44_45_corrected_rotate_then_translate_reaches_the_goal(
    x, y, theta, gx, gy, duration, backwards
) -> None:
    """With Δρ the change of ρ, -distance: (43) prints it positive, which drives away from the goal."""
    start = Pose(x, y, theta)
    turn = polar(start, (gx, gy)).alpha + (math.pi if backwards else 0.0)
    turned = follow(start, rotation(turn, duration), duration)
    at = polar(turned, (gx, gy))
    if at.rho < 1e-6:
        return
    twist = translation(at.rho, at.alpha, duration)
    delta_rho = -at.rho
    both = -delta_rho / (duration * R * math.cos(at.alpha))
    np.testing.assert_allclose(right_left(twist), (both, both), rtol=1e-12)
    assert (both < 0) == backwards
    np.testing.assert_allclose(follow(turned, twist, duration)[:2], (gx, gy), atol=1e-9)


def test_a_straight_move_to_a_goal_beside_the_robot_is_refused() -> None:
    with pytest.raises(ValueError, match="turn to the goal first"):
        translation(1.0, 0.5, 1.0)


def test_on_the_goal_itself_polar_coordinates_have_no_rates() -> None:
    at = polar(Pose(1.0, 2.0, 0.3), (1.0, 2.0))
    assert at == (0.0, 0.0, -0.3)
    with pytest.raises(ValueError, match="no rate"):
        polar_rates(at, Twist(1.0, 0.0, 0.0))
