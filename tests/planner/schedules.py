"""Schedules made by hand, and the problems that they solve.

Most are a speed bump sin²(πt/T) along a path whose poses are known in closed form. Those of `exact` have
accelerations that change at samples only.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from drives import DRIVES
from drives.drive import BodyPath, Car, Drive, Holonomic, Limits
from drives.se2 import Array, Pose, Twist, compose, exp
from planner.errors import AuditFailed
from planner.problem import Environment, Footprint, Goal, Options, Problem, Robot
from planner.schedule import WheelSchedule
from planner.verify import Certificate, verify
from tests.planner.conftest import PARAMETERS

KINDS = sorted(DRIVES)
START = Pose(1.0, -2.0, 0.4)
PERIOD, DURATION, RADIUS = 0.02, 3.13, 0.3
AFTER = slice(70, None)


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


Law = tuple[Array, Array, Array]
"""Way, speed and acceleration along a path at the times of a fine grid."""


def bump(fine: Array, pick: Any) -> Law:
    turn = 2 * np.pi / fine[-1]
    s = fine / 2 - np.sin(turn * fine) / (2 * turn)
    return s, np.sin(turn * fine / 2) ** 2, turn / 2 * np.sin(turn * fine)


def ramps(fine: Array, pick: Any) -> Law:
    """Speed linear between samples: up to 1, and down again to a last step of any length."""
    time = fine[pick]
    rise = 1.25 / time[-1]
    at = np.minimum(np.minimum(4 * rise * time, 1.0), 4 * rise * (time[-1] - time))
    speed, slope = np.interp(fine, time, at), np.diff(at) / np.diff(time)
    interval = np.searchsorted(time, fine * (1 + 1e-12), side="right").clip(1, len(time) - 1) - 1
    way = np.append(0.0, np.cumsum(np.diff(fine) * (speed[1:] + speed[:-1]) / 2))
    return way, speed, slope[interval]


def exact(kind: str, period: float = PERIOD, duration: float = DURATION, **options: Any) -> Case:
    """A true schedule whose accelerations along the path change at samples only."""
    return moving(drive_of(kind), period=period, duration=duration, law=ramps, **options)


def moving(
    drive: Drive,
    tangent: Twist | None = None,
    weave: float = 0.0,
    period: float = PERIOD,
    duration: float = DURATION,
    law: Callable[[Array, Any], Law] = bump,
) -> Case:
    """A true schedule: along an arc, or (weave, 1/m) along a curve that changes curvature."""
    tangent = tangent or tangent_of(drive)
    fine = np.append(np.arange(0.0, duration - 1e-9, period / 20), duration)
    pick = np.append(np.arange(0, len(fine) - 1, 20), len(fine) - 1)
    s, speed, change = law(fine, pick)
    heading = START.theta + tangent.omega * s + weave * (1 - np.cos(s))
    along, steeper = np.tile(tangent, (len(s), 1)), np.zeros((len(s), 3))
    along[:, 2] += weave * np.sin(s)
    steeper[:, 2] = weave * np.cos(s)
    wheels = drive.actuators(BodyPath(s, heading, along, steeper))

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
    columns = (
        fine, integral(wheels.wheel * v), wheels.wheel * v, wheels.wheel * a + wheels.wheel_derivative * v**2,
        wheels.steering, wheels.steering_derivative * v, pose, along * v,
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


Spoil = Callable[[Case], Case]


def column(name: str, at: Any, by: float) -> Spoil:
    return lambda case: case.schedules(**{name: changed(getattr(case.schedule, name), at, by)})
