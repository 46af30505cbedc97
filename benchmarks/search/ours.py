"""The queries through the planner, in this process: what each plan took, and what it failed with."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from benchmarks.search.mobilities import Mobility
from benchmarks.search.scenes import Query, problem, world
from drives.se2 import Array
from planner.connect import connector
from planner.curves import SEGMENTS
from planner.edges import joined
from planner.environment import CollisionWorld
from planner.errors import PlanningError
from planner.plan import plan
from planner.problem import Environment

__all__ = ["Ours", "in_legs", "prepare", "run", "run_one", "time_motions"]


@dataclass(frozen=True, slots=True)
class Ours:
    """One query: seconds that plan() took; length m, 0 where it failed; who found the way, or why not;
    seconds by stage."""

    solved: bool
    total: float
    length: float
    by: str
    stages: dict[str, float] = field(default_factory=dict)


def prepare(environment: Environment, mobility: Mobility) -> float:
    """Seconds until a world stands of which nothing was known to this process before."""
    begin = time.perf_counter()
    CollisionWorld.build(environment, mobility.robot.footprint)
    return time.perf_counter() - begin


def run(mobility: Mobility, queries: Iterable[Query], budget: float) -> list[Ours]:
    """Every query once, effort "first", its world looked at before as one that serves many requests is."""
    made = []
    for query in queries:
        world(query, mobility)
        made.append(run_one(mobility, query, budget))
    return made


def run_one(mobility: Mobility, query: Query, budget: float) -> Ours:
    """One query."""
    asked = problem(query, mobility, effort="first", time_budget=budget)
    begin = time.perf_counter()
    try:
        made = plan(asked)
    except PlanningError as error:
        return Ours(False, time.perf_counter() - begin, 0.0, f"{type(error).__name__}: {error}")
    total = time.perf_counter() - begin
    return Ours(True, total, made.length, made.planning["planner"], made.planning["timings"])


def in_legs(mobility: Mobility, query: Query, budget: float) -> float | None:
    """Length (m) of the way by way of the poses that the query names; None where a leg is not found."""
    poses = (query.start, *query.via, query.goal)
    legs = [run_one(mobility, Query(query.draw, query.environment, a, b), budget) for a, b in pairwise(poses)]
    return sum(leg.length for leg in legs) if all(leg.solved for leg in legs) else None


def time_motions(mobility: Mobility, environment: Environment, a: Array, b: Array) -> float:
    """Seconds that checking the motions from poses a (n, 3) to b takes, one by one as a search does."""
    free = CollisionWorld.build(environment, mobility.robot.footprint)
    joins = connector(mobility.robot, free, mobility.options)
    law, steps = joins.law, np.empty((SEGMENTS, 3))
    pairs = np.hstack([a, b]).tolist()
    begin = time.perf_counter()
    for pair in pairs:
        joined(free.kernel, law.kind, law.radius, law.reverse, *pair, steps)
    return time.perf_counter() - begin
