"""Local planners: the motions that join two poses where nothing but the robot's own mobility is in the
way.

A search samples poses; a Connector says which motions join two of them, how long they take, and whether
they are free.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drives.drive import Car, Holonomic, Unicycle
from drives.se2 import Array, Pose, wrap
from planner.edges import curve_free, motions_free, pivot_free, quickest_words
from planner.environment import CollisionWorld, linear_free
from planner.estimate import pace, step_durations
from planner.path import LinePiece, Path, as_path, as_steps
from planner.problem import Options, Robot

__all__ = [
    "Connector",
    "CurveConnector",
    "LineConnector",
    "Motions",
    "PivotConnector",
    "connector",
    "is_path_free",
]

_OVERLAPPING = 0.5
"""Share of the time to steer, or to turn on the spot, that is lost where the robot drives
meanwhile, roughly."""

_COURSES, _FLAT = 72, 1e-3
"""Directions that speeds are compared in, and by what share a peak must stand out from those beside it."""

_WAYS, _SCALES = 16, (1.0, 1.5, 2.5, 4.0)
"""How many curves are as many as may be of use, and of which turning radii they are tried before any search,
in units of the connector's."""

_ALL = slice(None)

_NOTHING = 1e-9
"""Ways (m) and turns (rad) below this are rounding, not motion."""


def is_path_free(world: CollisionWorld, path: Path) -> bool:
    """Whether the footprint is clear everywhere along the path."""
    return all(
        world.linear_free(piece.start, piece.end)
        if isinstance(piece, LinePiece)
        else world.twist_free(piece.start, piece.twist)
        for piece in path
    )


@dataclass(frozen=True, slots=True, eq=False)
class Motions:
    """Several ways to join each of n pairs of poses.

    start (n, 3): the first of each pair. times (n, ways) s, estimated, inf where there is no such way. steps
    (n, ways, k, 3): what is driven in turn, twists held for unit time or, where `straight`, displacements in
    the world; those of zero are none.
    """

    world: CollisionWorld
    start: Array
    times: Array
    steps: Array
    straight: bool = False

    def free(self, pairs: slice = _ALL, ways: slice = _ALL) -> NDArray[np.bool_]:
        """Whether those of two slices are free."""
        steps = self.steps[pairs, ways]
        free: NDArray[np.bool_] = motions_free(self.world.kernel, self.start[pairs], steps, self.straight)
        return free

    def path(self, pair: int, way: int) -> Path:
        """The motion itself."""
        return as_path(self.start[pair], self.steps[pair, way], self.straight)


@dataclass(frozen=True, eq=False)
class Connector(ABC):
    """How one kind of mobility joins two poses, and the state space in which OMPL searches for it.

    turning_radius m: of the curves, 0 where there are none. flows: whether motions are timed as if they only
    stopped where they change direction, which is what an optimizer makes of them, or as they stop.
    """

    robot: Robot
    world: CollisionWorld
    reverse: bool = True
    turning_radius: float = 0.0
    flows: bool = False

    @property
    def state_space(self) -> Literal["SE2", "ReedsShepp", "Dubins"]:
        return "SE2"

    @property
    def steers(self) -> bool:
        """Whether the body heads where it goes, or against it."""
        return True

    @property
    def fast_directions(self) -> Array:
        """Directions (k,) rad in the body frame that a base is faster in than in those beside them."""
        return np.zeros(0)

    @abstractmethod
    def motions(self, a: Array, b: Array, ways: int = _WAYS) -> Motions:
        """Ways from poses a (n, 3) to poses b (n, 3), headings of b taken mod 2π; of curves, so many of the
        quickest."""

    @abstractmethod
    def edge_free(self, a: Pose, b: Pose) -> bool:
        """Whether the shortest motion from a to b is free: quick, for the inside of a search."""

    def direct(self, a: Array, b: Array) -> list[Motions]:
        """All motions worth trying before any search."""
        return [self.motions(a, b)]

    def connect(self, a: Pose, b: Pose) -> Path | None:
        """The quickest free motion from a to b, or None."""
        motions = self.motions(np.array([a]), np.array([b]))
        for way in np.argsort(motions.times[0], kind="stable").tolist():
            if motions.times[0, way] < np.inf and motions.free(_ALL, slice(way, way + 1))[0, 0]:
                return motions.path(0, way)
        return None

    @cached_property
    def reversal(self) -> float:
        """Time (s) of a change of direction, beside that of the motions before and after it."""
        limits = self.robot.limits
        return float((limits.wheel_speed / limits.wheel_acceleration).max()) if self.flows else 0.0

    def durations(self, start: Array, steps: Array) -> Array:
        """Estimates (n,) s of the time that steps (n, 3), those of Motions, take from poses start (n, 3)."""
        found: Array = step_durations(self._pace, start, steps, not self.steers, self.flows)
        return found

    def duration(self, path: Path) -> float:
        """Estimate (s) of the time that a path takes."""
        start, steps, _ = as_steps(path)
        way = np.sign(steps[:, 0])[steps[:, 0] != 0] if self.steers else np.zeros(0)
        reversals = np.count_nonzero(np.diff(way)) * self.reversal
        return float(self.durations(start, steps).sum()) + reversals + self._steering_time(path)

    @cached_property
    def _pace(self) -> Array:
        return pace(self.robot.drive, self.robot.limits)

    def _steering_time(self, path: Path) -> float:
        return 0.0

    def _constant(self, *twists: Sequence[float]) -> tuple[Array, Array]:
        """Largest speed and acceleration (k,) along constant unit twists: per second and second², of the
        unit."""
        # Rest to rest over a way so short, and so long, that only one of them counts.
        unit = np.array(twists)
        short, long = (self.durations(np.zeros_like(unit), unit * scale) for scale in (1e-6, 1e9))
        return 1e9 / long, np.full_like(long, np.inf) if self.flows else 4e-6 / short**2


@dataclass(frozen=True, eq=False)
class LineConnector(Connector):
    """Holonomic: a straight line in SE(2), the heading turning the shorter way."""

    @property
    def steers(self) -> bool:
        return False

    def motions(self, a: Array, b: Array, ways: int = _WAYS) -> Motions:
        step = b - a
        step[:, 2] = math.pi - (math.pi - step[:, 2]) % math.tau
        return Motions(self.world, a, self.durations(a, step)[:, None], step[:, None, None], straight=True)

    @property
    def fast_directions(self) -> Array:
        return self._fast[0]

    def direct(self, a: Array, b: Array) -> list[Motions]:
        return [self.motions(a, b), *([self._rides(a, b)] if self.flows else [])]

    @cached_property
    def _fast(self) -> tuple[Array, Array, float]:
        """Directions (k,) rad in the body frame in which the base is faster than in those beside them, its
        speeds there (m/s), and that of turning (rad/s)."""
        course = np.linspace(0.0, math.tau, _COURSES, endpoint=False)
        twists = np.stack([np.cos(course), np.sin(course), np.zeros(_COURSES)], -1)
        twists = np.vstack([twists, [0.0, 0.0, 1.0]])
        *speeds, turning = 1 / self.durations(np.zeros_like(twists), twists)
        speed = np.array(speeds)
        peaks = (speed > np.roll(speed, 1) * (1 + _FLAT)) & (speed >= np.roll(speed, -1) * (1 + _FLAT))
        return course[peaks], speed[peaks], float(turning)

    def _rides(self, a: Array, b: Array) -> Motions:
        """Straight ways in a fast direction: turned into on the way, and out of again."""
        directions, speeds, turning = self._fast
        way = (b - a)[:, None, :2]
        ride = np.arctan2(way[..., 1], way[..., 0]) - directions
        first, last = _wrapped(ride - a[:, 2:]), _wrapped(b[:, 2:] - ride)
        turns = np.stack([first, np.zeros_like(first), last], -1)
        with np.errstate(divide="ignore", invalid="ignore"):
            needed = np.abs(turns) / turning * speeds[:, None]
            shares = needed / np.hypot(way[..., 0], way[..., 1])[..., None]
        fits = shares.sum(-1) < 1.0
        shares[..., 1] = 1.0 - shares.sum(-1)
        shares[~fits] = 0.0
        steps = np.concatenate([shares[..., None] * way[..., None, :], turns[..., None]], -1)
        steps[~fits] = 0.0
        start = np.zeros_like(steps)
        start[..., 2] = a[:, 2, None, None] + np.cumsum(turns, -1) - turns
        times = self.durations(start.reshape(-1, 3), steps.reshape(-1, 3)).reshape(turns.shape).sum(-1)
        return Motions(self.world, a, np.where(fits, times, np.inf), steps, straight=True)

    def edge_free(self, a: Pose, b: Pose) -> bool:
        return bool(linear_free(self.world.kernel, *a, b.x, b.y, a.theta + wrap(b.theta - a.theta)))


@dataclass(frozen=True, eq=False)
class PivotConnector(Connector):
    """Unicycle: turn on the spot towards the goal, drive straight, turn on the spot. Forwards or
    backwards."""

    def durations(self, start: Array, steps: Array) -> Array:
        times = super().durations(start, steps)
        return np.where(~steps[:, :2].any(1) & self.flows, _OVERLAPPING * times, times)

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        return self._constant((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))

    def motions(self, a: Array, b: Array, ways: int = _WAYS) -> Motions:
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

        steps = np.zeros((*first.shape, 3, 3))
        steps[..., 0, 2], steps[..., 1, 0], steps[..., 2, 2] = first, np.outer(distance, sign), last
        return Motions(self.world, a, times, steps)

    def edge_free(self, a: Pose, b: Pose) -> bool:
        return bool(pivot_free(self.world.kernel, *a, *b, self.reverse))


@dataclass(frozen=True, eq=False)
class CurveConnector(Connector):
    """Car: Reeds–Shepp words of the turning radius, or Dubins words where it must not reverse."""

    @property
    def state_space(self) -> Literal["SE2", "ReedsShepp", "Dubins"]:
        return "ReedsShepp" if self.reverse else "Dubins"

    @cached_property
    def _limits(self) -> tuple[Array, Array]:
        """Largest speeds and accelerations (len(_SCALES), 2) on straights and on curves of each radius."""
        radii = self.turning_radius * np.array(_SCALES)
        curves = [(1.0, 0.0, sign / radius) for radius in radii.tolist() for sign in (1, -1)]
        speed, push = (
            np.column_stack([np.full(len(radii), each[0]), each[1:].reshape(-1, 2).min(1)])
            for each in self._constant((1.0, 0.0, 0.0), *curves)
        )
        return speed, push

    def motions(self, a: Array, b: Array, ways: int = _WAYS) -> Motions:
        return self._words(a, b, 0, ways)

    def _words(self, a: Array, b: Array, k: int, ways: int) -> Motions:
        """The quickest words of _SCALES[k] times the turning radius."""
        radius, (speed, push) = _SCALES[k] * self.turning_radius, self._limits
        steering = abs(self._steering_angle(1 / radius)) * self._steering_slowness
        times, steps = quickest_words(
            a, b, radius, self.reverse, speed[k], push[k], steering, self.reversal, ways
        )
        return Motions(self.world, a, times, steps)

    def direct(self, a: Array, b: Array) -> list[Motions]:
        return [self._words(a, b, k, _WAYS) for k in range(len(_SCALES))]

    def edge_free(self, a: Pose, b: Pose) -> bool:
        return bool(curve_free(self.world.kernel, *a, *b, self.turning_radius, self.reverse))

    @property
    def _steering_slowness(self) -> float:
        """Time (s) that steering by 1 rad costs."""
        return (_OVERLAPPING if self.flows else 1.0) / self.robot.limits.steering_rate

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
        return math.fsum(abs(b - a) for a, b in pairwise(angles)) * self._steering_slowness


def connector(robot: Robot, world: CollisionWorld, options: Options) -> Connector:
    """The local planner that the robot's mobility asks for."""
    # Trailing wheels have to swing round first, which the optimizer knows nothing of.
    flows = options.effort != "first" and robot.drive.settled is robot.drive
    match robot.drive.mobility(robot.limits):
        case Holonomic() if options.reverse:
            return LineConnector(robot, world, flows=flows)
        case Car(min_turning_radius):
            return CurveConnector(
                robot, world, options.reverse, max(options.turning_radius, min_turning_radius), flows
            )
        case Unicycle() if options.turning_radius > 0:
            return CurveConnector(robot, world, options.reverse, options.turning_radius, flows)
        case _:
            return PivotConnector(robot, world, options.reverse, flows=flows)


def _wrapped(angle: Array) -> Array:
    """The same angles in (-π, π], and none that is only rounding."""
    inside: Array = math.pi - (math.pi - angle) % math.tau
    return np.where(np.abs(inside) < _NOTHING, 0.0, inside)


def _rest_to_rest(way: Array, speed: Any, acceleration: Any) -> Array:
    """Time (s) over ways >= 0 from rest to rest."""
    ramp = speed / acceleration
    time: Array = np.where(way > speed * ramp, way / speed + ramp, 2 * np.sqrt(way / acceleration))
    return time
