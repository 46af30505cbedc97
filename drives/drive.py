"""What every drive promises: a path of the body becomes a path of its actuators.

Along a path q(s) with body tangent ξ(s) = dq/ds in the body frame, a drive gives w(s), the wheel angle gained
per unit of s, and δ(s), the steering angle. For any speed ṡ then

    wheel rate      w·ṡ
    wheel accel.    w·s̈ + w′·ṡ²
    steering rate   δ′·ṡ

Two laws, which the tests hold every drive to: rates scale with the twist (degree 1); steering angles do not
change when the twist is scaled by a positive number (degree 0).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array, Twist

__all__ = [
    "ActuatorPath", "BodyPath", "Car", "Drive", "Holonomic", "InadmissibleTwist", "InvalidDrive", "Limits",
    "Mobility", "Rolling", "Unicycle", "WheelState",
]  # fmt: skip


class InvalidDrive(ValueError):
    """A drive whose parameters are degenerate. `parameter` names the one at fault, where there is one."""

    def __init__(self, message: str, parameter: str | None = None) -> None:
        super().__init__(message)
        self.parameter = parameter


class InadmissibleTwist(ValueError):
    """A twist that the drive cannot do without slipping."""


@dataclass(frozen=True, slots=True)
class Holonomic:
    """Every twist is possible: plan in SE(2)."""


@dataclass(frozen=True, slots=True)
class Unicycle:
    """Drives along its heading and turns on the spot."""


@dataclass(frozen=True, slots=True)
class Car:
    """Drives along its heading on curves of at least `min_turning_radius` (m, > 0, at the body origin)."""

    min_turning_radius: float


Mobility = Holonomic | Unicycle | Car


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """What the actuators and the body may do. Arrays are per wheel, in the drive's order; absent is inf.

    wheel_speed rad/s (m,), wheel_acceleration rad/s² (m,), wheel_jerk rad/s³ (m,), steering_angle rad,
    steering_rate rad/s, linear_speed m/s, angular_speed rad/s, linear_acceleration m/s² (rate of change of
    the speed of the body origin), lateral_acceleration m/s² (|speed × turn rate of the direction of travel|).
    """

    wheel_speed: Array
    wheel_acceleration: Array
    wheel_jerk: Array
    steering_angle: float = np.inf
    steering_rate: float = np.inf
    linear_speed: float = np.inf
    angular_speed: float = np.inf
    linear_acceleration: float = np.inf
    lateral_acceleration: float = np.inf


@dataclass(frozen=True, slots=True, eq=False)
class BodyPath:
    """Samples of a path q(s) that is twice differentiable in s.

    s (n,) strictly increasing; heading (n,) rad, continuous; tangent (n, 3) = ξ(s), body frame, per unit of
    s; tangent_derivative (n, 3) = dξ/ds.
    """

    s: Array
    heading: Array
    tangent: Array
    tangent_derivative: Array


@dataclass(frozen=True, slots=True, eq=False)
class ActuatorPath:
    """What the actuators do along a BodyPath: wheel (n, m) = w(s), wheel_derivative (n, m) = dw/ds,
    steering (n, k) = δ(s) rad, continuous, steering_derivative (n, k) = dδ/ds."""

    wheel: Array
    wheel_derivative: Array
    steering: Array
    steering_derivative: Array


@dataclass(frozen=True, slots=True, eq=False)
class WheelState:
    """Answer of the instantaneous inverse: rates (m,) rad/s, steering (k,) rad, and steering_rates (k,)
    rad/s, which only a powered caster and a synchro drive need (zero elsewhere)."""

    rates: Array
    steering: Array
    steering_rates: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class Rolling:
    """How the wheels of a drive roll, in closed form, for those who optimize over its twists.

    Wheel i turns at rows[i]·ξ rad/s where steered[i] is false, else at ±|velocity of points[i]| /
    radius[i]. rows (m, 3); steered (m,); points (m, 2) m, body frame; radius (m,) m. heading_steers: the
    steering rate is the twist's omega (synchro); otherwise steered wheels turn as the direction of their
    own velocity does. trail m: by which the contacts of steered wheels trail their axes; such wheels roll so
    once they have swung round.
    """

    rows: Array
    steered: NDArray[np.bool_]
    points: Array
    radius: Array
    heading_steers: bool = False
    trail: float = 0.0


class Drive(ABC):
    """One robot base: a frozen dataclass whose fields are the contract's parameters (m, rad).

    Constructing one with degenerate parameters raises InvalidDrive.
    """

    kind: ClassVar[str]
    """The contract's name of the drive: "differential", "omni", …"""

    steers_at_rest: ClassVar[bool] = False
    """Whether steered wheels can be turned while the body stands still (tricycle, ackermann, swerve)."""

    @property
    def fixed_body_heading(self) -> float | None:
        """World heading (rad) of a footprint that does not turn with the pose (synchro), else None."""
        return None

    @property
    @abstractmethod
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the m wheels, in the contract's order."""

    @property
    def steered_names(self) -> tuple[str, ...]:
        """Names of the k steered wheels, in the contract's order."""
        return ()

    def steered_headings(self, steering: Array) -> Array | None:
        """The pose's headings (n, k) rad, modulo 2π, that steering angles (n, k) mean if theta is the heading
        of the steered wheels (synchro), else None."""
        return None

    @property
    def settled(self) -> Drive:
        """The drive that this one rolls like once trailing wheels have swung round."""
        return self

    @abstractmethod
    def mobility(self, limits: Limits) -> Mobility:
        """How the base may move, its steering limited to limits.steering_angle."""

    @abstractmethod
    def rolling_law(self) -> Rolling:
        """How the wheels roll, once trailing ones have swung round."""

    @abstractmethod
    def inverse(self, twist: Twist, steering: Array | None = None) -> WheelState:
        """Wheel rates and steering angles of a twist.

        steering (k,): the present angles. A powered caster needs them (default zero); swerve modules take the
        direction (of the two, π apart) nearest to them; others ignore them. Without them swerve angles lie in
        (-π, π] with rates >= 0, car-like angles in [-π/2, π/2].
        Raises InadmissibleTwist.
        """

    @abstractmethod
    def forward(self, rates: Array, steering: Array, steering_rates: Array) -> tuple[Array, Array]:
        """Least-squares twists (n, 3) of rates (n, m), steering (n, k), steering_rates (n, k), and slip (n,):
        the largest rolling or sliding equation left unmet, m/s."""

    @abstractmethod
    def actuators(
        self, path: BodyPath, steering: Array | None = None, steering_limit: float = np.inf
    ) -> ActuatorPath:
        """The actuator law of this drive along a path whose tangents it can do.

        steering (k,): where the steered wheels stand before the path begins. A swerve module takes the branch
        of its angle (mod π) nearest to it that keeps |δ| <= steering_limit all along; a powered caster and a
        synchro drive begin exactly there (default: caster 0, synchro heading - body_heading). Where a wheel's
        own velocity vanishes all along, its angle is held. Raises InadmissibleTwist where a tangent cannot be
        done, or no branch stays within the limit.
        """
