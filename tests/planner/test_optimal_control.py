"""Solvers are built once a shape, and how long that takes is foreseen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.duration.queries import query
from planner import optimal_control
from planner.optimal_control import build_time, solver
from planner.plan import plan
from planner.problem import Options
from planner.shape import Shape

CASTERS = Shape(
    "twist", 0, 3, 2, jerk=True, given="all", forward=False, trail=True, pushes=False
)  # fmt: skip


def test_a_solver_that_is_kept_takes_no_time_and_another_one_some() -> None:
    shape = replace(CASTERS, trail=False, jerk=False)
    solver(shape)
    assert build_time(shape) == 0.0
    assert build_time(replace(shape, planes=shape.planes + 1)) > 0.02
    assert build_time(CASTERS) > 2 * build_time(replace(CASTERS, jerk=False)) > 0.0


def test_no_solver_is_built_if_the_time_budget_would_end_before_it_is() -> None:
    problem = query("powered_caster", "open", 0)
    limits = replace(problem.robot.limits, wheel_jerk=8.3 * problem.robot.limits.wheel_acceleration)
    problem = replace(problem, robot=replace(problem.robot, limits=limits))
    kept = dict(optimal_control._SOLVERS._kept)
    optimal_control._SOLVERS._kept.clear()
    try:
        made = plan(replace(problem, options=Options(time_budget=0.3)))
        assert not optimal_control._SOLVERS._kept
        assert not made.planning["optimized"]
        assert made.planning["cut_short"]
        assert np.isfinite(made.duration)
    finally:
        optimal_control._SOLVERS._kept.update(kept)
