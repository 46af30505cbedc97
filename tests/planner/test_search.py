"""What a search finds leads from start to goal, free all the way; else it says what it tried."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable

import numpy as np
import pytest

from drives.se2 import Pose, wrap
from planner.collision import INNER_RADIUS
from planner.connect import connector
from planner.environment import CollisionWorld
from planner.path import Path
from planner.problem import Bounds, Environment, Polygon, Problem
from planner.search import Search
from planner.shorten import shorten

Ask = Callable[..., Problem]
START, GOAL = (-2.4, 0.0, 0.3), (2.2, -0.9, -0.5)
KINDS = ["differential", "omni", "ackermann", "synchro", "powered_caster"]


def search(problem: Problem, *goals: tuple[float, float, float], seed: int = 3) -> Search:
    robot, options = problem.robot, problem.options
    world = CollisionWorld.build(
        problem.environment, robot.footprint, options.min_clearance, robot.drive.fixed_body_heading
    )
    local = connector(robot, world, options)
    return Search(local, problem.environment, problem.start, [Pose(*goal) for goal in goals], seed)


def clock(looks: int) -> Callable[[], bool]:
    """Says that time is up once it has been looked at so many times: the same on any machine."""
    count = itertools.count()
    return lambda *_: next(count) >= looks


def first(asked: Search, count: int) -> list[Path]:
    """The first paths found, within a time that is ample but ends."""
    end = time.monotonic() + 60.0
    found = [path for _, path in itertools.islice(asked.paths(lambda *_: time.monotonic() > end), count)]
    assert len(found) == count, asked.tried
    return found


def is_free(problem: Problem, path: Path) -> bool:
    robot = problem.robot
    world = CollisionWorld.build(
        problem.environment, robot.footprint, 0.0, robot.drive.fixed_body_heading
    )  # built anew: no pose that was checked on the way is taken on trust
    poses = np.concatenate([piece.poses(np.linspace(0.0, 1.0, 300)) for piece in path])
    return bool(world.clearance(poses).min() >= 0.0)


def joins(path: Path, start: Pose, goals: list[Pose]) -> bool:
    """Whether the pieces follow one another from the start to one of the goals, headings mod 2π."""
    ends = [start, *(piece.end for piece in path)]
    gaps = [math.dist(end[:2], piece.start[:2]) for end, piece in zip(ends[:-1], path, strict=True)]
    turns = [abs(wrap(piece.start.theta - end.theta)) for end, piece in zip(ends[:-1], path, strict=True)]
    last = min(max(math.dist(ends[-1][:2], g[:2]), abs(wrap(ends[-1].theta - g.theta))) for g in goals)
    return max(*gaps, *turns, last) < 1e-9


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("reverse", [True, False])
def test_paths_lead_from_start_to_goal_and_are_free(
    ask: Ask, clutter: Environment, kind: str, reverse: bool
) -> None:
    problem = ask(kind, START, GOAL, clutter, reverse=reverse)
    for path in first(search(problem, GOAL), 3):
        assert joins(path, problem.start, [Pose(*GOAL)])
        assert is_free(problem, path)


def test_paths_tell_their_planner_and_every_turn_is_on_record(ask: Ask, clutter: Environment) -> None:
    asked = search(ask("differential", START, GOAL, clutter), GOAL)
    names = [name for name, _ in itertools.islice(asked.paths(clock(10_000)), 3)]
    solved = [turn["planner"] for turn in asked.tried if turn["outcome"] == "solved"]
    assert solved == names
    assert all(turn["motions_checked"] > 0 for turn in asked.tried)


def test_same_seed_same_paths(ask: Ask, clutter: Environment) -> None:
    problem = ask("omni", START, GOAL, clutter)

    def found(seed: int) -> list[Path]:
        return first(search(problem, GOAL, seed=seed), 2)

    once = found(3)
    assert found(4) != once
    assert found(3) == once


@pytest.mark.parametrize("kind", ["differential", "omni", "ackermann"])
def test_any_of_several_goals_will_do(ask: Ask, clutter: Environment, kind: str) -> None:
    goals = [(2.2, -0.9, turn) for turn in (-2.0, -0.5, 1.0, 2.5)]
    problem = ask(kind, START, GOAL, clutter)
    for path in first(search(problem, *goals), 2):
        assert joins(path, problem.start, [Pose(*goal) for goal in goals])
        assert is_free(problem, path)


def box() -> Environment:
    """A goal with four walls round it."""
    sides = [(-1.0, -1.0, 1.0, -0.9), (-1.0, 0.9, 1.0, 1.0), (-1.0, -1.0, -0.9, 1.0), (0.9, -1.0, 1.0, 1.0)]
    walls = tuple(Polygon(np.array([[a, b], [c, b], [c, d], [a, d]])) for a, b, c, d in sides)
    return Environment(Bounds(-3.0, -3.0, 3.0, 3.0), walls)


@pytest.mark.parametrize("kind", KINDS)
def test_a_goal_in_a_closed_box_yields_nothing_and_the_record_says_so(ask: Ask, kind: str) -> None:
    asked = search(ask(kind, (-2.0, -2.0, 0.0), (0.0, 0.0, 0.0), box()), (0.0, 0.0, 0.0))
    assert list(asked.paths(clock(200))) == []
    assert len(asked.tried) >= 1
    assert {turn["outcome"] for turn in asked.tried} == {"not solved"}


def test_the_goal_outside_the_box_is_the_one_reached(ask: Ask) -> None:
    problem = ask("omni", (-2.0, -2.0, 0.0), (0.0, 0.0, 0.0), box())
    outside = (2.0, 2.0, 1.0)
    (path,) = first(search(problem, (0.0, 0.0, 0.0), outside), 1)
    assert joins(path, problem.start, [Pose(*outside)])


def test_no_time_no_turn(ask: Ask, clutter: Environment) -> None:
    asked = search(ask("omni", START, GOAL, clutter), GOAL)
    assert list(asked.paths(lambda *_: True)) == []
    assert asked.tried == []


@pytest.mark.parametrize("kind", ["differential", "omni", "ackermann"])
def test_others_are_free_and_not_the_same(ask: Ask, clutter: Environment, kind: str) -> None:
    problem = ask(kind, START, GOAL, clutter)
    others = 0
    for seed in range(6):
        asked = search(problem, GOAL, seed=seed)
        found = [*first(asked, 1), *asked.others(lambda *_: False)]
        assert len(set(found)) == len(found)
        others += len(found) - 1
        for path in found:
            assert joins(path, problem.start, [Pose(*GOAL)])
            assert is_free(problem, path)
    assert others > 0


@pytest.mark.parametrize("kind", ["differential", "omni", "ackermann"])
def test_a_short_way_takes_no_more_work_on_a_larger_floor(ask: Ask, clutter: Environment, kind: str) -> None:
    wide = Environment(Bounds(-500.0, -500.0, 500.0, 500.0), clutter.obstacles)
    wider = Environment(Bounds(-5000.0, -5000.0, 5000.0, 5000.0), clutter.obstacles)
    worked = []
    for environment in (wide, wider):
        asked = search(ask(kind, START, GOAL, environment), GOAL)
        first(asked, 1)
        worked.append(asked.work)
    assert worked[0] == worked[1] < 300


def test_doubts_are_told_after_the_first_search_failed(ask: Ask, clutter: Environment) -> None:
    def doubt() -> None:
        raise RuntimeError

    problem = ask("omni", (-2.0, -2.0, 0.0), (0.0, 0.0, 0.0), box())
    asked = search(problem, (0.0, 0.0, 0.0))
    asked.doubt = doubt
    with pytest.raises(RuntimeError):
        next(asked.paths(lambda *_: False))
    assert len(asked.tried) == 1
    asked = search(ask("omni", START, GOAL, clutter), GOAL)
    asked.doubt = doubt
    next(asked.paths(lambda *_: False))


# ---------------------------------------------------------------- shortening


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_shortened_path_is_free_no_slower_and_joins_the_same_poses(
    ask: Ask, clutter: Environment, kind: str, seed: int
) -> None:
    problem = ask(kind, START, GOAL, clutter)
    asked = search(problem, GOAL, seed=seed)
    (path,) = first(asked, 1)
    shorter = shorten(path, asked.connector)
    assert joins(shorter, problem.start, [Pose(*GOAL)])
    assert is_free(problem, shorter)
    assert asked.connector.duration(shorter) <= asked.connector.duration(path) + 1e-9
    assert shorter[0].start.theta == pytest.approx(problem.start.theta)
    for piece, after in itertools.pairwise(shorter):
        assert after.start.theta == pytest.approx(piece.end.theta, abs=1e-9)
    assert sum(piece.length for piece in shorter) < 30.0


# ---------------------------------------------------------------- passages


def passage(middle: float, gap: float) -> Environment:
    """Two rooms, and a corridor along x between them."""
    walls = ((-1.0, -3.0, 1.0, middle - gap / 2), (-1.0, middle + gap / 2, 1.0, 3.0))
    return Environment(
        Bounds(-6.0, -3.0, 6.0, 3.0),
        tuple(Polygon(np.array([[a, b], [c, b], [c, d], [a, d]])) for a, b, c, d in walls),
    )


@pytest.mark.parametrize("kind", ["differential", "omni", "ackermann"])
@pytest.mark.parametrize("middle", [0.0, 0.37, -0.81])
def test_a_corridor_hardly_wider_than_the_robot_takes_little_work(ask: Ask, kind: str, middle: float) -> None:
    start = Pose(-3.5, 0.2, 0.5)
    problem = ask(kind, start, (3.5, 0.0, -0.4), passage(middle, 0.0))
    gap = 2 * float(search(problem).connector.world.kernel[INNER_RADIUS] + problem.robot.footprint.radius)
    problem = ask(kind, start, (3.5, 0.0, -0.4), passage(middle, gap + 0.06))
    asked = search(problem, (3.5, 0.0, -0.4))
    (path,) = first(asked, 1)
    assert is_free(problem, path)
    assert asked.work < 5_000
