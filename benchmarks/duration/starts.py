"""Where to start the optimization from: the planner's own schedules, and motions of other topologies."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from benchmarks.duration.direct import Guess
from drives import PoweredCaster
from drives.drive import Car, Holonomic
from drives.se2 import Array, Pose, between, wrap
from planner.curves import REEDS_SHEPP, REEDS_SHEPP_END, SEGMENTS, solve_word, word_reaches, word_segment
from planner.problem import Problem
from planner.schedule import WheelSchedule

__all__ = ["from_schedule", "other_ways"]

_RADII = (0.15, 0.6, 1.5)
"""Turning radii (m) tried where the drive sets none."""
_SCALES = (1.0, 1.6)
_RIDES = (None, 0, 1, 2, 3, 4, 5)
"""Headings (π/3) relative to the course that a holonomic base turns to on the way; None: it turns evenly."""
_EDGE = 15
"""Intervals, at either end, in which casters swing round."""

_Segment = tuple[float, float]
"""Way (m, negative backwards) and turn (rad) of a part from rest to rest."""


def from_schedule(problem: Problem, made: WheelSchedule, knots: int) -> Guess:
    """The planner's schedule at the knots."""
    time = _grid(problem, float(made.time[-1]), knots)

    def at(columns: Array) -> Array:
        rows = [np.interp(time, made.time, column) for column in columns.T]
        return np.array(rows).reshape(columns.shape[1], len(time)).T

    return Guess(time, at(made.pose), at(made.twist), at(made.steering_angle))


def other_ways(problem: Problem, knots: int, most: int) -> list[tuple[str, Guess]]:
    """Motions to start from, by name, obstacles unheeded; the quickest by a rough estimate first."""
    robot = problem.robot
    mobility = robot.drive.mobility(robot.limits)
    if isinstance(mobility, Holonomic):
        found = [_straight(problem, knots, ride, way) for ride in _RIDES for way in (0, 1)]
    else:
        radii = [s * mobility.min_turning_radius for s in _SCALES] if isinstance(mobility, Car) else _RADII
        ways = [*_words(problem, radii)]
        ways += [] if isinstance(mobility, Car) else [*_pivots(problem)]
        found = [(name, _driven(problem, segments, knots)) for name, segments in ways]
    found.sort(key=lambda way: way[1].time[-1])
    distinct: list[tuple[str, Guess]] = []
    for name, guess in found:
        if name not in {other for other, _ in distinct}:
            distinct.append((name, guess))
    return distinct[:most]


def _fastest(problem: Problem) -> tuple[float, float, float]:
    """Roughly: speed (m/s), turn rate (rad/s), and time (s) to get to either."""
    robot = problem.robot
    law, limits = robot.drive.rolling_law(), robot.limits
    speed, push = float(limits.wheel_speed.min()), float(limits.wheel_acceleration.min())
    if law.steered.any():
        linear = speed * float(law.radius[law.steered][0])
        angular = linear / float(np.hypot(*law.points.T).max())
    else:
        linear = speed / float(np.abs(law.rows[:, 0]).max())
        angular = speed / max(float(np.abs(law.rows[:, 2]).max()), 1e-9)
    if law.heading_steers:
        angular = float(limits.steering_rate)
    return linear, angular, speed / push


def _grid(problem: Problem, duration: float, knots: int) -> Array:
    """Times (knots + 1,), closer together where casters swing round."""
    if not isinstance(problem.robot.drive, PoweredCaster):
        return np.linspace(0.0, duration, knots + 1)
    early, late = min(0.7, 0.2 * duration), duration - min(0.5, 0.15 * duration)
    return np.concatenate([
        np.linspace(0.0, early, _EDGE + 1)[:-1],
        np.linspace(early, late, knots - 2 * _EDGE + 1)[:-1],
        np.linspace(late, duration, _EDGE + 1),
    ])  # fmt: skip


def _straight(problem: Problem, knots: int, ride: int | None, way: int) -> tuple[str, Guess]:
    """Straight to the goal, the heading turning to `ride` and on from there; way 1: round the other side."""
    start, goal = problem.start, problem.goal
    assert goal.theta is not None
    linear, angular, ramp = _fastest(problem)
    turn = wrap(goal.theta - start.theta)
    turn -= way * math.copysign(math.tau, turn)
    course = math.atan2(goal.y - start.y, goal.x - start.x)
    turns = [turn]
    if ride is not None:
        first = wrap(course + ride * math.pi / 3 - start.theta)
        turns = [first, wrap(goal.theta - start.theta - first)]
        if way:
            turns[1] -= math.copysign(math.tau, turns[1])
    distance = math.hypot(goal.x - start.x, goal.y - start.y)
    duration = distance / linear + sum(map(abs, turns)) / angular / 2 + 2 * ramp
    time = _grid(problem, duration, knots)
    u = time / duration
    if ride is None:
        theta = start.theta + turn * _smooth(u)
    else:
        theta = start.theta + turns[0] * _smooth(u / 0.35) + turns[1] * _smooth((u - 0.65) / 0.35)
    s = _smooth(u)
    pose = np.stack([start.x + (goal.x - start.x) * s, start.y + (goal.y - start.y) * s, theta], -1)
    rate = np.gradient(pose, time, axis=0)
    rate[[0, -1]] = 0.0
    c, d = np.cos(theta), np.sin(theta)
    twist = np.stack([c * rate[:, 0] + d * rate[:, 1], c * rate[:, 1] - d * rate[:, 0], rate[:, 2]], -1)
    return f"line {'even' if ride is None else ride} {way}", Guess(
        time, pose, twist, _swing(problem, time, twist)
    )


def _words(problem: Problem, radii: tuple[float, ...] | list[float]) -> Iterator[tuple[str, list[_Segment]]]:
    """Reeds–Shepp words."""
    goal = problem.goal
    assert goal.theta is not None
    apart = between(problem.start, Pose(goal.x, goal.y, goal.theta))
    phi = wrap(apart.theta)
    s, c = math.sin(phi), math.cos(phi)
    for radius in radii:
        x, y = apart.x / radius, apart.y / radius
        for row in range(REEDS_SHEPP, REEDS_SHEPP_END):
            word = solve_word(row, x, y, phi, s, c, math.inf)
            if word[0] == math.inf or not word_reaches(row, word, x, y, s, c):
                continue
            parts = [word_segment(row, i, word) for i in range(SEGMENTS)]
            segments = [(ell * radius, k * ell) for k, ell in parts if ell]
            if segments:
                turns = ("LSR"[1 - round(k)] + "-+"[int(ell > 0)] for k, ell in parts if abs(ell) > 0.05)
                yield "".join(turns), segments


def _pivots(problem: Problem) -> Iterator[tuple[str, list[_Segment]]]:
    """Turn, drive, turn: forwards and backwards."""
    start, goal = problem.start, problem.goal
    assert goal.theta is not None
    course = math.atan2(goal.y - start.y, goal.x - start.x)
    distance = math.hypot(goal.x - start.x, goal.y - start.y)
    for sign in (1, -1):
        way = course if sign > 0 else course + math.pi
        first = wrap(way - start.theta)
        yield f"pivot {sign:+}", [(0.0, first), (sign * distance, 0.0), (0.0, wrap(goal.theta - way))]


def _driven(problem: Problem, segments: list[_Segment], knots: int) -> Guess:
    """Segments one after the other, from rest to rest, slower and faster smoothly."""
    linear, angular, ramp = _fastest(problem)
    lasting = np.array([max(abs(s) / linear, abs(turn) / angular) + 0.5 * ramp for s, turn in segments])
    until = np.cumsum(lasting)
    fine = np.linspace(0.0, until[-1], 40 * knots + 1)
    which = np.clip(np.searchsorted(until, fine, side="right"), 0, len(segments) - 1)
    u = (fine - (until - lasting)[which]) / lasting[which]
    rate = np.array(segments)[which] * (6 * u * (1 - u) / lasting[which])[:, None]
    step = np.diff(fine)[:, None] * (rate[1:] + rate[:-1]) / 2
    theta = problem.start.theta + np.concatenate([[0.0], np.cumsum(step[:, 1])])
    middle = (theta[1:] + theta[:-1]) / 2
    way = np.cumsum(np.stack([np.cos(middle), np.sin(middle)], -1) * step[:, :1], 0)
    pose = np.column_stack([np.concatenate([np.zeros((1, 2)), way]) + problem.start[:2], theta])
    twist = np.stack([rate[:, 0], np.zeros(len(fine)), rate[:, 1]], -1)
    time = fine[::40]
    return Guess(time, pose[::40], twist[::40], np.zeros((knots + 1, 0)))


def _swing(problem: Problem, time: Array, twist: Array) -> Array:
    """Angles (n + 1, k) of casters led along, by Euler's rule in small steps."""
    drive = problem.robot.drive
    if not isinstance(drive, PoweredCaster):
        return np.zeros((len(time), 0))
    points, beta = drive.rolling_law().points, np.zeros(len(drive.modules))
    angles = [beta]
    for i in range(len(time) - 1):
        for share in np.arange(0.0, 1.0, 0.02):
            vx, vy, omega = twist[i] + share * (twist[i + 1] - twist[i])
            px, py = vx - points[:, 1] * omega, vy + points[:, 0] * omega
            across = np.cos(beta) * py - np.sin(beta) * px
            beta = beta + (across / drive.caster_offset - omega) * 0.02 * (time[i + 1] - time[i])
        angles.append(beta)
    return np.array(angles)


def _smooth(u: Array) -> Array:
    u = np.clip(u, 0.0, 1.0)
    smooth: Array = u * u * (3 - 2 * u)
    return smooth
