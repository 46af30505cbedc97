"""Grids, polynomials and points between them, compiled, against numpy's own and against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from planner import sampling

RNG = np.random.default_rng(7)


def test_a_union_has_every_point_once_and_tells_where_each_is() -> None:
    grid = np.sort(RNG.uniform(0, 1, 40))
    at = np.sort(np.concatenate([RNG.uniform(0, 1, 60), grid[::7], grid[3:5] + 1e-14, [at_end := grid[-1]]]))
    every, here = sampling.union(grid, at)
    assert (np.diff(every) > 1e-13).all()
    np.testing.assert_allclose(every[here], at, atol=2e-14)
    assert len(every) == 100
    assert every[-1] == max(at_end, at[-1])


def test_a_union_bears_points_that_rounding_has_put_out_of_order() -> None:
    every, here = sampling.union(np.array([0.0, 0.5, 1.0]), np.array([0.25, 0.25 - 1e-17, 0.25, 1.0]))
    np.testing.assert_array_equal(every, [0.0, 0.25, 0.5, 1.0])
    np.testing.assert_array_equal(here, [1, 1, 1, 3])


@pytest.mark.parametrize("ordered", [True, False])
def test_a_profile_is_its_segments_polynomials(ordered: bool) -> None:
    time = np.concatenate([[0.0], np.cumsum(RNG.uniform(0.1, 1, 5))])
    columns = RNG.normal(size=(4, 5))
    t = RNG.uniform(0, time[-1], 50)
    t = np.concatenate([np.sort(t) if ordered else t, [time[-1]]])
    found = sampling.polynomials(time, *columns, t)
    for k, moment in enumerate(t):
        i = min(np.searchsorted(time, moment, side="right") - 1, 4)
        position, velocity, acceleration, jerk = columns[:, i]
        law = Polynomial([position, velocity, acceleration / 2, jerk / 6])
        wanted = [law.deriv(order)(moment - time[i]) for order in (0, 1, 2)]
        np.testing.assert_allclose([column[k] for column in found], wanted, atol=1e-13)


def test_a_grid_is_cut_where_steering_or_wheels_change_much_and_only_there() -> None:
    grid = np.array([0.0, 1.0, 2.0, 3.0])
    steering, wheel = np.array([[0.0], [0.0], [0.1], [0.1]]), np.array([[1.0], [1.0], [1.0], [1.05]])
    found = sampling.refined(grid, steering, wheel)
    np.testing.assert_allclose(found, [0, 1, 1.25, 1.5, 1.75, 2, 2.5, 3])
    np.testing.assert_array_equal(sampling.refined(grid, 0.3 * steering, 0 * wheel), grid)


def test_points_between_those_of_a_profile_are_on_it() -> None:
    time, velocity = np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.4])
    position, acceleration = np.array([0.0, 0.2]), np.array([0.4, 0.0])
    s, x, change = sampling.between(time, position, velocity, acceleration)
    assert (np.diff(s) > 0).all()
    assert s[0] == 0.0
    assert s[-1] == pytest.approx(1.0)
    for at, square, gain in zip(s, x, change, strict=True):
        assert square == pytest.approx(0.8 * at if gain else 0.16)
