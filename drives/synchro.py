"""Synchro drive: all wheels drive and steer as one, and the body does not turn: theta is the wheels' heading.

vx = r·rate and omega = steering rate for every wheel (locomotion lecture, "Synchronous drive").
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from drives.checks import count, lengths, number, refuse_beyond, refuse_sideways
from drives.drive import ActuatorPath, BodyPath, Drive, Limits, Mobility, Rolling, Unicycle, WheelState
from drives.se2 import Array, Twist

__all__ = ["Synchro"]


@dataclass(frozen=True)
class Synchro(Drive):
    """wheel_radius m; wheel_count; body_heading rad, world: what the body and its footprint keep."""

    kind: ClassVar[str] = "synchro"

    wheel_radius: float
    wheel_count: int = 3
    body_heading: float = 0.0

    def __post_init__(self) -> None:
        lengths(wheel_radius=self.wheel_radius)
        count("wheel_count", self.wheel_count, 1)
        number("body_heading", self.body_heading)

    @property
    def wheel_names(self) -> tuple[str, ...]:
        return tuple(f"wheel_{i + 1}" for i in range(self.wheel_count))

    @property
    def steered_names(self) -> tuple[str, ...]:
        return self.wheel_names

    @property
    def fixed_body_heading(self) -> float | None:
        return self.body_heading

    def steered_headings(self, steering: Array) -> Array | None:
        return steering + self.body_heading

    def rolling_law(self) -> Rolling:
        m = self.wheel_count
        rows = np.tile([1 / self.wheel_radius, 0.0, 0.0], (m, 1))
        return Rolling(rows, np.zeros(m, dtype=bool), np.zeros((m, 2)), np.ones(m), heading_steers=True)

    def mobility(self, limits: Limits) -> Mobility:
        return Unicycle()

    def inverse(self, twist: Twist, steering: Array | None = None) -> WheelState:
        """Steering is as given, by default zero: a twist does not say where in the body the wheels point."""
        refuse_sideways(self.kind, np.array([twist], dtype=float))
        every = np.ones(self.wheel_count)
        angles = 0 * every if steering is None else np.array(steering, dtype=float)
        return WheelState(every * twist.vx / self.wheel_radius, angles, every * twist.omega)

    def forward(self, rates: Array, steering: Array, steering_rates: Array) -> tuple[Array, Array]:
        """The twist is in the wheels' own frame, so only the rates tell it; steering is not looked at.

        Slip also counts how far (rad/s) the wheels disagree on omega.
        """
        travel = rates * self.wheel_radius
        v, omega = travel.mean(axis=1, keepdims=True), steering_rates.mean(axis=1, keepdims=True)
        slip = np.abs(np.hstack([travel - v, steering_rates - omega])).max(axis=1)
        return np.hstack([v, np.zeros_like(v), omega]), slip

    def actuators(
        self, path: BodyPath, steering: Array | None = None, steering_limit: float = np.inf
    ) -> ActuatorPath:
        refuse_sideways(self.kind, path.tangent)
        every = np.ones(self.wheel_count)
        start = path.heading[0] - self.body_heading if steering is None else steering
        angles = start * every + (path.heading - path.heading[0])[:, None]
        refuse_beyond(angles, steering_limit, self.wheel_names)
        return ActuatorPath(
            path.tangent[:, :1] / self.wheel_radius * every,
            path.tangent_derivative[:, :1] / self.wheel_radius * every,
            angles,
            path.tangent[:, 2:] * every,
        )
