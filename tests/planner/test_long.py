"""Long motions, optimized window by window: joined without a jump, within limits, free, linear in cost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.duration.robots import ROBOTS
from benchmarks.long import serpentine
from drives.se2 import Array, Pose
from planner.connect import connector
from planner.environment import CollisionWorld
from planner.guess import Guess
from planner.horizon import State, receding
from planner.optimize import Optimizer
from planner.problem import Problem
from planner.schedule import schedule
from planner.shorten import shorten
from planner.time_law import time_path
from planner.trajectory import Flowing, Phases
from planner.verify import verify
from tests.planner.worlds import is_path_free

DRIVES = ["differential", "mecanum", "ackermann", "swerve", "powered_caster"]


def long_motion(kind: str, length: float, jerk: float = np.inf) -> tuple[Problem, CollisionWorld, Phases]:
    robot = ROBOTS[kind]
    limits = replace(robot.limits, wheel_jerk=jerk * robot.limits.wheel_acceleration)
    problem, path = serpentine(replace(robot, limits=limits), length)
    world = CollisionWorld.build(problem.environment, robot.footprint)
    assert is_path_free(world, path)
    return problem, world, time_path(path, robot.drive, limits)


@pytest.mark.parametrize("kind", DRIVES)
def test_a_long_motion_among_obstacles_flows_within_all_limits_and_keeps_clear(kind: str) -> None:
    problem, world, timed = long_motion(kind, 60.0)
    faster = Optimizer(problem, world, lambda _: False).faster(timed, 1)
    assert faster is not None
    assert faster.duration < 0.7 * timed.duration
    assert verify(problem, schedule(faster, 0.02), world).clearance > 0


@pytest.mark.parametrize("kind", ["differential", "ackermann"])
def test_a_long_motion_keeps_the_jerk_limit(kind: str) -> None:
    problem, world, timed = long_motion(kind, 40.0, jerk=10.0)
    faster = Optimizer(problem, world, lambda _: False).faster(timed, 1)
    assert faster is not None
    assert verify(problem, schedule(faster, 0.02), world).wheel_jerk_ratio <= 1.02


@pytest.mark.parametrize("kind", DRIVES)
def test_windows_join_without_a_jump_in_pose_twist_or_curvature(kind: str) -> None:
    problem, world, timed = long_motion(kind, 40.0)
    faster = Optimizer(problem, world, lambda _: False).faster(timed, 1)
    assert faster is not None
    (flowing,) = faster.phases
    assert isinstance(flowing, Flowing)
    assert len(flowing.time) > 65
    step = np.diff(flowing.time)[:, None]
    c = flowing.coefficients
    arrived = sum(c[:, k] * step**k for k in range(c.shape[1]))
    assert arrived[:-1] == pytest.approx(c[1:, 0], abs=1e-3)
    around = np.sort(np.concatenate([flowing.time[1:-1] - 1e-7, flowing.time[1:-1] + 1e-7]))
    poses = flowing.poses(around)
    assert np.abs(poses[1::2] - poses[::2]).max() < 1e-5


def test_optimizing_again_does_not_make_a_long_motion_slower() -> None:
    problem, world, timed = long_motion("differential", 40.0)
    optimizer = Optimizer(problem, world, lambda _: False)
    once, again = (optimizer.faster(timed, rounds) for rounds in (1, 3))
    assert once is not None
    assert again is not None
    assert again.duration <= once.duration


def test_a_long_motion_is_given_up_when_time_is_over() -> None:
    problem, world, timed = long_motion("mecanum", 40.0)
    assert Optimizer(problem, world, lambda _: True).faster(timed, 1) is None


def straight(knots: int) -> Guess:
    time = np.arange(knots + 1) * 0.3
    still = np.zeros_like(time)
    return Guess(time, np.column_stack([time, still, still]), np.column_stack([still + 1, still]))


def along(guess: Guess, begin: State) -> Flowing:
    """Along the x axis through a guess, at rest where it ends."""
    time = np.linspace(0.0, float(guess.time[-1]), len(guess.time))
    v = np.full(len(time), (guess.pose[-1, 0] - begin.pose.x) / time[-1])
    coefficients = np.zeros((len(time) - 1, 3, 2))
    coefficients[:, 0, 0] = v[1:]
    return Flowing(begin.pose, time, coefficients, False, None)


@pytest.mark.parametrize(
    ("fails", "runs"),
    [
        (lambda coordinates: False, 1),
        # In motion, however short: the robot stops where the window before ends.
        (lambda coordinates: coordinates.any(), 4),
    ],
)
def test_where_a_window_cannot_be_solved_the_last_one_is_driven_to_its_end(
    fails: Callable[[Array], bool], runs: int
) -> None:
    guess = straight(256)
    still = State(Pose(0, 0, 0), np.zeros(2), np.zeros(2), "all")

    def window(part: Guess, begin: State) -> Flowing | None:
        return None if fails(begin.coordinates) else along(part, begin)

    found = receding(guess, still, ROBOTS["differential"], window)
    assert found is not None
    assert len(found) == runs
    end = still.pose.x
    for run in found:
        assert run.start.x == pytest.approx(end)
        end = float(run.poses(run.time)[-1, 0])
    assert end == pytest.approx(guess.pose[-1, 0])


def test_a_window_from_rest_that_cannot_be_solved_is_the_end() -> None:
    still = State(Pose(0, 0, 0), np.zeros(2), np.zeros(2), "all")
    assert receding(straight(256), still, ROBOTS["differential"], lambda part, begin: None) is None


def test_windows_are_as_many_as_the_length_asks_for() -> None:
    def asked(knots: int) -> int:
        lengths: list[int] = []

        def window(part: Guess, begin: State) -> Flowing:
            lengths.append(len(part.time))
            return along(part, begin)

        receding(
            straight(knots),
            State(Pose(0, 0, 0), np.zeros(2), np.zeros(2), "all"),
            ROBOTS["differential"],
            window,
        )
        assert set(lengths) == {65}
        return len(lengths)

    assert asked(2048) <= 2 * asked(1024) + 1


@pytest.mark.parametrize("kind", ["differential", "ackermann"])
def test_a_long_path_is_shortened_everywhere_and_stays_free(kind: str) -> None:
    robot = ROBOTS[kind]
    problem, path = serpentine(robot, 80.0)
    world = CollisionWorld.build(problem.environment, robot.footprint)
    local = connector(robot, world, problem.options)
    shorter = shorten(path, local)
    assert is_path_free(world, shorter)
    assert local.duration(shorter) <= local.duration(path)
