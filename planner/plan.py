"""plan(problem) → Plan: search, shorten, time, optimize, schedule, verify."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import chain
from typing import Any

import numpy as np

from drives import Ackermann, Differential, Mecanum, PoweredCaster
from drives.drive import BodyPath, Limits
from drives.se2 import Pose, wrap
from drives.wheel import Module
from planner import curves, environment
from planner.connect import Connector, connector, is_path_free
from planner.environment import CollisionWorld
from planner.errors import (
    AuditFailed,
    LimitsInfeasible,
    NoPathExists,
    NoPathFound,
    PlanningError,
    PoseInCollision,
    PoseOutOfBounds,
)  # fmt: skip
from planner.optimize import Optimizer
from planner.path import Path
from planner.problem import (
    Bounds,
    Circle,
    Environment,
    Footprint,
    Goal,
    Options,
    Polygon,
    Problem,
    Robot,
)  # fmt: skip
from planner.schedule import WheelSchedule, schedule, standstill
from planner.search import Search
from planner.shorten import shorten
from planner.time_law import time_path
from planner.trajectory import Phases
from planner.verify import Certificate, verify

__all__ = ["MAX_SAMPLES", "Plan", "plan", "warm_up"]

MAX_SAMPLES = 200_000
"""A schedule longer than this many samples is refused as infeasible."""

_GOOD_CANDIDATES = 3
_GOOD_TRIES, _GOOD_ROUNDS, _BEST_ROUNDS = 2, 1, 6
_HEADINGS = 16
_SAME = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A certified answer. duration s; length m (travelled by the body origin); planning: JSON values that
    say how it was made: planner, state_space, seed, timings {stage: s}, …"""

    duration: float
    length: float
    schedule: WheelSchedule
    certificate: Certificate
    planning: dict[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    planner: str
    timed: Phases
    optimized: bool = False


def plan(problem: Problem) -> Plan:
    """A certified plan for the problem, or a PlanningError that says why there is none."""
    watch = _Stopwatch(problem.options.time_budget)
    robot, options = problem.robot, problem.options
    world = CollisionWorld.build(
        problem.environment, robot.footprint, options.min_clearance, robot.drive.fixed_body_heading
    )
    goals = _goals(problem, world)
    if any(_same(problem.start, goal) for goal in goals):
        return _standing(problem, world, watch)
    local = connector(robot, world, options)
    watch.lap("prepare")
    candidates = _candidates(problem, local, goals, watch)
    candidates += _refined(problem, world, candidates, watch)
    candidates.sort(key=lambda c: c.timed.duration)
    refused: PlanningError | None = None
    for best in candidates:
        made = schedule(best.timed, options.sample_period)
        watch.lap("schedule")
        try:
            certificate = verify(problem, made, world)
        except AuditFailed as failure:
            refused = refused or failure
            continue
        finally:
            watch.lap("verify")
        about = {
            "planner": best.planner,
            "state_space": local.state_space,
            "optimized": best.optimized,
            "stops": _stops(made),
        }
        way = float(np.hypot(*np.diff(made.pose[:, :2], axis=0).T).sum())
        return Plan(best.timed.duration, way, made, certificate, _planning(problem, watch, **about))
    assert refused is not None
    raise refused


def _goals(problem: Problem, world: CollisionWorld) -> list[Pose]:
    """The free goal poses, after start and goal have been checked."""
    start, goal = problem.start, problem.goal
    _check("start", start, world, problem.options.min_clearance)
    if goal.theta is not None:
        poses = [Pose(goal.x, goal.y, goal.theta)]
    elif math.hypot(goal.x - start.x, goal.y - start.y) < _SAME:
        poses = [start]
    else:
        course = math.atan2(goal.y - start.y, goal.x - start.x)
        headings = [course, start.theta, *(course + math.tau * k / _HEADINGS for k in range(1, _HEADINGS))]
        poses = [Pose(goal.x, goal.y, theta) for theta in headings]
    free = [pose for pose in poses if world.is_free(pose)]
    if not free:
        _check("goal", max(poses, key=lambda p: float(world.clearance(np.array([p]))[0])), world,
               problem.options.min_clearance)  # fmt: skip
    return free


def _check(which: Any, pose: Pose, world: CollisionWorld, min_clearance: float) -> None:
    if not world.contained(pose):
        raise PoseOutOfBounds(which, f"the footprint at the {which} leaves the bounds or the map", pose)
    if not world.is_free(pose):
        short = float(world.clearance(np.array([pose]))[0]) - min_clearance
        needed = f" by min_clearance {min_clearance:g} m" if min_clearance else ""
        raise PoseInCollision(
            which,
            f"the footprint at the {which} does not clear the obstacles{needed}: {short:.4f} m",
            pose,
            short,
        )


def _same(a: Pose, b: Pose) -> bool:
    return math.hypot(a.x - b.x, a.y - b.y) < _SAME and abs(wrap(a.theta - b.theta)) < _SAME


def _candidates(problem: Problem, local: Connector, goals: list[Pose], watch: _Stopwatch) -> list[_Candidate]:
    """Timed ways to the goal: one for effort first, a few for good, as many as time allows for best."""
    options, robot = problem.options, problem.robot
    search = Search(local, problem.environment, problem.start, goals, options.seed)
    enough = {"first": 1, "good": _GOOD_CANDIDATES, "best": math.inf}[options.effort]
    found: list[_Candidate] = []
    refused: LimitsInfeasible | None = None
    direct = _direct(problem.start, local, goals)
    if not direct:
        _refuse_if_separated(problem, local.world)
    ways: Iterator[tuple[str, Path]] = (("direct", path) for path in direct)
    if not direct or options.effort == "best":
        ways = chain(ways, search.paths(watch.is_over))
    for planner, path in ways:
        watch.lap("search")
        if planner != "direct":
            path = shorten(path, local)
            watch.lap("shorten")
        try:
            timed = time_path(path, robot.drive, robot.limits, problem.steering)
            _refuse_if_endless(timed, options.sample_period)
            found.append(_Candidate(planner, timed))
        except LimitsInfeasible as error:
            refused = refused or error
        watch.lap("time")
        if planner != "direct":
            if len(found) >= enough:
                break
            if options.effort == "good":
                # More ways are worth about as much work again as the first took.
                search.allowance = 2 * search.work + 200 if search.allowance is None else search.allowance
        if watch.is_over():
            break
    if found:
        return found
    if refused is not None:
        raise refused
    raise NoPathFound(
        f"the time budget of {options.time_budget:g} s ended before a path was found", tried=search.tried
    )


def _refined(
    problem: Problem, world: CollisionWorld, candidates: list[_Candidate], watch: _Stopwatch
) -> list[_Candidate]:
    """Faster motions near the candidates: for effort good near the first for which there is one, for best
    all."""
    effort, drive = problem.options.effort, problem.robot.drive
    # Trailing wheels have to swing round first, which the optimizer knows nothing of: it seldom helps them.
    if effort == "first" or (effort == "good" and drive.settled is not drive):
        return []
    optimizer = Optimizer(problem, world, watch.is_over)
    found: list[_Candidate] = []
    tries, rounds = (_GOOD_TRIES, _GOOD_ROUNDS) if effort == "good" else (None, _BEST_ROUNDS)
    for near in sorted(candidates, key=lambda c: c.timed.duration)[:tries]:
        if watch.is_over() or (found and effort == "good"):
            break
        faster = optimizer.faster(near.timed, rounds, alone=near.planner == "direct")
        if faster is not None:
            found.append(_Candidate(near.planner, faster, optimized=True))
    watch.lap("optimize")
    return found


def _stops(made: WheelSchedule) -> int:
    """How often the wheels come to rest on the way."""
    top = np.abs(made.wheel_velocity).max(0) + 1e-300
    still = (np.abs(made.wheel_velocity) < 1e-2 * top).all(1)
    return int(np.count_nonzero(np.diff(still.astype(int)) == 1)) - 1


def _direct(start: Pose, local: Connector, goals: list[Pose]) -> list[Path]:
    """The quickest free ways, by estimate, that need no search."""
    ways = [
        (float(time), motions, pair, way)
        for motions in local.direct(np.repeat([start], len(goals), 0), np.array(goals))
        for (pair, way), time in np.ndenumerate(motions.times)
        if time < np.inf
    ]
    best: list[Path] = []
    for _, motions, pair, way in sorted(ways, key=lambda w: w[0]):
        path = motions.path(pair, way)
        if is_path_free(local.world, path):
            best.append(path)
            if len(best) == _GOOD_CANDIDATES:
                break
    return best


def _refuse_if_separated(problem: Problem, world: CollisionWorld) -> None:
    cut = world.separation(problem.start, problem.goal)
    if cut is not None:
        raise NoPathExists(
            f"a disc of radius {cut.radius:.3f} m inside the footprint cannot pass from start to goal",
            proof={
                "method": "separation of the largest disc inside the footprint",
                **{name: float(value) for name, value in asdict(cut).items()},
            },
        )


def _refuse_if_endless(timed: Phases, period: float) -> None:
    if timed.duration / period > MAX_SAMPLES:
        raise LimitsInfeasible(
            f"the motion would take {timed.duration:.6g} s, more than {MAX_SAMPLES} samples of {period:g} s"
        )


def _standing(problem: Problem, world: CollisionWorld, watch: _Stopwatch) -> Plan:
    drive, start = problem.robot.drive, problem.start
    steering = problem.steering
    if steering is None:
        still = BodyPath(np.zeros(1), np.array([start.theta]), np.zeros((1, 3)), np.zeros((1, 3)))
        steering = drive.actuators(still).steering[0]
    made = standstill(np.array(start), len(drive.wheel_names), steering)
    certificate = verify(problem, made, world)
    watch.lap("verify")
    return Plan(
        0.0,
        0.0,
        made,
        certificate,
        _planning(problem, watch, planner="none", state_space="SE2", optimized=False, stops=0),
    )


def _planning(problem: Problem, watch: _Stopwatch, **about: Any) -> dict[str, Any]:
    options = problem.options
    return {**about, "seed": options.seed, "effort": options.effort, "timings": watch.timings()}


class _Stopwatch:
    """Planning time: what is left of the budget, and what each stage took (s)."""

    def __init__(self, budget: float) -> None:
        self._begin = self._last = time.perf_counter()
        self._budget = budget
        self._laps: dict[str, float] = {}

    def is_over(self) -> bool:
        return time.perf_counter() - self._begin >= self._budget

    def lap(self, stage: str) -> None:
        now = time.perf_counter()
        self._laps[stage] = self._laps.get(stage, 0.0) + now - self._last
        self._last = now

    def timings(self) -> dict[str, float]:
        return {stage: round(t, 6) for stage, t in self._laps.items()} | {
            "total": round(time.perf_counter() - self._begin, 6)
        }


def warm_up() -> None:
    """Import and compile whatever the first plan would otherwise wait for, by planning a little of
    everything."""
    environment.warm_up()
    curves.warm_up()
    modules = tuple(Module(name, x, y) for name, x, y in (("left", 0.0, 0.2), ("right", 0.0, -0.2)))
    wall = Polygon(np.array([[-0.1, -4.0], [0.1, -4.0], [0.1, 1.0], [-0.1, 1.0]]))
    around = Environment(Bounds(-4.0, -4.0, 4.0, 4.0), (wall, Circle(0.0, 1.0, 0.1)))
    footprint = Footprint(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]))
    for drive, turned in (
        (Mecanum(0.05, 0.3, 0.4), np.inf),
        (Differential(0.05, 0.3), np.inf),
        (Ackermann(0.05, 0.4, 0.3), 0.7),
        (PoweredCaster(0.05, 0.04, modules), np.inf),
    ):
        m = len(drive.wheel_names)
        limits = Limits(np.full(m, 20.0), np.full(m, 40.0), np.full(m, np.inf), turned, 5.0)
        # Compiling counts as planning time here.
        problem = Problem(
            Robot(drive, footprint, limits),
            Pose(-2.0, 0.0, 0.0),
            Goal(2.0, 0.0, 0.5),
            around,
            Options(time_budget=60.0),
        )
        plan(problem)
        world = CollisionWorld.build(around, footprint)
        connector(problem.robot, world, problem.options).edge_free(problem.start, Pose(2.0, 0.0, 0.5))
