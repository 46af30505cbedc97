"""Where there is no plan, plan() says why: a stable code, and details that are JSON."""

from __future__ import annotations

import json
import math
import pickle
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from drives import DRIVES
from drives.se2 import Pose
from planner import errors
from planner.candidates import MAX_WAY
from planner.errors import (
    AuditFailed,
    InvalidGeometry,
    LimitsInfeasible,
    NoPathExists,
    NoPathFound,
    PlanningError,
    PoseInCollision,
    PoseOutOfBounds,
    TooManySamples,
)  # fmt: skip
from planner.plan import plan
from planner.problem import MAX_SAMPLES, Bounds, Circle, Environment, Footprint, Polygon, Problem

Ask = Callable[..., Problem]
POST = (Circle(0.0, 0.0, 0.3),)
AROUND = Bounds(-5.0, -5.0, 5.0, 5.0)


def refused(problem: Problem) -> PlanningError:
    with pytest.raises(PlanningError) as caught:
        plan(problem)
    json.dumps(caught.value.details, allow_nan=False)
    assert len(caught.value.message) > 10
    return caught.value


def with_footprint(problem: Problem, vertices: list[list[float]], radius: float = 0.0) -> Problem:
    return replace(problem, robot=replace(problem.robot, footprint=Footprint(np.array(vertices), radius)))


# ---------------------------------------------------------------- start and goal


@pytest.mark.parametrize("kind", DRIVES)
@pytest.mark.parametrize("which", ["start", "goal"])
def test_a_pose_in_collision_is_named_with_how_deep_it_is(ask: Ask, kind: str, which: str) -> None:
    inside, free = (0.1, 0.0, 0.2), (2.0, 1.0, 0.0)
    ends = (inside, free) if which == "start" else (free, inside)
    error = refused(ask(kind, *ends, Environment(AROUND, POST)))
    assert isinstance(error, PoseInCollision)
    assert error.code == f"{which}-in-collision"
    assert error.details["pose"] == {"x": 0.1, "y": 0.0, "theta": 0.2}
    assert -1.0 < error.details["clearance"] < 0.0


@pytest.mark.parametrize("which", ["start", "goal"])
def test_depth_is_the_distance_that_parts_them(ask: Ask, which: str) -> None:
    # a disc of 0.2 m whose centre is 0.45 m from that of a disc of 0.3 m
    inside, free = (0.45, 0.0, 0.0), (2.0, 1.0, 0.0)
    ends = (inside, free) if which == "start" else (free, inside)
    problem = with_footprint(ask("omni", *ends, Environment(AROUND, POST)), [[0.0, 0.0]], 0.2)
    assert refused(problem).details["clearance"] == pytest.approx(-0.05, abs=1e-6)


@pytest.mark.parametrize("which", ["start", "goal"])
def test_a_pose_nearer_than_min_clearance_is_in_collision(ask: Ask, which: str) -> None:
    near, free = (0.55, 0.0, 0.0), (2.0, 1.0, 0.0)
    ends = (near, free) if which == "start" else (free, near)

    def problem(min_clearance: float) -> Problem:
        asked = ask("omni", *ends, Environment(AROUND, POST), min_clearance=min_clearance)
        return with_footprint(asked, [[0.0, 0.0]], 0.2)

    error = refused(problem(0.06))
    assert error.code == f"{which}-in-collision"
    assert error.details["clearance"] == pytest.approx(-0.01, abs=1e-6)
    assert "min_clearance" in error.message
    assert plan(problem(0.04)).certificate.clearance >= 0.04 - 1e-9


@pytest.mark.parametrize("which", ["start", "goal"])
@pytest.mark.parametrize("outside", [(4.9, 0.0, 0.0), (0.0, -6.0, 1.0), (-4.8, 4.8, 2.0)])
def test_a_pose_out_of_bounds_is_named(ask: Ask, which: str, outside: tuple[float, float, float]) -> None:
    free = (1.0, 1.0, 0.0)
    ends = (outside, free) if which == "start" else (free, outside)
    error = refused(ask("differential", *ends))
    assert isinstance(error, PoseOutOfBounds)
    assert error.code == f"{which}-out-of-bounds"
    assert tuple(error.details["pose"].values()) == outside


def test_a_goal_of_any_heading_is_refused_only_where_every_heading_is(ask: Ask) -> None:
    slot = Environment(
        Bounds(-5.0, -1.0, 5.0, 1.0),
        (Polygon(np.array([[1.5, 0.23], [3.0, 0.23], [3.0, 1.0], [1.5, 1.0]])),
         Polygon(np.array([[1.5, -1.0], [3.0, -1.0], [3.0, -0.23], [1.5, -0.23]]))),
    )  # fmt: skip
    made = plan(ask("mecanum", (-1.0, 0.0, 0.0), (2.2, 0.0, None), slot))
    assert made.certificate.clearance > 0
    error = refused(ask("mecanum", (-1.0, 0.0, 0.0), (2.2, 0.3, None), slot))
    assert error.code == "goal-in-collision"
    assert refused(ask("mecanum", (-1.0, 0.0, 0.0), (9.0, 0.0, None), slot)).code == "goal-out-of-bounds"


def test_a_start_that_is_the_goal_is_still_checked(ask: Ask) -> None:
    assert refused(ask("omni", (0, 0, 0), (0, 0, 0), Environment(AROUND, POST))).code == "start-in-collision"


# ---------------------------------------------------------------- no path


@pytest.mark.parametrize("kind", DRIVES)
def test_a_wall_is_proven_to_be_closed_at_once(ask: Ask, kind: str) -> None:
    wall = Polygon(np.array([[-0.1, -5.0], [0.1, -5.0], [0.1, 5.0], [-0.1, 5.0]]))
    problem = ask(kind, (-2, 0, 0), (2, 0, 0), Environment(AROUND, (wall,)), effort="good", time_budget=20.0)
    refused(problem)
    began = time.perf_counter()
    error = refused(problem)
    assert time.perf_counter() - began < 1.0
    assert isinstance(error, NoPathExists)
    assert error.code == "no-path-exists"
    assert error.details["proof"]["width"] == 0.0


def test_a_gap_narrower_than_the_robot_is_proven_to_be_closed(ask: Ask) -> None:
    walls = tuple(
        Polygon(np.array([[-0.1, a], [0.1, a], [0.1, b], [-0.1, b]])) for a, b in ((-5.0, -0.17), (0.17, 5.0))
    )
    error = refused(ask("omni", (-2, 0, 0), (2, 0, 0), Environment(AROUND, walls)))
    assert error.code == "no-path-exists"
    assert error.details["proof"]["width"] == pytest.approx(0.34, abs=1e-6)
    assert error.details["proof"]["width_needed"] > 0.34


def corner() -> Environment:
    """A corridor 0.6 m wide that turns a right angle at the origin."""
    return Environment(
        Bounds(-4.0, -0.3, 0.3, 4.0),
        (Polygon(np.array([[-4.0, 0.3], [-0.3, 0.3], [-0.3, 4.0], [-4.0, 4.0]])),),
    )


@pytest.mark.parametrize("kind", ["mecanum", "differential", "ackermann"])
def test_a_corner_too_tight_to_turn_in_is_not_found_and_says_what_was_tried(ask: Ask, kind: str) -> None:
    ladder = [[-1.0, -0.2], [1.0, -0.2], [1.0, 0.2], [-1.0, 0.2]]
    problem = ask(kind, (-2.5, 0.0, 0.0), (0.0, 2.5, math.pi / 2), corner(), time_budget=1.5)
    began = time.perf_counter()
    error = refused(with_footprint(problem, ladder))
    assert time.perf_counter() - began < 6.0
    assert isinstance(error, NoPathFound)
    assert error.code == "no-path-found"
    assert "1.5 s" in error.message
    assert len(error.details["tried"]) > 0
    assert all(turn["outcome"] != "solved" for turn in error.details["tried"])
    nearest = error.details["nearest"]
    assert nearest["distance"] == pytest.approx(math.hypot(nearest["x"], nearest["y"] - 2.5))
    assert 0.0 < nearest["distance"] < math.hypot(2.5, 2.5)


@pytest.mark.parametrize("kind", ["mecanum", "differential"])
def test_the_same_corner_lets_a_short_robot_through(ask: Ask, kind: str) -> None:
    short = [[-0.15, -0.15], [0.15, -0.15], [0.15, 0.15], [-0.15, 0.15]]
    made = plan(with_footprint(ask(kind, (-2.5, 0, 0), (0.0, 2.5, math.pi / 2), corner()), short))
    assert made.certificate.clearance >= 0.0


@pytest.mark.parametrize("effort", ["first", "good", "best"])
def test_a_budget_too_small_to_search_in_says_so(ask: Ask, clutter: Environment, effort: str) -> None:
    problem = ask(
        "differential", (-2.4, 0.0, 0.3), (2.2, -0.9, -0.5), clutter, time_budget=1e-6, effort=effort
    )
    error = refused(problem)
    assert error.code == "no-path-found"
    assert "1e-06 s" in error.message
    assert isinstance(error.details["tried"], list)


def test_a_way_that_needs_no_search_is_found_in_any_budget(ask: Ask) -> None:
    assert plan(ask("differential", (0, 0, 0), (2, 1, 0), time_budget=1e-6)).duration > 0


# ---------------------------------------------------------------- limits and geometry


@pytest.mark.parametrize("kind", DRIVES)
def test_a_motion_of_too_many_samples_is_refused_with_its_duration_and_the_bound(ask: Ask, kind: str) -> None:
    def problem(samples: float) -> Problem:
        """Two metres straight ahead that take about so many samples, mostly at full speed."""
        unlimited = plan(ask(kind, (-1, 0, 0), (1, 0, 0), limits={"wheel_acceleration": 1e6})).duration
        slower = unlimited / (samples * 0.02)
        return ask(
            kind, (-1, 0, 0), (1, 0, 0), limits={"wheel_speed": 10 * slower, "wheel_acceleration": 1e3}
        )

    error = refused(problem(MAX_SAMPLES * 1.1))
    assert isinstance(error, TooManySamples)
    assert error.code == "too-many-samples"
    assert error.details["duration"] == pytest.approx(MAX_SAMPLES * 1.1 * 0.02, rel=1e-2)
    assert (error.details["sample_period"], error.details["max_samples"]) == (0.02, MAX_SAMPLES)


def test_the_bound_on_samples_is_an_option_and_is_met_exactly(ask: Ask) -> None:
    problem = ask("differential", (-1, 0, 0), (1, 0, 0), effort="first")
    count = len(plan(problem).schedule.time)

    def bounded(by: int) -> Problem:
        return replace(problem, options=replace(problem.options, max_samples=by))

    assert len(plan(bounded(count)).schedule.time) == count
    assert isinstance(refused(bounded(count - 1)), TooManySamples)


def test_a_slow_motion_of_fewer_samples_is_planned(ask: Ask) -> None:
    # 2 m at 0.1 m/rad and 0.01 rad/s: 2000 s, 20,000 samples of 0.1 s
    problem = ask("differential", (-1, 0, 0), (1, 0, 0), limits={"wheel_speed": 0.01}, sample_period=0.1)
    made = plan(problem)
    assert made.duration == pytest.approx(2000.0, rel=1e-3)
    assert len(made.schedule.time) < MAX_SAMPLES


@pytest.mark.parametrize("kind", ["differential", "mecanum"])
def test_a_way_too_long_to_be_checked_is_infeasible_and_a_shorter_one_is_planned(ask: Ask, kind: str) -> None:
    def problem(way: float) -> Problem:
        floor = Environment(Bounds(-5.0, -5.0, way + 5.0, 5.0))
        return ask(kind, (0, 0, 0), (way, 0, 0), floor, limits={"wheel_speed": 100.0}, sample_period=1.0)

    error = refused(problem(1.01 * MAX_WAY))
    assert isinstance(error, LimitsInfeasible)
    assert "101000 m, more than the 100000 m" in str(error)
    made = plan(problem(0.99 * MAX_WAY))
    assert made.length == pytest.approx(0.99 * MAX_WAY)
    assert made.certificate.clearance > 4


def test_steering_that_no_path_can_keep_is_infeasible(ask: Ask) -> None:
    # A swerve that may steer a thousandth of a radian only, asked to go sideways.
    problem = ask("swerve", (0, 0, 0), (0, 2, 0), limits={"steering_angle": 1e-3})
    assert refused(problem).code == "limits-infeasible"


@pytest.mark.parametrize(
    "vertices",
    [
        [[0.3, 0.2], [-0.3, -0.2], [0.3, -0.2], [-0.3, 0.2]],
        [[0.3, 0.0], [0.0, 0.0], [-0.3, 0.0]],
        [[0.1, 0.1], [0.1, 0.1], [0.1, 0.1]],
        [[0.0, 0.0], [math.nan, 0.0], [0.0, 1.0]],
        [[0.0, 0.0], [1.0, 0.0]],
    ],
    ids=["bow-tie", "flat", "point", "nan", "two"],
)
@pytest.mark.parametrize("what", ["footprint", "obstacle"])
def test_degenerate_shapes_are_pointed_at(ask: Ask, vertices: list[list[float]], what: str) -> None:
    problem = ask("omni", (-1, 0, 0), (1, 0, 0))
    if what == "footprint":
        problem = with_footprint(problem, vertices)
    else:
        shapes = (Circle(3.0, 3.0, 0.1), Polygon(np.array(vertices)))
        problem = replace(problem, environment=Environment(AROUND, shapes))
    error = refused(problem)
    assert isinstance(error, InvalidGeometry)
    assert error.code == "invalid-geometry"
    pointer = "/robot/footprint" if what == "footprint" else "/environment/obstacles/1"
    assert [fault["pointer"] for fault in error.details["errors"]] == [pointer]


# ---------------------------------------------------------------- what a worker sends back

EXAMPLES = [
    InvalidGeometry("the footprint crosses itself", "/robot/footprint"),
    PoseInCollision("start", "too near", Pose(1.0, 2.0, 3.0), -0.1),
    PoseInCollision("goal", "too near", Pose(1.0, 2.0, 3.0), -0.1),
    PoseOutOfBounds("start", "outside", Pose(1.0, 2.0, 3.0)),
    PoseOutOfBounds("goal", "outside", Pose(1.0, 2.0, 3.0)),
    NoPathExists("a wall", {"method": "separation", "width": 0.0}),
    NoPathFound("time is up", [{"planner": "RRTConnect", "outcome": "not solved"}]),
    LimitsInfeasible("too slow"),
    TooManySamples(5000.0, 0.02, 200_000),
    AuditFailed("it slips", {"slip": 1.0}, ["the slip is 1 m/s"]),
]


@pytest.mark.parametrize("error", EXAMPLES, ids=lambda error: str(error.code))
def test_errors_survive_the_way_from_a_worker(error: PlanningError) -> None:
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is type(error)
    assert (back.code, back.message, back.details, str(back)) == (
        error.code, error.message, error.details, str(error),
    )  # fmt: skip


def test_an_error_that_was_raised_survives_too(ask: Ask) -> None:
    error = refused(ask("omni", (0, 0, 0), (2, 0, 0), Environment(AROUND, POST)))
    back = pickle.loads(pickle.dumps(error))
    assert (back.code, back.details) == (error.code, error.details)


def test_every_failure_has_its_example_here() -> None:
    named = {getattr(errors, name) for name in errors.__all__} - {PlanningError}
    assert named == {type(error) for error in EXAMPLES}
    assert len({error.code for error in EXAMPLES}) == len(EXAMPLES)
