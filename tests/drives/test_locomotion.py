"""Lecture "Mobile robot locomotion and kinematics principles", formula by formula.

l is the track width, d the wheelbase; its wheels 0…3 of a mecanum base are front-left, rear-left, rear-right,
front-right.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drives import Ackermann, Differential, Mecanum, Synchro, Tricycle
from drives.arc import centre_of_curvature, follow, radius_of_curvature
from drives.se2 import Pose, Twist

TRACK = 0.5
speed = st.floats(-2.0, 2.0)
angle = st.floats(-7.0, 7.0)
fast = settings(max_examples=60, deadline=None)
NONE = np.zeros((1, 0))


def differential(v_l: float, v_r: float) -> Twist:
    twist, _ = Differential(0.1, TRACK).forward(np.array([[v_l, v_r]]) / 0.1, NONE, NONE)
    return Twist(*twist[0])


@fast
@given(speed, speed, angle)
def test_differential_centre_and_radius_of_curvature_corrected(v_l, v_r, theta) -> None:
    """R = l(v_l + v_r)/2(v_r - v_l), printed with v_l - v_r: then v_l = ω(R - l/2) and v_r = ω(R + l/2)
    hold."""
    if abs(v_r - v_l) < 1e-3:
        return
    twist = differential(v_l, v_r)
    omega = (v_r - v_l) / TRACK
    radius = TRACK * (v_l + v_r) / (2 * (v_r - v_l))
    assert twist.omega == pytest.approx(omega, abs=1e-12)
    assert radius_of_curvature(twist) == pytest.approx(abs(radius), abs=1e-9)
    centre = centre_of_curvature(Pose(1.0, 2.0, theta), twist)
    printed = (1.0 - radius * math.sin(theta), 2.0 + radius * math.cos(theta))
    np.testing.assert_allclose(centre, printed, atol=1e-9)
    assert omega * (radius - TRACK / 2) == pytest.approx(v_l, abs=1e-12)
    assert omega * (radius + TRACK / 2) == pytest.approx(v_r, abs=1e-12)


@pytest.mark.parametrize("v", [0.5, -2.0, 0.0])
def test_equal_wheels_have_no_centre(v) -> None:
    for twist in (differential(v, v), Twist(v, 0.0, 0.0)):
        assert centre_of_curvature(Pose(1.0, 2.0, 0.3), twist) is None
        assert radius_of_curvature(twist) == math.inf


def test_turning_on_the_spot_has_its_centre_in_the_body_origin() -> None:
    assert radius_of_curvature(Twist(0.0, 0.0, 1.0)) == 0.0
    assert centre_of_curvature(Pose(1.0, 2.0, 0.3), Twist(0.0, 0.0, 1.0)) == (1.0, 2.0)


@fast
@given(speed, speed, angle, st.floats(0.0, 5.0))
def test_generalized_equation_corrected_gives_the_pose_after_turning_about_the_centre(
    v_l, v_r, theta, t
) -> None:
    """Its left side is the new pose, though printed as a velocity."""
    twist, start = differential(v_l, v_r), Pose(1.0, 2.0, theta)
    if abs(twist.omega) < 1e-2:
        return
    cx, cy = centre_of_curvature(start, twist)
    turn = twist.omega * t
    c, s = math.cos(turn), math.sin(turn)
    dx, dy = start.x - cx, start.y - cy
    printed = (c * dx - s * dy + cx, s * dx + c * dy + cy, theta + turn)
    np.testing.assert_allclose(follow(start, twist, t), printed, atol=1e-9)


@fast
@given(speed, speed, angle)
def test_integrals_of_the_wheel_speeds_give_the_pose(v_l, v_r, theta) -> None:
    """x = ½∫(v_r + v_l)cos θ, y likewise, θ = (1/l)∫(v_r - v_l), by Gauss-Legendre quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    t, w = 0.5 * (nodes + 1), 0.5 * weights
    at = theta + (v_r - v_l) / TRACK * t
    v = (v_r + v_l) / 2
    expected = (w @ np.cos(at) * v, w @ np.sin(at) * v, theta + (v_r - v_l) / TRACK)
    np.testing.assert_allclose(follow(Pose(0, 0, theta), differential(v_l, v_r), 1.0), expected, atol=1e-11)


@fast
@given(speed.filter(lambda v: abs(v) > 1e-2), st.floats(-1.2, 1.2))
def test_tricycle_radius_is_wheelbase_over_tangent_of_steering(v, steering) -> None:
    if abs(steering) < 1e-2:
        return
    radius = 0.8 / math.tan(steering)
    state = Tricycle(0.1, 0.8, TRACK).inverse(Twist(v, 0.0, v / radius))
    assert state.steering[0] == pytest.approx(steering, abs=1e-12)
    assert state.rates[0] == pytest.approx(v / math.cos(steering) / 0.1, abs=1e-9)
    omega = v / radius
    np.testing.assert_allclose(
        state.rates[1:] * 0.1, (omega * (radius - TRACK / 2), omega * (radius + TRACK / 2)), atol=1e-12
    )


@fast
@given(st.floats(0.5, 50.0), st.sampled_from([-1.0, 1.0]), st.sampled_from([-1.0, 1.0]))
def test_ackermann_wheels_point_about_one_centre(radius, turn, sense) -> None:
    """cot δ_outer - cot δ_inner = track/wheelbase, and every wheel's axle passes through the centre."""
    state = Ackermann(0.1, 0.8, TRACK).inverse(Twist(sense * turn * radius, 0.0, sense))
    left, right = state.steering
    inner, outer = (left, right) if turn > 0 else (-right, -left)
    assert inner > outer > 0
    assert 1 / math.tan(outer) - 1 / math.tan(inner) == pytest.approx(TRACK / 0.8, abs=1e-9)
    for delta, y in ((left, TRACK / 2), (right, -TRACK / 2)):
        to_centre = (0.0 - 0.8, turn * radius - y)
        assert to_centre[0] * math.cos(delta) + to_centre[1] * math.sin(delta) == pytest.approx(0, abs=1e-9)
    from_centre = [math.hypot(0.8, turn * radius - y) for y in (TRACK / 2, -TRACK / 2)]
    np.testing.assert_allclose(np.abs(state.rates[:2]) * 0.1, from_centre, rtol=1e-12)


@fast
@given(speed, speed, st.floats(-3, 3))
def test_synchronous_drive_moves_along_its_wheels_and_turns_them_alone(v, omega, start) -> None:
    synchro = Synchro(0.1, 4)
    state = synchro.inverse(Twist(v, 0.0, omega), np.full(4, start))
    np.testing.assert_allclose(state.rates, v / 0.1)
    assert (state.steering_rates == omega).all()
    assert (state.steering == start).all()
    twist, slip = synchro.forward(state.rates[None], state.steering[None], state.steering_rates[None])
    np.testing.assert_allclose(twist[0], (v, 0.0, omega), atol=1e-14)
    assert slip[0] < 1e-14


def test_synchronous_wheels_that_disagree_slip_by_the_largest_distance_from_their_mean() -> None:
    rates, turning = np.array([[1.0, 2.0, 6.0]]), np.array([[0.1, 0.1, 0.4]])
    twist, slip = Synchro(0.1).forward(rates, np.zeros((1, 3)), turning)
    np.testing.assert_allclose(twist, [[0.3, 0.0, 0.2]], atol=1e-15)
    assert slip[0] == pytest.approx(0.3)
    assert Synchro(0.1).forward(rates * 0 + 1, np.zeros((1, 3)), turning)[1][0] == pytest.approx(0.2)


@fast
@given(st.tuples(speed, speed, speed, speed))
def test_mecanum_means_and_error_term(v) -> None:
    """v_y forward, v_x to the right, v_θ clockwise at the lever k = (track + wheelbase)/2, and v_error = our
    slip."""
    v0, v1, v2, v3 = v
    mecanum = Mecanum(0.08, 0.4, 0.6)
    rates = np.array([[v0, v3, v1, v2]]) / 0.08  # front-left, front-right, rear-left, rear-right
    (vx, vy, omega), slip = (a[0] for a in mecanum.forward(rates, NONE, NONE))
    assert vx == pytest.approx((v0 + v1 + v2 + v3) / 4, abs=1e-13)
    assert -vy == pytest.approx((v0 - v1 + v2 - v3) / 4, abs=1e-13)
    assert -0.5 * omega == pytest.approx((v0 + v1 - v2 - v3) / 4, abs=1e-13)
    assert slip == pytest.approx(abs(v0 - v1 - v2 + v3) / 4, abs=1e-13)


@fast
@given(speed, speed, speed)
def test_mecanum_rates_are_the_contracts(vx, vy, omega) -> None:
    k = (0.4 + 0.6) / 2
    expected = [vx - vy - k * omega, vx + vy + k * omega, vx + vy - k * omega, vx - vy + k * omega]
    rates = Mecanum(0.08, 0.4, 0.6).inverse(Twist(vx, vy, omega)).rates
    np.testing.assert_allclose(rates * 0.08, expected, atol=1e-14)
