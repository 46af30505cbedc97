"""The rigid motion that wheels make, in closed form and compiled, against numpy's own least squares."""

from __future__ import annotations

import numpy as np
import pytest

from drives.wheel import fixed_motion, rigid_motion, rolling_row

RNG = np.random.default_rng(4)
RADIUS = 0.07


def state(n: int, wheels: int, steered: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random rates (n, m), steering and steering rates (n, k)."""
    steering, swing = RNG.uniform(-4, 4, (n, steered)), RNG.normal(size=(n, steered))
    return RNG.normal(size=(n, wheels)), steering, swing


def equations(x, y, trail, rates, steering, swing) -> tuple[np.ndarray, np.ndarray]:
    """Rows (n, 2m, 3) and values (n, 2m): all rolling equations, then all sliding ones."""
    n, m = rates.shape
    heading, across = np.zeros((n, m)), np.zeros((n, m))
    lever = np.zeros((n, m, 3))
    k = steering.shape[1]
    heading[:, :k], across[:, :k], lever[:, :k, 2] = steering, trail * swing, trail
    left = rolling_row(x, y, heading + np.pi / 2) - lever
    return np.hstack([rolling_row(x, y, heading), left]), np.hstack([RADIUS * rates, across])


def expected(rows: np.ndarray, values: np.ndarray, rcond: float = 1e-7) -> tuple[np.ndarray, np.ndarray]:
    """What numpy makes of each, lengths in units of their root mean square."""
    twists = []
    for r, v in zip(rows, values, strict=True):
        unit = np.array([1.0, 1.0, np.sqrt(np.mean(r[:, 2] ** 2)) or 1.0])
        twists.append(np.linalg.lstsq(r / unit, v, rcond=rcond)[0] / unit)
    slip = np.abs(np.einsum("nek,nk->ne", rows, np.array(twists)) - values).max(axis=1)
    return np.array(twists), slip


@pytest.mark.parametrize(("wheels", "steered"), [(2, 2), (3, 1), (4, 2), (4, 4), (7, 7)])
@pytest.mark.parametrize("trail", [0.0, 0.04])
def test_the_twist_is_the_one_of_least_squares(wheels: int, steered: int, trail: float) -> None:
    x, y = RNG.normal(size=(2, wheels))
    rates, steering, swing = state(200, wheels, steered)
    twist, slip = rigid_motion(x, y, RADIUS, trail, rates, steering, swing)
    wanted, unmet = expected(*equations(x, y, trail, rates, steering, swing))
    np.testing.assert_allclose(twist, wanted, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(slip, unmet, atol=1e-12)


@pytest.mark.parametrize("scale", [1e-5, 1.0, 1e5])
def test_the_robots_size_does_not_matter(scale: float) -> None:
    x, y = scale * RNG.normal(size=(2, 4))
    rates, steering, swing = state(200, 4, 4)
    twist, slip = rigid_motion(x, y, RADIUS, 0.1 * scale, rates, steering, swing)
    wanted, unmet = expected(*equations(x, y, 0.1 * scale, rates, steering, swing))
    np.testing.assert_allclose(twist * (1, 1, scale), wanted * (1, 1, scale), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(slip / max(scale, 1), unmet / max(scale, 1), atol=1e-12)


@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-4, 1e-3, 1e-2])
def test_wheels_next_to_one_point_keep_their_accuracy(apart: float) -> None:
    """Two wheels at one point leave turning about it open; the nearer to it, the less omega is known."""
    x, y = np.array([0.3, 0.3 + apart]), np.array([0.2, 0.2])
    moving = RNG.normal(size=(100, 3))
    steering = np.arctan2(moving[:, 1:2] + moving[:, 2:] * x, moving[:, :1] - moving[:, 2:] * y)
    speed = np.hypot(moving[:, 1:2] + moving[:, 2:] * x, moving[:, :1] - moving[:, 2:] * y)
    twist, slip = rigid_motion(x, y, RADIUS, 0.0, speed / RADIUS, steering, 0 * steering)
    assert slip.max() < 1e-6
    if apart >= 1e-5:
        np.testing.assert_allclose(twist, moving, atol=1e-14 / apart)
    if apart == 0.0:
        wanted, _ = expected(*equations(x, y, 0.0, speed / RADIUS, steering, 0 * steering))
        np.testing.assert_allclose(twist, wanted, atol=1e-12)


def test_casters_whose_contacts_meet_get_the_shortest_twist() -> None:
    """Pointing at each other, their trails bring the contacts together."""
    x, y = np.array([0.55, 0.45]), np.array([0.2, 0.2])
    rates, _, swing = state(50, 2, 2)
    steering = np.tile([0.0, np.pi], (50, 1))
    twist, slip = rigid_motion(x, y, RADIUS, 0.05, rates, steering, swing)
    wanted, unmet = expected(*equations(x, y, 0.05, rates, steering, swing))
    np.testing.assert_allclose(twist, wanted, atol=1e-12)
    np.testing.assert_allclose(slip, unmet, atol=1e-12)


def test_one_wheel_at_the_origin_says_nothing_of_turning() -> None:
    origin, one = np.zeros(1), np.ones((1, 1))
    twist, slip = rigid_motion(origin, origin, 1.0, 0.0, one, one, one)
    np.testing.assert_allclose(twist, [[np.cos(1), np.sin(1), 0.0]], atol=1e-15)
    assert slip[0] < 1e-15


@pytest.mark.parametrize(("wheels", "more"), [(2, 1), (3, 0), (4, 0), (6, 1)])
def test_wheels_that_never_steer_make_the_twist_of_least_squares(wheels: int, more: int) -> None:
    rows, travel = RNG.normal(size=(wheels + more, 3)), RNG.uniform(0.05, 0.1, wheels)
    rates = RNG.normal(size=(200, wheels))
    twist, slip = fixed_motion(rows, np.linalg.pinv(rows), travel, rates)
    values = np.hstack([rates * travel, np.zeros((200, more))])
    wanted = np.linalg.lstsq(rows, values.T)[0].T
    np.testing.assert_allclose(twist, wanted, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(slip, np.abs(wanted @ rows.T - values).max(1), atol=1e-11)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_no_numbers_stay_so(value: float) -> None:
    x, y = np.array([0.3, -0.3]), np.array([0.2, -0.1])
    rates, steering, swing = state(3, 2, 2)
    rates[1, 0] = value
    rows = RNG.normal(size=(3, 3))
    made = (
        rigid_motion(x, y, RADIUS, 0.0, rates, steering, swing),
        fixed_motion(rows, np.linalg.pinv(rows), np.ones(2), rates),
    )
    for twist, slip in made:
        assert not np.isfinite(twist[1]).any()
        assert not np.isfinite(slip[1])
        assert np.isfinite(twist[[0, 2]]).all()
        assert np.isfinite(slip[[0, 2]]).all()
