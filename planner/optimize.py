"""A motion that stops here and there → the fastest motion near it that does not."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drives.drive import Car, Holonomic, InadmissibleTwist, Limits, Unicycle
from drives.se2 import Array, Pose
from planner.corridor import half_planes
from planner.environment import CollisionWorld
from planner.guess import Coordinates, Guess, flowing, flowing_time, sampled
from planner.optimal_control import Shape, solver
from planner.problem import Problem
from planner.retime import hastened
from planner.schedule import WheelSchedule
from planner.trajectory import Driven, Flowing, Phase, Phases, Steer

__all__ = ["Optimizer"]

_KNOTS = (16, 24, 32, 48, 64, 96)
_INTERVAL, _SPACING = 0.3, 0.35
"""Time (s), and among obstacles way (m), between knots to aim at."""
_TRIES = 3
_GAIN = 0.99
"""A round that leaves more than this share of the time was the last."""
_STEP = 0.01
"""Way (m) between poses that are checked, on average."""


@dataclass(frozen=True, eq=False)
class Optimizer:
    """Direct optimization of one problem's motions: pose, wheel rates and steering at once, obstacles kept
    clear of.

    is_over: whether to give up.
    """

    problem: Problem
    world: CollisionWorld
    is_over: Callable[[], bool]

    def faster(self, motion: Phases, rounds: int, alone: bool) -> Phases | None:
        """The fastest free motion found near a free one, within all limits; None where that is no faster.

        rounds: how often it may be improved among obstacles, as long as each is worth while. alone:
        whether to try first without them, which is quick, and where they are far that is enough.
        """
        if alone:
            knots = _knots(motion, self.problem.robot.limits, math.inf)
            found = self._solve(self._guess(motion, knots), np.zeros((knots + 1, 0, 5)))
            if found is not None and self._is_free(found):
                found = hastened(found, self.problem.robot.limits)
                return found if found.duration < motion.duration else None
        knots = _knots(motion, self.problem.robot.limits, _SPACING)
        best = motion
        for _ in range(rounds):
            found = self._in_corridor(best, knots)
            if found is None or found.duration >= best.duration:
                break
            done = found.duration > _GAIN * best.duration
            best = found
            if done or self.is_over():
                break
        return None if best is motion else best

    def _in_corridor(self, motion: Phases, knots: int) -> Phases | None:
        """The fastest free motion on the same side of all obstacles as a free one, or None."""
        guess = self._guess(motion, knots)
        planes = half_planes(self.world.kernel, guess.pose, True)
        near = planes
        for _ in range(_TRIES):
            found = self._solve(guess, near)
            if found is None:
                return None
            if self._is_free(found):
                return hastened(found, self.problem.robot.limits)
            if self.is_over():
                break
            # Beside the obstacles near the motion, those that the answer ran into.
            met = self._guess(found, knots).pose
            near = np.concatenate([planes, half_planes(self.world.kernel, met, False)], 1)
        return None

    def _is_free(self, motion: Phases) -> bool:
        # Chords between poses: an arc strays from them by less than the certificate's tolerance, which has
        # the last word.
        steps = math.ceil(_length(motion) / _STEP) + 100
        pose = motion.sample(np.linspace(0.0, motion.duration, steps)).pose
        return self.world.polyline_free(pose) < 0

    @cached_property
    def _coordinates(self) -> Coordinates:
        robot, options = self.problem.robot, self.problem.options
        match robot.drive.mobility(robot.limits):
            case Holonomic():
                return "twist"
            case Unicycle():
                return "car" if options.turning_radius > 0 else "unicycle"
            case Car():
                return "car"

    @cached_property
    def _turning_radius(self) -> float:
        """The smallest (m) that the drive and the request allow, 0: none."""
        mobility = self.problem.robot.drive.mobility(self.problem.robot.limits)
        least = mobility.min_turning_radius if isinstance(mobility, Car) else 0.0
        return max(least, self.problem.options.turning_radius)

    @cached_property
    def _bend(self) -> float | None:
        """The curvature (1/m) at which a car's steered wheels stand at the start, if that is given."""
        law, steering = self.problem.robot.drive.rolling_law(), self.problem.steering
        if steering is None or self._coordinates != "car" or not law.steered.any():
            return None
        x, y = law.points[law.steered].T
        # Each wheel's own centre on the rear axle's line: x / tan δ = 1/k - y.
        tangent = np.tan(np.clip(steering, -1.5, 1.5))
        most = 1 / self._turning_radius
        return float(np.clip(np.mean(tangent / (x + y * tangent)), -most, most))

    def _guess(self, motion: Phases, knots: int) -> Guess:
        if any(isinstance(phase, Driven) for phase in motion.phases):
            return flowing(motion, self.problem.robot.limits, self._coordinates, knots)
        return sampled(motion, self._coordinates, knots)

    def _solve(self, guess: Guess, planes: Array) -> Phases | None:
        """The fastest motion near a guess on the right side of planes (n + 1, p, 5), slowed to keep all
        limits."""
        drive, limits = self.problem.robot.drive, self.problem.robot.limits
        law = drive.rolling_law()
        # Of wheels that always turn alike, one will do.
        _, distinct = np.unique(np.column_stack([law.rows, limits.wheel_speed, limits.wheel_acceleration,
                                                 limits.wheel_jerk]), axis=0, return_index=True)  # fmt: skip
        fixed = np.intersect1d(np.flatnonzero(~law.steered), distinct)
        steered = np.flatnonzero(law.steered)
        order = np.concatenate([fixed, steered])
        n = len(guess.time) - 1
        shape = Shape(
            self._coordinates, len(fixed), len(steered), planes.shape[1], n,
            jerk=bool(np.isfinite(limits.wheel_jerk).any()), held=self._bend is not None,
            forward=not self.problem.options.reverse,
        )  # fmt: skip
        # Units: the extent of the motion and its present duration. The origin is the start.
        length = max(float(np.ptp(guess.pose[:, :2], axis=0).max()), 0.3)
        time = float(guess.time[-1])
        extent = np.array([length, length, 1.0])
        origin = np.array([guess.pose[0, 0], guess.pose[0, 1], 0.0])
        unit = {
            "twist": extent / time,
            "unicycle": extent[1:] / time,
            "car": np.array([length / time, 1 / length]),
        }[shape.coordinates]
        speed, most = (
            limits.wheel_speed[order],
            min(limits.angular_speed, limits.steering_rate if law.heading_steers else math.inf),
        )
        nearby = planes.copy()
        nearby[..., 4] -= planes[..., :2] @ origin[:2]
        nearby[..., 2:] /= length
        parameters = {
            "start": (guess.pose[0] - origin) / extent, "goal": (guess.pose[-1] - origin) / extent,
            "rate": law.rows[fixed] * extent / time / limits.wheel_speed[fixed, None],
            "x": law.points[steered, 0] / length, "y": law.points[steered, 1] / length,
            "speed": length / time / (law.radius[steered] * limits.wheel_speed[steered]),
            "acceleration": speed / limits.wheel_acceleration[order] / time,
            "jerk": speed / limits.wheel_jerk[order] / time**2, "steering": 1 / time / limits.steering_rate,
            "curvature": self._turning_radius / length,
            "body": [
                length / time / limits.linear_speed, 1 / time / most,
                length / time**2 / limits.linear_acceleration, length / time**2 / limits.lateral_acceleration,
            ],
            "bend": length * (self._bend or 0.0), "planes": nearby,
        }  # fmt: skip
        q = guess.coordinates / unit
        rates = np.gradient(q, 1 / n, axis=0)
        first = np.column_stack(
            [(guess.pose - origin) / extent, q, *([rates] if shape.jerk else []), np.ones(n + 1)]
        )
        answer = solver(shape).solve(parameters, first, np.diff(rates if shape.jerk else q, axis=0) * n)
        if answer is None:
            return None
        x, u = answer
        duration = float(x[-1, -1]) * time
        coordinates = x[:, 3 : 3 + shape.size] * unit
        change, bow = np.diff(coordinates, axis=0) * n / duration, np.zeros((n, shape.size))
        if shape.jerk:
            change, bow = x[:-1, 3 + shape.size : 3 + 2 * shape.size] * unit / time, u * unit / time**2 / 2
        return self._slowed(
            Pose(*guess.pose[0].tolist()), np.linspace(0.0, duration, n + 1),
            np.stack([coordinates[:-1], change, bow], 1),
        )  # fmt: skip

    def _slowed(self, start: Pose, time: Array, coefficients: Array) -> Phases | None:
        """The motion of Flowing, slowed down as a whole by as much as it exceeds any limit."""
        drive, limits, steering = self.problem.robot.drive, self.problem.robot.limits, self.problem.steering
        curves = self._coordinates == "car"

        def flow(slower: float) -> Flowing:
            scaled = coefficients / slower ** np.arange(3.0)[:, None]
            scaled[..., : 1 if curves else None] /= slower
            return Flowing(start, time * slower, scaled, curves, steering, limits.steering_angle)

        try:
            slower = _excess(Phases(drive, (flow(1.0),)), time, limits)
            if not slower < 1.5:
                return None
            motion = flow(slower)
            lead: list[Phase] = []
            if steering is not None and drive.steers_at_rest:
                needed = Phases(drive, (motion,)).sample(np.array([0.0, motion.duration])).steering_angle[0]
                change = float(np.abs(needed - steering).max())
                if change > 1e-12:
                    lead.append(Steer(start, steering, needed, change / limits.steering_rate))
        except InadmissibleTwist:
            return None
        return Phases(drive, (*lead, motion))


def _knots(motion: Phases, limits: Limits, spacing: float) -> int:
    stops = any(isinstance(phase, Driven) for phase in motion.phases)
    time = flowing_time(motion, limits) if stops else motion.duration
    wanted = max(time / _INTERVAL, _length(motion) / spacing)
    return next((n for n in _KNOTS if wanted <= n), _KNOTS[-1])


def _length(motion: Phases) -> float:
    """Way (m) of the body origin."""
    pose = motion.sample(np.linspace(0.0, motion.duration, 200)).pose
    return float(np.hypot(*np.diff(pose[:, :2], axis=0).T).sum())


def _excess(motion: Phases, knots: Array, limits: Limits) -> float:
    """By what factor a motion must be slowed to keep all limits; less than 1 where it may go faster."""
    h = np.diff(knots)[:, None]
    # Just after a knot, between, and just before the next.
    inside = (knots[:-1, None] + h * np.array([1e-6, 0.25, 0.5, 0.75, 1 - 1e-6])).ravel()
    sampled = motion.sample(np.concatenate([[0.0], inside, knots[-1:]]))
    speed = np.hypot(sampled.twist[:, 0], sampled.twist[:, 1])
    step = np.diff(sampled.time)
    within = step > 0.1 * h.min()

    def changes(values: Array) -> Array:
        slopes: Array = np.abs(np.diff(values, axis=0)[within].T / step[within])
        return slopes.T

    orders = (
        (1, np.abs(sampled.wheel_velocity) / limits.wheel_speed),
        (1, np.abs(sampled.steering_rate) / limits.steering_rate),
        (1, speed / limits.linear_speed),
        (1, np.abs(sampled.twist[:, 2]) / limits.angular_speed),
        (2, np.abs(sampled.wheel_acceleration[1:-1]) / limits.wheel_acceleration),
        (2, changes(speed) / limits.linear_acceleration),
        (2, _lateral(sampled) / limits.lateral_acceleration),
        (3, changes(sampled.wheel_acceleration) / limits.wheel_jerk),
    )
    return max(math.pow(np.max(over, initial=0.0), 1 / order) for order, over in orders)


def _lateral(sampled: WheelSchedule) -> Array:
    """Acceleration (n,) m/s² of the body origin across its direction of travel, of drives that go where
    they point."""
    across = np.abs(sampled.twist[:, 0] * sampled.twist[:, 2])
    return np.where(np.abs(sampled.twist[:, 1]) > 1e-9, 0.0, across)
