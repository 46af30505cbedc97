"""Planned durations over the best known ones, and planning times.

python -m benchmarks.duration [--drive D ...] [--set open|clutter] [--effort first good best] [--limit N]
                              [--jerk] [--refresh]
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from benchmarks.duration import jerk
from benchmarks.duration.queries import COUNT, SETS, Set, query
from benchmarks.duration.reference import Known, load, save
from benchmarks.duration.robots import ROBOTS
from planner.errors import PlanningError
from planner.plan import plan
from planner.problem import Options, Problem
from planner.warm_up import warm_up

_EFFORTS = ("first", "good", "best")
_BUDGET = 3.0
_FASTER = 1e-3
"""Share by which a plan must beat its reference to be worth a word."""
_HEADER = (
    f"{'drive':15}{'set':9}{'effort':7}{'n':>3}{'median':>9}{'90 %':>7}{'worst':>7}"
    f"{'time: median':>15}{'worst':>7}  worst queries"
)


@dataclass
class _Row:
    """One planned query."""

    draw: int
    duration: float | None
    planning: float
    failure: str = ""


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.duration", description=__doc__.split("\n")[0])
    parser.add_argument("--drive", nargs="+", choices=list(ROBOTS), default=list(ROBOTS))
    parser.add_argument("--set", choices=get_args(Set), default=None)
    parser.add_argument("--effort", nargs="+", choices=_EFFORTS, default=list(_EFFORTS))
    parser.add_argument("--limit", type=int, default=COUNT, help="queries of every set")
    parser.add_argument("--refresh", action="store_true", help="keep faster plans as the reference")
    parser.add_argument(
        "--jerk", action="store_true", help="limit the wheels' jerk instead, and compare with TOPP3"
    )
    given = parser.parse_args()
    warm_up()
    if given.jerk:
        jerk.main(given.drive, given.limit)
        return
    known = load()
    print(_HEADER)
    for drive in given.drive:
        for which in SETS if given.set is None else (given.set,):
            references = known.get(drive, {}).get(which, [])[: given.limit]
            problems = [query(drive, which, reference.draw) for reference in references]
            if problems:
                _planned(replace(problems[0], options=Options(time_budget=_BUDGET)), 0)
            for effort in given.effort if problems else ():
                options = Options(time_budget=_BUDGET, effort=effort)
                rows = [
                    _planned(replace(problem, options=options), reference.draw)
                    for problem, reference in zip(problems, references, strict=True)
                ]
                _report(drive, which, effort, rows, references)
                if given.refresh:
                    _refresh(effort, rows, references)
    if given.refresh:
        save(known, "python -m benchmarks.duration " + " ".join(sys.argv[1:]))


def _planned(problem: Problem, draw: int) -> _Row:
    begin = time.perf_counter()
    try:
        made = plan(problem)
    except PlanningError as error:
        return _Row(draw, None, time.perf_counter() - begin, f"{type(error).__name__}: {error}")
    return _Row(draw, made.duration, time.perf_counter() - begin)


def _report(drive: str, which: Set, effort: str, rows: list[_Row], references: list[Known]) -> None:
    solved = [(row, known) for row, known in zip(rows, references, strict=True) if row.duration is not None]
    times = [row.planning for row in rows]
    ratio = np.array([row.duration / known.duration for row, known in solved])
    line = f"{drive:15}{which:9}{effort:7}{len(rows):3}"
    if solved:
        line += f"{np.median(ratio):9.3f}{np.quantile(ratio, 0.9):7.3f}{ratio.max():7.3f}"
    line += f"{np.median(times):13.2f} s{max(times):6.2f} s"
    worst = np.argsort(-ratio)[:3]
    print(line + "  " + ", ".join(f"{solved[i][0].draw}: {ratio[i]:.3f}" for i in worst), flush=True)
    for row in rows:
        if row.failure:
            print(f"    {row.draw}: {row.failure}")
    for (row, known), share in zip(solved, ratio, strict=True):
        if share < 1 - _FASTER:
            print(f"    {row.draw}: {row.duration:.3f} s is faster than the reference {known.duration:.3f} s "
                  f"({share:.3f})")  # fmt: skip


def _refresh(effort: str, rows: list[_Row], references: list[Known]) -> None:
    for row, known in zip(rows, references, strict=True):
        if row.duration is not None and row.duration < known.duration:
            known.duration, known.by = row.duration, f"planner {effort}"


if __name__ == "__main__":
    main()
