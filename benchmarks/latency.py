"""How long a plan takes, and what optimizing gains: every request in examples/, effort first and good, warm.

python -m benchmarks.latency [--repeat N]
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from api.convert import to_problem
from api.schemas import PlanRequest
from planner.plan import Plan, plan
from planner.problem import Problem
from planner.warm_up import warm_up

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


def no_map(*_: Any) -> Any:
    raise LookupError("requests on a map are the demo's")


def timed(problem: Problem, effort: str, repeat: int) -> tuple[Plan, list[float]]:
    """The plan, and how long (ms) it took each time."""
    stated = replace(problem, options=replace(problem.options, effort=effort, time_budget=10.0))
    made = plan(stated)
    took = []
    for _ in range(repeat):
        begin = time.perf_counter()
        made = plan(stated)
        took.append((time.perf_counter() - begin) * 1e3)
    return made, took


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--repeat", type=int, default=20)
    repeat = parser.parse_args().repeat
    warm_up()
    print(
        f"{'request':16}{'first: ms (p90)':>18}{'motion':>9}{'good: ms (p90)':>18}{'motion':>9}{'ratio':>7}"
    )
    ratios = []
    for file in sorted(EXAMPLES.glob("*.json")):
        problem = to_problem(PlanRequest.model_validate(json.loads(file.read_text())), no_map, 30.0)
        row, durations = f"{file.stem:16}", []
        for effort in ("first", "good"):
            made, took = timed(problem, effort, repeat)
            p90 = statistics.quantiles(took, n=10)[-1]
            row += f"{statistics.median(took):9.0f} ({p90:4.0f})  {made.duration:7.2f} s"
            durations.append(made.duration)
        ratios.append(durations[1] / durations[0])
        print(f"{row}{ratios[-1]:7.2f}")
    print(f"duration good / first: median {statistics.median(ratios):.2f}, worst {max(ratios):.2f}")


if __name__ == "__main__":
    main()
