"""What is measured of a plan beside its answer."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from api.planning import duration_ratio


def ratio(duration, angles, speed=10.0, acceleration=20.0):
    """Of a motion whose wheels stand at these angles, one row a sample."""
    angles = np.array(angles, dtype=float)
    limits = SimpleNamespace(
        wheel_speed=np.full(angles.shape[1], speed), wheel_acceleration=np.full(angles.shape[1], acceleration)
    )
    problem = SimpleNamespace(robot=SimpleNamespace(limits=limits))
    return duration_ratio(
        problem, SimpleNamespace(duration=duration, schedule=SimpleNamespace(wheel_angle=angles))
    )


@pytest.mark.parametrize(
    ("angles", "least"),
    [
        ([[0.0], [100.0]], 100 / 10 + 10 / 20),  # cruises
        ([[0.0], [1.0]], 2 * math.sqrt(1 / 20)),  # never reaches its speed
        ([[0.0], [5.0]], 1.0),  # just reaches it
        ([[0.0, 0.0], [40.0, -100.0]], 10.5),  # the busier wheel counts
        ([[0.0], [50.0], [0.0]], 10.5),  # there and back
    ],
)
def test_a_motion_at_its_wheels_limits_has_the_ratio_one_and_twice_as_long_two(angles, least):
    assert ratio(least, angles) == pytest.approx(1.0, rel=1e-12)
    assert ratio(2 * least, angles) == pytest.approx(2.0, rel=1e-12)


def test_no_motion_has_the_ratio_one():
    assert ratio(0.0, [[0.0, 0.0]]) == 1.0
