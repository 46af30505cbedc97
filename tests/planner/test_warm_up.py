"""After the warm-up of a process no plan waits for a kernel to be compiled or loaded."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np

from planner.problem import Bounds, Environment, Polygon
from tests.planner.plans import JOURNEYS, KINDS, Ask

LATE = """
import gc, pickle, sys
from contextlib import suppress
from numba.core.registry import CPUDispatcher
from planner.errors import NoPathExists
from planner.plan import plan
from planner.warm_up import warm_up

def kernels():
    return {
        (kernel.py_func.__module__, kernel.py_func.__name__, types)
        for kernel in gc.get_objects() if isinstance(kernel, CPUDispatcher)
        for types in kernel.signatures if kernel.py_func.__module__.startswith("planner.")
    }

warm_up()
warm = kernels()
for problem in pickle.load(sys.stdin.buffer):
    with suppress(NoPathExists):
        plan(problem)
print(len(warm), *sorted(str(kernel) for kernel in kernels() - warm), sep="\\n")
"""


def test_plans_after_the_warm_up_find_every_kernel_ready(
    ask: Ask, floor: Environment, clutter: Environment
) -> None:
    places = {"floor": floor, "clutter": clutter}
    shut = Environment(Bounds(-5, -5, 5, 5), (Polygon(np.array([[-1, -5], [1, -5], [1, 5], [-1, 5]])),))
    problems = [ask(kind, *JOURNEYS[place], places[place]) for kind in KINDS for place in places]
    problems += [ask(kind, *JOURNEYS["clutter"], clutter, effort="good") for kind in KINDS]
    problems += [ask(kind, *JOURNEYS["floor"], steering=0.1) for kind in ("tricycle", "swerve")]
    problems += [ask(kind, *JOURNEYS["clutter"], clutter, reverse=False) for kind in ("tricycle", "tracked")]
    problems += [ask(kind, *JOURNEYS["floor"], shut) for kind in ("omni", "tricycle", "tracked")]
    jerk = {"wheel_jerk": 80.0}
    problems += [ask("mecanum", *JOURNEYS["clutter"], clutter, limits=jerk)]
    problems += [
        ask(kind, *JOURNEYS["clutter"], clutter, effort="good", limits=jerk)
        for kind in ("ackermann", "swerve")
    ]
    done = subprocess.run(
        [sys.executable, "-c", LATE], input=pickle.dumps(problems), capture_output=True, check=True,
        timeout=240, cwd=Path(__file__).parents[2],
    )  # fmt: skip
    warm, *late = done.stdout.decode().splitlines()
    assert int(warm) > 20
    assert late == []
