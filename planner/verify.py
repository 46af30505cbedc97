"""The certificate: what becomes of a client who does nothing but follow the wheel schedule.

It knows nothing of how the schedule was made. It interpolates the samples as a client would, puts them
through the drive's forward kinematics, integrates the twists, and compares what comes out with what was
asked for. Every check yields `Reading`s, values against bounds; one judge makes of them a `Certificate` and
sentences. A limit holds at the samples and for the mean over each interval, which no true motion exceeds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

import numpy as np

from drives.drive import Holonomic
from drives.se2 import Array, wrap
from planner.errors import AuditFailed
from planner.gauges import integrals, lengths, mean_rates, outer, worst
from planner.problem import Problem
from planner.rolling import Rolled, moved, points, roll
from planner.schedule import WheelSchedule

__all__ = ["Certificate", "Surroundings", "verify"]

# How far rolling may end from the goal or leave the stated poses: m, m per metre travelled, rad.
_POSITION, _POSITION_PER_METRE, _HEADING = 5e-4, 5e-5, 1e-3
# What may be lost where a number is copied, and where two are said to be the same (m, rad, s, rad/s).
_COPIED, _SAME = 5e-7, 1e-9
# The largest rate that counts as rest, as a share of its limit; how much of the clearance may be missing, m.
_REST, _CLEARANCE = 5e-7, 1e-4
# Motion of the footprint between two looks at its clearance, m: everywhere, where it comes close, and in all;
# and to what share of the clearance that was not asked for it is found.
_COARSE, _FINE, _LONGEST, _MARGIN = 0.64, 0.005, 8e3, 0.01
# Largest number in a certificate: JSON has no infinity.
_SATURATED = 1e6

_QUANTITIES = {
    # key: (what the sentence calls it, unit, by how much value / bound may pass 1)
    "closure_position": ("the distance from the goal after rolling", "m", 0.0),
    "closure_heading": ("the angle from the goal's heading after rolling", "rad", 0.0),
    "wheel_speed_ratio": ("the wheel speed", "rad/s", 1e-3),
    "wheel_acceleration_ratio": ("the wheel acceleration", "rad/s²", 1e-2),
    "wheel_jerk_ratio": ("the wheel jerk", "rad/s³", 2e-2),
    "wheel angle": ("the gap between the wheel angle and the integral of its velocity", "rad", 0.0),
    "wheel velocity": ("the gap between the wheel velocity and the integral of acceleration", "rad/s", 0.0),
    "steering_angle_ratio": ("the steering angle", "rad", 1e-4),
    "steering_rate_ratio": ("the steering rate", "rad/s", 1e-2),
    "steering angle": ("the gap between the steering angle and the integral of its rate", "rad", 0.0),
    "wheels at rest": ("the wheel speed at an end of the motion", "rad/s", 0.0),
    "steering at rest": ("the steering rate at an end of the motion", "rad/s", 0.0),
    "start": ("the distance from the start", "m or rad", 0.0),
    "present steering": ("the angle from the present steering", "rad", 0.0),
    "slip": ("the slip", "m/s", 0.0),
    "twist": ("the gap between the rolled and the stated twist", "m/s or rad/s", 0.0),
    "drift_position": ("the distance between the rolled and the stated position", "m", 0.0),
    "drift_heading": ("the angle between the rolled and the stated heading", "rad", 0.0),
    "linear_speed_ratio": ("the linear speed", "m/s", 1e-3),
    "angular_speed_ratio": ("the angular speed", "rad/s", 1e-3),
    "linear_acceleration_ratio": ("the linear acceleration", "m/s²", 2e-2),
    "lateral_acceleration_ratio": ("the lateral acceleration", "m/s²", 2e-2),
    "backwards": ("the speed backwards, where reverse is false,", "m/s", 0.0),
    "turning": ("the turn rate times turning_radius", "m/s", 0.0),
}


@dataclass(frozen=True, slots=True)
class Certificate:
    """What an independent check of a schedule found, worst case over the whole motion.

    closure_position m, closure_heading rad: from the goal to where rolling the wheels forward ends (heading 0
    where any will do); each *_ratio: used / allowed, 0 where there is no limit; slip m/s: largest equation of
    the wheels left unmet; clearance m: smallest distance from the footprint to an obstacle or the boundary
    (what exceeds min_clearance of it to 1 %); drift_position m, drift_heading rad: largest gap between the
    rolled and the stated poses. Nothing leaves ±1e6: where there is no obstacle at all, the clearance is 1e6.
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


class Surroundings(Protocol):
    """Whoever knows how far the footprint is from obstacles and the boundary; negative: how deep in them."""

    def clearance(self, poses: Array) -> Array:
        """Distance (n,) m at poses (n, 3). Where it exceeds 1 m, a lower bound will do."""


class Reading(NamedTuple):
    """value (r, c) >= 0, not to exceed bound, which broadcasts to it, by more than the quantity's slack.

    quantity is a key of the table above. Where it is also a field of the certificate, that field is the
    largest value / bound if it is a ratio, else the largest value. Column j is of columns[j] (none: of the
    robot); row i was taken at time[i] (None: at sample i, or over the interval that begins there)."""

    quantity: str
    value: Array
    bound: Array | float
    columns: tuple[str, ...] = ()
    time: Array | None = None


def verify(problem: Problem, schedule: WheelSchedule, world: Surroundings) -> Certificate:
    """Certify a schedule for a problem.

    Raises AuditFailed with what was found and a sentence for each violation. Where a column has the wrong
    shape, a number is not finite or the time grid is not the client's, the certificate is empty.
    """
    violations = _unreadable(problem, schedule)
    if violations:
        raise AuditFailed(f"the schedule cannot be read: {violations[0]}", {}, violations)
    found = {field.name: 0.0 for field in fields(Certificate)}
    # What overflows here comes out as inf or nan, and both are violations.
    with np.errstate(all="ignore"):
        rolled = roll(problem, schedule)
        found["clearance"], violations = _clearance(problem, schedule, rolled, world)
        checks = (_closure, _wheels, _steering, _ends, _agreement, _body, _route)
        for reading in (r for check in checks for r in check(problem, schedule, rolled) if r.value.size):
            most, faults = _judge(reading, schedule.time)
            violations += faults
            if reading.quantity in found:
                found[reading.quantity] = max(found[reading.quantity], most)
    if violations:
        raise AuditFailed(f"the plan fails its own check: {violations[0]}", found, violations)
    return Certificate(**found)


def _judge(reading: Reading, time: Array) -> tuple[float, list[str]]:
    """What to certify, and a sentence where the bound is passed."""
    what, unit, slack = _QUANTITIES[reading.quantity]
    bound = np.broadcast_to(reading.bound, reading.value.shape)
    used, i, j, top = worst(np.ascontiguousarray(reading.value), bound)
    found = min(used if reading.quantity.endswith("_ratio") else top, _SATURATED)
    limit = bound[i, j]
    if used <= 1 + slack:
        return found, []
    owner = f" of {reading.columns[j]}" if reading.columns else ""
    at = (time if reading.time is None else reading.time)[i]
    return found, [
        f"{what}{owner} is {reading.value[i, j]:.6g} {unit} at t = {at:.4f} s, allowed {limit:.6g} {unit}"
    ]


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
    if not (0 < last <= period * (1 + 1e-6) and off.max() <= _COPIED):
        faults = [f"the time grid is not 0, {period:g}, {2 * period:g}, … s with a last step no longer"]
    return faults


def _tolerance(rolled: Rolled) -> float:
    """How far an open-loop motion of this length may be off, m."""
    return _POSITION + _POSITION_PER_METRE * rolled.length


def _closure(problem: Problem, schedule: WheelSchedule, rolled: Rolled) -> Iterator[Reading]:
    goal, (x, y, theta), last = problem.goal, rolled.pose[-1], schedule.time[-1:]
    # A single sample claims that the start is the goal; there is nothing to roll.
    near, aligned = (_tolerance(rolled), _HEADING) if len(schedule.time) > 1 else (_SAME, _SAME)
    yield Reading("closure_position", np.hypot(x - goal.x, y - goal.y).reshape(1, 1), near, time=last)
    if goal.theta is not None:
        turn = np.array([[abs(wrap(float(theta) - goal.theta))]])
        yield Reading("closure_heading", turn, aligned, time=last)


def _intervals(problem: Problem, schedule: WheelSchedule) -> tuple[Array, Array]:
    """Lengths (n - 1,) s of the intervals, and the times to take means over: at least a thousandth of the
    period, because a last step may be so short that its mean is rounding."""
    h = np.diff(schedule.time)
    return h, np.maximum(h, 1e-3 * problem.options.sample_period)


def _wheels(problem: Problem, schedule: WheelSchedule, _: Rolled) -> Iterator[Reading]:
    limits, names = problem.robot.limits, problem.robot.drive.wheel_names
    h, over = _intervals(problem, schedule)
    angle, speed, change = schedule.wheel_angle, schedule.wheel_velocity, schedule.wheel_acceleration
    for quantity, rate, limit in (
        ("wheel_speed_ratio", np.abs(speed), limits.wheel_speed),
        ("wheel_speed_ratio", mean_rates(angle, over), limits.wheel_speed),
        ("wheel_acceleration_ratio", np.abs(change), limits.wheel_acceleration),
        ("wheel_acceleration_ratio", mean_rates(speed, over), limits.wheel_acceleration),
        ("wheel_jerk_ratio", mean_rates(change, over), limits.wheel_jerk),
    ):
        yield Reading(quantity, rate, limit, names)
    # The trapezoid rule is off by a·h²/4 at most: where the rate rises, then falls, as fast as it may.
    for quantity, whole, rate, limit in (
        ("wheel angle", angle, speed, 1.01 * limits.wheel_acceleration),
        ("wheel velocity", speed, change, 1.02 * limits.wheel_jerk),
    ):
        gap = np.abs(np.diff(whole, axis=0) - integrals(rate, h))
        yield Reading(quantity, gap, outer(h**2 / 4, limit, _COPIED), names)


def _steering(problem: Problem, schedule: WheelSchedule, _: Rolled) -> Iterator[Reading]:
    limits, names = problem.robot.limits, problem.robot.drive.steered_names
    h, over = _intervals(problem, schedule)
    angle, rate, limit = schedule.steering_angle, schedule.steering_rate, limits.steering_rate
    trapezoid = integrals(rate, h)
    yield Reading("steering_angle_ratio", np.abs(angle), limits.steering_angle, names)
    yield Reading("steering_rate_ratio", np.abs(rate), limit, names)
    yield Reading("steering_rate_ratio", mean_rates(angle, over), limit, names)
    # A steering rate may jump, so between samples nothing is sure but that it stays within its limit.
    most = outer(h, np.full(len(names), 1.01 * limit), 0.0)
    room = np.maximum(most - np.abs(trapezoid), 0.0) + _COPIED
    yield Reading("steering angle", np.abs(np.diff(angle, axis=0) - trapezoid), room, names)


def _ends(problem: Problem, schedule: WheelSchedule, _: Rolled) -> Iterator[Reading]:
    drive, limits, ends = problem.robot.drive, problem.robot.limits, [0, -1]
    for quantity, rate, limit, names in (
        ("wheels at rest", schedule.wheel_velocity, limits.wheel_speed, drive.wheel_names),
        ("steering at rest", schedule.steering_rate, limits.steering_rate, drive.steered_names),
    ):
        yield Reading(quantity, np.abs(rate[ends]), _REST * limit + _SAME, names, schedule.time[ends])
    yield Reading("start", np.abs(schedule.pose[:1] - problem.start), _COPIED, ("x", "y", "theta"))
    if problem.steering is not None:
        turned = np.abs(schedule.steering_angle[:1] - problem.steering)
        yield Reading("present steering", turned, _COPIED, drive.steered_names)


def _agreement(_: Problem, schedule: WheelSchedule, rolled: Rolled) -> Iterator[Reading]:
    linear = max(float(lengths(rolled.twist).max()), 0.05)
    fastest = max(linear, float(np.abs(rolled.twist[:, 2]).max()))
    yield Reading("slip", rolled.slip[:, None], 5e-4 * linear + 5e-5)
    gap = np.abs(rolled.twist - schedule.twist)
    yield Reading("twist", gap, 2.5e-3 * fastest + 5e-4, ("vx", "vy", "omega"))
    apart = np.abs(rolled.pose - schedule.pose)
    yield Reading("drift_position", lengths(apart), _tolerance(rolled))
    yield Reading("drift_heading", apart[:, 2:], _HEADING)


def _body(problem: Problem, schedule: WheelSchedule, rolled: Rolled) -> Iterator[Reading]:
    """The limits of the body, on the motion that the wheels make and on the stated one."""
    limits, over = problem.robot.limits, _intervals(problem, schedule)[1]
    holonomic = isinstance(problem.robot.drive.mobility(limits), Holonomic)
    for twist, pose in ((rolled.twist, rolled.pose), (schedule.twist, schedule.pose)):
        speed, omega = lengths(twist), twist[:, 2:]
        yield Reading("linear_speed_ratio", speed, limits.linear_speed)
        yield Reading("angular_speed_ratio", np.abs(omega), limits.angular_speed)
        yield Reading("linear_acceleration_ratio", mean_rates(speed, over), limits.linear_acceleration)
        if limits.lateral_acceleration < math.inf:
            lateral = _lateral(twist, pose[:, 2], over)[:, None] if holonomic else speed * omega
            yield Reading("lateral_acceleration_ratio", np.abs(lateral), limits.lateral_acceleration)


def _lateral(twist: Array, heading: Array, h: Array) -> Array:
    """Mean of speed × turn rate of the direction of travel over each interval h (n - 1,): (n - 1,) m/s²."""
    velocity = (twist[:, 0] + 1j * twist[:, 1]) * np.exp(1j * heading)
    speed, cross = np.abs(velocity), (velocity[:-1].conj() * velocity[1:]).imag
    both = speed[:-1] + speed[1:]
    # A robot this slow may have stopped within the interval, and at rest the direction may jump.
    moving = both > 2 * np.abs(np.diff(speed)).max(initial=0.0)
    return np.where(moving, 2 * cross / (both * h), 0.0)


def _route(problem: Problem, schedule: WheelSchedule, rolled: Rolled) -> Iterator[Reading]:
    options, mobility = problem.options, problem.robot.drive.mobility(problem.robot.limits)
    for twist in (rolled.twist, schedule.twist):
        vx, omega = twist[:, :1], twist[:, 2:]
        if not options.reverse:
            yield Reading("backwards", np.maximum(-vx, 0.0), 5e-4)
        if options.turning_radius > 0 and not isinstance(mobility, Holonomic):
            yield Reading("turning", np.abs(omega) * options.turning_radius, np.abs(vx) * 1.005 + 1e-3)


def _clearance(
    problem: Problem, schedule: WheelSchedule, rolled: Rolled, world: Surroundings
) -> tuple[float, list[str]]:
    """The smallest clearance (m) of the motion, and a sentence where it is too small."""
    footprint, fixed = problem.robot.footprint, problem.robot.drive.fixed_body_heading
    reach = float(np.hypot(*footprint.vertices.T).max()) + footprint.radius
    asked = problem.options.min_clearance
    # What the robot does, and what the client is told: they may differ by the drift that is allowed.
    paths = [rolled.path, np.column_stack([schedule.pose, schedule.time])]
    if fixed is not None:
        paths = [np.insert(np.delete(path, 2, axis=1), 2, fixed, axis=1) for path in paths]
    nearest, (x, y, theta, when) = _nearest(world, paths[0], reach, asked, math.inf)
    also, where = _nearest(world, paths[1], reach, asked, nearest)
    if also < nearest:
        nearest, (x, y, theta, when) = also, where
    if nearest >= asked - _CLEARANCE:
        return nearest, []
    place = f"at t = {when:.4f} s, pose ({x:.4f}, {y:.4f}, {theta:.4f})"
    return nearest, [f"the clearance is {nearest:.6g} m {place}, allowed at least {asked:.6g} m"]


def _nearest(
    world: Surroundings, path: Array, reach: float, asked: float, known: float
) -> tuple[float, Array]:
    """The smallest clearance (m, within ±1e6) along a polyline (n, 4) of poses and times, and the point (4,)
    where it is. reach m: of the footprint; known m: a clearance elsewhere, what is larger than which does not
    matter. What cannot be checked has a clearance of -1e6."""
    way = moved(path, reach)
    if not way[-1] <= _LONGEST:
        return -_SATURATED, path[-1]

    def look(at: Array) -> Array:
        near = world.clearance(points(path, way, at)[:, :3])
        return np.minimum(np.fmax(near, -_SATURATED), _SATURATED)  # no number: the lowest

    at = np.linspace(0.0, way[-1], 1 + math.ceil(way[-1] / _COARSE))
    near = look(at)
    nearest, where = _least(near, at)
    # Clearance changes by no more than the footprint moves, so most stretches cannot hold the smallest.
    stretches = np.stack([at[:-1], at[1:], near[:-1], near[1:]])
    while True:
        least = min(nearest, known)
        enough = least - _MARGIN * max(least - asked, 0.0)
        begin, end, first, last = stretches
        stretches = stretches[:, (first + last - (end - begin)) / 2 < enough]
        wide = stretches[1] - stretches[0] > _FINE
        if not wide.any():
            break
        begin, end, first, last = stretches[:, wide]
        at = begin + (end - begin) / 2
        near = look(at)
        nearest, where = min((nearest, where), _least(near, at))
        halves = np.stack([begin, at, first, near]), np.stack([at, end, near, last])
        stretches = np.concatenate([stretches[:, ~wide], *halves], axis=1)
    if stretches.size:
        # The samples themselves: a cusp may come nearer than its surroundings.
        begin, end = np.sort(stretches[:2])
        i = np.searchsorted(begin, way, side="right") - 1
        at = way[(i >= 0) & (way <= end[i])]
        nearest, where = min((nearest, where), _least(look(at), at))
    return nearest, points(path, way, np.array([where]))[0]


def _least(values: Array, at: Array) -> tuple[float, float]:
    """The smallest of some values, and where the first such is."""
    i = int(np.argmin(values)) if len(values) else 0
    return (float(values[i]), float(at[i])) if len(values) else (math.inf, 0.0)
