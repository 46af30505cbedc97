"""Trajectory → WheelSchedule: what leaves the planner, on the client's time grid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from drives.se2 import Array

__all__ = ["Trajectory", "WheelSchedule", "sample_times", "schedule", "standstill"]


@dataclass(frozen=True, slots=True, eq=False)
class WheelSchedule:
    """A motion sampled at 0, period, 2 period, …, duration (the last step may be shorter).

    time (n,) s; wheel_angle, wheel_velocity (n, m) rad, rad/s; wheel_acceleration (n, m) rad/s², of the
    cubics through these where each interval begins, and where the last one ends; steering_angle,
    steering_rate (n, k) rad, rad/s; pose (n, 3) in the world frame, theta continuous; twist (n, 3) in the
    body frame. Columns are in the drive's order of wheels and of steered wheels. At rest at both ends.
    """

    time: Array
    wheel_angle: Array
    wheel_velocity: Array
    wheel_acceleration: Array
    steering_angle: Array
    steering_rate: Array
    pose: Array
    twist: Array


class Trajectory(Protocol):
    """A motion of body and actuators as a function of time, whoever made it."""

    @property
    def duration(self) -> float:
        """s."""

    def sample(self, time: Array) -> WheelSchedule:
        """The motion at times (n,), increasing within [0, duration]."""


def schedule(trajectory: Trajectory, period: float) -> WheelSchedule:
    """The trajectory at 0, period, 2 period, …, duration."""
    made = trajectory.sample(sample_times(trajectory.duration, period))
    return _frozen(replace(made, wheel_acceleration=_accelerations(made)))


def _accelerations(made: WheelSchedule) -> Array:
    """Of the cubics that a client draws through the samples (n, m): as the interval after each sample begins,
    and as the last one ends."""
    h, rate = np.diff(made.time)[:, None], made.wheel_velocity
    mean = np.diff(made.wheel_angle, axis=0) / h
    begin = (6 * mean - 4 * rate[:-1] - 2 * rate[1:]) / h
    end = (2 * rate[-2] + 4 * rate[-1] - 6 * mean[-1]) / h[-1]
    return np.concatenate([begin, end[None]])


def sample_times(duration: float, period: float) -> Array:
    """0, period, 2 period, …, duration."""
    steps = int(np.floor(duration / period * (1 + 1e-12)))
    time = np.arange(steps + 1, dtype=np.float64) * period
    # A last step so short that its differences are rounding is left out.
    if duration - time[-1] > 1e-6 * period or steps == 0:
        time = np.append(time, duration)
    else:
        time[-1] = duration
    return time


def standstill(pose: Array, wheels: int, steering: Array, duration: float = 0.0) -> WheelSchedule:
    """A robot that stands at pose (3,), its wheels steered by steering (k,), for a duration (s) of at most
    one period: two samples, or a single one if the duration is 0."""
    time = np.array([0.0, duration] if duration > 0 else [0.0])
    rest, still = np.zeros((len(time), wheels)), np.zeros((len(time), len(steering)))
    poses, angles = np.tile(pose, (len(time), 1)), np.tile(steering, (len(time), 1))
    return _frozen(WheelSchedule(time, rest, rest, rest, angles, still, poses, np.zeros((len(time), 3))))


def _frozen(out: WheelSchedule) -> WheelSchedule:
    for column in (
        out.time, out.wheel_angle, out.wheel_velocity, out.wheel_acceleration, out.steering_angle,
        out.steering_rate, out.pose, out.twist,
    ):  # fmt: skip
        column.flags.writeable = False
    return out
