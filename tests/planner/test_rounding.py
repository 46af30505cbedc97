"""Steering rounded off: the wheels of the schedule end where the motion was to end."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.duration.queries import query
from benchmarks.duration.robots import ROBOTS
from drives.drive import Car
from drives.se2 import Pose
from planner.plan import plan
from planner.problem import Bounds, Environment, Goal, Options, Problem
from planner.rolling import roll
from planner.rounding import rounded, rounded_phase
from planner.schedule import sample_times, schedule
from planner.trajectory import Flowing, Phases

PERIOD = 0.02


def zigzag(kind: str, seed: int, last: float) -> tuple[Problem, Flowing]:
    """A car that steers to and fro, now and then as far as it can, and drives back in between."""
    robot = ROBOTS[kind]
    random = np.random.default_rng(seed)
    n = 41
    time = 0.37 * np.arange(n + 1) + last * (np.arange(n + 1) == n)
    v = 0.8 * np.interp(np.arange(n + 1), [0, 4, 14, 18, 24, 28, 37, n], [0, 1, 1, -1, -1, 1, 1, 0])
    mobility, limits = robot.drive.mobility(robot.limits), robot.limits
    assert isinstance(mobility, Car)
    bend, steps = [0.0], random.choice([-0.37, 0.37], n) * limits.steering_rate
    for step in steps:
        bend.append(float(np.clip(bend[-1] + step, -limits.steering_angle, limits.steering_angle)))
    k = np.tan(bend) / math.tan(limits.steering_angle) / mobility.min_turning_radius
    knots = np.stack([v, k], 1)
    rates = np.diff(knots, axis=0) / np.diff(time)[:, None]
    coefficients = np.stack([knots[:-1], rates, np.zeros_like(rates)], 1)
    motion = Flowing(Pose(1.0, 2.0, 0.3), time, coefficients, True, None, limits.steering_angle)
    goal = Goal(*motion.poses(time)[-1].tolist())
    return Problem(robot, motion.start, goal, Environment(Bounds(-50, -50, 50, 50))), motion


@pytest.mark.parametrize("kind", ["ackermann", "tricycle"])
@pytest.mark.parametrize(("seed", "last"), [(0, 0.0), (1, 0.013), (2, 1e-7), (3, 0.0199999)])
def test_rolling_ends_where_the_motion_was_to_end_and_stays_with_it(
    kind: str, seed: int, last: float
) -> None:
    problem, motion = zigzag(kind, seed, last)
    samples = sample_times(motion.duration, PERIOD)
    drive, goal = problem.robot.drive, motion.poses(motion.time)[-1]
    made = schedule(Phases(drive, (rounded_phase(motion, samples),)), PERIOD)
    rolled = roll(problem, made).pose
    as_it_was = roll(problem, schedule(Phases(drive, (motion,)), PERIOD)).pose
    assert np.abs(as_it_was[-1] - goal).max() > 5e-5
    assert np.abs(rolled[-1] - goal).max() < 1e-5
    assert np.abs(rolled - made.pose).max() < 1e-5


@pytest.mark.parametrize("kind", ["ackermann", "tricycle"])
def test_samples_are_those_of_the_motion_but_for_a_thousandth(kind: str) -> None:
    problem, motion = zigzag(kind, 4, 0.0)
    drive, limits = problem.robot.drive, problem.robot.limits
    rounded_off = rounded_phase(motion, sample_times(motion.duration, PERIOD))
    before, after = (schedule(Phases(drive, (m,)), PERIOD) for m in (motion, rounded_off))
    assert np.abs(after.steering_angle - before.steering_angle).max() < 1e-3 * limits.steering_angle
    assert np.abs(after.steering_angle).max() <= limits.steering_angle * (1 + 1e-9)
    assert np.abs(after.steering_rate - before.steering_rate).max() < 1e-3 * math.pi
    assert np.abs(after.wheel_velocity - before.wheel_velocity).max() < 1e-3 * limits.wheel_speed.min()


@pytest.mark.parametrize(("kind", "draw"), [("ackermann", 2), ("tricycle", 7)])
def test_a_car_in_clutter_ends_within_a_tenth_of_a_millimetre_of_its_goal(kind: str, draw: int) -> None:
    options = Options(effort="good", time_budget=60.0)
    made = plan(replace(query(kind, "clutter", draw), options=options))
    assert made.planning["optimized"]
    assert made.certificate.closure_position < 1e-4
    assert made.certificate.drift_position < 1e-4


@pytest.mark.parametrize("kind", ["ackermann", "tricycle"])
def test_wheels_at_their_fastest_are_not_made_faster(kind: str) -> None:
    problem, motion = zigzag(kind, 6, 0.007)
    drive, limits = problem.robot.drive, problem.robot.limits
    as_it_was = schedule(Phases(drive, (motion,)), PERIOD)
    fastest = np.abs(as_it_was.wheel_velocity).max(0)
    limits = replace(limits, wheel_speed=fastest, wheel_acceleration=1e3 * fastest)
    made = rounded(Phases(drive, (motion,)), limits, PERIOD)
    after = schedule(made, PERIOD)
    mean = np.diff(after.wheel_angle, axis=0) / np.diff(after.time)[:, None]
    for rate in (after.wheel_velocity, mean):
        assert (np.abs(rate) <= limits.wheel_speed * (1 + 2e-4)).all()
    assert made.duration <= motion.duration * (1 + 5e-3)
    assert np.abs(roll(problem, after).pose[-1] - motion.poses(motion.time)[-1]).max() < 1e-5


def test_wheels_are_not_accelerated_more_than_they_may() -> None:
    problem, motion = zigzag("ackermann", 6, 0.007)
    drive, limits = problem.robot.drive, problem.robot.limits
    as_it_was = schedule(Phases(drive, (motion,)), PERIOD)
    most = 0.98 * np.abs(as_it_was.wheel_acceleration).max(0)
    limits = replace(limits, wheel_speed=np.full(len(most), np.inf), wheel_acceleration=most)
    after = schedule(rounded(Phases(drive, (motion,)), limits, PERIOD), PERIOD)
    assert (np.abs(after.wheel_acceleration) <= most * (1 + 5e-4)).all()


def test_a_straight_motion_is_left_as_it_is() -> None:
    robot = ROBOTS["ackermann"]
    time = np.array([0.0, 0.51, 1.02])
    coefficients = np.zeros((2, 3, 2))
    coefficients[:, :2, 0] = [[0.0, 1.0], [0.51, -1.0]]
    motion = Flowing(Pose(0.0, 0.0, 0.5), time, coefficients, True, None)
    made = rounded_phase(motion, sample_times(1.02, PERIOD))
    assert np.abs(made.poses(time) - motion.poses(time)).max() < 1e-12
    drive = robot.drive
    assert (schedule(Phases(drive, (made,)), PERIOD).steering_angle == 0).all()
