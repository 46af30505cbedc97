"""The best known duration of every query: multi-start direct optimization, independent of the planner's own.

    python -m benchmarks.duration.reference [--drive D ...] [--set open|clutter] [--starts N] [--again]

A query whose reference is stored is passed over unless --again, which looks for a better one.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.duration.certified import Failed, certified
from benchmarks.duration.clearance import half_planes
from benchmarks.duration.direct import PLANES, Guess, program
from benchmarks.duration.queries import COUNT, SEED, SETS, Set, query, solvable, world
from benchmarks.duration.robots import ROBOTS
from benchmarks.duration.starts import from_schedule, other_ways
from drives import PoweredCaster
from drives.se2 import Array
from planner.environment import CollisionWorld
from planner.errors import PlanningError
from planner.plan import plan
from planner.problem import Options, Problem
from planner.schedule import WheelSchedule
from planner.warm_up import warm_up

__all__ = ["Known", "improve", "load", "main", "save"]

STORED = Path(__file__).with_name("reference.json")

_KNOTS = {"open": 60, "clutter": 88}
_MORE = 32
"""Intervals more in clutter where casters take many of them at the ends."""
_ROUNDS = 4
_SPARE = (0.002, 0.01, 0.025)
"""Room (m) at knots for what happens between them, more where it did not do."""
_GAIN = 0.997


@dataclass
class Known:
    """A query, by its draw, its best known duration (s) and where that came from."""

    draw: int
    duration: float = math.inf
    by: str = ""


def load() -> dict[str, dict[str, list[Known]]]:
    """Everything stored, by drive and set."""
    if not STORED.exists():
        return {}
    stored = json.loads(STORED.read_text())["drives"]
    return {
        drive: {which: [Known(**row) for row in rows] for which, rows in sets.items()}
        for drive, sets in stored.items()
    }


def save(known: dict[str, dict[str, list[Known]]], command: str) -> None:
    """Store it, one query a line."""
    before = json.loads(STORED.read_text())["about"].get("commands", []) if STORED.exists() else []
    about = {
        "commands": [*before, command] if command not in before else before,
        "seed": SEED, "python": platform.python_version(),
        **{name: version(name) for name in ("casadi", "numpy")},
    }  # fmt: skip
    drives = []
    for drive in sorted(known):
        sets = []
        for which in sorted(known[drive]):
            rows = [json.dumps({"draw": k.draw, "duration": round(k.duration, 5), "by": k.by})
                    for k in known[drive][which] if k.duration < math.inf]  # fmt: skip
            sets.append(f'   "{which}": [\n    ' + ",\n    ".join(rows) + "\n   ]")
        drives.append(f'  "{drive}": {{\n' + ",\n".join(sets) + "\n  }")
    body = f'{{\n "about": {json.dumps(about)},\n "drives": {{\n' + ",\n".join(drives) + "\n }\n}\n"
    STORED.write_text(body)


def improve(
    drive: str, which: Set, known: Known, starts: int, log: Callable[[str, str], None] | None = None
) -> Known:
    """The best known so far, or a better one. log: told of every attempt and its outcome."""
    problem = query(drive, which, known.draw)
    room = world(problem)
    best = known
    for name, guess in _starts(problem, which, starts):
        for made, how in _solved(drive, which, problem, room, guess):
            if log:
                log(name, how if made is None else f"{made.time[-1]:.4f}")
            if made is not None and made.time[-1] < best.duration - 1e-5:
                best = Known(known.draw, float(made.time[-1]), name)
    for effort, made in _plans(problem, ("first", "good"), (0,)):
        if made.time[-1] < best.duration - 1e-5:
            best = Known(known.draw, float(made.time[-1]), f"planner {effort}")
    return best


def _knots(problem: Problem, which: Set) -> int:
    casters = isinstance(problem.robot.drive, PoweredCaster)
    return _KNOTS[which] + (_MORE if casters and which == "clutter" else 0)


def _starts(problem: Problem, which: Set, most: int) -> Iterator[tuple[str, Guess]]:
    knots = _knots(problem, which)
    seeds = (0,) if which == "open" else tuple(range(2 * most))
    found = sorted(_plans(problem, ("good", "first"), seeds), key=lambda plan: float(plan[1].time[-1]))
    durations: list[float] = []
    for name, made in found:
        duration = float(made.time[-1])
        if all(abs(duration / other - 1) > 0.01 for other in durations) and len(durations) < most:
            durations.append(duration)
            yield f"planner {name}", from_schedule(problem, made, knots)
    if which == "open":
        yield from other_ways(problem, knots, most)


def _plans(
    problem: Problem, efforts: tuple[Any, ...], seeds: tuple[int, ...]
) -> Iterator[tuple[str, WheelSchedule]]:
    for seed in seeds:
        for effort in efforts if seed == seeds[0] else efforts[:1]:
            options = Options(time_budget=3.0, effort=effort, seed=seed)
            try:
                yield f"{effort} {seed}", plan(replace(problem, options=options)).schedule
            except PlanningError:
                continue


def _solved(
    drive: str, which: Set, problem: Problem, room: CollisionWorld, guess: Guess
) -> Iterator[tuple[WheelSchedule | None, str]]:
    """Certified schedules near a guess, or None and why not; in clutter several, each from the one before."""
    knots = _knots(problem, which)
    start, goal = np.array(problem.start), guess.pose[-1].copy()
    goal[:2] = problem.goal.x, problem.goal.y
    assert problem.goal.theta is not None
    goal[2] = problem.goal.theta + math.tau * round((goal[2] - problem.goal.theta) / math.tau)
    spare, best, hit = 0, math.inf, np.zeros((knots + 1, 0, 3))
    for _ in range(_ROUNDS if which == "clutter" else 1):
        planes: Array = np.zeros((knots + 1, 0, 3))
        if which == "clutter":
            planes = half_planes(problem, guess.pose, PLANES - hit.shape[1], _SPARE[spare])
            planes = np.concatenate([planes, hit], 1)
        found = program(drive, knots, which == "clutter").solve(guess, start, goal, planes)
        if found is None:
            yield None, "no solution"
            return
        try:
            made = certified(problem, room, found)
        except Failed as failure:
            yield None, str(failure)
            if which == "open" or str(failure) != "collides" or spare + 1 == len(_SPARE):
                return
            spare += 1
            hit = half_planes(problem, found.pose, 2, _SPARE[spare])
            continue
        yield made, ""
        hit = hit[:, :0]
        if made.time[-1] > _GAIN * best:
            return
        best = float(made.time[-1])
        guess = from_schedule(problem, made, knots)


def _say(name: str, outcome: str) -> None:
    print(f"    {name}: {outcome[:110]}")


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.duration.reference")
    parser.add_argument("--drive", nargs="+", choices=list(ROBOTS), default=list(ROBOTS))
    parser.add_argument("--set", choices=SETS, default=None)
    parser.add_argument("--starts", type=int, default=4)
    parser.add_argument("--limit", type=int, default=COUNT)
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--verbose", action="store_true")
    given = parser.parse_args()
    warm_up()
    known = load()
    for which in SETS if given.set is None else (given.set,):
        for drive in given.drive:
            rows = known.setdefault(drive, {}).setdefault(which, [])
            if len(rows) < given.limit:
                draws = range(COUNT) if which == "open" else solvable(drive, which)
                rows += [
                    Known(draw)
                    for draw in islice(draws, given.limit)
                    if draw > max((r.draw for r in rows), default=-1)
                ]
            begin = time.perf_counter()
            for i, row in enumerate(rows[: given.limit]):
                if row.duration < math.inf and not given.again:
                    continue
                log = _say if given.verbose else None
                rows[i] = improve(drive, which, row, given.starts, log)
                print(drive, which, rows[i].draw, f"{rows[i].duration:.3f}", rows[i].by, flush=True)
                save(known, "python -m benchmarks.duration.reference " + " ".join(sys.argv[1:]))
            print(f"{drive} {which}: {time.perf_counter() - begin:.0f} s", flush=True)


if __name__ == "__main__":
    main()
