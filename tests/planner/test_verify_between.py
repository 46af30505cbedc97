"""Exact schedules, spoiled so that samples and means over intervals still look right, are refused."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from drives import Mecanum
from drives.se2 import Array, Pose, Twist, compose
from planner.schedule import WheelSchedule
from tests.planner.schedules import (
    DURATION,
    KINDS,
    PERIOD,
    START,
    Case,
    asking_for,
    changed,
    drive_of,
    exact,
)

STEERED = ["ackermann", "powered_caster", "swerve", "synchro", "tricycle"]
FIXED = ["differential", "mecanum", "omni", "skid_steer", "swedish", "tracked"]


def named(case: Case, sentence: str) -> None:
    found = case.sentences()
    assert any(re.match(sentence, each) for each in found), found


def straight(speed: Array, kind: str = "differential", direction: tuple[float, float] = (1.0, 0.0)) -> Case:
    """Straight ahead at speeds (n,) m/s at the samples, linear between them."""
    drive = drive_of(kind)
    time = np.arange(len(speed)) * PERIOD
    way = np.append(0.0, np.cumsum(PERIOD * (speed[1:] + speed[:-1]) / 2))
    slope = np.diff(speed) / PERIOD
    rates = drive.inverse(Twist(*direction, 0.0)).rates
    twist = speed[:, None] * [*direction, 0.0]
    pose = np.array([compose(START, Pose(*(s * np.array(direction)), 0.0)) for s in way])
    columns = (np.outer(v, rates) for v in (way, speed, np.append(slope, slope[-1])))
    none = np.zeros((len(time), 0))
    return asking_for(drive, WheelSchedule(time, *columns, none, none, pose, twist))


@pytest.mark.parametrize("kind", KINDS)
def test_a_wheel_acceleration_between_samples(kind: str) -> None:
    """An angle off by h²/5 times the limit changes the accelerations beside it by 1.2 times the limit."""
    case = exact(kind)
    by = PERIOD**2 / 5 * case.problem.robot.limits.wheel_acceleration[0]
    spoiled = case.schedules(wheel_angle=changed(case.schedule.wheel_angle, (70, 0), by))
    named(spoiled, r"the wheel acceleration between samples of \w+ is .* at t = 1\.(38|4|42)")


@pytest.mark.parametrize("kind", KINDS)
def test_a_wheel_speed_between_samples(kind: str) -> None:
    case = exact(kind, 0.1)
    rates, limits = case.schedule.wheel_velocity, case.problem.robot.limits
    j = int(np.argmax(np.abs(rates[15])))
    by = 0.02 * 0.1 * rates[15, j]
    case = case.limits(
        wheel_acceleration=0 * limits.wheel_acceleration + 1e3,
        wheel_speed=0 * limits.wheel_speed + np.abs(rates[15:17]).max() * 1.001,
    )
    spoiled = case.schedules(wheel_angle=changed(case.schedule.wheel_angle, (slice(16, None), j), by))
    name = drive_of(kind).wheel_names[j]
    named(spoiled, rf"the wheel speed between samples of {name} is .* at t = 1\.5\d+ s")


@pytest.mark.parametrize("kind", STEERED)
def test_a_steering_rate_between_samples(kind: str) -> None:
    case = exact(kind, weave=0.3)
    used = float(np.abs(case.schedule.steering_rate).max())
    case = case.limits(steering_rate=used * 1.01)
    assert case.verify().steering_rate_ratio <= 1
    k, j = np.unravel_index(np.argmax(np.abs(case.schedule.steering_rate)), case.schedule.steering_rate.shape)
    by = 0.3 * PERIOD * case.schedule.steering_rate[k, j]
    spoiled = case.schedules(steering_angle=changed(case.schedule.steering_angle, (slice(k, None), j), by))
    named(spoiled, rf"the steering rate of {drive_of(kind).steered_names[j]} is ")


@pytest.mark.parametrize("kind", STEERED)
def test_a_steering_angle_between_samples(kind: str) -> None:
    """The wheel swings out and back between two samples at which it stands within the limit."""
    case = exact(kind)
    schedule = case.schedule
    largest = float(np.abs(schedule.steering_angle).max())
    k, j = np.unravel_index(np.argmax(np.abs(schedule.steering_angle)), schedule.steering_angle.shape)
    k = min(max(int(k), 1), len(schedule.time) - 3)
    out = 2.0 * (1.0 if schedule.steering_angle[k, j] >= 0 else -1.0)
    rate = changed(changed(schedule.steering_rate, (k, j), out), (k + 1, j), -out)
    spoiled = case.limits(steering_angle=largest + 1e-6, steering_rate=100.0).schedules(steering_rate=rate)
    named(spoiled, rf"the steering angle between samples of {drive_of(kind).steered_names[j]} is ")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.0, 0.9])
def test_a_stated_acceleration_that_is_not_the_cubic_s(kind: str, share: float) -> None:
    case = exact(kind)
    named(
        case.schedules(wheel_acceleration=share * case.schedule.wheel_acceleration),
        r"the gap between the stated and the interpolated wheel acceleration of \w+ is ",
    )


@pytest.mark.parametrize("beside", [0.2, 0.5, 0.8])
def test_an_acceleration_between_those_of_two_intervals_may_be_stated(beside: float) -> None:
    case = exact("differential")
    true = case.schedule.wheel_acceleration
    mixed = true.copy()
    mixed[1:-1] = beside * true[1:-1] + (1 - beside) * true[:-2]
    assert case.schedules(wheel_acceleration=mixed).verify()


def test_a_jump_of_acceleration_counts_as_jerk_over_one_period() -> None:
    case = exact("differential")
    limit = case.problem.robot.limits.wheel_acceleration
    jump = limit / 1.001 / PERIOD
    assert case.limits(wheel_jerk=jump).verify().wheel_jerk_ratio == pytest.approx(1, abs=1e-6)
    named(case.limits(wheel_jerk=jump / 1.05), r"the wheel jerk of \w+ is .* at t = 0\.0000 s")
    # The column says nothing of a jerk that the cubics have.
    flat = case.schedules(wheel_acceleration=0 * case.schedule.wheel_acceleration)
    named(flat.limits(wheel_jerk=jump / 1.05), r"the wheel jerk of \w+ is .* at t = 0\.0000 s")


@pytest.mark.parametrize("speed", [1.0, 0.3])
def test_a_reversal_within_one_interval_is_an_acceleration(speed: float) -> None:
    ramp = np.linspace(0.0, speed, 40)
    case = straight(np.concatenate([ramp, -ramp[::-1]]))
    used = 2 * speed / PERIOD
    found = case.limits(linear_acceleration=used).verify()
    assert found.linear_acceleration_ratio == pytest.approx(1, abs=1e-6)
    named(
        case.limits(linear_acceleration=0.9 * used),
        r"the linear acceleration of the rolled motion is [\d.]+ m/s² at t = 0\.8",
    )


def test_a_stated_reversal_is_an_acceleration() -> None:
    """The wheels stand; the stated twists do not."""
    case = straight(np.zeros(60))
    twist = case.schedule.twist.copy()
    twist[30:40, 0] = [1e-4, -1e-4] * 5
    named(
        case.schedules(twist=twist).limits(
            linear_acceleration=5e-3, wheel_acceleration=np.ones(2), wheel_speed=np.ones(2)
        ),
        r"the linear acceleration is 0\.01 m/s² at t = 0\.[67]",
    )


def corner(brake: bool) -> Case:
    """An omni robot turns its direction of travel at 0.2 m/s, and brakes hard somewhere else."""
    drive, n = drive_of("omni"), 400
    time = np.arange(n) * PERIOD
    speed = 0.2 * np.minimum(np.minimum(time, time[-1] - time), 1.0)
    if brake:
        speed[300:310] = [0.2, 1.0, 2.0, 1.0, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2]
    course = np.interp(time, [2.0, 2.6], [0.0, 1.5])
    twist = np.column_stack([speed * np.cos(course), speed * np.sin(course), np.zeros(n)])
    rows = np.array([drive.inverse(Twist(*unit)).rates for unit in np.eye(3)])
    way = np.vstack([np.zeros(3), np.cumsum(PERIOD * (twist[1:] + twist[:-1]) / 2, axis=0)])
    slope = np.diff(twist, axis=0) / PERIOD
    pose = np.array([compose(START, Pose(x, y, 0.0)) for x, y, _ in way])
    columns = (each @ rows for each in (way, twist, np.vstack([slope, slope[-1:]])))
    none = np.zeros((n, 0))
    return asking_for(drive, WheelSchedule(time, *columns, none, none, pose, twist))


@pytest.mark.parametrize("brake", [False, True])
def test_lateral_acceleration_is_judged_in_slow_phases_whatever_happens_elsewhere(brake: bool) -> None:
    case = corner(brake)
    used = 0.2 * 1.5 / 0.6
    found = case.limits(lateral_acceleration=used * 1.01).verify()
    assert found.lateral_acceleration_ratio == pytest.approx(1 / 1.01, abs=2e-3)
    named(
        case.limits(lateral_acceleration=used / 1.1),
        r"the lateral acceleration of the rolled motion is .* at t = 2\.",
    )


def test_lateral_acceleration_of_a_drive_that_only_goes_ahead_is_speed_times_turn_rate() -> None:
    case = exact("differential", tangent=Twist(0.02, 0.0, 0.5))
    found = case.limits(lateral_acceleration=0.01).verify()
    assert found.lateral_acceleration_ratio == pytest.approx(1, abs=1e-4)
    named(
        case.limits(lateral_acceleration=0.0097),
        r"the lateral acceleration of the rolled motion is 0\.01 m/s²",
    )


def test_the_direction_of_travel_that_turns_between_samples_is_seen() -> None:
    """From (1, 0.3) to (-1, 0.3) m/s in one interval: the whole acceleration is lateral in its middle."""
    drive = drive_of("omni")
    ramp = np.linspace(0.0, 1.0, 40)[:, None]
    twist = np.vstack([ramp * [1.0, 0.3, 0.0], ramp[::-1] * [-1.0, 0.3, 0.0]])
    time = np.arange(80) * PERIOD
    rows = np.array([drive.inverse(Twist(*unit)).rates for unit in np.eye(3)])
    way = np.vstack([np.zeros(3), np.cumsum(PERIOD * (twist[1:] + twist[:-1]) / 2, axis=0)])
    slope = np.diff(twist, axis=0) / PERIOD
    pose = np.array([compose(START, Pose(x, y, 0.0)) for x, y, _ in way])
    columns = (each @ rows for each in (way, twist, np.vstack([slope, slope[-1:]])))
    none = np.zeros((80, 0))
    case = asking_for(drive, WheelSchedule(time, *columns, none, none, pose, twist))
    found = case.limits(lateral_acceleration=100.0).verify()
    assert found.lateral_acceleration_ratio == pytest.approx(1, abs=5e-3)


def test_a_step_back_between_two_samples_is_driving_backwards() -> None:
    case = straight(np.concatenate([np.linspace(0, 1, 40), np.linspace(1, 0, 40), np.zeros(20)]))
    loose = case.limits(wheel_acceleration=np.full(2, 1e3)).options(reverse=False)
    assert loose.verify()
    back = loose.schedules(
        wheel_angle=changed(case.schedule.wheel_angle, slice(90, None), -1e-3),
        pose=changed(case.schedule.pose, (slice(90, None), 0), -1e-4),
    )
    named(back, r"the speed backwards although reverse is false is 0\.0075\d* m/s at t = 1\.78")


def test_turning_tighter_between_two_samples() -> None:
    """Before and after the samples agree; in between one wheel runs ahead of the other."""
    case = exact("differential", tangent=Twist(1.0, 0.0, 0.5)).limits(
        wheel_acceleration=np.full(2, 1e3), wheel_speed=np.full(2, 100.0)
    )
    case = case.options(turning_radius=2.0)
    assert case.verify()
    ahead = changed(case.schedule.wheel_angle, (slice(80, None), 0), -2e-3)
    named(case.schedules(wheel_angle=ahead), r"the turn rate times turning_radius is .* at t = 1\.58")


@pytest.mark.parametrize("kind", ["ackermann", "powered_caster", "swerve", "tricycle"])
def test_slip_between_samples(kind: str) -> None:
    """A steered wheel swings out and back while the robot drives on."""
    case = exact(kind).limits(steering_rate=1e3)
    rate = changed(changed(case.schedule.steering_rate, (80, 0), 4.0), (81, 0), -4.0)
    named(case.schedules(steering_rate=rate), r"the slip is [\d.]+ m/s at t = 1\.(58|6|62)")


@pytest.mark.parametrize("by", [0.01, -0.3, 2.0, np.pi])
def test_wheels_of_a_synchro_drive_that_do_not_point_along_theta(by: float) -> None:
    case = exact("synchro")
    turned = case.schedules(steering_angle=case.schedule.steering_angle + by)
    turned = replace(turned, problem=replace(case.problem, steering=None))
    named(turned, r"the angle between the heading and that of the steered wheel of wheel_\d is ")
    round_again = case.schedules(steering_angle=case.schedule.steering_angle + 2 * np.pi)
    assert replace(round_again, problem=replace(case.problem, steering=None)).verify()


@pytest.mark.parametrize("kind", FIXED)
def test_zeros_written_at_the_start_of_a_motion_under_way(kind: str) -> None:
    """Without its first second the motion begins at full speed; only the first sample says it is at rest."""
    whole = exact(kind)
    cut = {name: getattr(whole.schedule, name)[50:].copy() for name in WheelSchedule.__slots__}
    cut["time"] = np.append(np.arange(len(cut["time"]) - 1) * PERIOD, DURATION - 50 * PERIOD)
    for name in ("wheel_velocity", "twist", "wheel_acceleration"):
        cut[name][0] = 0.0
    schedule = WheelSchedule(**cut)
    problem = replace(whole.problem, start=Pose(*cut["pose"][0].tolist()))
    named(Case(problem, schedule), r"the wheel acceleration(?: between samples)? of \w+ is .* at t = 0\.0")


def test_wheels_said_to_rest_while_the_body_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rest is measured on the forward twist, too."""
    case = exact("mecanum")
    true = Mecanum.forward

    def creeping(drive: Mecanum, *state: Array) -> tuple[Array, Array]:
        twist, slip = true(drive, *state)
        return np.add(twist, [1e-4, 0.0, 0.0]), slip

    monkeypatch.setattr(Mecanum, "forward", creeping)
    named(case, r"the twist at an end of the motion of vx is 0\.0001 ")


@pytest.mark.parametrize("share", [1e-3, 1e-5])
def test_a_very_short_last_step_hides_no_jump(share: float) -> None:
    """A last step may be so short that its acceleration is rounding; the stop within it still counts."""
    case = exact("differential", duration=(60 + share) * PERIOD)
    schedule = case.schedule
    moving = changed(schedule.wheel_velocity, (-2, 0), 0.5)
    named(case.schedules(wheel_velocity=moving), r"the wheel acceleration(?: between samples)? of left is ")
