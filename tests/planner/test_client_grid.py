"""A motion on the client's grid keeps every limit at every instant, and goes where the given one goes."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from drives.drive import Limits
from drives.se2 import Array, Pose, Twist
from planner.client_grid import on_grid
from planner.path import LinePiece, TwistPiece
from planner.plan import plan
from planner.problem import Environment, Robot
from planner.schedule import WheelSchedule, schedule
from planner.time_law import time_path
from planner.trajectory import Steer
from tests.planner.plans import JOURNEYS, KINDS, Ask

PERIODS = (0.001, 0.007, 0.02, 0.1)


def cubics(time: Array, angle: Array, rate: Array) -> tuple[Array, Array]:
    """Rates at 21 points of every interval, and accelerations at its two ends, of the cubics that a client
    draws through samples (n, m): (n - 1, 21, m) and (n - 1, 2, m)."""
    h = np.diff(time)[:, None, None]
    u = np.linspace(0.0, 1.0, 21)[None, :, None]
    first, last, rise = rate[:-1, None], rate[1:, None], np.diff(angle, axis=0)[:, None] / h
    rates = first * (1 - 4 * u + 3 * u**2) + last * (3 * u**2 - 2 * u) + 6 * rise * u * (1 - u)
    ends = np.concatenate([6 * rise - 4 * first - 2 * last, 2 * first + 4 * last - 6 * rise], 1) / h
    return rates, ends


def keeps(made: WheelSchedule, limits: Limits, slack: float = 5e-4) -> bool:
    rates, accelerations = cubics(made.time, made.wheel_angle, made.wheel_velocity)
    steering, _ = cubics(made.time, made.steering_angle, made.steering_rate)
    shares = (
        np.abs(rates) / limits.wheel_speed,
        np.abs(accelerations) / limits.wheel_acceleration,
        np.abs(steering) / limits.steering_rate,
    )
    return all(share.max(initial=0.0) <= 1 + slack for share in shares)


@pytest.mark.parametrize("effort", ["first", "good"])
@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("kind", KINDS)
def test_limits_hold_between_the_samples(
    ask: Ask, clutter: Environment, kind: str, period: float, effort: str
) -> None:
    problem = ask(kind, *JOURNEYS["clutter"], clutter, sample_period=period, effort=effort)
    made = plan(problem)
    assert keeps(made.schedule, problem.robot.limits)
    assert made.planning["refused"] == 0


@pytest.mark.parametrize("period", [0.02, 0.1])
@pytest.mark.parametrize("kind", KINDS)
def test_limits_hold_between_the_samples_with_limited_jerk(
    ask: Ask, floor: Environment, kind: str, period: float
) -> None:
    problem = ask(
        kind, *JOURNEYS["floor"], floor, sample_period=period, effort="good", limits={"wheel_jerk": 150.0}
    )
    made = plan(problem).schedule
    assert keeps(made, problem.robot.limits)
    _, ends = cubics(made.time, made.wheel_angle, made.wheel_velocity)
    step = np.diff(made.time)[:, None]
    assert np.abs(np.diff(ends, axis=1)[:, 0] / step).max() <= 150.0 * 1.01
    # Accelerations do not jump at samples, nor at the ends.
    jumps = np.abs(np.diff(ends.reshape(-1, ends.shape[2]), axis=0)[1::2])
    assert jumps.max() < 0.03 * 150.0 * period
    assert np.abs(ends[[0, -1], [0, 1]]).max() < 0.03 * 150.0 * period


@pytest.mark.parametrize("kind", ["tricycle", "swerve", "omni"])
def test_every_stop_on_the_way_is_at_a_sample(robot: Callable[..., Robot], kind: str) -> None:
    period, example = 0.02, robot(kind)
    bend = TwistPiece(Pose(0.0, 0.0, 0.0), Twist(1.0, 0.0, 0.7))
    path = (bend, TwistPiece(bend.end, Twist(-0.8, 0.0, 0.5)))
    steering = np.full(len(example.drive.steered_names), 0.1)
    motion = time_path(path, example.drive, example.limits, steering)
    made = on_grid(motion, example.limits, period)
    assert [type(phase) for phase in made.phases] == [type(phase) for phase in motion.phases]
    for given, phase in zip(motion.phases[:-1], made.phases[:-1], strict=True):
        assert phase.duration / period == pytest.approx(round(phase.duration / period), abs=1e-9)
        assert given.duration <= phase.duration * (1 + 1e-9) < given.duration + 2.5 * period
    assert made.duration < motion.duration + 2.5 * period * len(made.phases)
    sampled = schedule(made, period)
    assert sampled.pose[-1] == pytest.approx(path[-1].end, abs=1e-9)
    for begin in np.cumsum([phase.duration for phase in made.phases[:-1]]):
        assert np.abs(sampled.wheel_velocity[round(begin / period)]).max() < 1e-9


def test_a_motion_shorter_than_a_sample_period_is_one_cubic(robot: Callable[..., Robot]) -> None:
    """s = 3u² − 2u³: of the cubics from rest to rest the only one. Its acceleration is 6 / T² at the ends."""
    example = robot("mecanum")
    motion = time_path((LinePiece(Pose(0, 0, 0), Pose(1e-3, 0, 0)),), example.drive, example.limits, None)
    made = on_grid(motion, example.limits, 0.1)
    assert made.duration < 0.1
    sampled = schedule(made, 0.1)
    assert len(sampled.time) == 2
    turned = 1e-3 / 0.08
    assert made.duration == pytest.approx(math.sqrt(6 * turned / 20.0), rel=1e-3)
    assert keeps(sampled, example.limits)


@pytest.mark.parametrize("period", [0.005, 0.02])
def test_wheel_rates_of_fixed_wheels_are_linear_between_samples(
    ask: Ask, clutter: Environment, period: float
) -> None:
    for kind in ("differential", "mecanum"):
        problem = ask(kind, *JOURNEYS["clutter"], clutter, sample_period=period, effort="good")
        made = plan(problem).schedule
        gained = np.diff(made.time)[:, None] * (made.wheel_velocity[1:] + made.wheel_velocity[:-1]) / 2
        assert np.abs(np.diff(made.wheel_angle, axis=0) - gained).max() < 1e-9


def test_steering_at_rest_begins_and_ends_at_rest(robot: Callable[..., Robot]) -> None:
    example = robot("tricycle")
    ahead = (TwistPiece(Pose(0, 0, 0), Twist(1, 0, 0)),)
    made = schedule(
        on_grid(time_path(ahead, example.drive, example.limits, np.array([0.6])), example.limits, 0.02), 0.02
    )
    rates, changes = cubics(made.time, made.steering_angle, made.steering_rate)
    assert made.steering_angle[0] == 0.6
    assert made.steering_rate[0] == 0.0
    assert np.abs(rates).max() == pytest.approx(3.0, rel=0.1)
    assert np.abs(rates).max() <= 3.0 * 1.0005
    # The rate is linear between samples, so it does not jump.
    assert np.abs(changes[:, 0] - changes[:, 1]).max() < 1e-6 * np.abs(changes).max()


def test_nothing_is_steered_if_the_wheels_stand_as_they_must() -> None:
    assert Steer.at_most(Pose(0, 0, 0), np.array([0.3]), np.array([0.3]), 3.0) is None
