"""A car's motion, its steering rounded off as whoever interpolates a schedule's samples does it.

Between knots the curvature is linear in time. Where its rate jumps between two samples, the cubic through
them differs from it, and their integrals by up to Δrate·h²/12: corner by corner the car is turned a little.
Here the curvature is that cubic from the outset, so that the wheels do what the motion says; then it is
corrected by as little as brings the car back to where the motion ended.

The end pose changes with the curvature by δp = ∫ g δκ dt, where g = v (y - y_end, x_end - x, 1): what turns
the car at one time moves its end about the place where it is then. The smallest δκ for a δp is a combination
of the components of g.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline, PPoly

from drives.drive import Limits
from drives.se2 import Array
from planner.schedule import sample_times
from planner.trajectory import Flowing, Phase, Phases

__all__ = ["rounded", "rounded_phase"]

_ROUNDS, _EXACT = 5, 1e-7
"""How often the end is corrected, and the miss (m, rad) that needs no more of it."""
_TRIES, _FASTER = 3, 1e-4
"""How often it is slowed down, and the least share that is worth it."""
_APART = 1e-6
"""Share of the sample period that samples are apart at least."""
_SMALL = 1e-8
"""Share of the curvature's largest effect on the end below which it has none: along a straight way."""


def rounded(motion: Phases, limits: Limits, period: float) -> Phases:
    """A car's motion with its steering rounded off; slower, by next to nothing, where wheels would be too
    fast or too much accelerated. period s: of the samples."""
    for _ in range(_TRIES):
        samples, begin = sample_times(motion.duration, period), 0.0
        phases: list[Phase] = []
        for phase in motion.phases:
            end = begin + phase.duration
            if isinstance(phase, Flowing):
                inside = samples[(samples > begin + _APART * period) & (samples < end - _APART * period)]
                phase = rounded_phase(phase, np.concatenate([[0.0], inside - begin, [phase.duration]]))
            phases.append(phase)
            begin = end
        made = Phases(motion.drive, tuple(phases))
        sampled = made.sample(samples)
        # At the samples, and in the mean between them.
        step = np.maximum(np.diff(samples), 1e-3 * period)[:, None]
        rates = np.concatenate([sampled.wheel_velocity, np.diff(sampled.wheel_angle, axis=0) / step])
        pushes = np.concatenate([sampled.wheel_acceleration, np.diff(sampled.wheel_velocity, axis=0) / step])
        share = max(
            float((np.abs(rates) / limits.wheel_speed).max()),
            math.sqrt(float((np.abs(pushes) / limits.wheel_acceleration).max())),
        )
        if share <= 1 + _FASTER:
            break
        slower = (phase.slowed(share) if isinstance(phase, Flowing) else phase for phase in motion.phases)
        motion = Phases(motion.drive, tuple(slower))
    return made


def rounded_phase(motion: Flowing, samples: Array) -> Flowing:
    """The motion of a car, its curvature cubic between samples (n,) s, the ends of the motion among them.

    It ends where the motion did, to within 1e-7, or as near as changes of curvature take it.
    """
    given = PPoly(motion.coefficients[:, ::-1].swapaxes(0, 1), motion.time)
    speed, curvature = given(samples).T
    # Steering is reported to be at rest at the ends.
    rate = given(samples, 1)[:, 1]
    rate[[0, -1]] = 0.0
    # Where the wheels are steered as far as they go, they are to be left there.
    most = max(float(np.abs(given(motion.time)[:, 1]).max()), 1e-12)
    room = 1 - (curvature / most) ** 2
    goal = motion.poses(motion.time)[-1]
    knots = np.union1d(motion.time, samples)[:-1]
    way = np.stack([given(knots, k)[:, 0] / math.factorial(k) for k in range(4)], 1)
    step = np.diff(samples)
    share = (np.append(step, 0.0) + np.append(0.0, step)) / 2
    for left in reversed(range(_ROUNDS + 1)):
        bend = CubicHermiteSpline(samples, curvature, rate)
        turn = np.stack([bend(knots, k) / math.factorial(k) for k in range(4)], 1)
        made = replace(
            motion,
            time=np.append(knots, samples[-1]),
            coefficients=np.stack([way, turn], 2),
            steering_limit=math.inf,
        )
        pose = made.poses(samples)
        miss = goal - pose[-1]
        if left == 0 or np.abs(miss).max() < _EXACT:
            break
        x, y = (pose[-1] - pose)[:, :2].T
        gained = speed * np.stack([-y, x, np.ones_like(x)])
        spread = gained * room * share
        change = np.linalg.lstsq(spread @ gained.T, miss, rcond=_SMALL)[0] @ (gained * room)
        curvature = curvature + change
        rate[1:-1] += np.gradient(change, samples)[1:-1]
    return made
