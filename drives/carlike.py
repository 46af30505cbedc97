"""Car-like drives: steered wheels in front, all pointing about one centre on the line of the rear axle.

The body origin is the middle of the rear axle. Drives of this kind differ in their front wheels only.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from drives.checks import lengths, refuse_sideways
from drives.drive import (
    ActuatorPath,
    BodyPath,
    Car,
    Drive,
    InadmissibleTwist,
    Limits,
    Mobility,
    Rolling,
    WheelState,
)
from drives.se2 import Array, Twist
from drives.steering import aim, steer
from drives.wheel import rigid_motion

__all__ = ["CarLike"]

TIGHTEST = 1 / 20
"""Smallest turning radius, in wheelbases, that mobility() gives. On tighter curves, which steering near π/2
would allow, the front wheels run more than twenty times as far as the body origin."""


@dataclass(frozen=True)
class CarLike(Drive):
    """wheel_radius m; wheelbase m, from rear to front axle; track_width m, between the wheels of an axle."""

    steers_at_rest: ClassVar[bool] = True

    wheel_radius: float
    wheelbase: float
    track_width: float

    def __post_init__(self) -> None:
        lengths(wheel_radius=self.wheel_radius, wheelbase=self.wheelbase, track_width=self.track_width)

    @property
    @abstractmethod
    def _front(self) -> tuple[float, ...]:
        """The y (m) of every front wheel, in the order of `steered_names`."""

    @property
    def wheel_names(self) -> tuple[str, ...]:
        return (*self.steered_names, "rear_left", "rear_right")

    def rolling_law(self) -> Rolling:
        return self._rolling_law

    @cached_property
    def _rolling_law(self) -> Rolling:
        x, y = self._points
        steered = np.arange(len(x)) < len(self._front)
        rows = np.stack([np.ones_like(y), np.zeros_like(y), -y], -1) / self.wheel_radius
        points = np.stack([x, y], -1)
        return Rolling(rows * ~steered[:, None], steered, points, np.full(len(x), self.wheel_radius))

    def mobility(self, limits: Limits) -> Mobility:
        """The radius at the body origin at which the inner front wheel reaches its limit.

        Where the limit is π/2 or more, or so near that the radius would be less, the wheelbase / 20 takes the
        place of wheelbase / tan(limit).
        """
        limit = limits.steering_angle
        radius = self.wheelbase / math.tan(limit) if limit < math.pi / 2 else 0.0
        return Car(max(radius, TIGHTEST * self.wheelbase) + max(self._front))

    def inverse(self, twist: Twist, steering: Array | None = None) -> WheelState:
        row = np.array([twist], dtype=float)
        refuse_sideways(self.kind, row)
        x, y = self._points
        k = len(self._front)
        # Nearest to 0 is the branch in [-π/2, π/2]: reversing keeps the angle and turns the rate round.
        front = aim(x[:k], y[:k], self.wheel_radius, Twist(twist.vx, 0.0, twist.omega), np.zeros(k))
        return WheelState(
            np.concatenate([front.rates, (row @ self._rear)[0]]), front.steering, front.steering_rates
        )

    def forward(self, rates: Array, steering: Array, steering_rates: Array) -> tuple[Array, Array]:
        return rigid_motion(*self._points, self.wheel_radius, 0.0, rates, steering, steering_rates)

    def actuators(
        self, path: BodyPath, steering: Array | None = None, steering_limit: float = np.inf
    ) -> ActuatorPath:
        refuse_sideways(self.kind, path.tangent)
        v, omega = np.abs(path.tangent[:, 0]), np.abs(path.tangent[:, 2])
        # Turning about a point between them, the front wheels toe in: each may be within the limit, yet to
        # get there the inner one would have to pass π/2.
        if steering_limit < np.pi / 2 and (v < (1 - 1e-9) * max(self._front) * omega).any():
            raise InadmissibleTwist(
                f"the {self.kind} drive cannot turn about a point between its front wheels"
            )
        x, y = self._points
        k = len(self._front)
        level = BodyPath(path.s, path.heading, path.tangent * _LEVEL, path.tangent_derivative * _LEVEL)
        front = steer(x[:k], y[:k], self.wheel_radius, level, np.zeros(k), steering_limit)
        return ActuatorPath(
            np.concatenate([front.wheel, path.tangent @ self._rear], 1),
            np.concatenate([front.wheel_derivative, path.tangent_derivative @ self._rear], 1),
            front.steering,
            front.steering_derivative,
        )

    @cached_property
    def _points(self) -> tuple[Array, Array]:
        """Where the wheels stand: x (m,) and y (m,)."""
        x = np.array([self.wheelbase] * len(self._front) + [0.0, 0.0])
        return x, np.array([*self._front, self.track_width / 2, -self.track_width / 2])

    @cached_property
    def _rear(self) -> Array:
        """Takes twists (n, 3) to the rates (n, 2) of the rear wheels."""
        y = self._points[1][-2:]
        return np.stack([np.ones(2), np.zeros(2), -y]) / self.wheel_radius


_LEVEL = np.array([1.0, 0.0, 1.0])
"""Takes out the round-off in vy, so that the front angles stand exactly where the rear axle allows."""
