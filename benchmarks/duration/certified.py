"""What a solution of the program is worth: its duration once it keeps every limit, or nothing."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.duration.direct import Solution
from drives.drive import InadmissibleTwist
from drives.se2 import Array, Pose
from planner.environment import CollisionWorld
from planner.errors import AuditFailed
from planner.problem import Problem
from planner.schedule import WheelSchedule, schedule
from planner.trajectory import Flowing, Phases
from planner.verify import verify

__all__ = ["Failed", "certified"]

_INSIDE = np.array([1e-6, 0.1, 0.25, 0.4, 0.5, 0.6, 0.75, 0.9, 1 - 1e-6])
_SLOWEST = 1.15
"""A solution that has to be slowed by more than this between its knots is none."""


class Failed(Exception):
    """Why a solution does not count."""


def certified(problem: Problem, world: CollisionWorld, solution: Solution) -> WheelSchedule:
    """The schedule of a solution, slowed as a whole until it keeps every limit, free and certified by the
    planner's own check. Raises Failed."""
    try:
        motion = _motion(problem, solution, 1.0)
        slower = max(1.0, _excess(problem, motion, solution.time))
        if not slower < _SLOWEST:
            raise Failed(f"limits exceeded {slower:.3f} times")
        motion = _motion(problem, solution, slower)
    except InadmissibleTwist as error:
        raise Failed(str(error)) from None
    pose = motion.sample(np.linspace(0.0, motion.duration, math.ceil(motion.duration / 0.005) + 1)).pose
    if world.polyline_free(pose) >= 0:
        raise Failed("collides")
    made = schedule(motion, problem.options.sample_period)
    try:
        verify(problem, made, world)
    except AuditFailed as error:
        raise Failed(str(error)) from None
    return made


def _motion(problem: Problem, solution: Solution, slower: float) -> Phases:
    robot = problem.robot
    n, _, size = solution.coefficients.shape
    coefficients = np.concatenate([solution.coefficients, np.zeros((n, 1, size))], 1)
    coefficients = coefficients / slower ** np.arange(3.0)[:, None]
    coefficients[..., : 1 if solution.curves else None] /= slower
    start = Pose(*solution.pose[0].tolist())
    time = solution.time * slower
    limit = robot.limits.steering_angle
    return Phases(robot.drive, (Flowing(start, time, coefficients, solution.curves, None, limit),))


def _excess(problem: Problem, motion: Phases, knots: Array) -> float:
    """By what factor to slow it."""
    limits = problem.robot.limits
    made = motion.sample((knots[:-1, None] + np.diff(knots)[:, None] * _INSIDE).ravel())
    used = (
        np.abs(made.wheel_velocity) / limits.wheel_speed,
        np.abs(made.steering_rate) / limits.steering_rate,
        np.sqrt(np.abs(made.wheel_acceleration) / limits.wheel_acceleration),
    )
    return max(float(np.max(ratio, initial=0.0)) for ratio in used)
