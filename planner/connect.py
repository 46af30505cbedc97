"""Local planners: the one motion that joins two poses where nothing but the robot's own mobility is in the way.

A search samples poses; a Connector says which motion joins two of them, whether it is free, and how long it takes.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

import numpy as np
from numba import njit

from drives.drive import Car, Holonomic, Unicycle
from drives.se2 import Pose, wrap
from planner.curves import candidates, shortest_word
from planner.environment import CollisionWorld, World, twist_free
from planner.path import LinePiece, Path, Piece, arc, merge, pivot
from planner.problem import Options, Robot
from planner.time_law import duration_estimate

__all__ = ["Connector", "CurveConnector", "LineConnector", "PivotConnector", "connector", "is_path_free"]

_NOTHING = 1e-9
"""Ways (m) and turns (rad) below this are rounding, not motion."""


_DIRECT_WORDS = 16


def is_path_free(world: CollisionWorld, path: Path) -> bool:
    """Whether the footprint is clear everywhere along the path."""
    return all(
        world.linear_free(piece.start, piece.end)
        if isinstance(piece, LinePiece)
        else world.twist_free(piece.start, piece.twist)
        for piece in path
    )


@dataclass(frozen=True, slots=True)
class Connector(ABC):
    """How one kind of mobility joins two poses, and the state space in which OMPL searches for it."""

    robot: Robot
    world: CollisionWorld
    reverse: bool = True
    turning_radius: float = 0.0

    @property
    def state_space(self) -> Literal["SE2", "ReedsShepp", "Dubins"]:
        return "SE2"

    @property
    def stations(self) -> int:
        """How many poses along a path are worth considering for shortcuts."""
        return 24

    def direct_paths(self, a: Pose, b: Pose) -> Iterator[Path]:
        """All motions from a to b worth trying before any search."""
        yield from self.paths(a, b)

    @abstractmethod
    def paths(self, a: Pose, b: Pose) -> Iterator[Path]:
        """Motions from a to b, b.theta taken mod 2π, the one that promises most first. At least one."""

    @abstractmethod
    def edge_free(self, a: Pose, b: Pose) -> bool:
        """Whether one of the first motions from a to b is free: quick, for the inside of a search."""

    def connect(self, a: Pose, b: Pose) -> Path | None:
        """The first free motion from a to b, or None."""
        return next((path for path in self.paths(a, b) if is_path_free(self.world, path)), None)

    def durations(self, paths: Sequence[Path]) -> list[float]:
        """Estimates (s) of the time that paths take, at rest between their pieces and at both ends."""
        pieces = [piece for path in paths for piece in path]
        if not pieces:
            return [0.0] * len(paths)
        s = np.linspace(0.0, 1.0, 5)
        tangents = np.stack([piece.tangents(s) for piece in pieces])
        driving = iter(duration_estimate(self.robot.drive, self.robot.limits, tangents).tolist())
        return [math.fsum(next(driving) for _ in path) + self._steering_time(path) for path in paths]

    def _steering_time(self, path: Path) -> float:
        return 0.0


@dataclass(frozen=True, slots=True)
class LineConnector(Connector):
    """Holonomic: a straight line in SE(2), the heading turning the shorter way."""

    def paths(self, a: Pose, b: Pose) -> Iterator[Path]:
        yield merge([LinePiece(a, Pose(b.x, b.y, a.theta + wrap(b.theta - a.theta)))])

    def edge_free(self, a: Pose, b: Pose) -> bool:
        return self.world.linear_free(a, Pose(b.x, b.y, a.theta + wrap(b.theta - a.theta)))


@dataclass(frozen=True, slots=True)
class PivotConnector(Connector):
    """Unicycle: turn on the spot towards the goal, drive straight, turn on the spot. Forwards or backwards."""

    def paths(self, a: Pose, b: Pose) -> Iterator[Path]:
        dx, dy = b.x - a.x, b.y - a.y
        distance = math.hypot(dx, dy)
        if distance < _NOTHING:
            yield merge([pivot(a, wrap(b.theta - a.theta))])
            return
        ways = []
        for sign in (1.0, -1.0) if self.reverse else (1.0,):
            course = math.atan2(sign * dy, sign * dx)
            turns = wrap(course - a.theta), wrap(b.theta - course)
            ways.append((abs(turns[0]) + abs(turns[1]), sign * distance, *turns))
        for _, length, first, last in sorted(ways):
            aligned = Pose(a.x, a.y, a.theta + first)
            there = Pose(b.x, b.y, aligned.theta)
            yield merge([
                *([pivot(a, first)] if abs(first) > _NOTHING else []),
                arc(aligned, 0.0, length),
                *([pivot(there, last)] if abs(last) > _NOTHING else []),
            ])  # fmt: skip

    def edge_free(self, a: Pose, b: Pose) -> bool:
        return self.connect(a, b) is not None


@dataclass(frozen=True, slots=True)
class CurveConnector(Connector):
    """Car: Reeds–Shepp words of the turning radius, or Dubins words where it must not reverse."""

    words: int = 4

    @property
    def state_space(self) -> Literal["SE2", "ReedsShepp", "Dubins"]:
        return "ReedsShepp" if self.reverse else "Dubins"

    def paths(self, a: Pose, b: Pose) -> Iterator[Path]:
        words = candidates(a, b, self.turning_radius, self.reverse)
        for word in words[: self.words]:
            pieces: list[Piece] = []
            pose = a
            for curvature, length in word.segments:
                pieces.append(arc(pose, curvature, length))
                pose = pieces[-1].end
            yield merge(pieces)

    @property
    def stations(self) -> int:
        return 12

    def direct_paths(self, a: Pose, b: Pose) -> Iterator[Path]:
        for scale in (1.0, 1.5, 2.5, 4.0):
            wider = replace(self, turning_radius=scale * self.turning_radius, words=_DIRECT_WORDS)
            yield from wider.paths(a, b)

    def edge_free(self, a: Pose, b: Pose) -> bool:
        return bool(_curve_free(self.world.kernel, *a, *b, self.turning_radius, self.reverse))

    def _steering_time(self, path: Path) -> float:
        """Time to steer at rest between pieces, the wheels taken for a single one at the middle."""
        mobility = self.robot.drive.mobility(self.robot.limits)
        if not isinstance(mobility, Car) or len(path) < 2:
            return 0.0
        wheelbase = math.tan(min(self.robot.limits.steering_angle, 1.5)) * mobility.min_turning_radius
        angles = [math.atan(p.turn / p.twist.vx * wheelbase) for p in path if not isinstance(p, LinePiece)]
        turned = math.fsum(abs(b - a) for a, b in pairwise(angles))
        return turned / self.robot.limits.steering_rate


@njit(cache=True)
def _curve_free(
    world: World, ax: float, ay: float, ath: float, bx: float, by: float, bth: float, radius: float, reverse: bool
) -> bool:
    """Whether the shortest word from a to b is free everywhere."""
    c, s = math.cos(ath), math.sin(ath)
    dx, dy = (bx - ax) / radius, (by - ay) / radius
    curvature, length = shortest_word(c * dx + s * dy, c * dy - s * dx, bth - ath, reverse)
    x, y, theta = ax, ay, ath
    for k in range(len(length)):
        ell = length[k] * radius
        if ell == 0.0:
            continue
        turn = curvature[k] * length[k]
        if not twist_free(world, x, y, theta, ell, 0.0, turn):
            return False
        half = turn / 2
        chord = ell if abs(half) < 1e-9 else ell * math.sin(half) / half
        x, y, theta = x + chord * math.cos(theta + half), y + chord * math.sin(theta + half), theta + turn
    return True


def connector(robot: Robot, world: CollisionWorld, options: Options) -> Connector:
    """The local planner that the robot's mobility asks for."""
    match robot.drive.mobility(robot.limits):
        case Holonomic():
            return LineConnector(robot, world)
        case Car(min_turning_radius):
            return CurveConnector(robot, world, options.reverse, max(options.turning_radius, min_turning_radius))
        case Unicycle():
            if options.turning_radius > 0:
                return CurveConnector(robot, world, options.reverse, options.turning_radius)
            return PivotConnector(robot, world, options.reverse)
