"""A motion that stops here and there → the fastest motion near it that does not."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TypeVar

import numpy as np

from drives.drive import Car, Holonomic, InadmissibleTwist, Unicycle
from drives.se2 import Array, Pose
from planner.client_grid import phase_on_grid
from planner.corridor import cover, half_planes, hull
from planner.environment import CollisionWorld
from planner.errors import LimitsInfeasible
from planner.guess import (
    KNOTS,
    Coordinates,
    Curves,
    Guess,
    driven,
    flowing,
    is_far,
    knot_count,
    ramp_time,
    sampled,
    swings,
    way_length,
)  # fmt: skip
from planner.horizon import WINDOW, State, receding
from planner.optimal_control import build_time, solver
from planner.problem import Problem
from planner.retime import hastened
from planner.shape import Shape
from planner.stopwatch import now
from planner.trajectory import Flowing, Phase, Phases, Steer
from planner.usage import slow_factor

__all__ = ["Optimizer"]

_SPARE = (0.005, 0.015, 0.025, 0.04)
"""Room (m) asked for at knots, which say nothing of the motion between them; more where it hit something."""
_GAIN = 0.99
"""A round that leaves more than this share of the time was the last."""
_ON_GRID = 1.05
"""By what factor a motion may become longer when it is put on the client's grid."""
_SLOWED = 1.05
"""A window that exceeds limits by more is not taken."""
_RETIMED = 4.0
"""A motion that takes this many times as long once it keeps the limits of jerk is given up."""
_TURNS = 4.0
"""Steering (rad) that is slow, if a motion has no time for more."""
_BUILDING = 1.3
"""Factor of the time that building a solver is expected to take, until which must be left."""
_STEP = 0.01
"""Way (m) between poses that are checked, on average."""
_INSIDE = np.linspace(0.1, 0.9, 9)
"""Shares of intervals between knots at which it is seen how near obstacles are."""
_HALVINGS = 6
"""How exactly it is found how far a pose must be moved."""


_Made = TypeVar("_Made")


@dataclass(frozen=True, eq=False)
class Optimizer:
    """Direct optimization of one problem's motions: pose, wheel rates and steering at once, obstacles kept
    clear of.

    is_over: whether to give up, as less time is left than given (s). iterations: at most so many a solve;
    hardly any that takes more than the default comes to an end.
    """

    problem: Problem
    world: CollisionWorld
    is_over: Callable[[float], bool]
    iterations: int = 60
    _took: list[float] = field(default_factory=list)

    @property
    def longest(self) -> float:
        """Time (s) that the longest solve took so far."""
        return max(self._took, default=0.0)

    def faster(self, motion: Phases | Curves, rounds: int) -> Phases | None:
        """The fastest free motion found near a free one, or a path, within all limits; None where that is
        no faster.

        rounds: how often it may be improved among obstacles, as long as each is worth while.
        """
        drive, limits = self.problem.robot.drive, self.problem.robot.limits
        most = _ON_GRID * _duration(motion)
        if is_far(driven(motion), self.problem.robot, self.world):
            guess = self._guess(motion, knot_count(motion, drive, limits, math.inf))
            n = len(guess.time) - 1
            found = self._solve(guess, self._begin(guess), np.zeros((2 * n, 0, 5)), np.full(n, 0.5))
            made = None if found is None else self._made(most, found)
            if made is not None:
                return made if made.duration < most else None
        knots = knot_count(motion, drive, limits)
        best = motion
        for _ in range(rounds):
            near = self._near(best, knots, most)
            if near is None or near.duration >= most:
                break
            done = near.duration > _GAIN * _duration(best)
            best, most = near, near.duration
            if done or self.is_over(self.longest):
                break
        return best if isinstance(best, Phases) and best is not motion else None

    def _near(self, motion: Phases | Curves, knots: int, most: float) -> Phases | None:
        """The fastest free motion on the same side of all obstacles as a free one, or None. One that takes
        longer than `most` (s) may be left out."""
        guess = self._guess(motion, knots)
        begin = self._begin(guess)
        made = self._in_corridor(guess, begin, partial(self._made, most)) if knots <= KNOTS[-1] else None
        if made is None and knots > WINDOW:
            runs = receding(guess, begin, self.problem.robot, self._window)
            made = None if runs is None else self._made(most, *runs)
        return made

    def _window(self, guess: Guess, begin: State) -> Flowing | None:
        if self.is_over(self.longest):
            return None
        return self._in_corridor(guess, begin, self._taken)

    def _taken(self, window: Flowing) -> Flowing | None:
        """A window, if it is free and hardly exceeds a limit, or is retimed later."""
        if not self._is_free(window):
            return None
        if self._is_jerk_limited:
            return window
        try:
            given = window if window.steering is not None else replace(window, steering=self.problem.steering)
            slower = slow_factor(
                Phases(self.problem.robot.drive, (given,)), window.time, self.problem.robot.limits
            )
        except InadmissibleTwist:
            return None
        return window if slower <= _SLOWED else None

    def _in_corridor(
        self, guess: Guess, begin: State, made_of: Callable[[Flowing], _Made | None]
    ) -> _Made | None:
        """What is made of the fastest motion on the same side of all obstacles as a guess, whose poses are
        free. made_of gives None for a motion that is not free."""
        shares = np.full(len(guess.time) - 1, 0.5)
        poses, relaxed = self._free(guess.pose, shares), True
        centres, radius = cover(self._corners)
        parts = [(centre[None], radius) for centre in centres]
        for spare in _SPARE:
            planes = np.concatenate([
                half_planes(self.world.kernel, corners, grown, poses[:-1], relaxed, spare)
                for corners, grown in parts
            ], 1)  # fmt: skip
            found = self._solve(guess, begin, planes, shares)
            made = None if found is None else made_of(found)
            if made is not None:
                return made
            if found is not None:
                # Now beside the obstacles that the answer ran into.
                shares = self._nearest(found)
                there = found.poses(_between(found.time, shares))
                poses, relaxed = self._backed(there, self._free(guess.pose, shares), spare), False
            elif radius == 0.0:
                break
            if self.is_over(self.longest):
                break
            # And with no more room than the footprint takes.
            parts, radius = [(self._corners, 0.0)], 0.0
        return None

    def _free(self, poses: Array, shares: Array) -> Array:
        """Free poses (n + 1, 3) and others between them: as the last, where a straight step is not free."""
        every = _between(poses, shares)
        between = every[1::2]
        hit = self.world.clearance(between) <= self.problem.options.min_clearance
        between[hit] = poses[:-1][hit]
        return every

    def _nearest(self, motion: Flowing) -> Array:
        """Shares (n,) of the intervals between knots, where a motion is nearest to obstacles."""
        step = np.diff(motion.time)[:, None]
        clearance = self.world.clearance(motion.poses((motion.time[:-1, None] + step * _INSIDE).ravel()))
        shares: Array = _INSIDE[np.argmin(clearance.reshape(len(step), -1), 1)]
        return shares

    def _backed(self, poses: Array, free: Array, spare: float) -> Array:
        """Poses (n, 3), moved towards free ones to where they are free, with what of the room to spare those
        have."""
        needed = self.problem.options.min_clearance + spare
        room = np.minimum(self.world.clearance(free), needed)
        low, high = np.zeros(len(poses)), np.ones(len(poses))
        share = high.copy()
        for _ in range(_HALVINGS):
            there = free + share[:, None] * (poses - free)
            clear = self.world.clearance(there) >= room
            low, high = np.where(clear, share, low), np.where(clear, high, share)
            share = np.where(low < 1.0, (low + high) / 2, 1.0)
        backed: Array = free + low[:, None] * (poses - free)
        return backed

    @cached_property
    def _corners(self) -> Array:
        return hull(self.problem.robot.footprint.vertices)

    def _is_free(self, motion: Flowing | Phases) -> bool:
        # Chords between poses: an arc strays from them by less than the certificate's tolerance, which has
        # the last word.
        if isinstance(motion, Flowing):
            steps = math.ceil(way_length(motion.poses(motion.time)) / _STEP) + 100
            return self.world.polyline_free(motion.poses(np.linspace(0.0, motion.duration, steps))) < 0
        return all(self._is_free(phase) for phase in motion.phases if isinstance(phase, Flowing))

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
    def _is_jerk_limited(self) -> bool:
        return bool(np.isfinite(self.problem.robot.limits.wheel_jerk).any())

    @cached_property
    def _turning_radius(self) -> float:
        """The smallest (m) that the drive and the request allow, 0: none."""
        mobility = self.problem.robot.drive.mobility(self.problem.robot.limits)
        least = mobility.min_turning_radius if isinstance(mobility, Car) else 0.0
        return max(least, self.problem.options.turning_radius)

    def _begin(self, guess: Guess) -> State:
        """At rest where a guess begins, wheels steered as the problem says, if it does."""
        still = np.zeros(guess.coordinates.shape[1])
        law, steering = self.problem.robot.drive.rolling_law(), self.problem.steering
        begin = State(Pose(*guess.pose[0].tolist()), still, still, "all")
        if law.trail > 0:
            return begin._replace(angles=np.zeros(len(law.rows)) if steering is None else steering)
        if self._coordinates != "car":
            return begin
        if steering is None or not law.steered.any():
            return begin._replace(given="rest")
        x, y = law.points[law.steered].T
        # Each wheel's own centre on the rear axle's line: x / tan δ = 1/k - y.
        tangent = np.tan(np.clip(steering, -1.5, 1.5))
        most = 1 / self._turning_radius
        bend = float(np.clip(np.mean(tangent / (x + y * tangent)), -most, most))
        return begin._replace(coordinates=np.array([0.0, bend]), given="curvature")

    def _guess(self, motion: Phases | Curves, knots: int) -> Guess:
        path, robot = driven(motion), self.problem.robot
        if path or not isinstance(motion, Phases):
            return flowing(path, robot.drive, robot.limits, self._coordinates, knots)
        return sampled(motion, robot.limits, self._coordinates, knots)

    def _solve(self, guess: Guess, begin: State, planes: Array, shares: Array) -> Flowing | None:
        """The fastest motion near a guess, from a state to rest where the guess ends, on the right side of
        planes (2n, p, 5), at knots and at shares (n,) of the time to the next. Between knots it may exceed
        limits a little."""
        drive, limits = self.problem.robot.drive, self.problem.robot.limits
        law = drive.rolling_law()
        if law.trail > 0:  # How casters swing at first is told by how the body moves at first.
            guess = guess.led(begin.coordinates, ramp_time(limits))
        # Of wheels that always turn alike, one will do.
        _, distinct = np.unique(np.column_stack([law.rows, limits.wheel_speed, limits.wheel_acceleration,
                                                 limits.wheel_jerk]), axis=0, return_index=True)  # fmt: skip
        fixed = np.intersect1d(np.flatnonzero(~law.steered), distinct)
        steered = np.flatnonzero(law.steered)
        order = np.concatenate([fixed, steered])
        n, pushes = len(guess.time) - 1, (limits.linear_acceleration, limits.lateral_acceleration)
        shape = Shape(
            self._coordinates, len(fixed), len(steered), planes.shape[1],
            jerk=self._is_jerk_limited, given=begin.given,
            forward=not self.problem.options.reverse, trail=law.trail > 0,
            pushes=self._coordinates == "twist" and min(pushes) < math.inf,
            slow=self._coordinates == "twist" and len(steered) > 0 and law.trail == 0.0
            and limits.steering_rate * float(guess.time[-1]) < _TURNS,
        )  # fmt: skip
        building = build_time(shape)
        if building > 0.0 and self.is_over(_BUILDING * building + self.longest):
            return None
        # Units: the extent of the motion and its present duration. The origin is where it begins.
        length = max(float(np.ptp(guess.pose[:, :2], axis=0).max()), 0.3)
        time = float(guess.time[-1])
        extent = np.array([length, length, 1.0])
        origin = np.array([begin.pose.x, begin.pose.y, 0.0])
        unit = {
            "twist": extent / time,
            "unicycle": extent[1:] / time,
            "car": np.array([length / time, 1 / length]),
        }[shape.coordinates]
        speed = limits.wheel_speed[order]
        most = min(limits.angular_speed, limits.steering_rate if law.heading_steers else math.inf)
        nearby = planes.copy()
        nearby[..., 4] -= planes[..., :2] @ origin[:2]
        nearby[..., 2:] /= length
        parameters = {
            "start": np.concatenate([
                (begin.pose - origin) / extent, begin.coordinates / unit,
                *([begin.rates / unit * time] if shape.jerk else []), begin.angles,
            ]),
            "goal": (guess.pose[-1] - origin) / extent,
            "rate": law.rows[fixed] * extent / time / limits.wheel_speed[fixed, None],
            "x": law.points[steered, 0] / length, "y": law.points[steered, 1] / length,
            "speed": length / time / (law.radius[steered] * limits.wheel_speed[steered]),
            "trail": law.trail / length,
            "acceleration": speed / limits.wheel_acceleration[order] / time,
            "jerk": speed / limits.wheel_jerk[order] / time**2, "steering": 1 / time / limits.steering_rate,
            "curvature": self._turning_radius / length,
            "body": [
                length / time / limits.linear_speed, 1 / time / most,
                length / time**2 / limits.linear_acceleration, length / time**2 / limits.lateral_acceleration,
            ],
            "planes": nearby, "shares": shares, "parts": np.diff(guess.time) / time,
        }  # fmt: skip
        q, at = guess.coordinates / unit, guess.time / time
        rates = np.gradient(q, at, axis=0)
        angles, swung = swings(guess, drive, begin.angles)
        first = np.column_stack([
            (guess.pose - origin) / extent, q, *([rates] if shape.jerk else []), angles, np.ones(n + 1),
        ])  # fmt: skip
        change = (np.diff(rates if shape.jerk else q, axis=0).T / np.diff(at)).T
        built = solver(shape)
        begin_of_solve = now()
        answer = built.solve(parameters, first, np.column_stack([change, swung]), self.iterations)
        self._took.append(now() - begin_of_solve)
        if answer is None:
            return None
        x, u = answer
        duration = float(x[-1, -1]) * time
        coordinates = x[:, 3 : 3 + shape.size] * unit
        exact = 1 if begin.given == "rest" else shape.size
        coordinates[0, :exact] = begin.coordinates[:exact]
        step, bow = duration * np.diff(at)[:, None], np.zeros((n, shape.size))
        change = np.diff(coordinates, axis=0) / step
        if shape.jerk:
            change, bow = (
                x[:-1, 3 + shape.size : 3 + 2 * shape.size] * unit / time,
                u[:, : shape.size] * unit / time**2 / 2,
            )
        return Flowing(
            begin.pose, duration * at, np.ascontiguousarray(np.stack([coordinates[:-1], change, bow], 1)),
            self._coordinates == "car", begin.angles if len(begin.angles) else None, limits.steering_angle,
        )  # fmt: skip

    def _made(self, most: float, *runs: Flowing) -> Phases | None:
        """Motions one after the other on the client's grid, within all limits, retimed if jerk is limited,
        and preceded by the steering at rest that each needs. None if that is not free, too slow, or takes
        longer than `most` (s) before."""
        drive, limits, steering = self.problem.robot.drive, self.problem.robot.limits, self.problem.steering
        most = min(most, self.problem.options.max_samples * self._period)
        if sum(run.duration for run in runs) > most or not all(self._is_free(run) for run in runs):
            return None
        phases: list[Phase] = []
        try:
            for i, run in enumerate(runs):
                steered = replace(run, steering=steering) if run.steering is None or i > 0 else run
                phase = self._on_grid(steered, whole=i + 1 < len(runs))
                ends = Phases(drive, (phase,)).sample(np.array([0.0, phase.duration])).steering_angle
                steer = None
                if steering is not None and drive.steers_at_rest:
                    steer = Steer.at_most(run.start, steering, ends[0], limits.steering_rate)
                if steer is not None:
                    phases.append(phase_on_grid(steer, drive, limits, self._period, whole=True))
                phases.append(phase)
                steering = ends[1]
        except (InadmissibleTwist, LimitsInfeasible):
            return None
        made = Phases(drive, tuple(phases))
        return made if self._is_free(made) else None

    def _on_grid(self, run: Flowing, whole: bool) -> Phase:
        """A run on the client's grid within all limits; if jerk is limited, retimed or slowed down, whichever
        takes less time there. Raises InadmissibleTwist, LimitsInfeasible."""
        drive, limits = self.problem.robot.drive, self.problem.robot.limits
        tried: list[Phase] = [run]
        if self._is_jerk_limited:
            slower = run.slowed(slow_factor(Phases(drive, (run,)), run.time, limits))
            retimed = hastened(Phases(drive, (slower,)), limits, partial(self.is_over, 0.0)).phases
            tried = [*retimed, *(slower for phase in retimed if phase is not slower)]
        radius = self.problem.options.turning_radius if self._coordinates == "car" else 0.0
        made: list[Phase] = []
        for phase in tried:
            if phase.duration < min([_RETIMED * run.duration, *(each.duration for each in made)]):
                with suppress(LimitsInfeasible):
                    made.append(phase_on_grid(phase, drive, limits, self._period, whole, radius))
        if not made:
            raise LimitsInfeasible(f"a motion of {run.duration:.6g} s exceeds the limits of jerk by far")
        return min(made, key=lambda each: each.duration)

    @cached_property
    def _period(self) -> float:
        return self.problem.options.sample_period


def _duration(motion: Phases | Curves) -> float:
    """s; of a path, that of the slowest motion along it."""
    return motion.duration if isinstance(motion, Phases) else math.inf


def _between(values: Array, shares: Array) -> Array:
    """Values (n + 1, …) with others between them, at shares (n,) of the steps from one to the next."""
    fine = np.empty((2 * len(values) - 1, *values.shape[1:]))
    fine[::2] = values
    fine[1::2] = values[:-1] + (shares * np.diff(values, axis=0).T).T
    return fine
