"""Least-squares twists: the compiled normal equations against numpy's own solver."""

from __future__ import annotations

import numpy as np
import pytest

from drives.wheel import rolling_row, solve_twist, wheel_rows

RNG = np.random.default_rng(4)


def steered(n: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Rows (n, 2m, 3) of m wheels at any angles."""
    return wheel_rows(x, y, RNG.uniform(-4, 4, (n, len(x))))


def test_rows_of_all_wheels_are_those_of_each() -> None:
    x, y = RNG.normal(size=(2, 4))
    angle = RNG.uniform(-4, 4, (20, 4))
    rows = wheel_rows(x, y, angle, 0.03)
    np.testing.assert_array_equal(rows[:, :4], rolling_row(x, y, angle))
    left = rolling_row(x, y, angle + np.pi / 2) - [0.0, 0.0, 0.03]
    np.testing.assert_allclose(rows[:, 4:], left, atol=1e-14)


def expected(rows: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What numpy makes of each, in the same units of length."""
    unit = np.array([1.0, 1.0, np.sqrt(np.mean(rows[..., 2] ** 2)) or 1.0])
    twists = [np.linalg.lstsq(r / unit, v, rcond=1e-7)[0] / unit for r, v in zip(rows, values, strict=True)]
    slip = np.abs(np.einsum("nek,nk->ne", rows, np.array(twists)) - values).max(axis=1)
    return np.array(twists), slip


@pytest.mark.parametrize("equations", [3, 4, 8, 11])
def test_random_rows_are_solved_as_numpy_solves_them(equations) -> None:
    rows = RNG.normal(size=(300, equations, 3)) * (1.0, 1.0, 0.3)
    # Of three random rows some are nearly dependent: compare in the measure in which the answer is known.
    rows = rows[np.linalg.cond(rows) < 1e3]
    values = RNG.normal(size=rows.shape[:2])
    twist, slip = solve_twist(rows, values)
    wanted, unmet = expected(rows, values)
    np.testing.assert_allclose(twist, wanted, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(slip, unmet, atol=1e-10)


@pytest.mark.parametrize("scale", [1e-5, 1.0, 1e5])
def test_the_robots_size_does_not_matter(scale) -> None:
    x, y = scale * RNG.normal(size=(2, 4))
    rows, values = steered(200, x, y), RNG.normal(size=(200, 8))
    twist, slip = solve_twist(rows, values)
    wanted, unmet = expected(rows, values)
    np.testing.assert_allclose(twist * (1, 1, scale), wanted * (1, 1, scale), rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(slip, unmet, atol=1e-12)


@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-9, 1e-7, 1e-5, 1e-4, 1e-3, 1e-2])
def test_rows_next_to_singular_keep_their_accuracy(apart) -> None:
    """Two wheels at one point leave turning about it open; the nearer to it, the less omega is known."""
    x, y = np.array([0.3, 0.3 + apart]), np.array([0.2, 0.2])
    rows = steered(100, x, y)
    values = np.einsum("nek,nk->ne", rows, RNG.normal(size=(100, 3)))
    twist, slip = solve_twist(rows, values)
    assert slip.max() < 1e-13 / max(apart, 1e-7)
    if apart >= 1e-5 or apart == 0.0:
        wanted, _ = expected(rows, values)
        np.testing.assert_allclose(twist, wanted, atol=1e-14 / max(apart, 1e-14) ** 2 if apart else 1e-12)


def test_open_directions_get_the_shortest_twist_beside_rows_that_leave_none_open() -> None:
    whole = steered(50, np.array([0.3, -0.3, 0.1]), np.array([0.2, -0.1, 0.4]))
    rows = whole.copy()
    rows[10:20, :, 0] = 0.0  # nothing tells vx
    rows[20:30] = rows[20:30, :1]  # one equation, over and over
    rows[30:40] = 0.0
    values = RNG.normal(size=rows.shape[:2])
    twist, slip = solve_twist(rows, values)
    wanted, unmet = expected(rows, values)
    np.testing.assert_allclose(twist, wanted, atol=1e-12)
    np.testing.assert_allclose(slip, unmet, atol=1e-12)
    assert (twist[10:20, 0] == 0).all()
    assert (twist[30:40] == 0).all()


def test_values_that_are_no_numbers_stay_so() -> None:
    rows = steered(3, np.array([0.3, -0.3]), np.array([0.2, -0.1]))
    values = np.zeros((3, 4))
    values[1, 2] = np.nan
    twist, slip = solve_twist(rows, values)
    assert np.isnan(twist[1]).all()
    assert np.isnan(slip[1])
    assert not np.isnan(twist[[0, 2]]).any()
