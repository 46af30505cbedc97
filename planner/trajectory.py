"""Motions of body and actuators as functions of time, made of phases that follow one another."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from drives.drive import ActuatorPath, BodyPath, Drive
from drives.se2 import Array, Pose
from planner import sampling
from planner.flow import headings, positions, values
from planner.path import Curve
from planner.schedule import WheelSchedule

__all__ = ["Driven", "Flowing", "Phase", "Phases", "Profile", "Steer", "Warped"]

_TURNED = 1e-12
"""Steering angles (rad) that differ by less are equal."""


class Phase(Protocol):
    """Part of a motion."""

    @property
    def duration(self) -> float:
        """s."""

    def fill(self, drive: Drive, time: Array, out: WheelSchedule, rows: slice, angle: Array) -> Array:
        """Write the motion at times (n,) since the phase began into rows of out, wheels starting at
        `angle` (m,).

        Returns the wheels' angles (m,) at the end of the phase.
        """


@dataclass(frozen=True, slots=True, eq=False)
class Phases:
    """A Trajectory of phases one after the other."""

    drive: Drive
    phases: tuple[Phase, ...]

    @property
    def duration(self) -> float:
        return math.fsum(phase.duration for phase in self.phases)

    @property
    def is_even(self) -> bool:
        """Whether all actuators turn in proportion in each phase."""
        return not any(
            isinstance(phase, Flowing | Warped) or (isinstance(phase, Driven) and len(phase.grid) > 2)
            for phase in self.phases
        )

    def sample(self, time: Array) -> WheelSchedule:
        """The motion at times (n,), which must increase within [0, duration]."""
        n, m, k = len(time), len(self.drive.wheel_names), len(self.drive.steered_names)
        out = WheelSchedule(
            time, *(np.zeros((n, m)) for _ in range(3)), *(np.zeros((n, k)) for _ in range(2)),
            *(np.zeros((n, 3)) for _ in range(2)),
        )  # fmt: skip
        begin, angle = 0.0, np.zeros(m)
        for phase in self.phases:
            first = int(np.searchsorted(time, begin, side="left"))
            end = (
                n
                if phase is self.phases[-1]
                else int(np.searchsorted(time, begin + phase.duration, side="left"))
            )
            local = np.clip(time[first:end] - begin, 0.0, phase.duration)
            angle = phase.fill(self.drive, local, out, slice(first, end), angle)
            begin += phase.duration
        return out


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """s(t) as polynomials: over segment i, from time[i] on, position[i], velocity[i], acceleration[i],
    jerk[i].

    time has one entry more than the others, its last is the duration.
    """

    time: Array
    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array

    @property
    def duration(self) -> float:
        return float(self.time[-1])

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """s, ṡ and s̈ at times t (n,)."""
        columns = (self.time, self.position, self.velocity, self.acceleration, self.jerk, t)
        found: tuple[Array, Array, Array] = sampling.polynomials(*map(np.ascontiguousarray, columns))
        return found

    def slowed(self, by: float) -> Profile:
        """The same way in `by` times the time."""
        return Profile(
            self.time * by, self.position, self.velocity / by, self.acceleration / by**2, self.jerk / by**3
        )


@dataclass(frozen=True, slots=True, eq=False)
class Steer:
    """The body at rest while steered wheels turn from `before` to `after` (k,) as a profile tells."""

    pose: Pose
    before: Array
    after: Array
    profile: Profile

    @classmethod
    def at_most(cls, pose: Pose, before: Array, after: Array, rate: float) -> Steer | None:
        """The steering at a rate (rad/s); None if nothing is to be turned."""
        change = float(np.max(np.abs(after - before), initial=0.0))
        if change <= _TURNED:
            return None
        speed, still = np.array([rate / change]), np.zeros(1)
        return cls(pose, before, after, Profile(np.array([0.0, change / rate]), still, speed, still, still))

    @property
    def duration(self) -> float:
        return self.profile.duration

    def fill(self, drive: Drive, time: Array, out: WheelSchedule, rows: slice, angle: Array) -> Array:
        share, rate, _ = self.profile.at(time)
        turn = self.after - self.before
        out.wheel_angle[rows] = angle
        out.steering_angle[rows] = self.before + np.multiply.outer(np.clip(share, 0.0, 1.0), turn)
        out.steering_rate[rows] = np.multiply.outer(rate, turn)
        out.pose[rows] = self.pose
        return angle


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """One piece of a path, driven by a profile from rest to rest. steering (k,): where the wheels stand as it
    begins; grid (n,): points of [0, 1] close enough together to resolve the actuators, its ends alone where
    w is constant and steering linear in s; fastest: whether no profile within the limits is known to be
    faster; law: the drive's at the grid, where it is known."""

    piece: Curve
    profile: Profile
    grid: Array
    steering: Array
    fastest: bool = False
    law: ActuatorPath | None = None

    @property
    def duration(self) -> float:
        return self.profile.duration

    def fill(self, drive: Drive, time: Array, out: WheelSchedule, rows: slice, angle: Array) -> Array:
        s, rate, acceleration = self.profile.at(time)
        s = np.clip(s, 0.0, 1.0)
        here = np.zeros(len(s), dtype=np.intp)
        share = s
        if len(self.grid) == 2:
            path = self.piece.body_path(self.grid)
            law = self.law or drive.actuators(path, self.steering)
            # One row for all: w is constant, steering linear in s.
            swing = np.diff(law.steering, axis=0)
        else:
            fine, here = sampling.union(self.grid, s)
            path = self.piece.body_path(fine)
            law = drive.actuators(path, self.steering)
            swing, share = law.steering_derivative, np.zeros_like(s)
        w, dw, steering, tangent = (
            np.array(each, order="C")  # copies, so that one kernel serves them all
            for each in (law.wheel, law.wheel_derivative, law.steering, path.tangent)
        )
        turned = sampling.integral(path.s, w, dw)
        sampling.fill(
            rows.start, here, share, rate, acceleration, w, dw, steering, swing, tangent, angle + turned,
            out.wheel_angle, out.wheel_velocity, out.wheel_acceleration, out.steering_angle,
            out.steering_rate, out.twist,
        )  # fmt: skip
        out.pose[rows] = self.piece.poses(s)
        end: Array = angle + turned[-1]
        return end


@dataclass(frozen=True, slots=True, eq=False)
class Warped:
    """Another phase along the same way at other times: what it does at profile(t) s, this does at t."""

    phase: Phase
    profile: Profile

    @property
    def duration(self) -> float:
        return self.profile.duration

    def fill(self, drive: Drive, time: Array, out: WheelSchedule, rows: slice, angle: Array) -> Array:
        then, rate, change = self.profile.at(time)
        end = self.phase.fill(drive, np.clip(then, 0.0, self.phase.duration), out, rows, angle)
        r, a = rate[:, None], change[:, None]
        out.wheel_acceleration[rows] = out.wheel_acceleration[rows] * r**2 + out.wheel_velocity[rows] * a
        for scaled in (out.wheel_velocity, out.steering_rate, out.twist):
            scaled[rows] *= r
        return end


@dataclass(frozen=True, slots=True, eq=False)
class Flowing:
    """A motion whose coordinates are polynomials in time between knots. A phase is one from rest to rest.

    time (n + 1,) s, from 0; coefficients (n, d, c): over interval i the coordinates are coefficients[i] ·
    (1, u, u², …), u = t - time[i]. Coordinates: (vx, vy, omega) the twist; (v, omega); or, where `curves`,
    (v, curvature 1/m), which leaves the steering of a car defined at rest. start: the pose it begins at;
    steering (k,): where steered wheels stand before, None: as the motion needs.
    """

    start: Pose
    time: Array
    coefficients: Array
    curves: bool
    steering: Array | None
    steering_limit: float = np.inf

    @property
    def duration(self) -> float:
        return float(self.time[-1])

    def fill(self, drive: Drive, time: Array, out: WheelSchedule, rows: slice, angle: Array) -> Array:
        knots, here = sampling.union(self.time, time)
        # Every interval is halved, for Simpson's rule: within it all rates are smooth.
        fine = np.empty(2 * len(knots) - 1)
        fine[::2], fine[1::2] = knots, (knots[:-1] + knots[1:]) / 2
        heading = self.start.theta + self._turned(fine)
        twist, change = self._twist(fine)
        v, dv = twist[:, :1], change[:, :1]
        if self.curves:
            tangent, derivative = self._direction(fine)
            law = drive.actuators(
                BodyPath(fine, heading, tangent, derivative), self.steering, self.steering_limit
            )
            rate, acceleration = law.wheel * v, law.wheel * dv + law.wheel_derivative * v
        else:
            law = drive.actuators(BodyPath(fine, heading, twist, change), self.steering, self.steering_limit)
            rate, acceleration = law.wheel, law.wheel_derivative
        h = np.diff(knots)[:, None]
        gained = h / 6 * (rate[:-2:2] + 4 * rate[1::2] + rate[2::2])
        turned = angle + np.concatenate([np.zeros((1, rate.shape[1])), np.cumsum(gained, 0)])
        out.wheel_angle[rows] = turned[here]
        out.wheel_velocity[rows] = rate[2 * here]
        out.wheel_acceleration[rows] = acceleration[2 * here]
        out.steering_angle[rows] = law.steering[2 * here]
        out.steering_rate[rows] = law.steering_derivative[2 * here]
        out.pose[rows] = self._poses(knots, heading[::2])[here]
        out.twist[rows] = twist[2 * here]
        end: Array = turned[-1]
        return end

    def slowed(self, by: float) -> Flowing:
        """The same way in `by` times the time."""
        scaled = self.coefficients / by ** np.arange(float(self.coefficients.shape[1]))[:, None]
        scaled[..., : 1 if self.curves else None] /= by
        return replace(self, time=self.time * by, coefficients=scaled)

    def poses(self, time: Array) -> Array:
        """Poses (n, 3) at increasing times (n,)."""
        knots, here = sampling.union(self.time, time)
        every: Array = self._poses(knots, self.start.theta + self._turned(knots))[here]
        return every

    def twists(self, time: Array) -> Array:
        """Twists (n, 3) at increasing times (n,)."""
        return self._twist(time)[0]

    def _twist(self, t: Array) -> tuple[Array, Array]:
        """Twists and their rates (n, 3)."""
        q, dq = values(self.time, self.coefficients, t)
        if q.shape[1] == 3:
            return q, dq
        zero = np.zeros(len(t))
        if not self.curves:
            return np.stack([q[:, 0], zero, q[:, 1]], -1), np.stack([dq[:, 0], zero, dq[:, 1]], -1)
        omega, change = q[:, 0] * q[:, 1], dq[:, 0] * q[:, 1] + q[:, 0] * dq[:, 1]
        return np.stack([q[:, 0], zero, omega], -1), np.stack([dq[:, 0], zero, change], -1)

    def _direction(self, t: Array) -> tuple[Array, Array]:
        """Tangents (1, 0, curvature) and their rates in time (n, 3)."""
        q, dq = values(self.time, self.coefficients, t)
        one, zero = np.ones(len(t)), np.zeros(len(t))
        return np.stack([one, zero, q[:, 1]], -1), np.stack([zero, zero, dq[:, 1]], -1)

    def _turned(self, t: Array) -> Array:
        """Change of heading (n,) since the start, exact: omega is a polynomial."""
        return headings(self.time, self.coefficients, self.curves, t)

    def _poses(self, t: Array, heading: Array) -> Array:
        """Poses (n, 3) at increasing times t from 0 that include the knots, by Gauss's rule between them."""
        place = positions(self.time, self.coefficients, self.curves, self.start.theta, t)
        return np.column_stack([place + self.start[:2], heading])
