"""Konstantinov, Chivarov and Shivarov, "Kinematics of mobile robots with three active wheels", equation by
equation.

Their φ is the angle of wheel 1 in the world: our theta + wheel_offset. Their velocities are in the world
frame.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drives import Omni
from drives.arc import centre_of_curvature, follow, radius_of_curvature
from drives.se2 import Pose, Twist

R, A, OFFSET = 0.05, 0.2, 0.35
OMNI = Omni(wheel_radius=R, robot_radius=A, wheel_offset=OFFSET)
ROOT3 = math.sqrt(3)
rate = st.floats(-20.0, 20.0)
angle = st.floats(-7.0, 7.0)
rates = st.tuples(rate, rate, rate)
fast = settings(max_examples=60, deadline=None)


def to_world(theta: float, twist) -> tuple[float, float, float]:
    c, s = math.cos(theta), math.sin(theta)
    return c * twist[0] - s * twist[1], s * twist[0] + c * twist[1], twist[2]


def to_body(theta: float, velocity) -> Twist:
    return Twist(*to_world(-theta, velocity))


def direct(omegas) -> Twist:
    twist, slip = OMNI.forward(np.array([omegas]), np.zeros((1, 0)), np.zeros((1, 0)))
    assert slip[0] < 1e-12
    return Twist(*twist[0])


@fast
@given(st.tuples(rate, rate, rate), angle, st.integers(0, 2))
def test_eq_2_corrected_the_wheels_centre_moves_by_plus_a_cos(velocity, phi, i) -> None:
    """ẋᵢ = ẋ - aφ̇ sin φᵢ; ẏᵢ = ẏ + aφ̇ cos φᵢ (printed with a minus): the derivative of (1)."""
    dx, dy, turn = velocity
    phi_i = phi + 2 * math.pi * i / 3
    h = 1e-5

    def centre(t: float) -> complex:  # eq. (1)
        return complex(dx * t + A * math.cos(phi_i + turn * t), dy * t + A * math.sin(phi_i + turn * t))

    moved = (centre(h) - centre(-h)) / (2 * h)
    assert moved == pytest.approx(
        complex(dx - A * turn * math.sin(phi_i), dy + A * turn * math.cos(phi_i)), abs=1e-6
    )


@fast
@given(st.tuples(rate, rate, rate), angle)
def test_eq_3_4_inverse(velocity, theta) -> None:
    dx, dy, turn = velocity
    phi = theta + OFFSET
    s, c = math.sin(phi), math.cos(phi)
    printed = [
        (dx * s - dy * c - A * turn) / R,  # printed with φᵢ for φ
        (dx * (ROOT3 * c - s) + dy * (c + ROOT3 * s) - 2 * A * turn) / (2 * R),
        (-dx * (ROOT3 * c + s) + dy * (c - ROOT3 * s) - 2 * A * turn) / (2 * R),
    ]
    np.testing.assert_allclose(OMNI.inverse(to_body(theta, velocity)).rates, printed, atol=1e-11, rtol=0)


@fast
@given(rates, angle)
def test_eq_5_direct(omegas, theta) -> None:
    w1, w2, w3 = omegas
    s, c = math.sin(theta + OFFSET), math.cos(theta + OFFSET)
    a, b = R / ROOT3 * (w2 - w3), R / 3 * (2 * w1 - w2 - w3)
    printed = (a * c + b * s, a * s - b * c, -R / (3 * A) * (w1 + w2 + w3))
    np.testing.assert_allclose(to_world(theta, direct(omegas)), printed, atol=1e-12, rtol=0)


@fast
@given(rates)
def test_mu_are_the_speeds_along_the_axles_and_two_thirds_of_their_squares_make_v_squared(omegas) -> None:
    """v² = ⅔(μ₁² + μ₂² + μ₃²), printed without the squares: the μᵢ themselves add up to zero."""
    w1, w2, w3 = omegas
    twist = direct(omegas)
    mu = [R / ROOT3 * d for d in (w2 - w3, w3 - w1, w1 - w2)]
    for i, expected in enumerate(mu):
        phi = OFFSET + 2 * math.pi * i / 3
        assert twist.vx * math.cos(phi) + twist.vy * math.sin(phi) == pytest.approx(expected, abs=1e-12)
    assert sum(mu) == pytest.approx(0.0, abs=1e-12)
    assert twist.vx**2 + twist.vy**2 == pytest.approx(2 / 3 * sum(m * m for m in mu), abs=1e-12)


@fast
@given(rate, rate, angle, st.floats(0.0, 5.0))
def test_constant_rates_with_no_sum_move_in_a_straight_line(w1, w2, theta, t) -> None:
    omegas = (w1, w2, -w1 - w2)
    phi = theta + OFFSET
    s, c = math.sin(phi), math.cos(phi)
    m = R * ((w1 + 2 * w2) / ROOT3 * c + w1 * s)
    n = R * ((w1 + 2 * w2) / ROOT3 * s - w1 * c)
    end = follow(Pose(1.0, 2.0, theta), direct(omegas), t)
    np.testing.assert_allclose(end, (1 + m * t, 2 + n * t, theta), atol=1e-11, rtol=0)
    assert math.hypot(m, n) == pytest.approx(2 * R * math.sqrt((w1 * w1 + w1 * w2 + w2 * w2) / 3), abs=1e-12)


@fast
@given(rates.filter(lambda w: abs(sum(w)) > 1e-2), angle, st.floats(0.0, 5.0))
def test_constant_rates_with_a_sum_move_on_a_circle(omegas, theta, t) -> None:
    """Centre as printed; radius R = 2aΩ₁/|Ω|, twice what is printed; θ by atan2, as its tangent loses the
    sense."""
    w1, w2, w3 = omegas
    total = w1 + w2 + w3
    omega0 = R * total / (3 * A)
    # Ω₁² = ω₁² + ω₂² + ω₃² - ω₁ω₂ - ω₂ω₃ - ω₃ω₁, as a sum of squares, which keeps all digits
    big1 = math.sqrt(((w1 - w2) ** 2 + (w2 - w3) ** 2 + (w3 - w1) ** 2) / 2)
    v = 2 * R * big1 / 3
    course = theta + OFFSET + math.atan2(w2 + w3 - 2 * w1, ROOT3 * (w2 - w3))
    printed = (1 + v / omega0 * math.sin(course), 2 - v / omega0 * math.cos(course))
    start, twist = Pose(1.0, 2.0, theta), direct(omegas)
    size = 1 + v / abs(omega0)
    np.testing.assert_allclose(centre_of_curvature(start, twist), printed, atol=1e-11 * size, rtol=0)
    assert radius_of_curvature(twist) == pytest.approx(2 * A * big1 / abs(total), abs=1e-11 * size)
    end = follow(start, twist, t)
    on_circle = math.hypot(end.x - printed[0], end.y - printed[1])
    assert on_circle == pytest.approx(2 * A * big1 / abs(total), abs=1e-10 * size)
    assert end.theta == pytest.approx(theta - omega0 * t, abs=1e-10)


def test_eq_6_the_heading_is_the_wheels_angles_added_whatever_the_order_they_turned_in() -> None:
    t = np.linspace(0, 2, 2001)
    psi = np.stack([np.sin(3 * t), t**2, np.cos(t) - 1], axis=1)
    twists, _ = OMNI.forward(np.gradient(psi, t, axis=0), np.zeros((2001, 0)), np.zeros((2001, 0)))
    turned = np.concatenate([[0.0], np.cumsum((twists[1:, 2] + twists[:-1, 2]) / 2 * np.diff(t))])
    np.testing.assert_allclose(turned, -R / (3 * A) * psi.sum(axis=1), atol=1e-6)
