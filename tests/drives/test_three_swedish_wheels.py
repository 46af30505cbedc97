"""Report "Three wheels omnidirectional mobile robot kinematics", after Siegwart and Nourbakhsh (2004), sect.
3.2.

Its wheel stands at distance l and angle α from the origin, its plane at angle β from the spoke, its rollers
at γ: [sin(α+β+γ)  -cos(α+β+γ)  -l·cos(β+γ)]·ξ = r·φ̇·cos γ (eq. (3.19) there), ξ in the body frame. The
rolling direction is α + β - π/2 as a heading.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drives import Omni, Swedish, SwedishWheel
from drives.se2 import Twist

speed = st.floats(-3.0, 3.0)
angle = st.floats(-3.0, 3.0)
fast = settings(max_examples=60, deadline=None)
LEVER, R = 0.25, 0.06


def spoke_wheel(
    name: str, alpha: float, beta: float, gamma: float, lever: float, radius: float
) -> SwedishWheel:
    x, y = lever * math.cos(alpha), lever * math.sin(alpha)
    return SwedishWheel(name, x, y, alpha + beta - math.pi / 2, gamma, radius)


@fast
@given(speed, speed, speed, angle, angle, st.floats(-1.2, 1.2), st.floats(0.01, 2.0))
def test_rolling_constraint_along_the_rollers_free_direction(
    vx, vy, omega, alpha, beta, gamma, lever
) -> None:
    wheel = spoke_wheel("it", alpha, beta, gamma, lever, R)
    base = [spoke_wheel(f"w{i}", 2 * math.pi * i / 3, 0.0, 0.0, 1.0, R) for i in range(3)]
    rate = Swedish((*base, wheel)).inverse(Twist(vx, vy, omega)).rates[-1]
    row = (
        math.sin(alpha + beta + gamma),
        -math.cos(alpha + beta + gamma),
        -lever * math.cos(beta + gamma),
    )
    assert R * rate * math.cos(gamma) == pytest.approx(np.dot(row, (vx, vy, omega)), abs=1e-12)


@fast
@given(speed, speed, speed, angle)
def test_tangential_swedish_90_wheels_make_the_omni_drive(vx, vy, omega, offset) -> None:
    """β = γ = 0 and α in thirds of a turn: equation (*) of the report."""
    wheels = tuple(
        spoke_wheel(f"wheel_{i + 1}", offset + 2 * math.pi * i / 3, 0, 0, LEVER, R) for i in range(3)
    )
    twist = Twist(vx, vy, omega)
    omni = Omni(R, LEVER, 3, offset)
    np.testing.assert_allclose(Swedish(wheels).inverse(twist).rates, omni.inverse(twist).rates, atol=1e-11)


@fast
@given(st.tuples(speed, speed, speed))
def test_forward_is_the_inverse_of_the_rolling_matrix(rates) -> None:
    """ξ = J₁⁻¹·J₂·φ̇, equation (**), for wheels at 60°, 180° and -60°."""
    alphas = (math.pi / 3, math.pi, -math.pi / 3)
    j1 = np.array([[math.sin(a), -math.cos(a), -LEVER] for a in alphas])
    wheels = tuple(spoke_wheel(f"w{i}", a, 0.0, 0.0, LEVER, R) for i, a in enumerate(alphas))
    twist, slip = Swedish(wheels).forward(np.array([rates]), np.zeros((1, 0)), np.zeros((1, 0)))
    np.testing.assert_allclose(twist[0], np.linalg.solve(j1, R * np.array(rates)), atol=1e-12)
    assert slip[0] < 1e-13
