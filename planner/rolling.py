"""The wheels of a schedule rolled forward from the start, as by a client who interpolates it with cubics.

Part of the certificate: it knows the drive's forward kinematics and nothing of how the schedule was made.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drives.se2 import Array
from planner.kernels import kernel
from planner.problem import Problem
from planner.schedule import WheelSchedule

__all__ = ["Rolled", "moved", "points", "roll"]

# Gauss–Legendre quadrature of order six over [0, 1]: its nodes, the weights of the whole integral, and of the
# integral up to each node (Hairer, Nørsett and Wanner, 1993, section II.7).
_ROOTS, _SHARES = np.polynomial.legendre.leggauss(3)
_NODES, _WHOLE = (1 + _ROOTS) / 2, _SHARES / 2
_PARTS = _NODES[:, None] ** [1, 2, 3] / [1, 2, 3] @ np.linalg.inv(np.vander(_NODES, increasing=True))
_STAGES = len(_NODES) + 1
"""Points an interval: the sample that begins it, then its nodes."""
_BLOCK = 1024
"""Intervals rolled at once."""


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
    time, forward = schedule.time, problem.robot.drive.forward
    n = len(time)
    pose, twist, slip = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    path = np.empty((_STAGES * (n - 1) + 1, 4))
    pose[0] = problem.start
    # Block by block, so that what lies between stays in the processor's cache.
    for first in range(0, max(n - 1, 1), _BLOCK):
        part = slice(first, first + _BLOCK + 1)
        rates = _cubic(time[part], schedule.wheel_angle[part], schedule.wheel_velocity[part])[1]
        turned = _cubic(time[part], schedule.steering_angle[part], schedule.steering_rate[part])
        moves, slips = forward(rates.T, *(each.T for each in turned))
        _travel(first, time, np.ascontiguousarray(moves.T), slips, pose, twist, slip, path)
    length = float(moved(pose, 0.0)[-1])
    pose.flags.writeable = twist.flags.writeable = False  # as those of a schedule: one kernel serves both
    return Rolled(pose, twist, slip, path, length)


@kernel
def _cubic(time: Array, value: Array, slope: Array) -> tuple[Array, Array]:
    """Hermite's cubic through samples (n, c), and its slope, (c, 4n - 3): at the samples, then at the first
    node of every interval, then at the second, then at the third."""
    n, columns = value.shape
    size = n + len(_NODES) * (n - 1)
    values, slopes = np.empty((columns, size)), np.empty((columns, size))
    for c in range(columns):
        for i in range(n):
            values[c, i], slopes[c, i] = value[i, c], slope[i, c]
        for i in range(n - 1):
            h = time[i + 1] - time[i]
            first, begin, end = values[c, i], slopes[c, i], slopes[c, i + 1]
            rise = (values[c, i + 1] - first) / h
            square, cube = 3 * rise - 2 * begin - end, begin + end - 2 * rise
            for k in range(len(_NODES)):
                u, at = _NODES[k], n + k * (n - 1) + i
                values[c, at] = first + h * u * (begin + u * (square + u * cube))
                slopes[c, at] = begin + u * (2 * square + 3 * u * cube)
    return values, slopes


@kernel
def _travel(
    first: int, time: Array, twists: Array, slips: Array, pose: Array, twist: Array, slip: Array, path: Array
) -> None:
    """Integrate a block of twists (3, 4k - 3) that begins at sample `first`, whose pose is known.

    What is found goes into poses (n, 3), twists (n, 3) and slip (n,) at the samples, and into the path
    (4n - 3, 4): poses and times at samples and nodes.
    """
    nodes = len(_NODES)
    n = (twists.shape[1] + nodes) // _STAGES
    gained = np.zeros(3)
    velocity = np.empty((nodes, 2))
    x, y, theta = pose[first, 0], pose[first, 1], pose[first, 2]
    for k in range(n):
        i = first + k
        at = _STAGES * i
        pose[i, 0], pose[i, 1], pose[i, 2] = x + gained[0], y + gained[1], theta + gained[2]
        twist[i, 0], twist[i, 1], twist[i, 2], slip[i] = twists[0, k], twists[1, k], twists[2, k], slips[k]
        path[at, 0], path[at, 1], path[at, 2], path[at, 3] = pose[i, 0], pose[i, 1], pose[i, 2], time[i]
        if k == n - 1:
            break
        h = time[i + 1] - time[i]
        turn = 0.0
        for a in range(nodes):
            part = 0.0
            for b in range(nodes):
                part += _PARTS[a, b] * twists[2, n + b * (n - 1) + k]
            node = n + a * (n - 1) + k
            heading = pose[i, 2] + h * part
            c, s, vx, vy = math.cos(heading), math.sin(heading), twists[0, node], twists[1, node]
            velocity[a, 0], velocity[a, 1] = c * vx - s * vy, s * vx + c * vy
            path[at + 1 + a, 2], path[at + 1 + a, 3] = heading, time[i] + h * _NODES[a]
            turn += _WHOLE[a] * twists[2, node]
        gained[2] += h * turn
        for axis in range(2):
            way = 0.0
            for a in range(nodes):
                part = 0.0
                for b in range(nodes):
                    part += _PARTS[a, b] * velocity[b, axis]
                path[at + 1 + a, axis] = path[at, axis] + h * part
                way += _WHOLE[a] * velocity[a, axis]
            gained[axis] += h * way


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
