"""Chakarov, "Kinematics model of nonholonomic wheeled mobile robots for mobile manipulation tasks".

Its columns run right, left; ours left, right. b is half the track width.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drives import Differential
from drives.differential import no_sideways_motion

R, B = 0.1, 0.3
ROBOT = Differential(wheel_radius=R, track_width=2 * B)
SWAP = [1, 0]
rate = st.floats(-10.0, 10.0)
angle = st.floats(-7.0, 7.0)
fast = settings(max_examples=60, deadline=None)


@fast
@given(rate, rate)
def test_eq_3_4_the_centre_moves_at_the_mean_and_turns_by_the_difference(right, left) -> None:
    v_r, v_l = R * right, R * left  # eq. (1): no slip
    twist, _ = ROBOT.forward(np.array([[left, right]]), np.zeros((1, 0)), np.zeros((1, 0)))
    np.testing.assert_allclose(twist[0], ((v_r + v_l) / 2, 0.0, (v_r - v_l) / (2 * B)), atol=1e-13, rtol=0)


@fast
@given(rate, rate, angle)
def test_eq_5_8_9_direct_task(right, left, phi) -> None:
    c, s = R / 2 * math.cos(phi), R / 2 * math.sin(phi)
    printed = np.array([[c, c], [s, s], [R / (2 * B), -R / (2 * B)]])
    np.testing.assert_allclose(ROBOT.world_jacobian(phi)[:, SWAP], printed, atol=1e-15)
    np.testing.assert_allclose(
        ROBOT.world_jacobian(phi) @ (left, right), printed @ (right, left), atol=1e-13, rtol=0
    )


@fast
@given(angle)
def test_eq_10_15_the_reverse_task_is_the_pseudo_inverse(phi) -> None:
    c, s = math.cos(phi), math.sin(phi)
    printed = np.array([[c, s, B], [c, s, -B]]) / R
    np.testing.assert_allclose(ROBOT.world_inverse(phi)[SWAP], printed, atol=1e-13)
    np.testing.assert_allclose(
        ROBOT.world_inverse(phi), np.linalg.pinv(ROBOT.world_jacobian(phi)), atol=1e-12
    )


@fast
@given(rate, rate, angle)
def test_eq_12_13_each_wheel_rolls_at_its_own_share(right, left, phi) -> None:
    dx, dy, turn = ROBOT.world_jacobian(phi) @ (left, right)
    forward = dx * math.cos(phi) + dy * math.sin(phi)
    assert forward + B * turn == pytest.approx(R * right, abs=1e-13)
    assert forward - B * turn == pytest.approx(R * left, abs=1e-13)


@fast
@given(angle)
def test_eq_11_14_16_the_constraint_is_all_that_the_wheels_cannot_do(phi) -> None:
    constraint = no_sideways_motion(phi)
    np.testing.assert_allclose(constraint, [[-math.sin(phi), math.cos(phi), 0.0]], atol=0)
    np.testing.assert_allclose(constraint @ ROBOT.world_jacobian(phi), 0.0, atol=1e-16)
    assert np.linalg.matrix_rank(np.vstack([constraint, ROBOT.world_jacobian(phi).T])) == 3
