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
from planner.errors import LimitsInfeasible, NoPathExists, NoPathFound, TooManySamples
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

__all__ = ["MAX_WAY", "Candidate", "candidates"]

MAX_WAY = 1e5
"""A motion on which the footprint moves farther, m, is refused: the certificate's check of it takes long."""

_DIRECT_CANDIDATES, _GOOD_CANDIDATES = 6, (8, 10)
"""Ways to the goal: direct ones; those found by search, and how many where all turn back."""
_GOOD_TRIES, _GOOD_ROUNDS, _BEST_ROUNDS = 3, 1, 6
_DRAWS = 1_000_000
"""What is added to the seed for the search that goes on at effort best."""
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
    stops, if that is known."""

    planner: str
    path: Path
    found: Path
    timed: Phases | None = None

    def stopping(self, timed: Phases) -> Candidate:
        return Candidate(self.planner, timed, self.found)


def candidates(
    problem: Problem, local: Connector, goals: list[Pose], watch: Stopwatch
) -> Iterator[list[Candidate]]:
    """Motions to choose from, each list with the fastest first; at least one motion, or a PlanningError.

    Every effort begins with all that the one below it does, so its plan is no slower. First: one motion, with
    stops. Good: one list of that motion and of what optimizing a few ways gives; then, if none of these will
    do, what optimizing the others with patience gives. Best: list after list as time allows, of whatever is
    found: with stops, then optimized.
    """
    effort, limits = problem.options.effort, problem.robot.limits
    quick = connector(problem.robot, local.world, replace(problem.options, effort="first"))
    search = Search(
        quick, problem.environment, problem.start, goals, problem.options.seed,
        lambda: _refuse_if_separated(problem, local.world),
    )  # fmt: skip
    paths = search.paths(watch.is_over)
    first = _first(problem, quick, goals, search, paths, watch)
    assert first.timed is not None
    if effort != "good":
        yield [first.stopping(first.timed)]
    if effort == "first":
        return
    optimizer = Optimizer(problem, local.world, watch.is_over)
    if first.planner != "direct":
        paths = chain([(first.planner, first.found)], paths)
    ways = list(_ways(problem, local, goals, search, paths, watch))
    yield from _good(problem, first, ways, optimizer, watch)
    if effort == "good":
        return
    # Other draws than those of the first search.
    search.seed, search.allowance = search.seed + _DRAWS, None
    known: set[float] = set()
    for planner, path in chain([(way.planner, way.found) for way in ways], search.paths(watch.is_over)):
        watch.lap("search")
        if watch.is_over():
            return
        way = _Way(planner, path if planner == "direct" else shorten(path, local), path)
        watch.lap("shorten")
        near = _stopping(problem, way, watch)
        # A search often finds the same way again.
        if near is None or round(near.timed.duration, 6) in known:
            continue
        known.add(round(near.timed.duration, 6))
        yield _hastened([near], limits, watch)
        if not watch.is_over(optimizer.longest):
            yield _optimized(replace(way, timed=near.timed), _BEST_ROUNDS, optimizer, watch)


def _good(
    problem: Problem, first: _Way, ways: list[_Way], optimizer: Optimizer, watch: Stopwatch
) -> Iterator[list[Candidate]]:
    """What effort good makes of ways, and of what effort first found."""
    drive, limits = problem.robot.drive, problem.robot.limits
    times = {way: flowing_time(way.path, drive, limits) for way in ways}
    ways = sorted(ways, key=times.__getitem__)
    flowed: dict[_Way, Candidate] = {}
    stuck: list[_Way] = []
    best: _Way | None = None
    for way in ways[:_GOOD_TRIES]:
        if watch.is_over(optimizer.longest):
            break
        if best is not None:
            over = min(_duration(flowed[best]) / times[best], _OVER)
            if over * (_HOPE if reversals(best.path) else 1.0) * times[way] >= _duration(flowed[best]):
                break
        # A search often finds the same way again.
        if any(abs(times[way] / times[other] - 1) < _SAME for other in flowed):
            continue
        if faster := _optimized(way, _GOOD_ROUNDS, optimizer, watch):
            (flowed[way],) = faster
            if best is None or _duration(flowed[way]) < _duration(flowed[best]):
                best = way
        else:
            stuck.append(way)
    assert first.timed is not None
    stopping = first.stopping(first.timed)
    # A way that cannot be made to flow may still be the quickest.
    most = _duration(stopping) if best is None else min(_duration(stopping), _duration(flowed[best]))
    others = [_stopping(problem, way, watch) for way in stuck if best is not None and times[way] < most]
    found = [stopping, *flowed.values(), *(each for each in others if each is not None)]
    yield _hastened(sorted(found, key=_duration), limits, watch)
    patient = replace(optimizer, iterations=_PATIENCE)
    # What its check refuses would be found again.
    for way in [way for way in ways[:_GOOD_TRIES] if way not in flowed]:
        if watch.is_over(optimizer.longest * _PATIENCE / optimizer.iterations):
            break
        if times[way] < _HASTE * _duration(stopping):
            yield _optimized(way, _GOOD_ROUNDS, patient, watch)
    rest = [_stopping(problem, way, watch) for way in ways if not watch.is_over()]
    yield _hastened([near for near in rest if near is not None], limits, watch)


def _optimized(way: _Way, rounds: int, optimizer: Optimizer, watch: Stopwatch) -> list[Candidate]:
    """The fastest motion found near a way, if it is faster."""
    faster = optimizer.faster(way.timed or way.path, rounds)
    watch.lap("optimize")
    return [] if faster is None else [Candidate(way.planner, faster, way.found, True)]


def _stopping(problem: Problem, way: _Way, watch: Stopwatch) -> Candidate | None:
    """The motion along a way with stops, if the limits allow one."""
    try:
        return way.stopping(_timed(problem, way.path))
    except LimitsInfeasible:
        return None
    finally:
        watch.lap("time")


def _hastened(found: list[Candidate], limits: Limits, watch: Stopwatch) -> list[Candidate]:
    """Motions, and those that may become the fastest retimed, too; the fastest first."""
    best, made = math.inf, []
    for near in sorted(found, key=_duration):
        made.append(near)
        if _HASTE * near.timed.duration < best:
            if not near.optimized:
                faster = hastened(near.timed, limits, watch.is_over)
                if faster is not near.timed:
                    made.append(replace(near, timed=faster))
            best = min(best, made[-1].timed.duration)
    watch.lap("optimize")
    return sorted(made, key=_duration)


def _duration(candidate: Candidate) -> float:
    return candidate.timed.duration


def _first(
    problem: Problem,
    quick: Connector,
    goals: list[Pose],
    search: Search,
    paths: Iterator[tuple[str, Path]],
    watch: Stopwatch,
) -> _Way:
    """What effort first finds: a direct way, or else one of the search's paths. Raises a PlanningError."""
    refused: LimitsInfeasible | None = None

    def found() -> Iterator[tuple[str, Path]]:
        for path in _direct(problem.start, quick, goals):
            yield "direct", path
        # If the limits forbid the direct ways, a search finds no better ones.
        searches = refused is None
        # Not `yield from`: it would close the search, which goes on later.
        while searches and (searched := next(paths, None)) is not None:
            yield searched

    for planner, path in found():
        watch.lap("search")
        work = search.work
        shorter = path if planner == "direct" else _quick(path, quick, search, watch, planner == HYBRID)
        watch.lap("shorten")
        try:
            way = _Way(planner, shorter, path, _timed(problem, shorter))
        except LimitsInfeasible as error:
            refused = refused or error
        else:
            # More ways are worth about as much work again as the first took.
            search.allowance = search.work + work + _WORK
            return way
        finally:
            watch.lap("time")
        if watch.is_over():
            break
    raise refused or NoPathFound(
        f"the time budget of {problem.options.time_budget:g} s ended before a path was found",
        search.tried,
        search.nearest,
    )


def _ways(
    problem: Problem,
    local: Connector,
    goals: list[Pose],
    search: Search,
    paths: Iterator[tuple[str, Path]],
    watch: Stopwatch,
) -> Iterator[_Way]:
    """The ways that effort good chooses from: direct ones, and of the search's if there are none, or all turn
    back."""
    direct = list(_direct(problem.start, local, goals))
    watch.lap("search")
    yield from (_Way("direct", path, path) for path in direct)
    turns_back = all(reversals(path) for path in direct)
    # On an open floor no way is better than a direct one.
    if direct and is_far(direct[0], problem.robot, local.world):
        return
    if direct and not (turns_back or _is_slow(direct, problem, local, goals)):
        return
    if direct:
        search.allowance = _WORK
    few, most = _GOOD_CANDIDATES
    for count, (planner, path) in enumerate(paths, 1):
        watch.lap("search")
        if (direct or count > 1) and watch.is_over():
            return
        shorter = shorten(path, local, rough=True, fits=planner == HYBRID)
        watch.lap("shorten")
        yield _Way(planner, shorter, path)
        turns_back = turns_back and reversals(shorter) > 0
        if count >= (most if turns_back else few):
            return


def _quick(found: Path, quick: Connector, search: Search, watch: Stopwatch, fits: bool) -> Path:
    """A way found, shortened for effort first; where it is a detour, the best of it and a few others."""
    path = shorten(found, quick, fits=fits)
    crow = math.dist(path[0].start[:2], path[-1].end[:2])
    if sum(piece.length for piece in path) <= _DETOUR * crow:
        return path
    others = [shorten(other, quick) for other in search.others(watch.is_over)]
    return min([path, *others], key=quick.duration)


def _is_slow(direct: list[Path], problem: Problem, local: Connector, goals: list[Pose]) -> bool:
    """Whether free direct ways take longer than the quickest direct way that is not free: a way round what
    blocks that one may be quicker."""
    tried = local.direct(np.repeat([problem.start], len(goals), 0), np.array(goals))
    quickest = min(tried, key=lambda motions: float(motions.times.min(initial=math.inf)))
    pair, way = np.unravel_index(np.argmin(quickest.times), quickest.times.shape)
    drive, limits = problem.robot.drive, problem.robot.limits
    least = flowing_time(quickest.path(int(pair), int(way)), drive, limits)
    return min(flowing_time(path, drive, limits) for path in direct) > _OVER * least


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
    options, reach = problem.options, problem.robot.footprint.reach
    way = sum(piece.length + reach * abs(piece.turn) for piece in path)
    if way > MAX_WAY:
        raise LimitsInfeasible(
            f"the footprint would move {way:.6g} m, more than the {MAX_WAY:g} m of a plan that can be checked"
        )
    timed = time_path(path, problem.robot.drive, problem.robot.limits, problem.steering)
    if timed.duration / options.sample_period > options.max_samples - 1:
        raise TooManySamples(timed.duration, options.sample_period, options.max_samples)
    return timed
