"""plan(problem) → Plan: search, shorten, time, optimize, schedule, verify."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drives.drive import BodyPath
from drives.se2 import Pose, wrap
from planner.candidates import Candidate, candidates
from planner.client_grid import on_grid
from planner.collision import CONTACT
from planner.connect import Connector, connector
from planner.environment import CollisionWorld
from planner.errors import AuditFailed, LimitsInfeasible, PoseInCollision, PoseOutOfBounds
from planner.headings import goal_headings
from planner.kernels import make_ready
from planner.problem import Problem, Robot
from planner.schedule import WheelSchedule, schedule, standstill
from planner.stopwatch import Stopwatch
from planner.usage import rolled
from planner.verify import Certificate, verify

__all__ = ["Plan", "plan"]

_SAME, _NEAR, _INSTANT = 1e-9, 1e-6, 1e-4
"""A goal nearer than _SAME (m, rad) is the start. If it is nearer than _NEAR, the robot stands for _INSTANT
(s): the certificate allows a miss of 0.5 mm, and a car would drive a full circle to end 1 nm behind."""
_SWING = 0.6
"""How far (rad) trailing wheels may swing from one sample to the next."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A certified answer. duration s; length m (travelled by the body origin); planning: JSON values that
    say how it was made: planner, state_space, seed, timings {stage: s}, cut_short (whether the time budget
    ended before the work that its effort asks for), …"""

    duration: float
    length: float
    schedule: WheelSchedule
    certificate: Certificate
    planning: dict[str, Any]


def plan(problem: Problem, improved: Callable[[Plan], None] | None = None) -> Plan:
    """A certified plan for the problem, or a PlanningError that says why there is none.

    improved: told, at effort best, of each certified plan found on the way, faster than the one before.

    The first plan compiles the kernels if the cache lacks them; the time budget begins afterwards.
    """
    make_ready()
    watch = Stopwatch(problem.options.time_budget)
    problem = replace(problem, robot=_resolved(problem))
    robot, options = problem.robot, problem.options
    world = CollisionWorld.build(
        problem.environment, robot.footprint, options.min_clearance, robot.drive.fixed_body_heading
    )
    goals = _goals(problem, world)
    apart = min(_apart(problem.start, goal) for goal in goals)
    if apart < _NEAR:
        instant = 0.0 if apart < _SAME else min(_INSTANT, options.sample_period)
        return _standing(problem, world, watch, instant)
    local = connector(robot, world, options)
    watch.lap("prepare")
    best: Plan | None = None
    failed: list[AuditFailed | LimitsInfeasible] = []
    for found in candidates(problem, local, goals, watch):
        for candidate in found:
            if best is not None and candidate.timed.duration >= best.duration:
                break
            try:
                made = _certified(problem, world, local, candidate, watch)
            except (AuditFailed, LimitsInfeasible) as failure:
                failed.append(failure)
                continue
            # On the client's grid a motion may take longer than it was expected to.
            if best is None or made.duration < best.duration:
                best = made
                if improved is not None and options.effort == "best":
                    improved(best)
        if options.effort != "best" and best is not None and best.planning["optimized"]:
            break
    if best is None:
        raise failed[0]
    refused = sum(isinstance(failure, AuditFailed) for failure in failed)
    return replace(best, planning=best.planning | _planning(problem, watch) | {"refused": refused})


def _resolved(problem: Problem) -> Robot:
    """The robot, its trailing wheels swinging so slowly that the samples tell how."""
    robot, period = problem.robot, problem.options.sample_period
    if robot.drive.settled is robot.drive:
        return robot
    rate = min(robot.limits.steering_rate, _SWING / period)
    return replace(robot, limits=replace(robot.limits, steering_rate=rate))


def _certified(
    problem: Problem, world: CollisionWorld, local: Connector, candidate: Candidate, watch: Stopwatch
) -> Plan:
    timed, period = candidate.timed, problem.options.sample_period
    if not candidate.optimized:
        timed = on_grid(timed, problem.robot.limits, period)
    made = schedule(timed, period)
    if not timed.is_even and made.steering_angle.shape[1] > 0:
        # The body moves as wheels interpolate.
        _, pose = rolled(made, problem.robot.drive)
        twist, _ = problem.robot.drive.forward(made.wheel_velocity, made.steering_angle, made.steering_rate)
        pose.flags.writeable = twist.flags.writeable = False
        made = replace(made, pose=pose, twist=twist)
    watch.lap("schedule")
    try:
        certificate = verify(problem, made, world)
    finally:
        watch.lap("verify")
    about = {
        "planner": candidate.planner,
        "state_space": local.state_space,
        "optimized": candidate.optimized,
        "stops": _stops(made),
    }
    way = float(np.hypot(*np.diff(made.pose[:, :2], axis=0).T).sum())
    return Plan(timed.duration, way, made, certificate, _planning(problem, watch, **about))


def _stops(made: WheelSchedule) -> int:
    """How often the body comes to rest on the way: wheels of casters may, while it moves."""
    pace = np.abs(made.twist).sum(1)
    still = pace < 1e-2 * pace.max()
    return int(np.count_nonzero(np.diff(still.astype(int)) == 1)) - 1


def _goals(problem: Problem, world: CollisionWorld) -> list[Pose]:
    """The free goal poses, after start and goal have been checked."""
    start, goal = problem.start, problem.goal
    _check("start", start, world, problem.options.min_clearance)
    if goal.theta is not None:
        poses = [Pose(goal.x, goal.y, goal.theta)]
    elif math.hypot(goal.x - start.x, goal.y - start.y) < _NEAR:
        poses = [Pose(goal.x, goal.y, start.theta)]
    else:
        headings = goal_headings(world, start, goal.x, goal.y)
        poses = [Pose(goal.x, goal.y, theta) for theta in dict.fromkeys(headings)]
    free = [pose for pose in poses if world.is_free(pose)]
    if not free:
        _check("goal", max(poses, key=lambda p: float(world.clearance(np.array([p]))[0])), world,
               problem.options.min_clearance)  # fmt: skip
    return free


def _check(which: Any, pose: Pose, world: CollisionWorld, min_clearance: float) -> None:
    if (beyond := world.beyond(pose)) > 0:
        where = f"the footprint at the {which} leaves the bounds or the map by {beyond:.6g} m"
        raise PoseOutOfBounds(which, where, pose)
    if not world.is_free(pose):
        clearance = float(world.clearance(np.array([pose]))[0])
        at = f"the footprint at the {which}"
        if clearance < 0:
            why = f"{at} overlaps an obstacle, by {-clearance:.6g} m or more"
        else:
            least = f"min_clearance + {CONTACT:g} m = {min_clearance + CONTACT:.6g} m"
            why = f"{at} is {clearance:.6g} m from an obstacle or a bound; it must be more than {least}"
        raise PoseInCollision(which, why, pose, clearance - min_clearance)


def _apart(a: Pose, b: Pose) -> float:
    """The larger of the distance (m) and the angle (rad) between two poses."""
    return max(math.hypot(a.x - b.x, a.y - b.y), abs(wrap(a.theta - b.theta)))


def _standing(problem: Problem, world: CollisionWorld, watch: Stopwatch, duration: float) -> Plan:
    drive, start = problem.robot.drive, problem.start
    steering = problem.steering
    if steering is None:
        still = BodyPath(np.zeros(1), np.array([start.theta]), np.zeros((1, 3)), np.zeros((1, 3)))
        steering = drive.actuators(still).steering[0]
    made = standstill(np.array(start), len(drive.wheel_names), steering, duration)
    certificate = verify(problem, made, world)
    watch.lap("verify")
    about = _planning(problem, watch, planner="none", state_space="SE2", optimized=False, stops=0, refused=0)
    return Plan(duration, 0.0, made, certificate, about)


def _planning(problem: Problem, watch: Stopwatch, **about: Any) -> dict[str, Any]:
    options = problem.options
    # Effort best always goes on until the budget ends.
    cut_short = watch.cut_short and options.effort != "best"
    return {
        **about,
        "seed": options.seed,
        "effort": options.effort,
        "cut_short": cut_short,
        "timings": watch.timings(),
    }
