"""The same request, the same plan; and more effort, a better one."""

from __future__ import annotations

import hashlib
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from planner.plan import Plan, plan
from planner.problem import Environment, Problem
from tests.planner.plans import JOURNEYS, KINDS, Ask, closes, keeps_limits

DIGEST = """
import hashlib, pickle, sys
from planner.plan import plan
for problem in pickle.load(sys.stdin.buffer):
    made = plan(problem).schedule
    columns = (made.time, made.wheel_angle, made.wheel_velocity, made.wheel_acceleration,
               made.steering_angle, made.steering_rate, made.pose, made.twist)
    print(hashlib.sha256(b"".join(column.tobytes() for column in columns)).hexdigest())
"""


def digest(problem: Problem) -> str:
    made = plan(problem).schedule
    columns = (
        made.time, made.wheel_angle, made.wheel_velocity, made.wheel_acceleration,
        made.steering_angle, made.steering_rate, made.pose, made.twist,
    )  # fmt: skip
    return hashlib.sha256(b"".join(column.tobytes() for column in columns)).hexdigest()


def test_same_seed_same_plan_bit_for_bit_in_any_process(ask: Ask, clutter: Environment) -> None:
    problems = [
        ask(kind, *JOURNEYS["clutter"], clutter, effort=effort, time_budget=60.0)
        for kind, effort in (
            ("differential", "first"), ("differential", "good"), ("ackermann", "good"), ("swerve", "first"),
            ("omni", "good"), ("powered_caster", "good"),
        )
    ]  # fmt: skip
    here = [digest(problem) for problem in problems]
    assert [digest(problem) for problem in reversed(problems)][::-1] == here
    elsewhere = subprocess.run(
        [sys.executable, "-c", DIGEST],
        input=pickle.dumps(problems), capture_output=True, check=True, timeout=120,
        cwd=Path(__file__).parents[2],
    )  # fmt: skip
    assert elsewhere.stdout.decode().split() == here


@pytest.mark.parametrize("scene", list(JOURNEYS))
@pytest.mark.parametrize(
    ("kind", "reverse"), [*((kind, True) for kind in KINDS), ("ackermann", False), ("omni", False)]
)
def test_more_effort_never_gives_a_slower_plan(
    ask: Ask, clutter: Environment, floor: Environment, kind: str, reverse: bool, scene: str
) -> None:
    first, good, best = (
        plan(
            ask(kind, *JOURNEYS[scene], clutter if scene == "clutter" else floor, effort=effort,
                reverse=reverse, time_budget=1.5)
        ).duration
        for effort in ("first", "good", "best")
    )  # fmt: skip
    assert best <= good <= first


@pytest.mark.parametrize(("kind", "reverse"), [("ackermann", True), ("ackermann", False), ("omni", True)])
def test_effort_good_costs_a_few_times_the_first_at_most(
    ask: Ask, clutter: Environment, kind: str, reverse: bool
) -> None:
    first, good = (
        plan(ask(kind, *JOURNEYS["clutter"], clutter, effort=e, reverse=reverse, time_budget=5.0)).planning
        for e in ("first", "good")
    )
    assert good["timings"]["total"] <= 8 * first["timings"]["total"] + 0.5


def test_effort_best_uses_its_time_and_no_more(ask: Ask, clutter: Environment) -> None:
    problem = ask("differential", *JOURNEYS["clutter"], clutter, effort="best", time_budget=0.7)
    made = plan(problem)
    assert 0.5 < made.planning["timings"]["total"] < 2.0
    assert keeps_limits(made)


def test_effort_best_tells_of_each_certified_plan_faster_than_the_one_before(
    ask: Ask, clutter: Environment
) -> None:
    told: list[Plan] = []
    final = plan(
        ask("differential", *JOURNEYS["clutter"], clutter, effort="best", time_budget=1.5), told.append
    )
    durations = [made.duration for made in told]
    assert len(durations) > 1
    assert np.all(np.diff(durations) < 0.0)
    assert final.duration == durations[-1]
    assert all(keeps_limits(made) and closes(made) for made in told)
