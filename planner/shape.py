"""What a compiled solver of motions is for: its variables and its parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

__all__ = ["Shape"]

_EXACT = 0.03
"""Unit of poses: gaps between intervals add up along the way, so they must be smaller than what limits are
exceeded by."""


@dataclass(frozen=True, slots=True)
class Shape:
    """What a compiled solver is for: all else are its parameters.

    coordinates: as of Flowing. rows, steered: how many wheels of either kind. planes: half-planes to keep
    to at every knot, and once between it and the next. jerk: whether wheel jerks are limited. given: what of
    the state it begins in is; a car at rest may begin with any curvature, or with any rate of the curvature.
    forward: whether it must not go backwards. trail: whether steered wheels are casters. pushes: whether a
    twist's accelerations along and across its velocity are limited. slow: whether the steering rates of
    wheels that stand along their own velocity are held at the ends of intervals, not in the middle.
    """

    coordinates: Literal["twist", "unicycle", "car"]
    rows: int
    steered: int
    planes: int
    jerk: bool
    given: Literal["all", "curvature", "rest"]
    forward: bool
    trail: bool
    pushes: bool
    slow: bool = False

    @property
    def size(self) -> int:
        """How many coordinates there are."""
        return 3 if self.coordinates == "twist" else 2

    @property
    def order(self) -> int:
        """How many derivatives of the coordinates are states."""
        return 2 if self.jerk else 1

    @property
    def casters(self) -> int:
        """How many there are."""
        return self.steered if self.trail else 0

    @property
    def angles(self) -> slice:
        """Which of the state are angles of casters."""
        first = 3 + self.order * self.size
        return slice(first, first + self.casters)

    @property
    def state(self) -> int:
        """Pose, coordinates (and rates), angles of casters, duration."""
        return 4 + self.order * self.size + self.casters

    def units(self, knots: Any) -> tuple[list[Any], list[Any]]:
        """What the solver's states (state,) and controls are in, so that a change over an interval is about
        one."""
        rates = [knots] * (self.size * (self.order - 1))
        states = [*[_EXACT] * 3, *[1.0] * self.size, *rates, *[1.0] * (self.casters + 1)]
        return states, [*[knots**self.order] * self.size, *[1.0] * (2 * self.casters)]

    def parameters(self) -> dict[str, int]:
        """Names and sizes, in order.

        start: pose, coordinates (and rates), angles of casters. goal: pose. rate (rows, 3): wheel rate over
        its limit per twist. x, y, speed (steered): where the wheel stands, and 1 over its largest rolling
        speed. trail: of casters. acceleration, jerk (rows + steered): rate limit over acceleration limit, and
        over jerk limit. steering: 1 over the steering rate. curvature: 1 over the largest. body: 1 over the
        limits of speed, omega, tangential and lateral acceleration. knots: how many intervals there are.
        """
        wheels = self.rows + self.steered
        return {
            "start": self.state - 1,
            "goal": 3,
            "rate": 3 * self.rows,
            "x": self.steered,
            "y": self.steered,
            "speed": self.steered,
            "trail": 1,
            "acceleration": wheels,
            "jerk": wheels,
            "steering": 1,
            "curvature": 1,
            "body": 4,
            "knots": 1,
        }
