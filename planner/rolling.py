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

__all__ = ["DERIVATIVE", "INSTANTS", "POWERS", "Rolled", "roll"]

# Gauss–Legendre quadrature of order six over [0, 1]: its nodes, the weights of the whole integral, and of the
# integral up to each node (Hairer, Nørsett and Wanner, 1993, section II.7).
_ROOTS, _SHARES = np.polynomial.legendre.leggauss(3)
_NODES, _WHOLE = (1 + _ROOTS) / 2, _SHARES / 2
_PARTS = _NODES[:, None] ** [1, 2, 3] / [1, 2, 3] @ np.linalg.inv(np.vander(_NODES, increasing=True))
_STAGES = len(_NODES) + 1
"""Points an interval: the sample that begins it, then its nodes."""

INSTANTS = np.concatenate([[0.0], _NODES, [1.0]])
"""The five instants of an interval at which the motion is known, as shares of it."""
POWERS = np.linalg.inv(np.vander(INSTANTS, increasing=True))
"""Takes five values at the instants to the coefficients of the quartic through them, the constant first."""
DERIVATIVE = np.arange(1.0, 5.0) * INSTANTS[:, None] ** np.arange(4) @ POWERS[1:]
"""Takes five values at the instants to the slopes of the quartic there, per interval."""
_BLOCK = 1024
"""Intervals rolled at once."""


@dataclass(frozen=True, slots=True, eq=False)
class Rolled:
    """The motion that the wheels of a schedule make.

    pose (n, 3): poses at the samples, world frame. path (4n - 3, 4), twist (4n - 3, 3), slip (4n - 3,) m/s:
    poses with their times, twists and slip at the samples and at three instants of every interval, in order
    of time. length m: travelled by the body origin.
    """

    pose: Array
    path: Array
    twist: Array
    slip: Array
    length: float


def roll(problem: Problem, schedule: WheelSchedule) -> Rolled:
    """Roll the wheels forward from the start."""
    time, forward = schedule.time, problem.robot.drive.forward
    n = len(time)
    size = _STAGES * (n - 1) + 1
    path, twist, slip = np.empty((size, 4)), np.empty((size, 3)), np.empty(size)
    path[0, :3] = problem.start
    # Block by block, to stay in the processor's cache.
    for first in range(0, max(n - 1, 1), _BLOCK):
        part = slice(first, first + _BLOCK + 1)
        rates = _cubic(time[part], schedule.wheel_angle[part], schedule.wheel_velocity[part])[1]
        turned = _cubic(time[part], schedule.steering_angle[part], schedule.steering_rate[part])
        moves, slips = forward(rates.T, *(each.T for each in turned))
        _travel(first, time, np.ascontiguousarray(moves.T), slips, twist, slip, path)
    pose = path[::_STAGES, :3].copy()
    length = float(np.hypot(*np.diff(pose[:, :2], axis=0).T).sum())
    return Rolled(pose, path, twist, slip, length)


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
    first: int, time: Array, twists: Array, slips: Array, twist: Array, slip: Array, path: Array
) -> None:
    """Integrate a block of twists (3, 4k - 3), slip (4k - 3,), in the order of _cubic, that begins at sample
    `first`, whose pose is in the path. Writes the block's part of a Rolled."""
    nodes = len(_NODES)
    n = (twists.shape[1] + nodes) // _STAGES
    gained = np.zeros(3)
    velocity = np.empty((nodes, 2))
    x, y, theta = path[_STAGES * first, 0], path[_STAGES * first, 1], path[_STAGES * first, 2]
    for k in range(n):
        i = first + k
        at = _STAGES * i
        for axis in range(3):
            twist[at, axis] = twists[axis, k]
        slip[at] = slips[k]
        path[at, 0], path[at, 1], path[at, 2], path[at, 3] = (
            x + gained[0],
            y + gained[1],
            theta + gained[2],
            time[i],
        )
        if k == n - 1:
            break
        h = time[i + 1] - time[i]
        turn = 0.0
        for a in range(nodes):
            part = 0.0
            for b in range(nodes):
                part += _PARTS[a, b] * twists[2, n + b * (n - 1) + k]
            node = n + a * (n - 1) + k
            heading = path[at, 2] + h * part
            c, s, vx, vy = math.cos(heading), math.sin(heading), twists[0, node], twists[1, node]
            velocity[a, 0], velocity[a, 1] = c * vx - s * vy, s * vx + c * vy
            path[at + 1 + a, 2], path[at + 1 + a, 3] = heading, time[i] + h * _NODES[a]
            for axis in range(3):
                twist[at + 1 + a, axis] = twists[axis, node]
            slip[at + 1 + a] = slips[node]
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
