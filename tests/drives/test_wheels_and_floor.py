"""Every drive against the floor under its wheels, by an oracle that knows only where each wheel stands.

A rigid body moves the point z (complex, body frame) with velocity v + i·omega·z. A wheel heading h rolls
along exp(ih) and slides along i·exp(ih). Nothing here is shared with drives/wheel.py.
"""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drives import (
    Ackermann,
    Differential,
    Mecanum,
    Module,
    Omni,
    PoweredCaster,
    SkidSteer,
    Swedish,
    SwedishWheel,
    Swerve,
    Tracked,
    Tricycle,
)
from drives.se2 import Twist

SPOTS = (0.3 + 0.2j, -0.3 + 0.2j, -0.3j)
MODULES = tuple(Module(f"m{i}", z.real, z.imag) for i, z in enumerate(SPOTS))
L, H = 0.8, 0.25
FRONTS, REARS = (L + H * 1j, L - H * 1j), (H * 1j, -H * 1j)
ROUND = tuple(0.2 * cmath.exp(1j * (0.3 + 2 * math.pi * i / 5)) for i in range(5))
CORNERS = (0.25 + 0.2j, 0.25 - 0.2j, -0.25 + 0.2j, -0.25 - 0.2j)
SWEDISH = tuple(
    SwedishWheel(f"s{i}", z.real, z.imag, heading, roller, radius)
    for i, (z, heading, roller, radius) in enumerate(
        [
            (0.3 + 0j, 1.5, 0.0, 0.05),
            (-0.2 + 0.2j, 0.1, 0.8, 0.06),
            (-0.2 - 0.2j, 0.0, -0.6, 0.07),
            (0.1j, 2, 0.3, 0.1),
        ]
    )
)
speed = st.floats(-3.0, 3.0)

# drive, wheel radius, places, fixed headings of the last wheels, roller angles or None
STEERED = {
    "tricycle": (Tricycle(0.1, L, 2 * H), (L + 0j, *REARS), 1, 0.0),
    "ackermann": (Ackermann(0.1, L, 2 * H), (*FRONTS, *REARS), 2, 0.0),
    "swerve": (Swerve(0.1, MODULES), SPOTS, 3, 0.0),
    "powered_caster": (PoweredCaster(0.1, 0.04, MODULES), SPOTS, 3, 0.04),
}
ROLLERS = {
    "omni": (
        Omni(0.1, 0.2, 5, 0.3),
        ROUND,
        [cmath.phase(z) - math.pi / 2 for z in ROUND],
        [0.0] * 5,
        [0.1] * 5,
    ),
    "mecanum": (
        Mecanum(0.1, 0.4, 0.5),
        CORNERS,
        [0.0] * 4,
        [-math.pi / 4, math.pi / 4, math.pi / 4, -math.pi / 4],
        [0.1] * 4,
    ),
    "swedish": (
        Swedish(SWEDISH),
        [complex(w.x, w.y) for w in SWEDISH],
        [w.heading for w in SWEDISH],
        [w.roller_angle for w in SWEDISH],
        [w.radius for w in SWEDISH],
    ),
}


def velocity(twist, z: complex) -> complex:
    return complex(twist[0], twist[1]) + 1j * twist[2] * z


def along(v: complex, direction: complex) -> float:
    return (v * direction.conjugate()).real


def steered_equations(name, steering, rates, steering_rates):
    """Rows on (vx, vy, omega) and values of all rolling and sliding equations, each in m/s."""
    _, spots, k, trail = STEERED[name]
    rows, values = [], []
    for i, z in enumerate(spots):
        heading = cmath.exp(1j * (steering[i] if i < k else 0.0))
        contact = z - trail * heading
        for direction, value in (
            (heading, 0.1 * rates[i]),
            (1j * heading, trail * steering_rates[i] if i < k else 0),
        ):
            rows.append([along(velocity(unit, contact), direction) for unit in np.eye(3)])
            values.append(value)
    return np.array(rows), np.array(values)


@pytest.mark.parametrize("name", sorted(STEERED))
@settings(max_examples=60, deadline=None)
@given(vx=speed, vy=speed, omega=speed, seed=st.integers(0, 99))
def test_steered_wheels_roll_along_their_heading_and_do_not_slide(name, vx, vy, omega, seed) -> None:
    drive, _, k, _ = STEERED[name]
    twist = Twist(vx, vy if name in ("swerve", "powered_caster") else 0.0, omega)
    state = drive.inverse(twist, np.random.default_rng(seed).uniform(-3, 3, k))
    rows, values = steered_equations(name, state.steering, state.rates, state.steering_rates)
    np.testing.assert_allclose(rows @ twist, values, atol=1e-12, rtol=0)


@pytest.mark.parametrize("name", sorted(STEERED))
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_forward_of_disagreeing_steered_wheels_is_least_squares(name, seed) -> None:
    drive, spots, k, _ = STEERED[name]
    rng = np.random.default_rng(seed)
    rates, steering, turning = rng.normal(size=len(spots)), rng.uniform(-3, 3, k), rng.normal(size=k)
    rows, values = steered_equations(name, steering, rates, turning)
    expected = np.linalg.lstsq(rows, values, rcond=None)[0]
    twist, slip = drive.forward(rates[None], steering[None], turning[None])
    np.testing.assert_allclose(twist[0], expected, atol=1e-11, rtol=0)
    assert slip[0] == pytest.approx(np.abs(rows @ expected - values).max(), abs=1e-12)


@pytest.mark.parametrize("name", sorted(ROLLERS))
@settings(max_examples=60, deadline=None)
@given(vx=speed, vy=speed, omega=speed)
def test_what_a_swedish_wheel_does_not_roll_its_rollers_take(name, vx, vy, omega) -> None:
    """contact velocity = r·rate along the heading + a roller's spin, across the roller's own axis."""
    drive, spots, headings, rollers, radii = ROLLERS[name]
    twist = Twist(vx, vy, omega)
    for z, h, g, r, rate in zip(spots, headings, rollers, radii, drive.inverse(twist).rates, strict=True):
        left_over = velocity(twist, z) - r * rate * cmath.exp(1j * h)
        assert along(left_over, cmath.exp(1j * (h + g))) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("name", sorted(ROLLERS))
@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_forward_of_disagreeing_swedish_wheels_is_least_squares(name, seed) -> None:
    drive, spots, headings, rollers, radii = ROLLERS[name]
    rates = np.random.default_rng(seed).normal(size=len(spots))
    # The contract writes a mecanum wheel's equation over cos γ; all four weigh the same, so only slip can
    # tell.
    over = [math.cos(g) if name == "mecanum" else 1.0 for g in rollers]
    rows = np.array(
        [
            [along(velocity(unit, z), cmath.exp(1j * (h + g))) / c for unit in np.eye(3)]
            for z, h, g, c in zip(spots, headings, rollers, over, strict=True)
        ]
    )
    values = rates * radii * np.cos(rollers) / over
    expected = np.linalg.lstsq(rows, values, rcond=None)[0]
    twist, slip = drive.forward(rates[None], np.zeros((1, 0)), np.zeros((1, 0)))
    np.testing.assert_allclose(twist[0], expected, atol=1e-12, rtol=0)
    assert slip[0] == pytest.approx(np.abs(rows @ expected - values).max(), abs=1e-12)


@given(left=speed, right=speed)
def test_two_wheels_of_a_differential_drive_always_agree(left, right) -> None:
    twist, slip = Differential(0.1, 0.5).forward(
        np.array([[left, right]]), np.zeros((1, 0)), np.zeros((1, 0))
    )
    assert slip[0] < 1e-14
    for rate, z in ((left, 0.25j), (right, -0.25j)):
        assert velocity(twist[0], z) == pytest.approx(0.1 * rate, abs=1e-14)


@given(omega=speed, offset=speed)
def test_turning_on_the_spot_drives_every_omni_wheel_backwards_alike(omega, offset) -> None:
    rates = Omni(0.1, 0.2, 5, offset).inverse(Twist(0.0, 0.0, omega)).rates
    np.testing.assert_allclose(rates, -0.2 * omega / 0.1, rtol=0, atol=1e-14)


@given(vx=speed, omega=speed, slip=st.floats(1.0, 3.0))
def test_wheels_that_skid_roll_like_a_differential_drive_of_the_effective_track(vx, omega, slip) -> None:
    left, right = Differential(0.1, 0.5 * slip).inverse(Twist(vx, 0.0, omega)).rates
    tracks = Tracked(0.1, 0.5, slip).inverse(Twist(vx, 0.0, omega)).rates
    four = SkidSteer(0.1, 0.5, 0.4, slip).inverse(Twist(vx, 0.0, omega)).rates
    np.testing.assert_allclose(tracks, (left, right), atol=1e-12)
    np.testing.assert_allclose(four, (left, right, left, right), atol=1e-12)


def test_skidding_wheels_of_a_side_that_disagree_slip_by_half_of_it() -> None:
    drive = SkidSteer(0.1, 0.5, 0.4, 1.6)
    twist, slip = drive.forward(np.array([[3.0, 2.0, 1.0, 2.0]]), np.zeros((1, 0)), np.zeros((1, 0)))
    np.testing.assert_allclose(twist, [[0.2, 0.0, 0.0]], atol=1e-15)
    assert slip[0] == pytest.approx(0.1, abs=1e-15)
