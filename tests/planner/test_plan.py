"""plan() keeps its promises, whichever drive and however the path and its timing were found."""

from __future__ import annotations

import hashlib
import math
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from drives import DRIVES, Differential, Mecanum, Tricycle
from drives.drive import Holonomic
from drives.se2 import Array, Pose, wrap
from planner.plan import Plan, plan
from planner.problem import Environment, Problem

Ask = Callable[..., Problem]
PI = math.pi
KINDS = list(DRIVES)
STEERED = ["tricycle", "ackermann", "synchro", "swerve", "powered_caster"]
NONHOLONOMIC = ["differential", "tracked", "skid_steer", "tricycle", "ackermann", "synchro"]
HOLONOMIC = [kind for kind in KINDS if kind not in NONHOLONOMIC]
JOURNEYS = {
    "floor": ((-2.0, -1.0, 0.5), (2.0, 1.5, -1.0)),
    "clutter": ((-2.4, 0.0, 0.3), (2.2, -0.9, -0.5)),
}

every_drive = pytest.mark.parametrize("kind", KINDS)


def ratios(made: Plan) -> dict[str, float]:
    return {name: value for name, value in asdict(made.certificate).items() if name.endswith("_ratio")}


def keeps_limits(made: Plan) -> bool:
    return all(0.0 <= ratio <= 1.001 for ratio in ratios(made).values())


def closes(made: Plan) -> bool:
    """Whether whoever rolls the wheels ends on the goal, to what the audit allows: half a millimetre and a
    twentieth of one for every metre, and half a milliradian."""
    allowed = 5e-4 + 5e-5 * made.length
    return made.certificate.closure_position < allowed and made.certificate.closure_heading < 5e-4


def largest(used: Array, allowed: Array | float) -> float:
    """The largest share of what is allowed; what is less than rounding counts as nothing."""
    return float((np.maximum(np.abs(used) - 1e-9, 0.0) / allowed).max(initial=0.0))


def distance(a: Array | Pose, b: Array | Pose) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])


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
    assert certificate.slip < 1e-9
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
        assert not rate[[0, -1]].any()
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


# ---------------------------------------------------------------- the same request, the same plan

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
            ("omni", "good"), ("powered_caster", "first"),
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


def test_effort_good_is_no_slower_than_first(ask: Ask, clutter: Environment) -> None:
    first, good = (plan(ask("mecanum", *JOURNEYS["clutter"], clutter, effort=e)) for e in ("first", "good"))
    assert good.duration <= first.duration


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


# ---------------------------------------------------------------- goals


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


@every_drive
def test_goal_without_heading_takes_any(ask: Ask, kind: str) -> None:
    made = plan(ask(kind, (0.0, 0.0, 0.4), (2.0, -1.0, None)))
    assert distance(made.schedule.pose[-1], Pose(2.0, -1.0, 0.0)) < 1e-9
    assert made.certificate.closure_heading == 0.0
    assert keeps_limits(made)


def test_goal_without_heading_is_reached_no_later_than_with_one(ask: Ask) -> None:
    free = plan(ask("differential", (0.0, 0.0, 0.4), (2.0, -1.0, None)))
    fixed = plan(ask("differential", (0.0, 0.0, 0.4), (2.0, -1.0, 2.0)))
    assert free.duration <= fixed.duration


@every_drive
@pytest.mark.parametrize("theta", [0.4, 0.4 - 2 * PI, None])
def test_start_that_is_the_goal_is_one_sample_at_rest(ask: Ask, kind: str, theta: float | None) -> None:
    made = plan(ask(kind, (1.0, 0.5, 0.4), (1.0, 0.5, theta)))
    columns = made.schedule
    assert made.duration == made.length == 0.0
    assert columns.time.tolist() == [0.0]
    assert columns.pose.tolist() == [[1.0, 0.5, 0.4]]
    for rate in (columns.wheel_velocity, columns.wheel_acceleration, columns.steering_rate, columns.twist):
        assert len(rate) == 1
        assert not rate.any()
    assert made.certificate.closure_position == made.certificate.closure_heading == 0.0


@every_drive
@pytest.mark.parametrize("aside", [False, True], ids=["ahead", "aside"])
def test_one_millimetre(ask: Ask, kind: str, aside: bool) -> None:
    theta = 0.3
    course = theta + (PI / 2 if aside else 0.0)
    goal = (1.0 + 1e-3 * math.cos(course), -1.0 + 1e-3 * math.sin(course), theta)
    made = plan(ask(kind, (1.0, -1.0, theta), goal))
    poses = made.schedule.pose
    assert distance(poses[-1], Pose(*goal)) < 1e-9
    assert abs(wrap(poses[-1, 2] - theta)) < 1e-9
    assert made.certificate.closure_position < 1e-5
    assert keeps_limits(made)
    assert made.duration > 0
    if not aside or kind in HOLONOMIC:
        assert made.length == pytest.approx(1e-3, rel=1e-6)


@every_drive
@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["left", "right"])
def test_turn_of_exactly_half_a_turn(ask: Ask, kind: str, sign: float) -> None:
    made = plan(ask(kind, (0.0, 0.0, 0.4), (0.0, 0.0, 0.4 + sign * PI)))
    poses = made.schedule.pose
    assert distance(poses[-1], Pose(0.0, 0.0, 0.0)) < 1e-9
    assert abs(wrap(poses[-1, 2] - 0.4 - PI)) < 1e-9
    assert keeps_limits(made)
    assert closes(made)
    if kind not in ("tricycle", "ackermann"):
        assert abs(poses[-1, 2] - 0.4) == pytest.approx(PI)
        assert made.length < 1e-9


@every_drive
def test_heading_is_continuous_across_the_wrap(ask: Ask, kind: str) -> None:
    made = plan(ask(kind, (0.0, 0.0, 3.1), (-1.0, 0.0, -3.1)))
    heading = made.schedule.pose[:, 2]
    assert heading[0] == 3.1
    assert np.abs(np.diff(heading)).max() < 0.2
    assert abs(wrap(heading[-1] + 3.1)) < 1e-9
    if kind in HOLONOMIC:
        assert heading[-1] == pytest.approx(2 * PI - 3.1)


@every_drive
@pytest.mark.parametrize("turns", [7.0, -20.0])
def test_heading_is_unwrapped_from_the_value_given_at_the_start(ask: Ask, kind: str, turns: float) -> None:
    made = plan(ask(kind, (-1.0, 0.0, turns), (1.0, 0.5, 0.2)))
    heading = made.schedule.pose[:, 2]
    assert heading[0] == turns
    assert np.abs(np.diff(heading)).max() < 0.2
    assert abs(heading[-1] - turns) < 2 * PI
    assert abs(wrap(heading[-1] - 0.2)) < 1e-9
    assert closes(made)


@every_drive
def test_whole_turns_in_a_request_change_nothing_but_theta(ask: Ask, kind: str) -> None:
    near = plan(ask(kind, (-1.0, 0.0, 0.7), (1.0, 0.5, 0.2)))
    wound = plan(ask(kind, (-1.0, 0.0, 0.7 + 6 * PI), (1.0, 0.5, 0.2 - 4 * PI)))
    assert wound.duration == pytest.approx(near.duration, rel=1e-6)
    assert wound.schedule.pose[:, 2] - 6 * PI == pytest.approx(near.schedule.pose[:, 2], abs=1e-6)


@every_drive
def test_far_from_the_origin_is_as_near_it(ask: Ask, floor: Environment, kind: str) -> None:
    assert floor.bounds is not None
    far = 1e5
    moved = replace(
        floor,
        bounds=replace(
            floor.bounds,
            **{name: value + far for name, value in asdict(floor.bounds).items()},
        ),
    )
    (x, y, theta), (gx, gy, turned) = JOURNEYS["floor"]
    here = plan(ask(kind, (x, y, theta), (gx, gy, turned)))
    there = plan(ask(kind, (x + far, y + far, theta), (gx + far, gy + far, turned), moved))
    assert there.duration == pytest.approx(here.duration, rel=1e-6)
    assert closes(there)
    assert there.certificate.clearance == pytest.approx(here.certificate.clearance, abs=1e-6)


def test_a_motion_begun_the_other_way_round_takes_as_long(ask: Ask) -> None:
    (x, y, theta), (gx, gy, turned) = JOURNEYS["floor"]
    left = plan(ask("differential", (x, y, theta), (gx, gy, turned)))
    right = plan(ask("differential", (x, -y, -theta), (gx, -gy, -turned)))
    assert right.duration == pytest.approx(left.duration, rel=1e-9)


# ---------------------------------------------------------------- options


@pytest.mark.parametrize("kind", ["differential", "omni", "ackermann", "synchro"])
@pytest.mark.parametrize("clearance", [0.05, 0.15])
def test_min_clearance_is_kept(ask: Ask, clutter: Environment, kind: str, clearance: float) -> None:
    made = plan(ask(kind, *JOURNEYS["clutter"], clutter, min_clearance=clearance))
    assert made.certificate.clearance >= clearance - 1e-9


@pytest.mark.parametrize("kind", NONHOLONOMIC)
@pytest.mark.parametrize("place", JOURNEYS)
def test_without_reverse_it_never_drives_backwards(
    ask: Ask, floor: Environment, clutter: Environment, kind: str, place: str
) -> None:
    problem = ask(kind, *JOURNEYS[place], {"floor": floor, "clutter": clutter}[place], reverse=False)
    made = plan(problem)
    assert made.schedule.twist[:, 0].min() >= -1e-12
    assert closes(made)


@pytest.mark.parametrize("kind", NONHOLONOMIC)
def test_with_reverse_it_backs_up_where_that_is_quicker(ask: Ask, kind: str) -> None:
    backwards = plan(ask(kind, (0.0, 0.0, 0.2), (-math.cos(0.2), -math.sin(0.2), 0.2)))
    forwards = plan(ask(kind, (0.0, 0.0, 0.2), (-math.cos(0.2), -math.sin(0.2), 0.2), reverse=False))
    assert backwards.schedule.twist[:, 0].max() <= 1e-12
    assert backwards.length == pytest.approx(1.0)
    assert backwards.duration < forwards.duration


@pytest.mark.parametrize("kind", NONHOLONOMIC)
@pytest.mark.parametrize("reverse", [True, False])
def test_turning_radius_is_a_floor(ask: Ask, kind: str, reverse: bool) -> None:
    radius = 1.1
    made = plan(ask(kind, *JOURNEYS["floor"], turning_radius=radius, reverse=reverse))
    vx, _, omega = made.schedule.twist.T
    assert (np.abs(omega) * radius <= np.abs(vx) * (1 + 1e-3) + 1e-6).all()
    assert np.abs(np.diff(made.schedule.pose[:, 2])).sum() > 0.1
    assert closes(made)


@every_drive
@pytest.mark.parametrize("period", [0.005, 0.1])
def test_sample_period_spaces_the_same_motion(ask: Ask, kind: str, period: float) -> None:
    usual, asked = (plan(ask(kind, *JOURNEYS["floor"], sample_period=p)) for p in (0.02, period))
    assert asked.duration == usual.duration
    assert asked.schedule.time[:-1] == pytest.approx(np.arange(len(asked.schedule.time) - 1) * period)
    assert keeps_limits(asked)
    finer, coarser = sorted((usual.schedule, asked.schedule), key=lambda s: -len(s.time))
    ratio = round(max(period, 0.02) / min(period, 0.02))
    n = len(coarser.time) - 1
    assert finer.pose[: n * ratio : ratio] == pytest.approx(coarser.pose[:n], abs=1e-7)


# ---------------------------------------------------------------- limits


@every_drive
@pytest.mark.parametrize("place", JOURNEYS)
def test_wheel_jerk_is_kept(
    ask: Ask, floor: Environment, clutter: Environment, kind: str, place: str
) -> None:
    jerk = 80.0
    problem = ask(
        kind, *JOURNEYS[place], {"floor": floor, "clutter": clutter}[place], limits={"wheel_jerk": jerk}
    )
    made = plan(problem)
    assert keeps_limits(made), ratios(made)
    change = np.diff(made.schedule.wheel_acceleration, axis=0)
    over = np.maximum(np.diff(made.schedule.time)[:, None], 1e-4)
    assert np.abs(change / over).max() <= jerk * (1 + 1e-3)
    assert np.abs(made.schedule.wheel_acceleration[[0, -1]]).max() < 1e-6


@every_drive
def test_each_wheel_keeps_its_own_limits(ask: Ask, kind: str) -> None:
    wheels = len(ask(kind, *JOURNEYS["floor"]).robot.drive.wheel_names)
    speed, acceleration = np.full(wheels, 10.0), np.full(wheels, 20.0)
    speed[0], acceleration[-1] = 3.0, 4.0
    made = plan(
        ask(kind, *JOURNEYS["floor"], limits={"wheel_speed": speed, "wheel_acceleration": acceleration})
    )
    columns = made.schedule
    assert largest(columns.wheel_velocity, speed) <= 1.001
    assert largest(columns.wheel_acceleration, acceleration) <= 1.001
    assert keeps_limits(made)
    assert made.duration > plan(ask(kind, *JOURNEYS["floor"])).duration


@every_drive
@pytest.mark.parametrize(
    ("name", "limit"),
    [
        ("linear_speed", 0.2), ("angular_speed", 0.3), ("linear_acceleration", 0.15),
        ("lateral_acceleration", 0.05),
    ],
)  # fmt: skip
def test_body_limits_are_kept(ask: Ask, kind: str, name: str, limit: float) -> None:
    problem = ask(kind, *JOURNEYS["floor"], limits={name: limit})
    made = plan(problem)
    assert keeps_limits(made), ratios(made)
    time, (vx, vy, omega) = made.schedule.time, made.schedule.twist.T
    speed, over = np.hypot(vx, vy), np.maximum(np.diff(time), 1e-4)
    if name == "linear_speed":
        assert speed.max() <= limit * 1.001
    if name == "angular_speed":
        assert np.abs(omega).max() <= limit * 1.001
    if name == "linear_acceleration":
        assert np.abs(np.diff(speed) / over).max() <= limit * 1.001
    if name == "lateral_acceleration":
        holonomic = isinstance(problem.robot.drive.mobility(problem.robot.limits), Holonomic)
        assert holonomic or np.abs(speed * omega).max() <= limit * 1.001


# ---------------------------------------------------------------- where the steered wheels stand


@pytest.mark.parametrize(
    ("kind", "angles"),
    [
        ("tricycle", 0.7), ("tricycle", -0.31), ("ackermann", 0.2), ("ackermann", [0.0, 0.0]),
        ("swerve", [1.0, -2.0, 0.3]), ("swerve", [3.0, 9.0, -7.5]), ("powered_caster", [1.0, -2.0, 0.3]),
        ("powered_caster", PI), ("powered_caster", 0.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("place", JOURNEYS)
def test_schedule_begins_where_the_steered_wheels_stand(
    ask: Ask, floor: Environment, clutter: Environment, kind: str, angles: float | list[float], place: str
) -> None:
    problem = ask(kind, *JOURNEYS[place], {"floor": floor, "clutter": clutter}[place], steering=angles)
    made = plan(problem)
    columns, limits = made.schedule, problem.robot.limits
    assert problem.steering is not None
    assert columns.steering_angle[0].tolist() == problem.steering.tolist()
    over = np.diff(columns.time)[:, None]
    assert largest(np.diff(columns.steering_angle, axis=0), limits.steering_rate * over) <= 1.001
    assert keeps_limits(made)
    assert closes(made)


def test_wheels_that_steer_at_rest_do_so_before_the_body_moves(ask: Ask) -> None:
    made = plan(ask("swerve", (0.0, 0.0, 0.0), (2.0, 0.0, 0.0), steering=[1.2, 0.0, -0.6])).schedule
    before = made.time < 1.2 / 3.0 - 1e-9
    assert before.sum() > 10
    assert not made.wheel_velocity[before].any()
    assert (made.pose[before] == made.pose[0]).all()


def test_a_caster_that_is_told_nothing_begins_at_zero(ask: Ask) -> None:
    made = plan(ask("powered_caster", *JOURNEYS["floor"]))
    assert not made.schedule.steering_angle[0].any()


@pytest.mark.parametrize("kind", STEERED)
def test_standing_still_keeps_the_steering_given(ask: Ask, kind: str) -> None:
    angle = -0.4 if kind == "synchro" else 0.5  # a synchro's wheels stand at theta - body_heading
    made = plan(ask(kind, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), steering=angle))
    assert (made.schedule.steering_angle == angle).all()


def test_synchro_wheels_begin_on_the_branch_given(ask: Ask) -> None:
    turned = -0.4 + 2 * PI
    made = plan(ask("synchro", (0.0, 0.0, 0.0), (2.0, 1.0, 0.0), steering=turned))
    assert (made.schedule.steering_angle[0] == turned).all()
    assert made.schedule.steering_angle - made.schedule.pose[:, 2:] == pytest.approx(turned)
