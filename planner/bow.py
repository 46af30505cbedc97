"""A straight way → a quicker one that bows out: for drives whose trailing wheels swing round on the way, so
that no optimizer of the body alone knows what a motion costs. The time law does, and is simply asked."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drives.drive import BodyPath
from drives.se2 import Array, Pose
from planner.environment import CollisionWorld
from planner.errors import LimitsInfeasible
from planner.path import LinePiece
from planner.problem import Problem
from planner.time_law import time_path
from planner.trajectory import Phases

__all__ = ["BowedPiece", "bowed"]

_FIRST, _LAST = np.array([0.15, 0.15, 0.6]), 0.04
"""Steps of the search: of the way, along and across it, and rad; and the share of them that ends it."""
_STEP = 0.01
"""Way (m) between poses that are checked."""


@dataclass(frozen=True, slots=True)
class BowedPiece:
    """A line in SE(2) that bows out by `bow` (x, y, theta; world frame) in its middle: a parabola."""

    start: Pose
    end: Pose
    bow: tuple[float, float, float]

    def poses(self, s: Array) -> Array:
        """Poses (n, 3) in the world frame at s (n,)."""
        a, b = np.array(self.start), np.array(self.end)
        poses: Array = a + np.multiply.outer(s, b - a) + np.multiply.outer(4 * s * (1 - s), self.bow)
        return poses

    def body_path(self, s: Array) -> BodyPath:
        first = np.array(self.end) - np.array(self.start) + np.multiply.outer(4 - 8 * s, self.bow)
        second = -8 * np.array(self.bow)
        heading = self.poses(s)[:, 2]
        c, d = np.cos(heading), np.sin(heading)
        vx, vy, omega = c * first[:, 0] + d * first[:, 1], c * first[:, 1] - d * first[:, 0], first[:, 2]
        ax, ay = c * second[0] + d * second[1], c * second[1] - d * second[0]
        derivative = np.stack([ax + omega * vy, ay - omega * vx, np.full_like(s, second[2])], -1)
        return BodyPath(s, heading, np.stack([vx, vy, omega], -1), derivative)


def bowed(
    line: LinePiece, known: Phases, problem: Problem, world: CollisionWorld, is_over: Callable[[], bool]
) -> Phases | None:
    """The quickest free motion found along a line that bows out, or None if none beats what is known.

    Compass search over the bow: along, across, and in heading.
    """
    drive, limits = problem.robot.drive, problem.robot.limits
    step = np.array(line.end) - np.array(line.start)
    way = math.hypot(step[0], step[1])
    c, d = (step[0] / way, step[1] / way) if way > 0 else (1.0, 0.0)
    size = np.diag(_FIRST * [way, way, 1.0]) @ np.array([[c, d, 0.0], [-d, c, 0.0], [0.0, 0.0, 1.0]])
    share = np.linspace(0.0, 1.0, math.ceil(2 * way / _STEP) + 50)
    best, here, scale = known, np.zeros(3), 1.0
    while scale > _LAST:
        improved = False
        for change in (sign * row for row in size for sign in (1.0, -1.0)):
            if is_over():
                return None if best is known else best
            there = here + scale * change
            piece = BowedPiece(line.start, line.end, (float(there[0]), float(there[1]), float(there[2])))
            try:
                found = time_path((piece,), drive, limits, problem.steering)
            except LimitsInfeasible:
                continue
            if found.duration < best.duration and world.polyline_free(piece.poses(share)) < 0:
                best, here, improved = found, there, True
        if not improved:
            scale /= 2
    return None if best is known else best
