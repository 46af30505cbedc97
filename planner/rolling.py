"""The wheels of a schedule rolled forward from the start, as by a client who interpolates it with cubics.

Part of the certificate: it knows the drive's forward kinematics and nothing of how the schedule was made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drives.se2 import Array
from planner.problem import Problem
from planner.schedule import WheelSchedule
from planner.tree import kernel

__all__ = ["Rolled", "moved", "points", "roll"]

# Gauss–Legendre quadrature of order six over [0, 1]: its nodes, the weights of the whole integral, and of the
# integral up to each node (Hairer, Nørsett and Wanner, 1993, section II.7).
_ROOTS, _SHARES = np.polynomial.legendre.leggauss(3)
_NODES, _WHOLE = (1 + _ROOTS) / 2, _SHARES / 2
_PARTS = _NODES[:, None] ** [1, 2, 3] / [1, 2, 3] @ np.linalg.inv(np.vander(_NODES, increasing=True))
_STAGES = len(_NODES) + 1
"""Points an interval: the sample that begins it, then its nodes."""


@dataclass(frozen=True, slots=True, eq=False)
class Rolled:
    """What the wheels make of a schedule. At the samples: pose (n, 3), world, twist (n, 3), slip (n,) m/s; at
    the samples and the nodes between them: poses and times, path (4n - 3, 4). length: of the way, m."""

    pose: Array
    twist: Array
    slip: Array
    path: Array
    length: float


def roll(problem: Problem, schedule: WheelSchedule) -> Rolled:
    """Roll the wheels forward from the start."""
    time = schedule.time
    _, rates = _cubic(time, schedule.wheel_angle, schedule.wheel_velocity)
    steering, steering_rates = _cubic(time, schedule.steering_angle, schedule.steering_rate)
    twist, slip = problem.robot.drive.forward(rates, steering, steering_rates)
    path = _travel(*problem.start, time, twist)
    pose = path[::_STAGES, :3].copy()
    length = float(moved(pose, 0.0)[-1])
    return Rolled(pose, twist[::_STAGES].copy(), slip[::_STAGES].copy(), path, length)


@kernel
def _cubic(time: Array, value: Array, slope: Array) -> tuple[Array, Array]:
    """Hermite's cubic through samples (n, c), and its slope, at the samples and the nodes, (4n - 3, c)."""
    n, columns = value.shape
    values, slopes = np.empty((_STAGES * (n - 1) + 1, columns)), np.empty((_STAGES * (n - 1) + 1, columns))
    for i in range(n):
        at = _STAGES * i
        values[at], slopes[at] = value[i], slope[i]
        if i == n - 1:
            break
        h = time[i + 1] - time[i]
        for c in range(columns):
            begin, end = slope[i, c], slope[i + 1, c]
            rise = (value[i + 1, c] - value[i, c]) / h
            square, cube = 3 * rise - 2 * begin - end, begin + end - 2 * rise
            for k in range(len(_NODES)):
                u = _NODES[k]
                values[at + 1 + k, c] = value[i, c] + h * u * (begin + u * (square + u * cube))
                slopes[at + 1 + k, c] = begin + u * (2 * square + 3 * u * cube)
    return values, slopes


@kernel
def _travel(x: float, y: float, theta: float, time: Array, twist: Array) -> Array:
    """Poses and times (4n - 3, 4) of a body from a pose on, its twists (4n - 3, 3) integrated."""
    nodes = len(_NODES)
    path = np.empty((len(twist), 4))
    gained = np.zeros(3)
    velocity = np.empty((nodes, 2))
    for i in range(len(time)):
        at = _STAGES * i
        path[at, 0], path[at, 1], path[at, 2] = x + gained[0], y + gained[1], theta + gained[2]
        path[at, 3] = time[i]
        if i == len(time) - 1:
            break
        h = time[i + 1] - time[i]
        turn = 0.0
        for k in range(nodes):
            heading = 0.0
            for j in range(nodes):
                heading += _PARTS[k, j] * twist[at + 1 + j, 2]
            heading = path[at, 2] + h * heading
            c, s, vx, vy = math.cos(heading), math.sin(heading), twist[at + 1 + k, 0], twist[at + 1 + k, 1]
            velocity[k, 0], velocity[k, 1] = c * vx - s * vy, s * vx + c * vy
            path[at + 1 + k, 2], path[at + 1 + k, 3] = heading, time[i] + h * _NODES[k]
            turn += _WHOLE[k] * twist[at + 1 + k, 2]
        gained[2] += h * turn
        for axis in range(2):
            way = 0.0
            for k in range(nodes):
                part = 0.0
                for j in range(nodes):
                    part += _PARTS[k, j] * velocity[j, axis]
                path[at + 1 + k, axis] = path[at, axis] + h * part
                way += _WHOLE[k] * velocity[k, axis]
            gained[axis] += h * way
    return path


@kernel
def moved(path: Array, reach: float) -> Array:
    """How far (n,) m a point within `reach` of the origin has moved since the start of a polyline of poses
    (n, 3 or more), at most."""
    way = np.zeros(len(path))
    for i in range(1, len(path)):
        dx, dy, turn = path[i, 0] - path[i - 1, 0], path[i, 1] - path[i - 1, 1], path[i, 2] - path[i - 1, 2]
        way[i] = way[i - 1] + math.sqrt(dx * dx + dy * dy) + reach * abs(turn)
    return way


@kernel
def points(path: Array, way: Array, at: Array) -> Array:
    """The points (k, 4) of a polyline (n, 4) at ways `at` (k,), given those of its vertices, way (n,)."""
    found = np.empty((len(at), 4))
    for k in range(len(at)):
        i = min(max(np.searchsorted(way, at[k], side="right") - 1, 0), max(len(way) - 2, 0))
        j = min(i + 1, len(way) - 1)
        share = (at[k] - way[i]) / (way[j] - way[i]) if way[j] > way[i] else 0.0
        for c in range(4):
            found[k, c] = path[i, c] + share * (path[j, c] - path[i, c])
    return found
