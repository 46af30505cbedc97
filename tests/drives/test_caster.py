"""Powered casters swing as their contacts are dragged: closed forms, and an integrator that is not ours."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from drives import Module, PoweredCaster
from drives.drive import BodyPath
from drives.se2 import Twist

B = 0.04
CASTER = PoweredCaster(0.05, B, (Module("a", 0.3, 0.2), Module("b", -0.3, -0.2), Module("c", 0.0, 0.0)))
ANGLE = st.floats(-3.0, 3.0)


def constant(twist, length: float, n: int) -> BodyPath:
    s = np.linspace(0.0, length, n)
    return BodyPath(s, twist[2] * s, np.tile(np.array(twist, dtype=float), (n, 1)), np.zeros((n, 3)))


@settings(max_examples=60, deadline=None)
@given(start=ANGLE)
def test_on_a_straight_line_a_caster_draws_a_tractrix(start) -> None:
    """β′ = -sin β / b, hence tan(β/2) = tan(β0/2)·exp(-s/b)."""
    path = constant((1.0, 0.0, 0.0), 0.4, 17)
    law = CASTER.actuators(path, np.full(3, start))
    exact = 2 * np.arctan(np.tan(start / 2) * np.exp(-path.s / B))
    np.testing.assert_allclose(law.steering, np.tile(exact[:, None], 3), atol=1e-12)


def test_turning_on_the_spot_about_its_own_axis_a_caster_does_not_move_on_the_floor() -> None:
    law = CASTER.actuators(constant((0.0, 0.0, 1.0), 20.0, 400), np.array([0.0, 0.0, 0.5]))
    np.testing.assert_allclose(law.steering[:, 2], 0.5 - np.linspace(0, 20, 400), atol=1e-11)
    np.testing.assert_allclose(law.wheel[:, 2], 0.0, atol=1e-15)


def test_on_a_circle_a_caster_settles_where_its_contact_trails_its_axis() -> None:
    """In steady state the contact moves along the wheel: sin β = b·omega / |p| past the direction of p."""
    law = CASTER.actuators(constant((1.0, 0.0, 0.5), 3.0, 301))
    for j, m in enumerate(CASTER.modules):
        p = np.array([1.0 - 0.5 * m.y, 0.5 * m.x])
        steady = np.arctan2(p[1], p[0]) - np.arcsin(B * 0.5 / np.hypot(*p))
        assert law.steering[-1, j] == pytest.approx(steady, abs=1e-12)


def test_a_caster_that_is_pushed_swings_round_to_trail() -> None:
    law = CASTER.actuators(constant((-1.0, 0.0, 0.0), 2.0, 201), np.array([0.1, -0.1, 3.0]))
    np.testing.assert_allclose(law.steering[-1], [np.pi, -np.pi, np.pi], atol=1e-9)
    np.testing.assert_allclose(law.wheel[-1], 20.0, rtol=1e-9)


@pytest.mark.parametrize("n", [250, 1000, 2000])
def test_swinging_agrees_with_a_high_order_integrator_to_1e_minus_8(n) -> None:
    s = np.linspace(0, 10, n)  # 250 samples space a path of 10 m by the offset itself
    one = np.ones_like(s)

    def tangent(t):
        return 1 + 0.3 * np.sin(t), 0.5 * np.cos(1.3 * t), 0.8 * np.sin(0.7 * t)

    slopes = np.stack([0.3 * np.cos(s), -0.65 * np.sin(1.3 * s), 0.56 * np.cos(0.7 * s)], axis=1)
    path = BodyPath(s, 0 * s, np.stack([one * c for c in tangent(s)], axis=1), slopes)
    start = np.array([0.3, -2.0, 3.0])
    law = CASTER.actuators(path, start)

    def swing(t, beta):
        vx, vy, omega = tangent(t)
        px = vx - omega * np.array([m.y for m in CASTER.modules])
        py = vy + omega * np.array([m.x for m in CASTER.modules])
        return (py * np.cos(beta) - px * np.sin(beta)) / B - omega

    exact = solve_ivp(swing, (0, 10), start, method="DOP853", rtol=1e-12, atol=1e-13, t_eval=s).y.T
    np.testing.assert_allclose(law.steering, exact, atol=1e-8, rtol=0)


@settings(max_examples=40, deadline=None)
@given(vx=st.floats(-1, 1), vy=st.floats(-1, 1), omega=st.floats(-1, 1), start=ANGLE)
def test_at_a_constant_twist_the_grid_does_not_matter(vx, vy, omega, start) -> None:
    coarse = CASTER.actuators(constant((vx, vy, omega), 0.2, 5), np.full(3, start))
    fine = CASTER.actuators(constant((vx, vy, omega), 0.2, 401), np.full(3, start))
    np.testing.assert_allclose(coarse.steering, fine.steering[::100], atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(vx=st.floats(-1, 1), vy=st.floats(-1, 1), omega=st.floats(-1, 1), start=ANGLE)
def test_driving_back_the_way_it_came_a_caster_swings_back(vx, vy, omega, start) -> None:
    there = CASTER.actuators(constant((vx, vy, omega), 0.2, 21), np.full(3, start))
    back = CASTER.actuators(constant((-vx, -vy, -omega), 0.2, 21), there.steering[-1])
    np.testing.assert_allclose(back.steering[::-1], there.steering, atol=1e-8)


def test_a_caster_stands_at_zero_unless_told_otherwise() -> None:
    assert (CASTER.inverse(Twist(1.0, 2.0, 3.0)).steering == 0).all()
    assert (CASTER.actuators(constant((1.0, 0.2, 0.0), 1.0, 11)).steering[0] == 0).all()


def test_where_all_contacts_meet_the_twist_is_the_least_that_fits() -> None:
    """Two modules 2b apart that trail towards each other touch the floor in one point: omega is then open."""
    pair = PoweredCaster(0.05, B, (Module("a", B, 0.0), Module("b", -B, 0.0)))
    twist, slip = pair.forward(np.zeros((1, 2)), np.array([[0.0, np.pi]]), np.zeros((1, 2)))
    np.testing.assert_allclose(twist, 0.0, atol=1e-12)
    assert slip[0] < 1e-12


def test_once_it_has_swung_round_a_caster_on_a_straight_rolls_like_the_swerve_it_settles_to() -> None:
    path = constant((0.8, 0.6, 0.0), 3.0, 301)
    trailing, settled = CASTER.actuators(path), CASTER.settled.actuators(path)
    np.testing.assert_allclose(trailing.wheel[-1], settled.wheel[-1], rtol=1e-12)
    np.testing.assert_allclose(trailing.steering[-1], settled.steering[-1], atol=1e-12)
