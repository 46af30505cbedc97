"""Local planners: the motions that join two poses where nothing but the robot's own mobility is in the
way.

A search samples poses; a Connector says which motions join two of them, how long they take, and whether
they are free.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drives.drive import Car, Holonomic, Unicycle
from drives.se2 import Array
from planner.curves import SEGMENTS
from planner.edges import (
    CURVE,
    LINE,
    NOTHING,
    OVERLAPPING,
    PIVOT,
    Law,
    duration,
    motions_between,
    motions_free,
    next_free,
    step_times,
)
from planner.environment import CollisionWorld
from planner.estimate import pace
from planner.fits import fitted
from planner.path import Path, as_path, as_steps
from planner.problem import Options, Robot

__all__ = ["Connector", "Motions", "connector", "free_paths"]

_COURSES, _FLAT = 72, 1e-3
"""Directions that speeds are compared in, and by what share a peak must stand out from those beside it."""

_HEADINGS = 9
"""Of a line that turns, at which the angles of steered wheels are compared."""
_WAYS, _SCALES = 16, (1.0, 1.5, 2.5, 4.0)
"""How many curves are as many as may be of use, and of which turning radii they are tried before any search,
in units of the connector's."""

_ALL = slice(None)
_NONE = np.zeros(0)


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


def free_paths(tried: list[Motions]) -> Iterator[Path]:
    """The motions that are free, the quickest first, each checked when asked for."""
    times = np.concatenate([motions.times.ravel() for motions in tried])
    order = np.argsort(times, kind="stable")
    order = order[: np.searchsorted(times[order], np.inf)]
    start, steps = np.empty((len(times), 3)), np.zeros((len(times), SEGMENTS, 3))
    straight, at = np.empty(len(times), dtype=np.bool_), 0
    for motions in tried:
        pairs, ways, k, _ = motions.steps.shape
        rows = slice(at, at + pairs * ways)
        start[rows] = np.repeat(motions.start, ways, 0)
        steps[rows, :k], straight[rows] = motions.steps.reshape(-1, k, 3), motions.straight
        at = rows.stop
    place = -1
    while (place := next_free(tried[0].world.kernel, start, steps, straight, order, place + 1)) >= 0:
        i = order[place]
        yield as_path(start[i], steps[i], bool(straight[i]))


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

    @cached_property
    @abstractmethod
    def law(self) -> Law:
        """How it moves, for compiled code."""

    def motions(self, a: Array, b: Array) -> Motions:
        """Ways from poses a (n, 3) to poses b (n, 3), headings of b taken mod 2π; of curves, the quickest."""
        times, steps = motions_between(self.law, a, b, self.ways(_WAYS))
        return Motions(self.world, a, times, steps, self.law.kind == LINE)

    def ways(self, most: int) -> int:
        """How many ways of joining two poses there are to try, where more than `most` are not asked for."""
        return most

    def direct(self, a: Array, b: Array) -> list[Motions]:
        """All motions worth trying before any search."""
        return [self.motions(a, b), Motions(self.world, a, *fitted(self.law, a, b))]

    @cached_property
    def reversal(self) -> float:
        """Time (s) of a change of direction, beside that of the motions before and after it."""
        limits = self.robot.limits
        return float((limits.wheel_speed / limits.wheel_acceleration).max()) if self.flows else 0.0

    def durations(self, start: Array, steps: Array) -> Array:
        """Estimates (n,) s of the time that steps (n, 3), those of Motions, take from poses start (n, 3)."""
        found: Array = step_times(self.law, start[:, 2], steps)
        return found

    def duration(self, path: Path) -> float:
        """Estimate (s) of the time that a path takes."""
        start, steps, _ = as_steps(path)
        return float(duration(self.law, start[0, 2], steps)) if path else 0.0

    def _law(
        self, kind: int, speed: Array = _NONE, push: Array = _NONE, lean: float = 0.0, slowness: float = 0.0
    ) -> Law:
        known = pace(self.robot.drive, self.robot.limits)
        radius = float(self.turning_radius)
        return Law(kind, self.reverse, self.flows, radius, known, speed, push, lean, slowness, self.reversal)


@dataclass(frozen=True, eq=False)
class LineConnector(Connector):
    """Holonomic: a straight line in SE(2), the heading turning the shorter way."""

    @property
    def steers(self) -> bool:
        return False

    @cached_property
    def law(self) -> Law:
        return self._law(LINE)

    def ways(self, most: int) -> int:
        return 1

    @property
    def fast_directions(self) -> Array:
        return self._fast[0]

    def direct(self, a: Array, b: Array) -> list[Motions]:
        # Curves are worth a try if no line is free, or if lines take long to steer for.
        lines, fits = self.motions(a, b), Motions(self.world, a, *fitted(self.law, a, b))
        steered = self._steered(a[:, 2], lines.steps[:, 0, 0])[:, None]
        worse = lines.free() & (steered <= lines.times)
        lines = replace(lines, times=np.maximum(lines.times, steered))
        fits = replace(fits, times=np.where(worse, np.inf, fits.times))
        return [lines, fits, *([self._rides(a, b)] if self.flows else [])]

    def _steered(self, theta: Array, lines: Array) -> Array:
        """Time (n,) s that wheels are steered for, on lines (n, 3) from poses of headings theta (n,)."""
        law, limits = self.robot.drive.settled.rolling_law(), self.robot.limits
        if not law.steered.any() or math.isinf(limits.steering_rate):
            return np.zeros(len(lines))
        heading = theta[:, None] + lines[:, 2:] * np.linspace(0.0, 1.0, _HEADINGS)
        travel = (lines[:, :1] + 1j * lines[:, 1:2]) * np.exp(-1j * heading)
        wheel = travel[..., None] + 1j * lines[:, 2:, None] * (law.points[law.steered] @ [1.0, 1.0j])
        turned: Array = np.abs(np.angle(wheel[:, 1:] * np.conj(wheel[:, :-1]))).sum(1).max(1)
        return turned / limits.steering_rate

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


@dataclass(frozen=True, eq=False)
class PivotConnector(Connector):
    """Unicycle: turn on the spot towards the goal, drive straight, turn on the spot. Forwards or
    backwards."""

    @cached_property
    def law(self) -> Law:
        return self._law(PIVOT)

    def ways(self, most: int) -> int:
        return min(most, 2 if self.reverse else 1)


@dataclass(frozen=True, eq=False)
class CurveConnector(Connector):
    """Car: Reeds–Shepp words of the turning radius, or Dubins words where it must not reverse."""

    @property
    def state_space(self) -> Literal["SE2", "ReedsShepp", "Dubins"]:
        return "ReedsShepp" if self.reverse else "Dubins"

    @cached_property
    def law(self) -> Law:
        return self._laws[0]

    @cached_property
    def _laws(self) -> list[Law]:
        """Of curves of each of _SCALES."""
        # From rest to rest over a way so short, and so long, that only acceleration, and only speed, counts.
        radii = (self.turning_radius * np.array(_SCALES)).tolist()
        units = [(1.0, 0.0, 0.0), *((1.0, 0.0, sign / radius) for radius in radii for sign in (1, -1))]
        plain = self._law(CURVE)
        theta, unit = np.zeros(len(units)), np.array(units)
        speed, push = 1e9 / step_times(plain, theta, 1e9 * unit), np.full(len(units), np.inf)
        if not self.flows:
            push = 4e-6 / step_times(plain, theta, 1e-6 * unit) ** 2
        lean, slowness = self._steering
        return [
            plain._replace(
                radius=radius,
                speed=np.array([speed[0], speed[k : k + 2].min()]),
                push=np.array([push[0], push[k : k + 2].min()]),
                lean=lean,
                slowness=slowness,
            )
            for k, radius in zip(range(1, len(units), 2), radii, strict=True)
        ]

    @property
    def _steering(self) -> tuple[float, float]:
        """Lean and slowness of the law, of a single wheel at the middle; 0 for a robot that need not stop to
        steer."""
        limits = self.robot.limits
        mobility = self.robot.drive.mobility(limits)
        if not isinstance(mobility, Car):
            return 0.0, 0.0
        lean = mobility.min_turning_radius * math.tan(min(limits.steering_angle, 1.5))
        return float(lean), float((OVERLAPPING if self.flows else 1.0) / limits.steering_rate)

    def direct(self, a: Array, b: Array) -> list[Motions]:
        fits = Motions(self.world, a, *fitted(self.law, a, b))
        return [*(Motions(self.world, a, *motions_between(law, a, b, _WAYS)) for law in self._laws), fits]


def connector(robot: Robot, world: CollisionWorld, options: Options) -> Connector:
    """The local planner that the robot's mobility asks for."""
    flows = options.effort != "first"
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
    return np.where(np.abs(inside) < NOTHING, 0.0, inside)
