"""The certificate: what becomes of a client who does nothing but follow the wheel schedule.

It knows nothing of how the schedule was made. It interpolates the samples as a client would, puts them
through the drive's forward kinematics, integrates the twists, and compares what comes out with what was
asked for. Every check yields `Reading`s, values against bounds; one judge makes of them a `Certificate` and
sentences. A limit holds at the samples and for the mean over each interval, which no true motion exceeds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple, Protocol

import numpy as np

from drives.drive import Holonomic
from drives.se2 import Array, Pose, wrap
from planner import gauges
from planner.errors import AuditFailed
from planner.kernels import kernel
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
# Motion of the footprint between two looks at its clearance, m: everywhere, where it comes close, and in all
# (a tenth more than the planner allows); and to what share of the clearance not asked for it is found.
_COARSE, _FINE, _LONGEST, _MARGIN = 0.64, 0.005, 1.1e5, 0.01
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
    """The largest share of a bound, used: value / bound, which may not exceed 1 by more than the quantity's
    slack. quantity is a key of the table above; where it is also a field of the certificate, that field is
    `used` if it is a ratio, else the value. at: the sample, or that which begins the interval; owner: which
    wheel or coordinate, "" for the robot."""

    quantity: str
    used: float
    value: float
    bound: float
    at: int = -1
    owner: str = ""


def _reading(quantity: str, value: float, bound: float, at: int = -1, owner: str = "") -> Reading:
    used = value / bound
    return Reading(quantity, math.inf if math.isnan(used) else used, value, bound, at, owner)


def _readings(quantities: Sequence[str], table: Array, columns: Sequence[str] = ()) -> Iterator[Reading]:
    """Of a gauge's table; column j is of columns[j] (none: of the robot)."""
    for quantity, (used, i, j, value, bound) in zip(quantities, table.tolist(), strict=True):
        if used >= 0:
            yield Reading(quantity, used, value, bound, int(i), columns[int(j)] if columns else "")


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
        for reading in (r for check in checks for r in check(problem, schedule, rolled)):
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
    _, used, value, bound, at, owner = reading
    found = used if reading.quantity.endswith("_ratio") else value
    found = found if found < _SATURATED else _SATURATED  # what is no number, too
    if used <= 1 + slack:
        return found, []
    of = f" of {owner}" if owner else ""
    return found, [f"{what}{of} is {value:.6g} {unit} at t = {time[at]:.4f} s, allowed {bound:.6g} {unit}"]


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
    goal, (x, y, theta) = problem.goal, rolled.pose[-1].tolist()
    # A single sample claims that the start is the goal; there is nothing to roll.
    near, aligned = (_tolerance(rolled), _HEADING) if len(schedule.time) > 1 else (_SAME, _SAME)
    apart = math.sqrt((x - goal.x) ** 2 + (y - goal.y) ** 2)
    yield _reading("closure_position", apart, near)
    if goal.theta is not None:
        yield _reading("closure_heading", abs(wrap(theta - goal.theta)), aligned)


def _shortest(problem: Problem) -> float:
    """The least time (s) to take a mean over: a last step may be so short that its mean is rounding."""
    return 1e-3 * problem.options.sample_period


def _wheels(problem: Problem, schedule: WheelSchedule, _: Rolled) -> Iterator[Reading]:
    limits, quantities = problem.robot.limits, (
        "wheel_speed_ratio", "wheel_speed_ratio", "wheel_acceleration_ratio", "wheel_acceleration_ratio",
        "wheel_jerk_ratio", "wheel angle", "wheel velocity",
    )  # fmt: skip
    table = gauges.wheels(
        schedule.time, _shortest(problem), schedule.wheel_angle, schedule.wheel_velocity,
        schedule.wheel_acceleration, limits.wheel_speed, limits.wheel_acceleration, limits.wheel_jerk,
        _COPIED,
    )  # fmt: skip
    return _readings(quantities, table, problem.robot.drive.wheel_names)


def _steering(problem: Problem, schedule: WheelSchedule, _: Rolled) -> Iterator[Reading]:
    limits = problem.robot.limits
    quantities = "steering_angle_ratio", "steering_rate_ratio", "steering_rate_ratio", "steering angle"
    table = gauges.steering(
        schedule.time, _shortest(problem), schedule.steering_angle, schedule.steering_rate,
        limits.steering_angle, limits.steering_rate, _COPIED,
    )  # fmt: skip
    return _readings(quantities, table, problem.robot.drive.steered_names)


def _ends(problem: Problem, schedule: WheelSchedule, _: Rolled) -> Iterator[Reading]:
    drive, limits = problem.robot.drive, problem.robot.limits
    steered = np.full(len(drive.steered_names), limits.steering_rate)
    for quantity, rate, limit, names in (
        ("wheels at rest", schedule.wheel_velocity, limits.wheel_speed, drive.wheel_names),
        ("steering at rest", schedule.steering_rate, steered, drive.steered_names),
    ):
        yield from _readings((quantity,), gauges.ends(rate, _REST * limit + _SAME), names)
    for owner, stated, asked in zip(Pose._fields, schedule.pose[0].tolist(), problem.start, strict=True):
        yield _reading("start", abs(stated - asked), _COPIED, 0, owner)
    if problem.steering is not None:
        turned = schedule.steering_angle[:1] - problem.steering
        bound = np.full(len(steered), _COPIED)
        yield from _readings(("present steering",), gauges.ends(turned, bound), drive.steered_names)


def _agreement(_: Problem, schedule: WheelSchedule, rolled: Rolled) -> Iterator[Reading]:
    slip, twist, *drift = gauges.agreement(
        rolled.twist, rolled.slip, rolled.pose, schedule.twist, schedule.pose, _tolerance(rolled), _HEADING
    )
    yield from _readings(("slip",), slip[None])
    yield from _readings(("twist",), twist[None], ("vx", "vy", "omega"))
    yield from _readings(("drift_position", "drift_heading"), np.array(drift))


def _body(problem: Problem, schedule: WheelSchedule, rolled: Rolled) -> Iterator[Reading]:
    """The limits of the body, on the motion that the wheels make and on the stated one."""
    limits = problem.robot.limits
    holonomic = isinstance(problem.robot.drive.mobility(limits), Holonomic)
    quantities = (
        "linear_speed_ratio", "angular_speed_ratio", "linear_acceleration_ratio", "lateral_acceleration_ratio"
    )  # fmt: skip
    for motion in (rolled, schedule):
        table = gauges.body(
            schedule.time, _shortest(problem), motion.twist, motion.pose, limits.linear_speed,
            limits.angular_speed, limits.linear_acceleration, limits.lateral_acceleration, holonomic,
        )  # fmt: skip
        yield from _readings(quantities, table)


def _route(problem: Problem, schedule: WheelSchedule, rolled: Rolled) -> Iterator[Reading]:
    options, mobility = problem.options, problem.robot.drive.mobility(problem.robot.limits)
    radius = 0.0 if isinstance(mobility, Holonomic) else options.turning_radius
    for motion in (rolled, schedule):
        table = gauges.route(motion.twist, not options.reverse, radius)
        yield from _readings(("backwards", "turning"), table)


def _clearance(
    problem: Problem, schedule: WheelSchedule, rolled: Rolled, world: Surroundings
) -> tuple[float, list[str]]:
    """The smallest clearance (m) of the motion, and a sentence where it is too small."""
    fixed, reach = problem.robot.drive.fixed_body_heading, problem.robot.footprint.reach
    asked = problem.options.min_clearance
    # What the robot does, and what the client is told: they may differ by the drift that is allowed.
    paths = [rolled.path, np.column_stack([schedule.pose, schedule.time])]
    if fixed is not None:
        paths = [np.column_stack([path[:, :2], np.full(len(path), fixed), path[:, 3]]) for path in paths]
    ways = [moved(path, reach) for path in paths]
    for way in ways:
        if not way[-1] <= _LONGEST:
            sentence = f"the footprint moves {way[-1]:.6g} m, of which {_LONGEST:.6g} m can be checked"
            return -_SATURATED, [sentence]
    nearest, (x, y, theta, when) = _nearest(world, paths[0], ways[0], asked, math.inf)
    also, where = _nearest(world, paths[1], ways[1], asked, nearest)
    if also < nearest:
        nearest, (x, y, theta, when) = also, where
    if nearest >= asked - _CLEARANCE:
        return nearest, []
    place = f"at t = {when:.4f} s, pose ({x:.4f}, {y:.4f}, {theta:.4f})"
    return nearest, [f"the clearance is {nearest:.6g} m {place}, allowed at least {asked:.6g} m"]


def _nearest(world: Surroundings, path: Array, way: Array, asked: float, known: float) -> tuple[float, Array]:
    """The smallest clearance (m, within ±1e6) along a polyline (n, 4) of poses and times, and the point (4,)
    where it is. way (n,) m: how far the footprint has moved; known m: a clearance elsewhere, what is larger
    than which does not matter."""

    def look(at: Array) -> tuple[Array, tuple[float, float]]:
        near = np.ascontiguousarray(world.clearance(points(path, way, at)[:, :3]))
        return near, _least(near, at, _SATURATED)

    at = np.linspace(0.0, way[-1], 1 + math.ceil(way[-1] / _COARSE))
    near, (nearest, where) = look(at)
    # Clearance changes by no more than the footprint moves, so most stretches cannot hold the smallest.
    stretches = np.column_stack([at[:-1], at[1:], near[:-1], near[1:]])
    while True:
        least = min(nearest, known)
        stretches, at = _halved(stretches, least - _MARGIN * max(least - asked, 0.0), _FINE)
        if not len(at):
            break
        near, found = look(at)
        nearest, where = min((nearest, where), found)
        halves = stretches[len(stretches) - 2 * len(at) :]
        halves[::2, 3] = halves[1::2, 2] = near
    if len(stretches):
        # The samples themselves: a cusp may come nearer than its surroundings.
        at = _among(way, stretches[np.argsort(stretches[:, 0])])
        nearest, where = min((nearest, where), look(at)[1])
    return nearest, points(path, way, np.array([where]))[0]


@kernel
def _halved(stretches: Array, enough: float, fine: float) -> tuple[Array, Array]:
    """Of stretches (n, 4), where they begin and end, and the clearances there, those that may hold less than
    enough: first the fine ones, then the halves of others; and where these meet."""
    n, wide = 0, 0
    found, at = np.empty((2 * len(stretches), 4)), np.empty(len(stretches))
    for fine_ones in (True, False):
        for begin, end, first, last in stretches:
            if not (first + last - (end - begin)) / 2 < enough or (end - begin > fine) == fine_ones:
                continue
            found[n] = begin, end, first, last
            n += 1
            if not fine_ones:
                middle = begin + (end - begin) / 2
                found[n - 1, 1], at[wide] = middle, middle
                found[n] = middle, end, first, last
                n, wide = n + 1, wide + 1
    return found[:n], at[:wide]


@kernel
def _among(way: Array, stretches: Array) -> Array:
    """Those of increasing ways (n,) that lie in stretches (k, 4), in order, disjoint but for their ends."""
    found, size = np.empty(len(way)), 0
    for begin, end in stretches[:, :2]:
        for i in range(np.searchsorted(way, begin), len(way)):
            if way[i] > end:
                break
            if size == 0 or way[i] > found[size - 1]:
                found[size] = way[i]
                size += 1
    return found[:size].copy()


@kernel
def _least(near: Array, at: Array, most: float) -> tuple[float, float]:
    """The smallest clearance, and where the first such is; inf where there are none. All are brought within
    ±most, what is no number to the lowest."""
    least, where = np.inf, 0.0
    for i in range(len(near)):
        near[i] = min(near[i], most) if near[i] >= -most else -most
        if near[i] < least:
            least, where = near[i], at[i]
    return least, where
