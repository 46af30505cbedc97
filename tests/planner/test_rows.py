"""Limits as rows: what they say of a motion, against the limits themselves."""

from __future__ import annotations

import numpy as np
import pytest

from drives import Mecanum, Module, Swerve
from drives.drive import BodyPath, Drive, Limits
from planner import rows

RNG = np.random.default_rng(5)
LIMITS = Limits(
    np.array([4.0, 5.0, 6.0, 7.0]), np.array([9.0, 8.0, 7.0, 6.0]), np.full(4, np.inf),
    steering_rate=2.0, linear_speed=0.5, angular_speed=0.6, linear_acceleration=0.7, lateral_acceleration=0.3,
)  # fmt: skip
CORNERS = tuple(Module(f"{x}{y}", x, y) for x in (0.3, -0.3) for y in (0.2, -0.2))


@pytest.mark.parametrize("drive", [Mecanum(0.05, 0.3, 0.4), Swerve(0.05, CORNERS)], ids=lambda d: d.kind)
def test_rows_say_what_the_limits_say(drive: Drive) -> None:
    """Along a line in the world on which the body turns, for random ṡ and s̈ at every point."""
    s = np.linspace(0.0, 1.0, 200)
    heading = 2 * s
    c, d = np.cos(heading), np.sin(heading)
    tangent = np.stack([c + 0.3 * d, 0.3 * c - d, np.full_like(s, 2.0)], -1)
    path = BodyPath(s, heading, tangent, 2 * tangent[:, [1, 0, 2]] * (1, -1, 0))
    law = drive.actuators(path)
    a, b, x_max = rows.limit_rows(path, law, LIMITS)
    rate, change = RNG.uniform(0.0, 0.5, (200, 1)), RNG.normal(size=(200, 1))
    speed = np.hypot(1, 0.3) * rate
    used = np.column_stack([
        np.abs(law.wheel * rate) / LIMITS.wheel_speed, np.abs(law.steering_derivative * rate) / 2.0,
        speed / 0.5, 2 * rate / 0.6, np.sqrt(0.0 * speed / 0.3),
    ])  # fmt: skip
    np.testing.assert_allclose(np.sqrt(rate[:, 0] ** 2 / x_max), used.max(1), rtol=1e-9)
    wheels = (law.wheel * change + law.wheel_derivative * rate**2) / LIMITS.wheel_acceleration
    body = np.hypot(1, 0.3) * change / 0.7  # on a line in the world, at a steady pace per unit of s
    np.testing.assert_allclose(a * change + b * rate**2, np.hstack([wheels, body]), atol=1e-12)
    most = rows.most_used(a, b, x_max, rate[:, 0] ** 2, change[:, 0])
    assert most == pytest.approx(max(1.0, used.max() ** 2, np.abs(wheels).max(), np.abs(body).max()))


def test_where_the_bound_can_be_held_the_rows_allow_it_at_both_ends() -> None:
    n = 300
    a, b, x_max = RNG.normal(size=(n, 3)), RNG.normal(size=(n, 3)), RNG.uniform(0.1, 1.0, n)
    step = RNG.uniform(0.1, 5.0, n - 1)
    u, free = rows.holding(a, b, x_max, step)
    np.testing.assert_allclose(x_max[:-1] + step * u, x_max[1:])
    first = np.abs(a[:-1] * u[:, None] + b[:-1] * x_max[:-1, None]).max(1)
    then = np.abs(a[1:] * u[:, None] + b[1:] * x_max[1:, None]).max(1)
    np.testing.assert_array_equal(free, np.maximum(first, then) <= 1.0)
    assert 0 < free.sum() < n - 1
