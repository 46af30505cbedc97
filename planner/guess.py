"""Where an optimization begins: poses and coordinates of a motion at equal steps of time.

A motion that stops between its pieces is no good one: half of its time goes by at stops, so half of the knots
would stand there. Here it flows: the twists of its pieces, each at cruising speed, follow one another and are
smoothed by a moving average over the time that it takes to get to speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from drives.drive import BodyPath, Drive, Limits
from drives.se2 import Array, Pose
from planner.environment import CollisionWorld
from planner.path import Curve
from planner.problem import Robot
from planner.time_law import cruising_speed
from planner.trajectory import Driven, Flowing, Phases

__all__ = [
    "KNOTS", "Coordinates", "Curves", "Guess", "cruising", "driven", "flowing", "flowing_time", "is_far",
    "knot_count", "ramp_time", "reversals", "sampled", "swings", "way_length",
]  # fmt: skip

Coordinates = Literal["twist", "unicycle", "car"]
"""(vx, vy, omega), (v, omega) or (v, curvature), see trajectory.Flowing."""

Curves = tuple[Curve, ...]

_SHARES = np.linspace(0.0, 1.0, 41)
KNOTS = (16, 24, 32, 48, 64, 96)
_INTERVAL, _SPACING = 0.3, 0.35
"""Time (s), and among obstacles way (m), between knots to aim at."""
_FAR = 0.5
"""Clearance (m) of a motion from which on it is optimized without obstacles."""
_FINE, _FINE_PER_KNOT = 2000, 20
"""Points at least that moving averages are taken over."""
_BEND_WINDOW = 2.0
"""Over how much more time than speeds a car's curvature is smoothed: wheels are slow to steer."""
_STILL = 1e-6
_EARLY, _LATE = np.append(0.0, np.cumsum(np.arange(3, 17))) / 133, np.linspace(1.0, 0.0, 4)
"""Knots from the start, as shares of the time in which casters swing round, and to the end, of that to full
speed."""
_SWING = 4.0
"""After how much way casters have swung round, in units of what they trail by."""


@dataclass(frozen=True, slots=True, eq=False)
class Guess:
    """A motion at n + 1 times: time (n + 1,), pose (n + 1, 3), coordinates (n + 1, c)."""

    time: Array
    pose: Array
    coordinates: Array

    def part(self, first: int, last: int, knots: int) -> Guess:
        """What lies between two knots, at another number of them."""
        index = np.linspace(first, last, knots + 1)
        time = np.interp(index, np.arange(len(self.time)), self.time)
        columns = np.column_stack([self.pose, self.coordinates])
        there = np.stack([np.interp(time, self.time, column) for column in columns.T], -1)
        return Guess(time - time[0], there[:, :3], there[:, 3:])

    def led(self, coordinates: Array, ramp: float) -> Guess:
        """The same poses, the coordinates led over from others within a time `ramp` (s)."""
        left = np.maximum(1 - self.time / ramp, 0.0)
        lead = np.multiply.outer(left, coordinates - self.coordinates[0])
        return replace(self, coordinates=self.coordinates + lead)


def driven(motion: Phases | Curves) -> Curves:
    """The pieces of a path, or of the one that a motion drives along."""
    if isinstance(motion, tuple):
        return motion
    return tuple(phase.piece for phase in motion.phases if isinstance(phase, Driven))


def flowing_time(path: Curves, drive: Drive, limits: Limits) -> float:
    """About how long (s) a motion along a path would take if it only stopped where it changes direction."""
    return float(cruising(path, drive, limits).time[-1]) + (1 + reversals(path)) * ramp_time(limits)


def reversals(path: Curves) -> int:
    """How often a motion along a path that drives where it heads turns back."""
    tangent = np.array([piece.body_path(np.array([0.5])).tangent[0] for piece in path])
    if tangent[:, 1].any():
        return 0
    forward = np.sign(tangent[np.abs(tangent[:, 0]) > _STILL, 0])
    return int(np.count_nonzero(np.diff(forward)))


def flowing(path: Curves, drive: Drive, limits: Limits, coordinates: Coordinates, knots: int) -> Guess:
    """A motion along a path as if it flowed. Its poses stay on the path, which is known to be free."""
    cruise, pose, twist = cruising(path, drive, limits)
    share, ramp = _ramp(float(cruise[-1]), reversals(path), limits)
    cruise, twist = cruise / share, twist * share
    time = _knots(cruise[-1] + ramp, drive, limits, knots)
    # Cruising lasts from ramp / 2 on; before and after it the robot rests.
    middle = time - ramp / 2
    within = np.clip(middle, 0.0, cruise[-1])
    if share < 1.0:
        within = (_passed(cruise[-1], middle + ramp / 2) - _passed(cruise[-1], middle - ramp / 2)) / ramp
    there = np.stack([np.interp(within, cruise, column) for column in pose.T], -1)
    rates = _smoothed(cruise, twist, middle, ramp, rest=True)
    match coordinates:
        case "twist":
            return Guess(time, there, rates)
        case "unicycle":
            return Guess(time, there, rates[:, [0, 2]])
        case "car":
            v, omega = twist[:, 0], twist[:, 2]
            bend = np.divide(omega, v, out=np.zeros_like(v), where=np.abs(v) > _STILL)
            bend = _smoothed(cruise, bend[:, None], middle, _BEND_WINDOW * ramp, rest=False)
            return Guess(time, there, np.column_stack([rates[:, 0], bend]))


def sampled(motion: Phases, limits: Limits, coordinates: Coordinates, knots: int) -> Guess:
    """A motion as it is."""
    time = _knots(motion.duration, motion.drive, limits, knots)
    rough = motion.sample(time)
    match coordinates:
        case "twist":
            return Guess(time, rough.pose, rough.twist)
        case "unicycle":
            return Guess(time, rough.pose, rough.twist[:, [0, 2]])
        case "car":
            fine = motion.sample(np.linspace(0.0, motion.duration, 20 * knots + 1))
            v, omega = fine.twist[:, 0], fine.twist[:, 2]
            moving = np.abs(v) > _STILL
            bend = np.interp(time, fine.time[moving], omega[moving] / v[moving])
            return Guess(time, rough.pose, np.column_stack([rough.twist[:, 0], bend]))


def swings(guess: Guess, drive: Drive, angles: Array) -> tuple[Array, Array]:
    """Where casters stand (n + 1, k) at the knots of a guess, given their angles (k,) at the first, and how
    far they swing (n, 2k) from each knot in a third of the interval, and until the next."""
    time, step = guess.time, np.diff(guess.time)
    if len(angles) == 0:
        return np.zeros((len(time), 0)), np.zeros((len(step), 0))
    change = (np.diff(guess.coordinates, axis=0).T / step).T
    coefficients = np.ascontiguousarray(np.stack([guess.coordinates[:-1], change], 1))
    motion = Flowing(Pose(*guess.pose[0].tolist()), time, coefficients, curves=False, steering=angles)
    times = np.append(np.stack([time[:-1], time[:-1] + step / 3], 1), time[-1])
    swung = Phases(drive, (motion,)).sample(times).steering_angle
    return swung[::2], np.column_stack([swung[1::2] - swung[:-1:2], np.diff(swung[::2], axis=0)])


def is_far(path: Curves, robot: Robot, world: CollisionWorld) -> bool:
    """Whether obstacles are so far from a path that a motion along it may be optimized without them."""
    return bool(path) and float(world.clearance(cruising(path, robot.drive, robot.limits).pose).min()) > _FAR


def knot_count(motion: Phases | Curves, drive: Drive, limits: Limits, spacing: float = _SPACING) -> int:
    """How many intervals to optimize a motion over, at most `spacing` m apart."""
    path = driven(motion)
    if path or not isinstance(motion, Phases):
        time, poses = flowing_time(path, drive, limits), cruising(path, drive, limits).pose
    else:
        time = motion.duration
        poses = motion.sample(np.linspace(0.0, time, max(200, math.ceil(time / 0.1)))).pose
    wanted = max(time / _INTERVAL, way_length(poses) / spacing)
    most = math.ceil(wanted) if math.isfinite(spacing) else KNOTS[-1]
    return next((n for n in KNOTS if wanted <= n), most)


def way_length(pose: Array) -> float:
    """Length (m) of the body origin along poses (n, 3)."""
    return float(np.hypot(*np.diff(pose[:, :2], axis=0).T).sum())


def _ramp(cruise: float, reversals: int, limits: Limits) -> tuple[float, float]:
    """The share of full speed to cruise at, and the time (s) that it takes to get there.

    On a short way the robot brakes before it is at full speed. cruise s: at full speed.
    """
    ramp = ramp_time(limits)
    share = min(1.0, math.sqrt(cruise / (1 + reversals) / ramp))
    return share, share * ramp


def _passed(cruise: float, time: Array) -> Array:
    """Integral of the time that has passed since cruising began, at most all of it, up to `time`."""
    within = np.clip(time, 0.0, cruise)
    passed: Array = within**2 / 2 + cruise * np.maximum(time - cruise, 0.0)
    return passed


def ramp_time(limits: Limits) -> float:
    """Time (s) from rest to full speed."""
    ramps = limits.wheel_speed / limits.wheel_acceleration + limits.wheel_acceleration / limits.wheel_jerk
    return float(ramps.max())


class Cruise(NamedTuple):
    """Time (n,), poses and twists (n, 3)."""

    time: Array
    pose: Array
    twist: Array


@lru_cache(maxsize=16)
def cruising(path: Curves, drive: Drive, limits: Limits) -> Cruise:
    """Along the pieces of a path, always as fast as rates allow."""
    along = [piece.body_path(_SHARES) for piece in path]
    poses = np.concatenate([piece.poses(_SHARES) for piece in path])
    heading, tangent, change = (
        np.concatenate([getattr(each, name) for each in along])
        for name in ("heading", "tangent", "tangent_derivative")
    )
    # One path, as only rates count; from one piece to the next is some way, too.
    s = (2 * np.arange(len(path))[:, None] + _SHARES).ravel()
    speed = cruising_speed(drive, limits, BodyPath(s, heading, tangent, change))
    slowness = (1 / speed).reshape(len(path), -1)
    lasting = np.diff(_SHARES) * (slowness[:, 1:] + slowness[:, :-1]) / 2
    time = np.cumsum(np.append(np.zeros((len(path), 1)), lasting, 1))
    return Cruise(time, poses, tangent * speed[:, None])


def _knots(duration: float, drive: Drive, limits: Limits, count: int) -> Array:
    """Times (n + 1,) of knots: of `count` intervals that last equally long; where there are casters, of some
    shorter ones before and after them."""
    law, ramp = drive.rolling_law(), ramp_time(limits)
    if law.trail == 0.0:
        return np.linspace(0.0, duration, count + 1)
    swing = ramp + _SWING * law.trail / float((law.radius * limits.wheel_speed).min())
    early = min(swing, duration / 3) * _EARLY
    late = duration - min(ramp, duration / 3) * _LATE
    return np.concatenate([early[:-1], np.linspace(early[-1], late[0], count + 1), late[1:]])


def _smoothed(cruise: Array, columns: Array, at: Array, width: float, rest: bool) -> Array:
    """Means (n, c) over windows of time around `at`. rest: beyond the ends, columns are 0, else as at the
    ends."""
    fine = np.linspace(at[0] - width / 2, at[-1] + width / 2, max(_FINE, _FINE_PER_KNOT * len(at)) + 1)
    # Where one piece ends, the next counts.
    i = np.clip(np.searchsorted(cruise, fine, side="right") - 1, 0, len(cruise) - 1)
    values = columns[i] * ((fine >= 0) & (fine <= cruise[-1]))[:, None] if rest else columns[i]
    steps = (values[1:] + values[:-1]) / 2 * (fine[1] - fine[0])
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, 0)])
    means = [
        (np.interp(at + width / 2, fine, c) - np.interp(at - width / 2, fine, c)) / width for c in total.T
    ]
    return np.stack(means, -1)
