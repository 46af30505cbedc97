"""The certificate: true schedules pass, and each way of spoiling one is told from the others.

The schedules are made by hand: a speed bump sin²(πt/T) along a path whose poses are known in closed form.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np
import pytest

from drives import DRIVES, Differential, Module, SwedishWheel
from drives.drive import BodyPath, Car, Drive, Holonomic, Limits
from drives.se2 import Array, Pose, Twist, compose, exp
from planner.errors import AuditFailed
from planner.problem import Environment, Footprint, Goal, Options, Problem, Robot
from planner.schedule import WheelSchedule
from planner.verify import Certificate, verify

MODULES = (Module("a", 0.3, 0.2), Module("b", -0.3, 0.2), Module("c", 0.0, -0.3))
PARAMETERS: dict[str, dict[str, Any]] = {
    "differential": {"wheel_radius": 0.1, "track_width": 0.5},
    "tracked": {"wheel_radius": 0.1, "track_width": 0.5, "slip_coefficient": 1.4},
    "skid_steer": {"wheel_radius": 0.1, "track_width": 0.5, "wheelbase": 0.4, "slip_coefficient": 1.6},
    "omni": {"wheel_radius": 0.05, "robot_radius": 0.2},
    "mecanum": {"wheel_radius": 0.08, "track_width": 0.4, "wheelbase": 0.5},
    "swedish": {
        "wheels": (
            SwedishWheel("a", 0.3, 0.0, 1.57, 0.0, 0.05),
            SwedishWheel("b", -0.2, 0.2, 0.1, 0.785, 0.06),
            SwedishWheel("c", -0.2, -0.2, 0.0, -0.785, 0.07),
        )
    },
    "tricycle": {"wheel_radius": 0.1, "wheelbase": 0.8, "track_width": 0.5},
    "ackermann": {"wheel_radius": 0.1, "wheelbase": 0.8, "track_width": 0.5},
    "synchro": {"wheel_radius": 0.1, "body_heading": 0.4},
    "swerve": {"wheel_radius": 0.05, "modules": MODULES},
    "powered_caster": {"wheel_radius": 0.05, "caster_offset": 0.04, "modules": MODULES},
}
KINDS = sorted(DRIVES)
STEERED = ["ackermann", "powered_caster", "swerve", "synchro", "tricycle"]
OVERDETERMINED = ["ackermann", "mecanum", "powered_caster", "skid_steer", "swerve", "synchro", "tricycle"]
START = Pose(1.0, -2.0, 0.4)
PERIOD, DURATION, RADIUS = 0.02, 3.13, 0.3


@dataclass
class Discs:
    """A world of discs (x, y, radius) around a round robot, which remembers what it was asked."""

    discs: tuple[tuple[float, float, float], ...] = ((40.0, 40.0, 0.5),)
    asked: int = 0
    headings: tuple[float, ...] = ()

    def clearance(self, poses: Array) -> Array:
        self.asked += len(poses)
        self.headings += tuple(poses[:, 2])
        gaps = [np.hypot(poses[:, 0] - x, poses[:, 1] - y) - r - RADIUS for x, y, r in self.discs]
        nearest: Array = np.min([np.full(len(poses), np.inf), *gaps], axis=0)
        return nearest


@dataclass(frozen=True)
class Case:
    problem: Problem
    schedule: WheelSchedule

    def verify(self, world: Any = None) -> Certificate:
        return verify(self.problem, self.schedule, world or Discs())

    def refused(self, world: Any = None) -> AuditFailed:
        with pytest.raises(AuditFailed) as caught:
            self.verify(world)
        json.dumps(caught.value.details, allow_nan=False)
        return caught.value

    def sentences(self, world: Any = None) -> list[str]:
        found: list[str] = self.refused(world).details["violations"]
        return found

    def schedules(self, **columns: Array) -> Case:
        return replace(self, schedule=replace(self.schedule, **columns))

    def limits(self, **values: Any) -> Case:
        robot = self.problem.robot
        return replace(
            self, problem=replace(self.problem, robot=replace(robot, limits=replace(robot.limits, **values)))
        )

    def options(self, **values: Any) -> Case:
        return replace(self, problem=replace(self.problem, options=replace(self.problem.options, **values)))


def drive_of(kind: str) -> Drive:
    return DRIVES[kind](**PARAMETERS[kind])


def tangent_of(drive: Drive) -> Twist:
    mobility = drive.mobility(Limits(np.ones(1), np.ones(1), np.ones(1), 0.9))
    if isinstance(mobility, Holonomic):
        return Twist(0.8, 0.5, 0.6)
    return Twist(1.0, 0.0, 0.3 if isinstance(mobility, Car) else 0.7)


def moving(
    drive: Drive,
    tangent: Twist | None = None,
    weave: float = 0.0,
    period: float = PERIOD,
    duration: float = DURATION,
) -> Case:
    """A true schedule: a bump of speed along an arc, or (weave, 1/m) along a curve that changes curvature."""
    tangent = tangent or tangent_of(drive)
    fine = np.append(np.arange(0.0, duration - 1e-9, period / 20), duration)
    turn = 2 * np.pi / duration
    s = fine / 2 - np.sin(turn * fine) / (2 * turn)
    speed, change = np.sin(turn * fine / 2) ** 2, turn / 2 * np.sin(turn * fine)
    heading = START.theta + tangent.omega * s + weave * (1 - np.cos(s))
    along, steeper = np.tile(tangent, (len(s), 1)), np.zeros((len(s), 3))
    along[:, 2] += weave * np.sin(s)
    steeper[:, 2] = weave * np.cos(s)
    law = drive.actuators(BodyPath(s, heading, along, steeper))

    def integral(rate: Array) -> Array:
        steps = np.diff(fine)[:, None] * (rate[1:] + rate[:-1]) / 2
        return np.concatenate([np.zeros((1, rate.shape[1])), np.cumsum(steps, 0)])

    v, a = speed[:, None], change[:, None]
    c, q = np.cos(heading)[:, None], np.sin(heading)[:, None]
    vx, vy = along[:, :1] * v, along[:, 1:2] * v
    position = np.array(START[:2]) + integral(np.hstack([c * vx - q * vy, q * vx + c * vy]))
    pose = np.column_stack([position, heading])
    if not weave:
        pose = np.array([compose(START, exp(Twist(*(x * each for each in tangent)))) for x in s])
    pick = np.append(np.arange(0, len(fine) - 1, 20), len(fine) - 1)
    columns = (
        fine, integral(law.wheel * v), law.wheel * v, law.wheel * a + law.wheel_derivative * v**2,
        law.steering, law.steering_derivative * v, pose, along * v,
    )  # fmt: skip
    schedule = WheelSchedule(*(column[pick] for column in columns))
    return asking_for(drive, schedule, period)


def asking_for(drive: Drive, schedule: WheelSchedule, period: float = PERIOD) -> Case:
    """The problem that a schedule solves, its limits just what it uses."""
    m = len(drive.wheel_names)
    limits = Limits(
        np.full(m, np.abs(schedule.wheel_velocity).max() * 1.0001),
        np.full(m, np.abs(schedule.wheel_acceleration).max() * 1.001),
        np.full(m, np.inf),
        steering_rate=max(float(np.abs(schedule.steering_rate).max(initial=0)), 0.1) * 1.001,
    )
    problem = Problem(
        Robot(drive, Footprint(np.zeros((1, 2)), RADIUS), limits),
        START,
        Goal(*(float(v) for v in schedule.pose[-1])),
        Environment(),
        Options(sample_period=period),
        schedule.steering_angle[0].copy(),
    )
    return Case(problem, schedule)


def changed(column: Array, at: Any, by: float) -> Array:
    out = column.copy()
    out[at] += by
    return out


def trapezoid(distance: float, acceleration: float, top: float) -> Case:
    """A differential drive along a straight line; the corners of its speed do not lie on the time grid."""
    drive = drive_of("differential")
    ramp = top / acceleration
    cruise = distance / top - ramp
    time = np.append(np.arange(0.0, 2 * ramp + cruise, PERIOD), 2 * ramp + cruise)
    left = time[-1] - time
    speed = np.minimum(np.minimum(acceleration * time, top), acceleration * left)
    change = acceleration * ((time < ramp).astype(float) - (left < ramp))
    s = np.where(time < ramp, acceleration * time**2 / 2, top * (time - ramp / 2))
    s = np.where(left < ramp, distance - acceleration * left**2 / 2, s)
    pose = np.array([compose(START, Pose(x, 0.0, 0.0)) for x in s])
    none = np.zeros((len(time), 0))
    angle, rate, rise = (np.column_stack([v, v]) / 0.1 for v in (s, speed, change))
    twist = np.column_stack([speed, 0 * speed, 0 * speed])
    return asking_for(drive, WheelSchedule(time, angle, rate, rise, none, none, pose, twist))


# -------------------------------------------------------- true schedules


@pytest.mark.parametrize("kind", KINDS)
def test_a_true_arc_passes(kind: str) -> None:
    found = moving(drive_of(kind)).verify()
    assert found.closure_position < 2e-6
    assert found.closure_heading < 2e-6
    assert found.drift_position < 2e-6
    assert found.drift_heading < 2e-6
    assert found.slip < 1e-9
    assert found.wheel_speed_ratio == pytest.approx(1 / 1.0001, abs=1e-6)
    assert found.wheel_acceleration_ratio == pytest.approx(1 / 1.001, abs=1e-4)
    assert found.wheel_jerk_ratio == found.steering_angle_ratio == found.linear_speed_ratio == 0
    assert found.steering_rate_ratio <= 1


@pytest.mark.parametrize("weave", [0.2, -0.3])
@pytest.mark.parametrize("kind", KINDS)
def test_a_true_weave_passes(kind: str, weave: float) -> None:
    found = moving(drive_of(kind), weave=weave).verify()
    assert found.closure_position < 2e-5
    assert found.closure_heading < 2e-5


@pytest.mark.parametrize("kind", KINDS)
def test_a_true_arc_passes_in_reverse(kind: str) -> None:
    drive = drive_of(kind)
    vx, vy, omega = tangent_of(drive)
    assert moving(drive, Twist(-vx, -vy, omega)).verify().closure_position < 2e-5


@pytest.mark.parametrize("period", [0.002, 0.1])
@pytest.mark.parametrize("kind", ["differential", "swerve", "ackermann"])
def test_other_periods_pass(kind: str, period: float) -> None:
    assert moving(drive_of(kind), period=period).verify().closure_position < 1e-4


def test_a_trapezoid_of_speed_passes_wherever_its_corners_lie() -> None:
    for distance in np.linspace(2.0, 2.3, 7):
        found = trapezoid(float(distance), 1.37, 0.93).verify()
        assert found.closure_position < 1e-9
        assert found.wheel_acceleration_ratio <= 1
        assert found.wheel_speed_ratio <= 1


@pytest.mark.parametrize("last", [1e-9, 1e-6, 1e-4])
def test_a_very_short_last_step_passes(last: float) -> None:
    case = moving(drive_of("differential"), duration=3.0)
    true = case.schedule

    def linger(column: Array) -> Array:
        return np.concatenate([column, column[-1:]])

    columns = {f.name: linger(getattr(true, f.name)) for f in fields(WheelSchedule)}
    # Rounding in the last sample but one, which a mean over so short a time would blow up.
    for name in ("wheel_velocity", "wheel_acceleration"):
        columns[name][-2] += 1e-7
    columns["time"][-1] += last
    found = case.limits(wheel_jerk=np.full(2, 40.0)).schedules(**columns).verify()
    assert found.wheel_jerk_ratio < 1


def test_any_heading_will_do_where_none_is_asked_for() -> None:
    case = moving(drive_of("differential"))
    goal = replace(case.problem.goal, theta=None)
    assert replace(case, problem=replace(case.problem, goal=goal)).verify().closure_heading == 0


@pytest.mark.parametrize("turns", [-2, -1, 1, 3])
def test_the_goal_heading_counts_modulo_full_turns(turns: int) -> None:
    case = moving(drive_of("ackermann"))
    theta = case.problem.goal.theta
    assert theta is not None
    goal = replace(case.problem.goal, theta=theta + 2 * math.pi * turns)
    assert replace(case, problem=replace(case.problem, goal=goal)).verify().closure_heading < 2e-6


def test_steering_first_at_rest_passes() -> None:
    """The rate of steering jumps; at both ends it is reported as rest."""
    case = moving(drive_of("ackermann"))
    true, steps, rate = case.schedule, 10, 0.1
    turn = np.arange(-steps, 0)[:, None] * PERIOD * rate
    rates = np.concatenate([np.full((steps, 2), rate), true.steering_rate])
    rates[0] = 0

    def wait(column: Array) -> Array:
        return np.concatenate([np.tile(column[0], (steps, 1)), column])

    schedule = WheelSchedule(
        np.concatenate([np.arange(steps) * PERIOD, true.time + steps * PERIOD]),
        wait(true.wheel_angle), wait(true.wheel_velocity), wait(true.wheel_acceleration),
        np.concatenate([true.steering_angle[0] + turn, true.steering_angle]), rates,
        wait(true.pose), wait(true.twist),
    )  # fmt: skip
    assert asking_for(drive_of("ackermann"), schedule).verify().closure_position < 2e-6


@pytest.mark.parametrize("kind", KINDS)
def test_standing_still_is_certified_by_a_single_sample(kind: str) -> None:
    case = moving(drive_of(kind))
    first = WheelSchedule(*(getattr(case.schedule, f.name)[:1] for f in fields(WheelSchedule)))
    problem = replace(case.problem, goal=Goal(*START))
    found = replace(case, problem=problem, schedule=first).verify(Discs(((START.x, START.y + 1, 0.2),)))
    expected = dict.fromkeys(asdict(found), 0.0) | {"clearance": pytest.approx(1 - 0.2 - RADIUS)}
    assert asdict(found) == expected
    # … but only where the start is the goal.
    elsewhere = replace(
        case, problem=replace(problem, goal=Goal(START.x + 1e-6, START.y, None)), schedule=first
    )
    assert any("from the goal after rolling" in s for s in elsewhere.sentences())


def test_the_certificate_is_finite_json() -> None:
    found = moving(drive_of("differential")).verify(Discs(()))
    assert found.clearance == 1e6
    assert json.loads(json.dumps(asdict(found), allow_nan=False))["clearance"] == 1e6


# ----------------------------------------------------- one thing spoiled

Spoil = Callable[[Case], Case]
AFTER, ALL = slice(70, None), slice(None)


def fast_wheel(case: Case) -> Case:
    j = int(np.argmax(np.abs(case.schedule.wheel_velocity).max(0)))
    gain = np.ones(case.schedule.wheel_angle.shape[1])
    gain[j] = 1.01
    columns = ("wheel_angle", "wheel_velocity", "wheel_acceleration")
    return case.schedules(**{name: getattr(case.schedule, name) * gain for name in columns}).limits(
        wheel_speed=case.problem.robot.limits.wheel_speed * 1.02,
        wheel_acceleration=case.problem.robot.limits.wheel_acceleration * 1.02,
    )


def goal_off(x: float, theta: float) -> Spoil:
    def spoil(case: Case) -> Case:
        goal = case.problem.goal
        assert goal.theta is not None
        return replace(case, problem=replace(case.problem, goal=Goal(goal.x + x, goal.y, goal.theta + theta)))

    return spoil


def start_off(case: Case) -> Case:
    start = case.problem.start
    return replace(case, problem=replace(case.problem, start=start._replace(y=start.y + 1e-4)))


def limit_under(name: str, share: float) -> Spoil:
    return lambda case: case.limits(**{name: getattr(case.problem.robot.limits, name) * share})


def column(name: str, at: Any, by: float) -> Spoil:
    return lambda case: case.schedules(**{name: changed(getattr(case.schedule, name), at, by)})


def jerk_over(case: Case) -> Case:
    used = np.abs(np.diff(case.schedule.wheel_acceleration, axis=0)).max() / PERIOD
    return case.limits(wheel_jerk=np.full(case.schedule.wheel_angle.shape[1], used / 1.04))


SPOILS: dict[str, tuple[Spoil, str]] = {
    "a wheel 1 % fast": (fast_wheel, r"after rolling is|the slip is|rolled and the stated"),
    "goal 5 mm off": (
        goal_off(5e-3, 0),
        r"distance from the goal after rolling is 0\.00[45]\d* m at t = 3\.13",
    ),
    "goal 4 mrad off": (
        goal_off(0, 4e-3),
        r"goal's heading after rolling is 0\.00[34]\d* rad .* allowed 0\.001",
    ),
    "start off": (start_off, r"the distance from the start of y is 0\.0001 .* at t = 0\.0000 s"),
    "speed 2 % over": (
        limit_under("wheel_speed", 0.98),
        r"the wheel speed of \w+ is [\d.]+ rad/s at t = 1\.",
    ),
    "acceleration 2 % over": (limit_under("wheel_acceleration", 0.98), r"the wheel acceleration of \w+ is"),
    "jerk 4 % over": (jerk_over, r"the wheel jerk of \w+ is [\d.]+ rad/s³"),
    "rolling at the end": (column("wheel_velocity", (-1, 0), 1e-3), r"wheel speed at an end .* at t = 3\.13"),
    "rolling at the start": (
        column("wheel_velocity", (0, 1), 1e-3),
        r"wheel speed at an end .* at t = 0\.00",
    ),
    "an angle out of step": (
        column("wheel_angle", (AFTER, 0), 0.01),
        r"gap between the wheel angle .* 1\.38",
    ),
    "a stated twist off": (column("twist", (70, 2), 0.02), r"rolled and the stated twist of omega is 0\.0"),
    "a stated pose off": (column("pose", (70, 0), 2e-3), r"the rolled and the stated position is 0\.00"),
    "a stated heading off": (column("pose", (70, 2), 2e-3), r"the rolled and the stated heading is 0\.00"),
    "a stated theta a turn off": (column("pose", (ALL, 2), 2 * math.pi), r"from the start of theta is 6\.28"),
    "a longer step": (column("time", AFTER, 1e-3), r"^the time grid is not 0, 0\.02, 0\.04"),
    "a late start": (column("time", 0, 1e-3), r"^the time grid"),
    "a last step backwards": (column("time", -1, -0.05), r"^the time grid"),
    "a last step too long": (column("time", -1, 0.05), r"^the time grid"),
}


@pytest.mark.parametrize("name", SPOILS)
@pytest.mark.parametrize("kind", KINDS)
def test_one_thing_spoiled_is_named(kind: str, name: str) -> None:
    spoil, sentence = SPOILS[name]
    found = spoil(moving(drive_of(kind))).sentences()
    assert any(re.search(sentence, each) for each in found), found


@pytest.mark.parametrize("name", [f.name for f in fields(WheelSchedule)])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused(name: str, value: float) -> None:
    case = moving(drive_of("swerve"))
    error = column(name, 30, value)(case).refused()
    assert error.details == {"certificate": {}, "violations": [f"{name} is not finite in sample 30"]}


@pytest.mark.parametrize("name", [f.name for f in fields(WheelSchedule)])
def test_a_column_of_another_shape_is_refused(name: str) -> None:
    case = moving(drive_of("swerve"))
    spoiled = case.schedules(**{name: getattr(case.schedule, name)[:-1]})
    assert any("has shape" in s for s in spoiled.sentences())


@pytest.mark.parametrize("answer", ["twist", "slip"])
def test_kinematics_that_answer_nan_are_refused(answer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    case = moving(drive_of("differential"))
    true = Differential.forward

    def broken(drive: Differential, *state: Array) -> tuple[Array, Array]:
        twist, slip = true(drive, *state)
        (twist if answer == "twist" else slip)[80] = math.nan
        return twist, slip

    monkeypatch.setattr(Differential, "forward", broken)
    assert any("is nan" in s for s in case.sentences())


def test_no_sample_at_all_is_refused() -> None:
    case = moving(drive_of("swerve"))
    nothing = WheelSchedule(*(getattr(case.schedule, f.name)[:0] for f in fields(WheelSchedule)))
    assert replace(case, schedule=nothing).sentences() == ["the schedule has no sample"]


@pytest.mark.parametrize("name", ["wheel_angle", "wheel_velocity", "wheel_acceleration", "pose", "twist"])
def test_numbers_near_overflow_are_refused(name: str) -> None:
    case = moving(drive_of("ackermann"))
    column(name, 70, 1e308)(case).refused()
    case.schedules(**{name: getattr(case.schedule, name) * 0 + 1e308}).refused()


@pytest.mark.parametrize("kind", OVERDETERMINED)
def test_wheels_that_disagree_slip(kind: str) -> None:
    found = column("wheel_velocity", (70, 0), 0.1)(moving(drive_of(kind))).sentences()
    assert any(s.startswith("the slip is 0.00") and "at t = 1.4000 s" in s for s in found), found


@pytest.mark.parametrize("kind", STEERED)
def test_steering_spoiled_is_named(kind: str) -> None:
    case = moving(drive_of(kind), weave=0.25)
    schedule, limits = case.schedule, case.problem.robot.limits
    first = drive_of(kind).steered_names[0]
    used = float(np.abs(schedule.steering_rate).max())
    case = case.limits(steering_rate=used * 1.001)
    assert case.verify().steering_rate_ratio == pytest.approx(1 / 1.001, abs=1e-3)
    assert case.problem.steering is not None
    turned = replace(case, problem=replace(case.problem, steering=changed(case.problem.steering, 0, 1e-3)))
    largest = float(np.abs(schedule.steering_angle).max())
    mirrored = 2 * schedule.steering_angle[0] - schedule.steering_angle
    for spoiled, sentence in (
        (case.limits(steering_rate=used / 1.02), r"^the steering rate of \w+ is [\d.]+ rad/s at"),
        (
            column("steering_rate", (70, 0), 2.1 * used)(case),
            rf"^the steering rate of {first} .* t = 1\.4000 s",
        ),
        (
            column("steering_angle", (AFTER, 0), used / 10)(case),
            rf"^the steering rate of {first} .* t = 1\.38",
        ),
        (case.limits(steering_angle=largest / 1.001), r"^the steering angle of \w+ is [\d.]+ rad at"),
        (turned, rf"^the angle from the present steering of {first} is 0\.001 rad at t = 0\.0000 s"),
        (
            column("steering_rate", (-1, 0), 0.01)(case),
            rf"^the steering rate at an end of the motion of {first}",
        ),
        (case.schedules(steering_angle=mirrored), r"^the gap between the steering angle and the integral"),
    ):
        found = spoiled.sentences()
        assert any(re.search(sentence, s) for s in found), (sentence, found)
    assert limits.steering_angle == math.inf
    exactly = case.limits(steering_angle=largest).verify()
    assert exactly.steering_angle_ratio == pytest.approx(1)


def test_velocity_is_the_integral_of_acceleration_where_jerk_is_limited() -> None:
    case = moving(drive_of("differential"))
    used = np.abs(np.diff(case.schedule.wheel_acceleration, axis=0)).max() / PERIOD
    case = case.limits(wheel_jerk=np.full(2, used))
    assert case.verify().wheel_jerk_ratio == pytest.approx(1, rel=1e-3)
    more = case.schedules(wheel_acceleration=case.schedule.wheel_acceleration + 0.3)
    assert any("between the wheel velocity and the integral" in s for s in more.sentences())


@pytest.mark.parametrize("kind", KINDS)
def test_driving_backwards_where_that_is_forbidden(kind: str) -> None:
    drive = drive_of(kind)
    vx, vy, omega = tangent_of(drive)
    assert moving(drive).options(reverse=False).verify()
    backwards = moving(drive, Twist(-vx, vy, omega))
    assert backwards.verify()
    assert any("the speed backwards" in s for s in backwards.options(reverse=False).sentences())


@pytest.mark.parametrize("kind", KINDS)
def test_turning_tighter_than_asked(kind: str) -> None:
    case = moving(drive_of(kind))
    vx, _, omega = tangent_of(drive_of(kind))
    assert case.options(turning_radius=vx / omega).verify()
    tighter = case.options(turning_radius=1.03 * vx / omega)
    if isinstance(drive_of(kind).mobility(case.problem.robot.limits), Holonomic):
        assert tighter.verify()
    else:
        assert any("the turn rate times turning_radius" in s for s in tighter.sentences())


@pytest.mark.parametrize(
    "name", ["linear_speed", "angular_speed", "linear_acceleration", "lateral_acceleration"]
)
@pytest.mark.parametrize("kind", KINDS)
def test_the_limits_of_the_body(kind: str, name: str) -> None:
    case = moving(drive_of(kind))
    vx, vy, omega = tangent_of(drive_of(kind))
    speed = math.hypot(vx, vy)
    used = {
        "linear_speed": speed,
        "angular_speed": omega,
        "linear_acceleration": speed * math.pi / DURATION,
        "lateral_acceleration": speed * omega,
    }[name]
    found = case.limits(**{name: used * 1.001}).verify()
    assert getattr(found, f"{name}_ratio") == pytest.approx(1, abs=2e-3)
    sentence = f"the {name.replace('_', ' ')} is "
    assert any(s.startswith(sentence) for s in case.limits(**{name: used * 0.97}).sentences())


def test_a_corner_taken_at_rest_is_no_lateral_acceleration() -> None:
    """Two straight legs at a right angle; the stop between them falls inside an interval of the grid."""
    drive, ramp = drive_of("omni"), 0.531
    time = np.append(np.arange(0.0, 4 * ramp, PERIOD), 4 * ramp)
    s, speed, change = np.zeros((3, 2, len(time)))
    for leg in (0, 1):
        t = np.clip(time - 2 * leg * ramp, 0, 2 * ramp)
        s[leg] = np.where(t < ramp, t**2 / 2, ramp**2 - (2 * ramp - t) ** 2 / 2)
        speed[leg] = np.minimum(t, 2 * ramp - t)
        change[leg] = np.where((t > 0) & (t < 2 * ramp), np.where(t < ramp, 1.0, -1.0), 0.0)
    change[0, 0] = 1.0
    rows = np.array([drive.inverse(Twist(*e)).rates for e in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))])
    pose = np.array([compose(START, Pose(x, y, 0.0)) for x, y in s.T])
    none = np.zeros((len(time), 0))
    twist = np.column_stack([speed.T, np.zeros(len(time))])
    schedule = WheelSchedule(time, s.T @ rows, speed.T @ rows, change.T @ rows, none, none, pose, twist)
    found = (
        asking_for(drive, schedule).limits(wheel_speed=np.full(3, 11.0), lateral_acceleration=0.05).verify()
    )
    assert found.lateral_acceleration_ratio < 1e-6


# ------------------------------------------------------------- clearance


@pytest.mark.parametrize("kind", KINDS)
def test_an_obstacle_in_the_way(kind: str) -> None:
    case = moving(drive_of(kind))
    x, y, _ = case.schedule.pose[100]
    error = case.refused(Discs(((x, y, 0.05),)))
    assert [s for s in error.details["violations"] if not s.startswith("the clearance is -0.3")] == []
    assert "at t = 2.0" in error.message
    assert error.details["certificate"]["clearance"] == pytest.approx(-0.35, abs=3e-3)
    assert set(error.details["certificate"]) == {f.name for f in fields(Certificate)}


@pytest.mark.parametrize("period", [0.002, 0.02, 0.5])
@pytest.mark.parametrize("beside", [0.31, 0.5, 2.0, 20.0])
def test_the_clearance_is_the_smallest_over_the_whole_motion(period: float, beside: float) -> None:
    case = moving(drive_of("differential"), Twist(1.0, 0.0, 0.0), period=period)
    x, y, _ = compose(START, Pose(0.7531, beside + 0.1, 0.0))
    world = Discs(((x, y, 0.1), (x + 30, y, 0.1)))
    assert case.verify(world).clearance == pytest.approx(beside - RADIUS, abs=3e-5)
    assert world.asked < 400


def test_the_least_clearance_asked_for_is_kept() -> None:
    case = moving(drive_of("differential"), Twist(1.0, 0.0, 0.0))
    x, y, _ = compose(START, Pose(0.75, 0.6, 0.0))
    world = Discs(((x, y, 0.1),))
    assert case.options(min_clearance=0.2).verify(world).clearance == pytest.approx(0.2, abs=3e-5)
    found = case.options(min_clearance=0.202).sentences(world)
    assert len(found) == 1
    assert re.match(
        r"the clearance is 0\.2\d* m at t = 1\.\d+ s, pose \(.*\), allowed at least 0\.202 m", found[0]
    )


def test_clearance_is_looked_at_on_the_arc_and_on_the_chord() -> None:
    """With samples far apart, what the robot does and what the samples say differ by the arc's height."""
    case = moving(drive_of("differential"), Twist(1.0, 0.0, 1.0), period=0.4, duration=4.0)
    case = case.limits(wheel_acceleration=np.full(2, 12.0))
    before, after = case.schedule.pose[5:7, 2] - START.theta
    rise = 1 - math.cos((after - before) / 2)  # of the arc, its radius 1 m, over its chord
    assert rise > 0.01
    turn = (before + after) / 2
    middle = compose(START, exp(Twist(turn, 0.0, turn)))
    inside, outside = (compose(middle, Pose(0.0, y, 0.0)) for y in (0.6, -0.6))
    near = 0.6 - 0.1 - RADIUS
    assert case.verify(Discs(((*inside[:2], 0.1),))).clearance == pytest.approx(near - rise, abs=2e-3)
    assert case.verify(Discs(((*outside[:2], 0.1),))).clearance == pytest.approx(near, abs=2e-3)


def test_a_synchro_drive_keeps_the_heading_of_its_body() -> None:
    world = Discs()
    moving(drive_of("synchro")).verify(world)
    assert set(world.headings) == {PARAMETERS["synchro"]["body_heading"]}


@pytest.mark.parametrize("value", [math.nan, -math.inf])
def test_a_clearance_that_is_no_number_fails(value: float) -> None:
    class Broken:
        def clearance(self, poses: Array) -> Array:
            return np.where(np.arange(len(poses)) == 3, value, 1.0)

    error = moving(drive_of("differential")).refused(Broken())
    assert error.details["certificate"]["clearance"] == -1e6
    assert error.details["violations"][0].startswith("the clearance is -1e+06 m at t = ")


def test_a_motion_too_long_to_check_fails_and_says_so() -> None:
    world = Discs()
    found = column("pose", (70, 0), 1e7)(moving(drive_of("differential"))).sentences(world)
    assert re.fullmatch(r"the footprint moves 2e\+07 m, of which 110000 m can be checked", found[0])
    assert world.asked < 1000
