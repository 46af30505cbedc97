"""plan() keeps its promises, whichever drive and however the path and its timing were found."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from drives import Differential, Mecanum, Tricycle
from drives.se2 import Array, wrap
from planner.plan import Plan, plan
from planner.problem import Environment, Problem
from tests.planner.plans import JOURNEYS, KINDS, PI, Ask, closes, distance, keeps_limits, largest, ratios

# ---------------------------------------------------------------- every drive, on the floor and in clutter


@pytest.fixture(
    scope="module",
    params=[
        f"{kind}-{place}-{effort}" for effort in ("first", "good") for place in JOURNEYS for kind in KINDS
    ],
)
def journey(request: Any, ask: Ask, floor: Environment, clutter: Environment) -> tuple[Problem, Plan]:
    kind, place, effort = request.param.split("-")
    problem = ask(kind, *JOURNEYS[place], {"floor": floor, "clutter": clutter}[place], effort=effort)
    return problem, plan(problem)


def test_certificate_finds_every_limit_kept(journey: tuple[Problem, Plan]) -> None:
    assert keeps_limits(journey[1]), ratios(journey[1])


def test_the_time_is_well_spent_up_to_a_limit(journey: tuple[Problem, Plan]) -> None:
    assert max(ratios(journey[1]).values()) > 0.99


def test_wheels_close_on_the_goal_without_slip(journey: tuple[Problem, Plan]) -> None:
    certificate = journey[1].certificate
    assert closes(journey[1])
    assert certificate.slip < 1e-4
    assert certificate.clearance >= 0.0


def test_it_leads_from_the_start_to_the_goal(journey: tuple[Problem, Plan]) -> None:
    problem, made = journey
    poses = made.schedule.pose
    assert poses[0] == pytest.approx(problem.start, abs=1e-12)
    assert distance(poses[-1], (problem.goal.x, problem.goal.y, 0.0)) < 1e-5
    assert problem.goal.theta is not None
    assert abs(wrap(poses[-1, 2] - problem.goal.theta)) < 1e-5


def test_it_is_at_rest_at_both_ends(journey: tuple[Problem, Plan]) -> None:
    made = journey[1].schedule
    for rate in (made.wheel_velocity, made.steering_rate, made.twist):
        assert np.abs(rate[[0, -1]]).max(initial=0.0) < 1e-9
    assert not made.wheel_angle[0].any()


def test_samples_are_a_period_apart_up_to_the_duration(journey: tuple[Problem, Plan]) -> None:
    problem, made = journey
    time, period = made.schedule.time, problem.options.sample_period
    assert time[:-1] == pytest.approx(np.arange(len(time) - 1) * period, abs=1e-9)
    assert time[-1] == made.duration
    assert 0 < time[-1] - time[-2] <= period * (1 + 1e-6)


def test_nothing_jumps(journey: tuple[Problem, Plan]) -> None:
    problem, made = journey
    limits, columns = problem.robot.limits, made.schedule
    over = np.diff(columns.time)[:, None]
    assert largest(np.diff(columns.wheel_angle, axis=0), limits.wheel_speed * over) <= 1.001
    assert largest(np.diff(columns.wheel_velocity, axis=0), limits.wheel_acceleration * over) <= 1.001
    assert largest(np.diff(columns.steering_angle, axis=0), limits.steering_rate * over) <= 1.001
    assert np.abs(np.diff(columns.pose[:, 2])).max() < PI / 2


def test_each_sample_is_what_the_drive_does_at_that_twist(journey: tuple[Problem, Plan]) -> None:
    problem, made = journey
    columns = made.schedule
    twist, slip = problem.robot.drive.forward(
        columns.wheel_velocity, columns.steering_angle, columns.steering_rate
    )
    assert slip.max() < 1e-9
    moving = np.abs(columns.wheel_velocity).max(1) > 1e-3
    assert twist[moving] == pytest.approx(columns.twist[moving], abs=1e-6)


def test_length_is_the_way_of_the_body_origin(journey: tuple[Problem, Plan]) -> None:
    made = journey[1]
    steps = np.diff(made.schedule.pose[:, :2], axis=0)
    assert made.length == pytest.approx(np.hypot(*steps.T).sum(), rel=2e-3)


def test_it_says_how_it_was_made(journey: tuple[Problem, Plan]) -> None:
    problem, made = journey
    assert made.planning["seed"] == problem.options.seed
    assert made.planning["timings"]["total"] > 0
    assert {"planner", "state_space"} <= made.planning.keys()


# ---------------------------------------------------------------- an oracle of its own: textbook odometry


def odometry(drive: Any, wheel: Array, steering: Array) -> tuple[Array, Array, Array]:
    """Forward, sideways (m) and turned (rad) in the body frame, from small turns of the wheels (n, m)."""
    r, none = drive.wheel_radius, np.zeros(len(wheel))
    match drive:
        case Differential():
            left, right = wheel.T
            return r * (left + right) / 2, none, r * (right - left) / drive.track_width
        case Mecanum():
            front_left, front_right, rear_left, rear_right = wheel.T
            lever = (drive.track_width + drive.wheelbase) / 2
            return (
                r * (front_left + front_right + rear_left + rear_right) / 4,
                r * (-front_left + front_right + rear_left - rear_right) / 4,
                r * (-front_left + front_right - rear_left + rear_right) / 4 / lever,
            )
        case Tricycle():
            front, angle = wheel[:, 0], steering[:, 0]
            return r * front * np.cos(angle), none, r * front * np.sin(angle) / drive.wheelbase
    raise AssertionError(f"no textbook odometry for {drive.kind}")


@pytest.mark.parametrize("kind", ["differential", "mecanum", "tricycle"])
@pytest.mark.parametrize("place", JOURNEYS)
def test_textbook_odometry_rolls_it_to_the_goal(
    ask: Ask, floor: Environment, clutter: Environment, kind: str, place: str
) -> None:
    problem = ask(kind, *JOURNEYS[place], {"floor": floor, "clutter": clutter}[place], sample_period=0.01)
    made = plan(problem).schedule
    fine = np.linspace(0.0, made.time[-1], 200_000)
    wheels = CubicHermiteSpline(made.time, made.wheel_angle, made.wheel_velocity)(fine)
    middle = (fine[1:] + fine[:-1]) / 2
    steering = np.zeros((len(middle), 0))
    if made.steering_angle.size:
        steering = CubicHermiteSpline(made.time, made.steering_angle, made.steering_rate)(middle)
    ahead, aside, turned = odometry(problem.robot.drive, np.diff(wheels, axis=0), steering)
    theta = problem.start.theta + np.concatenate([[0.0], np.cumsum(turned)])
    heading = (theta[1:] + theta[:-1]) / 2
    x = problem.start.x + np.cumsum(np.cos(heading) * ahead - np.sin(heading) * aside)
    y = problem.start.y + np.cumsum(np.sin(heading) * ahead + np.cos(heading) * aside)
    assert problem.goal.theta is not None
    assert math.hypot(x[-1] - problem.goal.x, y[-1] - problem.goal.y) < 1e-4
    assert abs(wrap(theta[-1] - problem.goal.theta)) < 1e-4
    # and on the way it is where the plan says
    for rolled, stated in zip((x, y, theta[1:]), made.pose.T, strict=True):
        assert np.interp(made.time[1:], fine[1:], rolled) == pytest.approx(stated[1:], abs=2e-4)
