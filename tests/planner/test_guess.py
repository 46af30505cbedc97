"""A guess's knots are where casters need them, and its casters stand where their law says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.duration.robots import ROBOTS
from drives import PoweredCaster
from drives.se2 import Array, Pose
from drives.wheel import Module
from planner.guess import Guess, flowing, ramp_time, swings
from planner.path import LinePiece

MODULES = (Module("left", 0.1, 0.2), Module("right", -0.3, -0.1))
OFFSET = 0.05
AHEAD = (LinePiece(Pose(0, 0, 0), Pose(6.0, 0, 0)),)


def led(speed: float, time: Array) -> Guess:
    """Straight ahead at a constant speed."""
    way = speed * time
    still = np.zeros_like(way)
    twist = np.column_stack([np.full_like(way, speed), still, still])
    return Guess(time, np.column_stack([way, still, still]), twist)


@pytest.mark.parametrize("begin", [1.5, -0.4, 3.0, -6.0])
def test_casters_led_straight_ahead_swing_along_a_tractrix(begin: float) -> None:
    time = np.array([0.0, 0.1, 0.25, 0.3, 0.7])
    angles, swung = swings(led(0.4, time), PoweredCaster(0.05, OFFSET, MODULES), np.array([begin, begin]))

    def tractrix(time: Array) -> Array:
        # tan(β/2) decays as exp(-way / offset), over whatever turns β begins with.
        turns = math.tau * round(begin / math.tau)
        half = math.tan((begin - turns) / 2) * np.exp(-0.4 * time / OFFSET)
        every: Array = turns + 2 * np.arctan(half)
        return every

    expected = tractrix(time)
    third = tractrix(time[:-1] + np.diff(time) / 3)
    np.testing.assert_allclose(angles, np.stack([expected] * 2, 1), atol=1e-7)
    np.testing.assert_allclose(swung[:, :2], np.stack([third - expected[:-1]] * 2, 1), atol=1e-7)
    np.testing.assert_allclose(swung[:, 2:], np.stack([np.diff(expected)] * 2, 1), atol=1e-7)


def test_without_casters_nothing_swings() -> None:
    angles, swung = swings(led(0.4, np.linspace(0.0, 1.0, 6)), ROBOTS["swerve"].drive, np.zeros(0))
    assert angles.shape == (6, 0)
    assert swung.shape == (5, 0)


def test_knots_are_close_together_only_where_casters_swing_round() -> None:
    robot = ROBOTS["powered_caster"]
    step = np.diff(flowing(AHEAD, robot.drive, robot.limits, "twist", 24).time)
    ramp = ramp_time(robot.limits)
    assert step[0] < 0.05 * ramp
    assert (np.diff(step[:14]) > 0).all()
    assert np.ptp(step[14:-3]) < 1e-12
    plain = ROBOTS["swerve"]
    assert np.ptp(np.diff(flowing(AHEAD, plain.drive, plain.limits, "twist", 24).time)) < 1e-12


def test_a_guess_led_over_begins_with_the_twist_given_and_soon_is_what_it_was() -> None:
    guess = led(0.4, np.linspace(0.0, 2.0, 21))
    twist = np.array([0.1, -0.3, 0.2])
    other = guess.led(twist, 0.5)
    np.testing.assert_allclose(other.coordinates[0], twist)
    np.testing.assert_array_equal(other.coordinates[guess.time >= 0.5], guess.coordinates[guess.time >= 0.5])
    np.testing.assert_array_equal(other.pose, guess.pose)


def test_part_of_a_guess_keeps_its_knots_where_it_has_as_many() -> None:
    time = np.array([0.0, 0.1, 0.3, 0.6, 1.0, 1.5])
    np.testing.assert_allclose(led(0.4, time).part(1, 4, 3).time, time[1:5] - 0.1)
    np.testing.assert_allclose(led(0.4, time).part(1, 4, 6).time, [0.0, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9])


def test_on_a_short_way_a_guess_brakes_before_full_speed_and_its_poses_go_where_its_speeds_do() -> None:
    plain = ROBOTS["mecanum"]
    way = (LinePiece(Pose(0, 0, 0), Pose(0.05, 0, 0)),)
    guess = flowing(way, plain.drive, plain.limits, "twist", 64)
    assert guess.time[-1] < 0.8 * ramp_time(plain.limits)
    speed = guess.coordinates[:, 0]
    driven = np.append(0.0, np.cumsum(np.diff(guess.time) * (speed[1:] + speed[:-1]) / 2))
    np.testing.assert_allclose(guess.pose[:, 0], driven, atol=2e-4)
