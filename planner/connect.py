"""Local planners: the motions that join two poses where nothing but the robot's own mobility is in the
way.

A search samples poses; a Connector says which motions join two of them, how long they take, and whether
they are free.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, NamedTuple, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drives.drive import Car, Holonomic, Unicycle
from drives.se2 import Array, Pose, wrap
from planner.curves import dubins_words, reeds_shepp_words, shortest_word
from planner.environment import CollisionWorld, World, linear_free, twist_free
from planner.path import LinePiece, Path, Piece, arc, merge, pivot
from planner.problem import Options, Robot
from planner.time_law import duration_estimate

__all__ = [
    "Connector",
    "CurveConnector",
    "LineConnector",
    "Motions",
    "PivotConnector",
    "connector",
    "is_path_free",
]

_NOTHING = 1e-9
"""Ways (m) and turns (rad) below this are rounding, not motion."""

_F = TypeVar("_F", bound=Callable[..., Any])


def _kernel(function: _F) -> _F:
    return cast(_F, njit(cache=True, error_model="numpy")(function))


def is_path_free(world: CollisionWorld, path: Path) -> bool:
    """Whether the footprint is clear everywhere along the path."""
    return all(
        world.linear_free(piece.start, piece.end)
        if isinstance(piece, LinePiece)
        else world.twist_free(piece.start, piece.twist)
        for piece in path
    )


class Motions(NamedTuple):
    """Several ways to join each of n pairs of poses: times (n, ways) s, estimated, inf where there is no such
    way; free() (n, ways), whether they are; path(pair, way), the motion itself."""

    times: Array
    free: Callable[[], NDArray[np.bool_]]
    path: Callable[[int, int], Path]


@dataclass(frozen=True, eq=False)
class Connector(ABC):
    """How one kind of mobility joins two poses, and the state space in which OMPL searches for it.

    turning_radius m: of the curves, 0 where there are none.
    """

    robot: Robot
    world: CollisionWorld
    reverse: bool = True
    turning_radius: float = 0.0

    @property
    def state_space(self) -> Literal["SE2", "ReedsShepp", "Dubins"]:
        return "SE2"

    @abstractmethod
    def motions(self, a: Array, b: Array) -> Motions:
        """Ways from poses a (n, 3) to poses b (n, 3), headings of b taken mod 2π."""

    @abstractmethod
    def edge_free(self, a: Pose, b: Pose) -> bool:
        """Whether the shortest motion from a to b is free: quick, for the inside of a search."""

    def direct(self, a: Array, b: Array) -> list[Motions]:
        """All motions worth trying before any search."""
        return [self.motions(a, b)]

    def connect(self, a: Pose, b: Pose) -> Path | None:
        """The quickest free motion from a to b, or None."""
        motions = self.motions(np.array([a]), np.array([b]))
        times = np.where(motions.free(), motions.times, np.inf)[0]
        way = int(np.argmin(times))
        return motions.path(0, way) if times[way] < np.inf else None

    def durations(self, path: Path) -> Array:
        """Estimates (n,) s of the time that each piece of a path takes from rest to rest."""
        s = np.linspace(0.0, 1.0, 5)
        return self._rest_to_rest(np.array([piece.body_path(s).tangent for piece in path]).reshape(-1, 5, 3))

    def duration(self, path: Path) -> float:
        """Estimate (s) of the time that a path takes, at rest between its pieces and at both ends."""
        return float(self.durations(path).sum()) + self._steering_time(path)

    def _rest_to_rest(self, tangents: Array) -> Array:
        return duration_estimate(self.robot.drive, self.robot.limits, tangents)

    def _steering_time(self, path: Path) -> float:
        return 0.0

    def _constant(self, *twists: Sequence[float]) -> tuple[Array, Array]:
        """Largest speed and acceleration (k,) along constant unit twists: per second and second², of the
        unit."""
        # Rest to rest over a way so short, and so long, that only one of them counts.
        unit = np.array(twists, dtype=np.float64)[:, None, :]
        short, long = self._rest_to_rest(unit * 1e-6), self._rest_to_rest(unit * 1e9)
        return 1e9 / long, 4e-6 / short**2


@dataclass(frozen=True, eq=False)
class LineConnector(Connector):
    """Holonomic: a straight line in SE(2), the heading turning the shorter way."""

    def motions(self, a: Array, b: Array) -> Motions:
        step = b - a
        step[:, 2] = math.pi - (math.pi - step[:, 2]) % math.tau
        heading = a[:, 2:] + step[:, 2:] * np.linspace(0.0, 1.0, 5)
        c, d = np.cos(heading), np.sin(heading)
        dx, dy = step[:, :1], step[:, 1:2]
        tangents = np.stack([c * dx + d * dy, c * dy - d * dx, np.broadcast_to(step[:, 2:], c.shape)], -1)

        def free() -> NDArray[np.bool_]:
            every: NDArray[np.bool_] = _lines_free(self.world.kernel, a, step)[:, None]
            return every

        def path(pair: int, _: int) -> Path:
            return merge([LinePiece(Pose(*a[pair].tolist()), Pose(*(a[pair] + step[pair]).tolist()))])

        return Motions(self._rest_to_rest(tangents)[:, None], free, path)

    def edge_free(self, a: Pose, b: Pose) -> bool:
        return bool(linear_free(self.world.kernel, *a, b.x, b.y, a.theta + wrap(b.theta - a.theta)))


@dataclass(frozen=True, eq=False)
class PivotConnector(Connector):
    """Unicycle: turn on the spot towards the goal, drive straight, turn on the spot. Forwards or
    backwards."""

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        return self._constant((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))

    def motions(self, a: Array, b: Array) -> Motions:
        step = b - a
        distance = np.hypot(step[:, 0], step[:, 1])
        sign = np.array([1.0, -1.0]) if self.reverse else np.array([1.0])
        course = np.arctan2(np.multiply.outer(step[:, 1], sign), np.multiply.outer(step[:, 0], sign))
        course = np.where(distance[:, None] < _NOTHING, a[:, 2:], course)
        first, last = _wrapped(course - a[:, 2:]), _wrapped(b[:, 2:] - course)
        (fast, spin), (push, swing) = self._limits
        times = (
            _rest_to_rest(np.abs(first), spin, swing) + _rest_to_rest(distance, fast, push)[:, None]
            + _rest_to_rest(np.abs(last), spin, swing)
        )  # fmt: skip

        def free() -> NDArray[np.bool_]:
            every: NDArray[np.bool_] = _pivots_free(
                self.world.kernel, a, first, np.outer(distance, sign), last
            )
            return every

        def path(pair: int, way: int) -> Path:
            begin, end = Pose(*a[pair].tolist()), b[pair].tolist()
            aligned = Pose(begin.x, begin.y, begin.theta + float(first[pair, way]))
            there = Pose(end[0], end[1], aligned.theta)
            return merge([
                pivot(begin, float(first[pair, way])),
                arc(aligned, 0.0, float(sign[way] * distance[pair])),
                pivot(there, float(last[pair, way])),
            ])  # fmt: skip

        return Motions(times, free, path)

    def edge_free(self, a: Pose, b: Pose) -> bool:
        return bool(_pivot_free(self.world.kernel, *a, *b, self.reverse))


@dataclass(frozen=True, eq=False)
class CurveConnector(Connector):
    """Car: Reeds–Shepp words of the turning radius, or Dubins words where it must not reverse."""

    ways: int = 4

    @property
    def state_space(self) -> Literal["SE2", "ReedsShepp", "Dubins"]:
        return "ReedsShepp" if self.reverse else "Dubins"

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        (straight, left, right), (push, push_left, push_right) = self._constant(
            *((1.0, 0.0, k / self.turning_radius) for k in (0, 1, -1))
        )
        return np.array([straight, min(left, right)]), np.array([push, min(push_left, push_right)])

    def motions(self, a: Array, b: Array) -> Motions:
        steering = abs(self._steering_angle(1 / self.turning_radius)) / self.robot.limits.steering_rate
        times, curvature, length = _quickest_words(
            a, b, self.turning_radius, self.reverse, *self._limits, steering, self.ways
        )

        def free() -> NDArray[np.bool_]:
            every: NDArray[np.bool_] = _words_free(self.world.kernel, a, curvature, length)
            return every

        def path(pair: int, way: int) -> Path:
            pieces: list[Piece] = []
            pose = Pose(*a[pair].tolist())
            for k, ell in zip(curvature[pair, way].tolist(), length[pair, way].tolist(), strict=True):
                pieces.append(arc(pose, k, ell))
                pose = pieces[-1].end
            return merge(pieces)

        return Motions(times, free, path)

    def direct(self, a: Array, b: Array) -> list[Motions]:
        return [
            replace(self, turning_radius=scale * self.turning_radius, ways=_DIRECT_WAYS).motions(a, b)
            for scale in (1.0, 1.5, 2.5, 4.0)
        ]

    def edge_free(self, a: Pose, b: Pose) -> bool:
        return bool(_curve_free(self.world.kernel, *a, *b, self.turning_radius, self.reverse))

    def _steering_angle(self, curvature: float) -> float:
        """Of a single wheel at the middle, rad; 0 for a robot that need not stop to steer."""
        mobility = self.robot.drive.mobility(self.robot.limits)
        if not isinstance(mobility, Car):
            return 0.0
        return math.atan(
            curvature * mobility.min_turning_radius * math.tan(min(self.robot.limits.steering_angle, 1.5))
        )

    def _steering_time(self, path: Path) -> float:
        angles = [self._steering_angle(p.turn / p.twist.vx) for p in path if not isinstance(p, LinePiece)]
        return math.fsum(abs(b - a) for a, b in pairwise(angles)) / self.robot.limits.steering_rate


_DIRECT_WAYS = 16


def connector(robot: Robot, world: CollisionWorld, options: Options) -> Connector:
    """The local planner that the robot's mobility asks for."""
    match robot.drive.mobility(robot.limits):
        case Holonomic() if options.reverse:
            return LineConnector(robot, world)
        case Car(min_turning_radius):
            return CurveConnector(
                robot, world, options.reverse, max(options.turning_radius, min_turning_radius)
            )
        case Unicycle() if options.turning_radius > 0:
            return CurveConnector(robot, world, options.reverse, options.turning_radius)
        case _:
            return PivotConnector(robot, world, options.reverse)


def _wrapped(angle: Array) -> Array:
    """The same angles in (-π, π], and none that is only rounding."""
    inside: Array = math.pi - (math.pi - angle) % math.tau
    return np.where(np.abs(inside) < _NOTHING, 0.0, inside)


def _rest_to_rest(way: Array, speed: Any, acceleration: Any) -> Array:
    """Time (s) over ways >= 0 from rest to rest."""
    cruises = way * acceleration > speed**2
    time: Array = np.where(cruises, way / speed + speed / acceleration, 2 * np.sqrt(way / acceleration))
    return time


@_kernel
def _quickest_words(
    a: Array,
    b: Array,
    radius: float,
    reverse: bool,
    speed: Array,
    acceleration: Array,
    steering: float,
    ways: int,
) -> tuple[Array, Array, Array]:
    """The words from a (n, 3) to b (n, 3) that take least time, at most `ways` each, the quickest first.

    speed, acceleration (2,): on straights and on curves. steering s: from straight to the curve. Returns
    times (n, ways), curvature (n, ways, 5) 1/m, length (n, ways, 5) m.
    """
    n = len(a)
    times = np.full((n, ways), np.inf)
    curvatures, lengths = np.zeros((n, ways, 5)), np.zeros((n, ways, 5))
    for i in range(n):
        c, s = math.cos(a[i, 2]), math.sin(a[i, 2])
        dx, dy = (b[i, 0] - a[i, 0]) / radius, (b[i, 1] - a[i, 1]) / radius
        x, y, phi = c * dx + s * dy, c * dy - s * dx, b[i, 2] - a[i, 2]
        words, arcs, count = reeds_shepp_words(x, y, phi) if reverse else dubins_words(x, y, phi)
        for k in range(count):
            time, last = 0.0, -2.0
            for j in range(words.shape[1]):
                ell = abs(arcs[k, j]) * radius
                if ell == 0.0:
                    continue
                curve = words[k, j]
                bent = 1 if curve != 0.0 else 0
                v, accel = speed[bent], acceleration[bent]
                time += ell / v + v / accel if ell * accel > v * v else 2 * math.sqrt(ell / accel)
                if last != -2.0:
                    time += abs(curve - last) * steering
                last = curve
            if time >= times[i, ways - 1]:
                continue
            place = ways - 1
            while place > 0 and times[i, place - 1] > time:
                times[i, place] = times[i, place - 1]
                curvatures[i, place] = curvatures[i, place - 1]
                lengths[i, place] = lengths[i, place - 1]
                place -= 1
            times[i, place] = time
            curvatures[i, place] = words[k] / radius
            lengths[i, place] = arcs[k] * radius
    return times, curvatures, lengths


@_kernel
def _word_free(world: World, x: float, y: float, theta: float, curvature: Array, length: Array) -> bool:
    """Whether arcs of curvature (5,) 1/m and length (5,) m, one after the other from a pose, are free."""
    for k in range(len(length)):
        ell = length[k]
        if ell == 0.0:
            continue
        turn = curvature[k] * ell
        if not twist_free(world, x, y, theta, ell, 0.0, turn):
            return False
        half = turn / 2
        chord = ell if abs(half) < 1e-9 else ell * math.sin(half) / half
        x, y, theta = x + chord * math.cos(theta + half), y + chord * math.sin(theta + half), theta + turn
    return True


@_kernel
def _curve_free(
    world: World,
    ax: float,
    ay: float,
    ath: float,
    bx: float,
    by: float,
    bth: float,
    radius: float,
    reverse: bool,
) -> bool:
    """Whether the shortest word from a to b is free everywhere."""
    c, s = math.cos(ath), math.sin(ath)
    dx, dy = (bx - ax) / radius, (by - ay) / radius
    curvature, length = shortest_word(c * dx + s * dy, c * dy - s * dx, bth - ath, reverse)
    return _word_free(world, ax, ay, ath, curvature / radius, length * radius)


@_kernel
def _words_free(world: World, a: Array, curvature: Array, length: Array) -> NDArray[np.bool_]:
    """Whether words (n, ways, 5) from poses a (n, 3) are free, (n, ways)."""
    n, ways, _ = length.shape
    free = np.zeros((n, ways), dtype=np.bool_)
    for i in range(n):
        for k in range(ways):
            free[i, k] = _word_free(world, a[i, 0], a[i, 1], a[i, 2], curvature[i, k], length[i, k])
    return free


@_kernel
def _lines_free(world: World, a: Array, step: Array) -> NDArray[np.bool_]:
    """Whether straight lines from poses a by step (n, 3) are free, (n,)."""
    free = np.zeros(len(a), dtype=np.bool_)
    for i in range(len(a)):
        x, y, theta = a[i, 0], a[i, 1], a[i, 2]
        free[i] = linear_free(world, x, y, theta, x + step[i, 0], y + step[i, 1], theta + step[i, 2])
    return free


@_kernel
def _pivots_free(world: World, a: Array, first: Array, way: Array, last: Array) -> NDArray[np.bool_]:
    """Whether turning by first, driving straight by way and turning by last (n, ways) is free, (n, ways)."""
    n, ways = way.shape
    free = np.zeros((n, ways), dtype=np.bool_)
    for i in range(n):
        for k in range(ways):
            x, y, theta = a[i, 0], a[i, 1], a[i, 2] + first[i, k]
            ex, ey = x + way[i, k] * math.cos(theta), y + way[i, k] * math.sin(theta)
            free[i, k] = (
                linear_free(world, x, y, theta, ex, ey, theta)
                and linear_free(world, x, y, a[i, 2], x, y, theta)
                and linear_free(world, ex, ey, theta, ex, ey, theta + last[i, k])
            )
    return free


@_kernel
def _pivot_free(
    world: World, ax: float, ay: float, ath: float, bx: float, by: float, bth: float, reverse: bool
) -> bool:
    """Whether turning towards b, driving there and turning on is free everywhere, forwards or backwards."""
    dx, dy = bx - ax, by - ay
    for sign in (1.0, -1.0):
        if sign < 0 and not reverse:
            break
        course = math.atan2(sign * dy, sign * dx)
        first = math.pi - (math.pi - (course - ath)) % math.tau
        last = math.pi - (math.pi - (bth - course)) % math.tau
        if (
            linear_free(world, ax, ay, ath + first, bx, by, ath + first)
            and linear_free(world, ax, ay, ath, ax, ay, ath + first)
            and linear_free(world, bx, by, ath + first, bx, by, ath + first + last)
        ):
            return True
    return False
