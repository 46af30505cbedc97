"""The certificate: what becomes of a client who does nothing but follow the wheel schedule.

It interpolates the samples as a client does, with cubics, puts them through the drive's forward kinematics,
integrates the twists, and compares the motion with what was asked for: at the samples and between them. It
shares no code with the planner's search, timing and optimization (docs/certificate.md lists what it shares).
Every check yields `Reading`s, values against bounds; `_judge` turns them into a `Certificate` and sentences.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from drives.drive import Holonomic
from drives.se2 import Array, Pose, wrap
from planner import body_gauges, gauges
from planner import tolerances as allowed
from planner.errors import AuditFailed
from planner.nearest import Surroundings, least_clearance, ways
from planner.problem import Problem
from planner.rolling import Rolled, roll
from planner.schedule import WheelSchedule

__all__ = ["Certificate", "Surroundings", "verify"]


@dataclass(frozen=True, slots=True)
class Certificate:
    """What an independent check of a schedule found, worst case over the whole motion, between samples, too.

    closure_position m, closure_heading rad: distance from the goal to the end of the rolled motion (heading 0
    if any will do); each *_ratio: used / allowed, 0 if there is no limit; slip m/s: largest residual of the
    wheels' equations; clearance m: a lower bound of the distance from the footprint to obstacles and bounds,
    accurate to 0.1 mm or to 1 % of its distance from min_clearance; drift_position m, drift_heading rad:
    largest gap between rolled and stated poses. All lie within ±1e6, the clearance without any obstacle.
    """

    closure_position: float
    closure_heading: float
    wheel_speed_ratio: float
    wheel_acceleration_ratio: float
    wheel_jerk_ratio: float
    steering_angle_ratio: float
    steering_rate_ratio: float
    slip: float
    clearance: float
    linear_speed_ratio: float
    angular_speed_ratio: float
    linear_acceleration_ratio: float
    lateral_acceleration_ratio: float
    drift_position: float
    drift_heading: float


class Reading(NamedTuple):
    """The largest share of a bound that a quantity uses: value / bound. quantity is a key of
    tolerances.QUANTITIES; at s; owner: which wheel or coordinate, "" for the robot."""

    quantity: str
    used: float
    value: float
    bound: float
    at: float
    owner: str = ""


def _reading(quantity: str, value: float, bound: float, at: float, owner: str = "") -> Reading:
    used = value / bound
    return Reading(quantity, math.inf if math.isnan(used) else used, value, bound, at, owner)


def _readings(quantities: Sequence[str], table: Array, columns: Sequence[str] = ()) -> Iterator[Reading]:
    """Of a gauge's table; column j is of columns[j] (none: of the robot)."""
    for quantity, (used, at, j, value, bound) in zip(quantities, table.tolist(), strict=True):
        if used >= 0:
            yield Reading(quantity, used, value, bound, at, columns[int(j)] if columns else "")


def verify(problem: Problem, schedule: WheelSchedule, world: Surroundings) -> Certificate:
    """Certify a schedule for a problem.

    Raises AuditFailed with what was found and a sentence for each violation. If a column has the wrong shape,
    a number is not finite or the time grid is not the client's, the certificate is empty.
    """
    violations = _unreadable(problem, schedule)
    if violations:
        raise AuditFailed(f"the schedule cannot be read: {violations[0]}", {}, violations)
    found = {field.name: 0.0 for field in fields(Certificate)}
    # Overflows end as inf or nan, and both are violations.
    with np.errstate(all="ignore"):
        rolled = roll(problem, schedule)
        body, bounds = _rolled_body(problem, rolled)
        found["clearance"], violations = _clearance(problem, rolled, bounds, world)
        checks = (_closure, _wheels, _steering, _ends, _agreement, _stated_body)
        readings = [r for check in checks for r in check(problem, schedule, rolled)]
        for reading in (*readings, *_readings(_ROLLED, body)):
            most, faults = _judge(reading)
            violations += faults
            field = reading.quantity.removesuffix(" between")
            if field in found:
                found[field] = max(found[field], most)
    if violations:
        raise AuditFailed(f"the plan fails its own check: {violations[0]}", found, violations)
    return Certificate(**found)


def _judge(reading: Reading) -> tuple[float, list[str]]:
    """What to certify, and a sentence if the bound is passed."""
    what, unit, slack = allowed.QUANTITIES[reading.quantity]
    _, used, value, bound, at, owner = reading
    found = used if "_ratio" in reading.quantity else value
    found = found if found < allowed.SATURATED else allowed.SATURATED  # also if it is not a number
    if used <= 1 + slack:
        return found, []
    of = f" of {owner}" if owner else ""
    return found, [f"{what}{of} is {value:.6g} {unit} at t = {at:.4f} s, allowed {bound:.6g} {unit}"]


def _unreadable(problem: Problem, schedule: WheelSchedule) -> list[str]:
    """Why a schedule cannot be measured at all."""
    drive, n = problem.robot.drive, len(schedule.time)
    if n == 0:
        return ["the schedule has no sample"]
    tail = {"wheel": (len(drive.wheel_names),), "steering": (len(drive.steered_names),), "time": ()}
    faults = []
    for name in (field.name for field in fields(schedule)):
        column, shape = getattr(schedule, name), (n, *tail.get(name.split("_")[0], (3,)))
        if column.shape != shape:
            faults.append(f"{name} has shape {column.shape}, not {shape}")
        elif not np.isfinite(column).all():
            faults.append(f"{name} is not finite in sample {np.argwhere(~np.isfinite(column))[0, 0]}")
    if faults:
        return faults
    time, period = schedule.time, problem.options.sample_period
    off = np.abs(time - np.arange(n) * period)[: max(n - 1, 1)]
    last = time[-1] - time[-2] if n > 1 else period
    if not (0 < last <= period * (1 + 1e-6) and off.max() <= allowed.COPIED):
        faults = [f"the time grid is not 0, {period:g}, {2 * period:g}, … s with a last step no longer"]
    return faults


def _tolerance(rolled: Rolled) -> float:
    """How far an open-loop motion of this length may be off, m."""
    return allowed.POSITION + allowed.POSITION_PER_METRE * rolled.length


def _closure(problem: Problem, schedule: WheelSchedule, rolled: Rolled) -> Iterator[Reading]:
    goal, (x, y, theta), end = problem.goal, rolled.pose[-1].tolist(), float(schedule.time[-1])
    # A single sample claims that the start is the goal; nothing is rolled.
    near, aligned = _tolerance(rolled), allowed.HEADING
    if len(schedule.time) == 1:
        near = aligned = allowed.SAME
    apart = math.sqrt((x - goal.x) ** 2 + (y - goal.y) ** 2)
    yield _reading("closure_position", apart, near, end)
    if goal.theta is not None:
        yield _reading("closure_heading", abs(wrap(theta - goal.theta)), aligned, end)


def _wheels(problem: Problem, schedule: WheelSchedule, _: Rolled) -> Iterator[Reading]:
    limits, quantities = problem.robot.limits, (
        "wheel_speed_ratio", "wheel_speed_ratio between", "wheel_acceleration_ratio",
        "wheel_acceleration_ratio between", "wheel_jerk_ratio", "wheel acceleration column",
    )  # fmt: skip
    table = gauges.wheels(
        schedule.time, problem.options.sample_period, schedule.wheel_angle, schedule.wheel_velocity,
        schedule.wheel_acceleration, limits.wheel_speed, limits.wheel_acceleration, limits.wheel_jerk,
        allowed.COLUMN,
    )  # fmt: skip
    return _readings(quantities, table, problem.robot.drive.wheel_names)


def _steering(problem: Problem, schedule: WheelSchedule, rolled: Rolled) -> Iterator[Reading]:
    limits, drive = problem.robot.limits, problem.robot.drive
    quantities = "steering_angle_ratio", "steering_angle_ratio between", "steering_rate_ratio"
    table = gauges.steering(
        schedule.time, schedule.steering_angle, schedule.steering_rate, limits.steering_angle,
        limits.steering_rate,
    )  # fmt: skip
    yield from _readings(quantities, table, drive.steered_names)
    headings = drive.steered_headings(schedule.steering_angle)
    if headings is not None:
        for pose in (rolled.pose, schedule.pose):
            off = np.abs(np.remainder(headings - pose[:, 2:] + math.pi, math.tau) - math.pi)
            i, j = np.unravel_index(int(np.argmax(off)), off.shape)
            at, owner = float(schedule.time[i]), drive.steered_names[j]
            yield _reading("steered heading", float(off[i, j]), allowed.HEADING, at, owner)


def _ends(problem: Problem, schedule: WheelSchedule, rolled: Rolled) -> Iterator[Reading]:
    drive, limits, time = problem.robot.drive, problem.robot.limits, schedule.time
    steered = np.full(len(drive.steered_names), limits.steering_rate)
    twists = np.full(3, 2 * _fastest(rolled))
    for quantity, rate, limit, names in (
        ("wheels at rest", schedule.wheel_velocity, limits.wheel_speed, drive.wheel_names),
        ("steering at rest", schedule.steering_rate, steered, drive.steered_names),
        ("body at rest", rolled.twist, twists, _TWIST),
        ("body at rest", schedule.twist, twists, _TWIST),
    ):
        table = gauges.ends(time[[0, -1]], rate[[0, -1]], allowed.REST * limit + allowed.SAME)
        yield from _readings((quantity,), table, names)
    for owner, stated, asked in zip(Pose._fields, schedule.pose[0].tolist(), problem.start, strict=True):
        yield _reading("start", abs(stated - asked), allowed.COPIED, 0.0, owner)
    if problem.steering is not None:
        turned = schedule.steering_angle[:1] - problem.steering
        table = gauges.ends(time[:1], turned, np.full(len(steered), allowed.COPIED))
        yield from _readings(("present steering",), table, drive.steered_names)


def _fastest(rolled: Rolled) -> float:
    """The largest speed (m/s), at least 0.05, or turn rate (rad/s), if that is more."""
    return max(
        0.05,
        float(np.hypot(rolled.twist[:, 0], rolled.twist[:, 1]).max()),
        float(np.abs(rolled.twist[:, 2]).max()),
    )


def _agreement(_: Problem, schedule: WheelSchedule, rolled: Rolled) -> Iterator[Reading]:
    share, room = allowed.TWIST
    twist, *drift = gauges.agreement(
        schedule.time, rolled.twist[::4].copy(), rolled.pose, schedule.twist, schedule.pose,
        share * _fastest(rolled) + room, _tolerance(rolled), allowed.HEADING,
    )  # fmt: skip
    yield from _readings(("twist",), twist[None], _TWIST)
    yield from _readings(("drift_position", "drift_heading"), np.array(drift))


_TWIST = "vx", "vy", "omega"
_LIMITS = (
    "linear_speed_ratio", "angular_speed_ratio", "linear_acceleration_ratio", "lateral_acceleration_ratio",
)  # fmt: skip
_STATED = (*_LIMITS, "backwards", "turning")
_ROLLED = (*(f"{name} between" for name in _LIMITS), "backwards", "turning", "slip")


def _asked_of_body(problem: Problem) -> tuple[float, float, float, float, bool, bool, float, Array]:
    """The limits of the body, and the rules for its route, as the gauges take them."""
    limits, options = problem.robot.limits, problem.options
    holonomic = isinstance(problem.robot.drive.mobility(limits), Holonomic)
    radius = 0.0 if holonomic else float(options.turning_radius)
    tolerances = np.array([allowed.BACKWARDS, *allowed.TURNING, *allowed.SLIP])
    return (
        float(limits.linear_speed), float(limits.angular_speed), float(limits.linear_acceleration),
        float(limits.lateral_acceleration), holonomic, not options.reverse, radius, tolerances,
    )  # fmt: skip


def _rolled_body(problem: Problem, rolled: Rolled) -> tuple[Array, Array]:
    """The table of the rolled motion, and bounds of its speed and turn rate in every interval."""
    return body_gauges.rolled(rolled.path, rolled.twist, rolled.slip, *_asked_of_body(problem))


def _stated_body(problem: Problem, schedule: WheelSchedule, _: Rolled) -> Iterator[Reading]:
    least = 1e-3 * problem.options.sample_period  # means over less are rounding
    table = body_gauges.stated(schedule.time, least, schedule.twist, schedule.pose, *_asked_of_body(problem))
    return _readings(_STATED, table)


def _clearance(
    problem: Problem, rolled: Rolled, bounds: Array, world: Surroundings
) -> tuple[float, list[str]]:
    """A lower bound of the clearance (m) along the motion, and a sentence if it is too small."""
    footprint, fixed = problem.robot.footprint, problem.robot.drive.fixed_body_heading
    asked = problem.options.min_clearance
    way = ways(rolled.path, bounds, footprint.reach if fixed is None else 0.0)
    if not way[-1] <= allowed.LONGEST:
        sentence = f"the footprint moves {way[-1]:.6g} m, of which {allowed.LONGEST:.6g} m can be checked"
        return -allowed.SATURATED, [sentence]
    clearance, (x, y, theta, when) = least_clearance(world, rolled.path, way, footprint, fixed, asked)
    if clearance >= asked - allowed.CLEARANCE:
        return clearance, []
    place = f"at t = {when:.4f} s, pose ({x:.4f}, {y:.4f}, {theta:.4f})"
    return clearance, [f"the clearance is {clearance:.6g} m {place}, allowed at least {asked:.6g} m"]
