"""Motions to choose from: found, shortened and timed with stops, then optimized so that they flow."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import chain, islice

import numpy as np

from drives.drive import Limits
from drives.se2 import Pose
from planner.connect import Connector, connector, free_paths
from planner.environment import CollisionWorld
from planner.errors import LimitsInfeasible, NoPathExists, NoPathFound
from planner.guess import flowing_time, is_far, reversals
from planner.optimize import Optimizer
from planner.path import Path
from planner.problem import Problem
from planner.retime import hastened
from planner.search import HYBRID, Search
from planner.shorten import shorten
from planner.stopwatch import Stopwatch
from planner.time_law import time_path
from planner.trajectory import Phases

__all__ = ["MAX_SAMPLES", "MAX_WAY", "Candidate", "candidates"]

MAX_SAMPLES = 200_000
"""A schedule longer than this many samples is refused as infeasible."""
MAX_WAY = 1e5
"""So is a motion on which the footprint moves farther, m: the certificate's check of it would take long."""

_DIRECT_CANDIDATES, _GOOD_CANDIDATES = 6, (8, 10)
"""Ways to the goal: direct ones; those found by search, and how many where all turn back."""
_GOOD_TRIES, _GOOD_ROUNDS, _BEST_ROUNDS = 3, 1, 6
_PATIENCE = 180
"""Iterations of the optimizer where all that took fewer was in vain."""
_WORK = 1200
"""Motions that may be checked to find other ways than direct ones."""
_DETOUR = 1.5
"""At effort first, how much longer than the crow flies a way is where others are looked for."""
_OVER, _HOPE = 1.05, 0.97
"""A motion is expected to exceed its flowing time as the best so far does, by the first factor at most; by
the second less where the best turns back."""
_SAME = 1e-3
"""Share by which flowing times of different ways differ at least."""
_HASTE = 0.9
"""Share of the duration of a motion with smoothed laws that is left, at best, once it is retimed."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A timed motion from the start to a goal. planner: who found its path; found: that path, before it was
    shortened; optimized: whether the motion was since."""

    planner: str
    timed: Phases
    found: Path
    optimized: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Way:
    """A path to a goal: who found it, what it was before it was shortened, and the motion along it with
    stops, where that is known."""

    planner: str
    path: Path
    found: Path
    timed: Phases | None

    def stopping(self, timed: Phases) -> Candidate:
        return Candidate(self.planner, timed, self.found)


def candidates(
    problem: Problem, local: Connector, goals: list[Pose], watch: Stopwatch
) -> Iterator[list[Candidate]]:
    """Motions to choose from, each list with the fastest first; at least one motion, or a PlanningError.

    Effort first: one, with stops. Good: one list of a few, one of them as quick with stops as first's, and of
    what optimizing the best of them gives; then, for those whom no optimized one of these will do, what
    optimizing them with patience gives. Best: list after list as time allows, of whatever is found: with
    stops, then optimized.
    """
    effort, drive, limits = problem.options.effort, problem.robot.drive, problem.robot.limits
    optimizer = Optimizer(problem, local.world, watch.is_over)
    search = Search(
        local, problem.environment, problem.start, goals, problem.options.seed,
        lambda: _refuse_if_separated(problem, local.world),
    )  # fmt: skip

    def optimized(way: _Way, rounds: int, by: Optimizer = optimizer) -> list[Candidate]:
        faster = by.faster(way.timed or way.path, rounds)
        watch.lap("optimize")
        return [] if faster is None else [Candidate(way.planner, faster, way.found, True)]

    if effort == "best":
        known: set[float] = set()
        for way in _ways(problem, local, goals, search, watch):
            assert way.timed is not None
            stopped = way.stopping(way.timed)
            hasty = [stopped] if known else [stopped, *_plain(problem, local, goals, stopped, search, watch)]
            hasty = _hastened(sorted(hasty, key=_duration), limits, watch)
            watch.lap("optimize")
            yield hasty
            # A search often finds the same way again.
            duration = round(stopped.timed.duration, 6)
            if duration not in known and not watch.is_over(optimizer.longest):
                yield optimized(way, _BEST_ROUNDS)
            known.add(duration)
        return
    ways = list(_ways(problem, local, goals, search, watch))
    stopping = {way: way.stopping(way.timed) for way in ways if way.timed is not None}
    first = stopping[ways[0]]

    def stops(way: _Way) -> Candidate | None:
        if way not in stopping:
            try:
                stopping[way] = way.stopping(_timed(problem, way.path))
            except LimitsInfeasible:
                return None
            watch.lap("time")
        return stopping[way]

    flowed: dict[_Way, Candidate] = {}
    if effort == "good":
        ways.sort(key=lambda way: flowing_time(way.path, drive, limits))
        best: _Way | None = None
        for way in ways[:_GOOD_TRIES]:
            if watch.is_over(optimizer.longest):
                break
            time = flowing_time(way.path, drive, limits)
            if best is not None:
                over = min(_duration(flowed[best]) / flowing_time(best.path, drive, limits), _OVER)
                if over * (_HOPE if reversals(best.path) else 1.0) * time >= _duration(flowed[best]):
                    break
            # A search often finds the same way again.
            if any(abs(time / flowing_time(other.path, drive, limits) - 1) < _SAME for other in flowed):
                continue
            if faster := optimized(way, _GOOD_ROUNDS):
                (flowed[way],) = faster
                if best is None or _duration(flowed[way]) < _duration(flowed[best]):
                    best = way
    found = [*stopping.values(), *flowed.values()]
    if effort == "good" and (local.flows or first.planner != "direct"):
        found += _plain(problem, local, goals, first, search, watch)
    found.sort(key=_duration)
    if effort == "good":
        found = _hastened(found, limits, watch)
        watch.lap("optimize")
    yield found
    if effort == "good":
        patient = replace(optimizer, iterations=_PATIENCE)
        # What its check refuses would be found again.
        for way in [way for way in ways[:_GOOD_TRIES] if way not in flowed]:
            if watch.is_over(optimizer.longest * _PATIENCE / optimizer.iterations):
                break
            near = stops(way)
            if near is not None and flowing_time(way.path, drive, limits) < _HASTE * _duration(near):
                yield optimized(way, _GOOD_ROUNDS, patient)
        rest = [stops(way) for way in ways if way not in stopping and not watch.is_over()]
        yield _hastened([near for near in rest if near is not None], limits, watch)


def _hastened(found: list[Candidate], limits: Limits, watch: Stopwatch) -> list[Candidate]:
    """Those that may become the fastest retimed, the fastest first."""
    best = math.inf
    found = list(found)
    for i, near in enumerate(found):
        if _HASTE * near.timed.duration < best:
            if not near.optimized:
                found[i] = replace(near, timed=hastened(near.timed, limits, watch.is_over))
            best = min(best, found[i].timed.duration)
    return sorted(found, key=_duration)


def _duration(candidate: Candidate) -> float:
    return candidate.timed.duration


def _ways(
    problem: Problem, local: Connector, goals: list[Pose], search: Search, watch: Stopwatch
) -> Iterator[_Way]:
    """Ways to the goal, until effort or time end; at least one that is timed, or a PlanningError."""
    options, robot = problem.options, problem.robot
    count = searched = 0
    waits = options.effort == "good"
    turns_back = True
    refused: LimitsInfeasible | None = None
    direct = _direct(problem.start, local, goals)
    found = list(islice(direct, 1))

    def ways() -> Iterator[tuple[str, Path]]:
        for path in chain(found, direct):
            yield "direct", path
        if count and options.effort == "good":
            search.allowance = _WORK
        # Where the limits forbid the direct ways, a search finds no better ones.
        if not found or options.effort == "best" or (count and turns_back):
            yield from search.paths(watch.is_over)

    def is_enough() -> bool:
        match options.effort:
            case "first":
                return count > 0
            case "good":
                few, most = _GOOD_CANDIDATES
                return searched >= (most if turns_back else few)
            case "best":
                return False

    for planner, path in ways():
        watch.lap("search")
        shorter = path
        if planner != "direct":
            if count and watch.is_over():
                break
            fits = planner == HYBRID
            shorter = (
                _quick(path, local, search, watch, fits)
                if options.effort == "first"
                else shorten(path, local, rough=waits, fits=fits)
            )
            watch.lap("shorten")
        try:
            # Most that are found by search are never driven from stop to stop.
            timed = None if waits and count and planner != "direct" else _timed(problem, shorter)
            watch.lap("time")
            yield _Way(planner, shorter, path, timed)
        except LimitsInfeasible as error:
            refused = refused or error
        else:
            count += 1
            searched += planner != "direct"
            if options.effort == "good" and turns_back:
                turns_back = reversals(shorter) > 0
                # On an open floor no way is better than a direct one.
                if planner == "direct" and count == 1 and is_far(shorter, robot, local.world):
                    turns_back = False
        if is_enough() or watch.is_over():
            break
        if planner != "direct" and options.effort == "good" and search.allowance is None:
            # More ways are worth about as much work again as the first took.
            search.allowance = 2 * search.work + _WORK
    if count == 0:
        raise refused or NoPathFound(
            f"the time budget of {options.time_budget:g} s ended before a path was found",
            search.tried,
            search.nearest,
        )


def _quick(found: Path, quick: Connector, search: Search, watch: Stopwatch, fits: bool) -> Path:
    """A way found, shortened for effort first; where it is a detour, the best of it and a few others."""
    path = shorten(found, quick, fits=fits)
    crow = math.dist(path[0].start[:2], path[-1].end[:2])
    if sum(piece.length for piece in path) <= _DETOUR * crow:
        return path
    others = [shorten(other, quick) for other in search.others(watch.is_over)]
    return min([path, *others], key=quick.duration)


def _plain(
    problem: Problem,
    local: Connector,
    goals: list[Pose],
    near: Candidate,
    search: Search,
    watch: Stopwatch,
) -> list[Candidate]:
    """What effort first makes of a way found, or of a direct one: others are the quickest once they flow, but
    not all of them can be made to."""
    robot = problem.robot
    quick = connector(robot, local.world, replace(problem.options, effort="first"))
    path = next(_direct(problem.start, quick, goals), None)
    planner = "direct" if path else near.planner
    path = path or _quick(near.found, quick, search, watch, near.planner == HYBRID)
    watch.lap("shorten")
    if near.planner == "direct" and path == near.found:
        return []  # it is near itself
    try:
        timed = _timed(problem, path)
    except LimitsInfeasible:
        return []
    finally:
        watch.lap("time")
    return [Candidate(planner, timed, path)]


def _direct(start: Pose, local: Connector, goals: list[Pose]) -> Iterator[Path]:
    """The quickest free ways, by estimate, that need no search: a few, each checked when asked for."""
    tried = local.direct(np.repeat([start], len(goals), 0), np.array(goals))
    return islice(free_paths(tried), _DIRECT_CANDIDATES)


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


def _timed(problem: Problem, path: Path) -> Phases:
    """The motion along a path with stops."""
    period, reach = problem.options.sample_period, problem.robot.footprint.reach
    way = sum(piece.length + reach * abs(piece.turn) for piece in path)
    if way > MAX_WAY:
        raise LimitsInfeasible(
            f"the footprint would move {way:.6g} m, more than the {MAX_WAY:g} m of a plan that can be checked"
        )
    timed = time_path(path, problem.robot.drive, problem.robot.limits, problem.steering)
    if timed.duration / period > MAX_SAMPLES:
        raise LimitsInfeasible(
            f"the motion would take {timed.duration:.6g} s, more than {MAX_SAMPLES} samples of {period:g} s"
        )
    return timed
