"""A motion → the same motion on the client's grid, where accelerations change at samples only.

Clients interpolate samples with cubic Hermite polynomials. These equal the planned motion if that is smooth
between samples. So the velocities of every phase become splines in time whose knots are the samples: of
degree one, or of degree two where a steering angle follows them or jerk is limited. A control point is the
mean of the given velocity over the cell around it. Means keep every convex limit that the given motion keeps,
and the way driven does not drift (compare Schoenberg's approximation, de Boor, 1978, chapter XI).

What little the end is off is corrected by the smallest change of velocities; what little a limit is exceeded
by slows the phase down.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from drives.drive import ActuatorPath, Drive, Limits
from drives.se2 import Array
from planner.errors import LimitsInfeasible
from planner.grid_spline import Pace, Spread, followed, given_phase, profile_of
from planner.kernels import kernel
from planner.rows import limit_rows
from planner.schedule import sample_times
from planner.trajectory import Driven, Flowing, Phase, Phases, Steer
from planner.usage import rolled, slow_factors

__all__ = ["on_grid", "phase_on_grid"]

_TRIES = 16
"""How often a phase is slowed down at most."""
_SLOWEST, _SLOWEST_FLOWING = 100.0, 4.0
"""How many times as long a phase may take on the grid, and a Flowing one, in whose place another may do."""
_EXACT, _SPARE = 2e-4, 1e-4
"""Share of a limit that may be exceeded, and by which a phase is slowed down more than it exceeds one."""
_LOCAL, _MUCH = 0.5, 0.004
"""If limits are exceeded by more than the second share at worst, and by less than the first share of that on
average, the motion is slowed down only there."""
_LAST_STEP = 0.05
"""Shortest last step in sample periods. Differences over a shorter one are rounding."""
_ROLLS, _CLOSE = 2, 5e-6
"""How often the end is aimed at anew by what rolling the samples misses, and the miss (m, rad) that is close
enough."""
_STRAY = 1e-4
"""Distance (m, rad) between the end of a path and the end of a motion along it at most."""
_LEAST_SPREAD = 1.02
"""By how much a motion is slowed down where wheels slip, at least."""


def on_grid(motion: Phases, limits: Limits, period: float) -> Phases:
    """The motion, each phase but the last in whole sample periods (s). Raises LimitsInfeasible."""
    last = len(motion.phases) - 1
    return Phases(
        motion.drive,
        tuple(
            phase_on_grid(phase, motion.drive, limits, period, whole=i < last)
            for i, phase in enumerate(motion.phases)
        ),
    )


def phase_on_grid(
    phase: Phase, drive: Drive, limits: Limits, period: float, whole: bool, turning_radius: float = 0.0
) -> Phase:
    """The phase on the grid, from rest to rest within all limits.

    whole: it takes whole sample periods (s). turning_radius: the smallest (m) that is allowed between
    samples, 0: any. Raises LimitsInfeasible.
    """
    if isinstance(phase, Steer):
        return _steered(phase, limits.steering_rate, period, whole)
    if isinstance(phase, Driven) and phase.law is not None and len(phase.grid) == 2:
        return _evenly_driven(phase, phase.law, limits, period, whole)
    given, jerk_limited = given_phase(phase, drive), bool(np.isfinite(limits.wheel_jerk).any())
    least = 3 if jerk_limited or isinstance(given, Flowing) else 2
    pace = Pace(np.array([0.0, phase.duration]), np.array([0.0, phase.duration]))
    goal = given.poses(given.time)[-1] if isinstance(given, Flowing) else np.zeros(3)
    aim = goal.copy()
    factor, rolls = math.inf, _ROLLS
    before: tuple[Pace, float] | None = None
    locally = True
    slowest = _SLOWEST_FLOWING if isinstance(given, Flowing) else _SLOWEST
    longest = slowest * max(phase.duration, least * period)
    for _ in range(_TRIES):
        if pace.duration > longest:
            break
        time = _times(pace.duration, period, whole or jerk_limited, least)
        pace = pace.slowed(time[-1] / pace.duration)
        spread = Spread(phase, given, time, pace, drive, jerk_limited, aim)
        made = spread.over()
        sampled = Phases(drive, (made,)).sample(time)
        factors = slow_factors(sampled, drive, limits)
        factor = float(factors.max())
        if factor > 1 + _EXACT:
            excess = np.maximum(factors - 1, 0.0)
            if before is not None and factor >= before[1]:
                # Slower here and there, it is accelerated more in between.
                pace, before, locally = before[0].slowed(before[1] + _SPARE), None, False
            elif locally and excess.mean() < _LOCAL * (factor - 1) and factor > 1 + _MUCH:
                before = pace, min(factor, 1.5)
                pace = pace.spread(time, 1 + np.minimum(excess, 0.5) + _SPARE * (excess > 0))
            else:
                pace = pace.slowed(min(factor, 1.5) + _SPARE)
        elif turning_radius == 0.0 and (np.ptp(sampled.steering_angle, 0) == 0.0).all():
            return made
        else:
            slips, poses = rolled(sampled, drive, turning_radius)
            miss = goal - poses[-1] if isinstance(given, Flowing) else np.zeros(3)
            if isinstance(given, Driven):
                # It cannot be led back to its path, so it must not stray.
                slips *= max(1.0, float(np.abs(poses[-1] - sampled.pose[-1]).max()) / _STRAY)
            if slips.max() > 1.0:
                slower = np.maximum(np.cbrt(slips), _LEAST_SPREAD)
                pace, before, locally = pace.spread(time, np.where(slips > 1.0, slower, 1.0)), None, True
            elif np.abs(miss).max() < _CLOSE or rolls == 0:
                if np.abs(sampled.steering_angle).max(initial=0.0) > limits.steering_angle * (1 + _SPARE):
                    raise LimitsInfeasible("on the grid the steering exceeds its largest angle")
                return made
            else:
                aim, rolls = aim + miss, rolls - 1
    raise _too_coarse(phase, period, factor)


def _steered(phase: Steer, rate: float, period: float, whole: bool) -> Steer:
    """Steering at rest: one cubic, or a rate that is constant but for the first and the last step."""
    change = float(np.abs(phase.after - phase.before).max())
    cubic = 1.5 * change / rate  # its largest rate is 1.5 times the mean
    duration = max(cubic if cubic <= period else change / rate + period, phase.duration)
    time = _times(duration, period, whole, 1)
    inner = time[1:-1]
    return replace(phase, profile=profile_of(time, np.ones(len(inner)), quadratic=False))


def _evenly_driven(phase: Driven, law: ActuatorPath, limits: Limits, period: float, whole: bool) -> Driven:
    """A path along which every actuator turns in proportion to s: its limits do not depend on s."""
    push, _, x_max = limit_rows(phase.piece.body_path(phase.grid), law, limits)
    most, fastest = float(np.abs(push).max()), math.sqrt(float(x_max.min()))
    jerk = float((np.abs(law.wheel[0]) / limits.wheel_jerk).max())
    pace, duration = Pace(np.array([0.0, phase.duration]), np.array([0.0, phase.duration])), phase.duration
    for _ in range(_TRIES):
        time = _times(duration, period, whole or jerk > 0.0, 3 if jerk > 0.0 else 1)
        profile = followed(phase, time, pace.slowed(time[-1] / phase.duration), jerk > 0.0)
        speed, acceleration, rise = _peaks(time, profile.velocity, profile.acceleration, profile.jerk)
        factor = max(speed / fastest, math.sqrt(acceleration * most), math.cbrt(rise * jerk))
        if factor <= 1 + _EXACT:
            return replace(phase, profile=profile)
        duration = float(time[-1]) * min(factor, 1.5) + _SPARE * phase.duration
    raise _too_coarse(phase, period, factor)


@kernel
def _peaks(time: Array, velocity: Array, acceleration: Array, jerk: Array) -> tuple[float, float, float]:
    """The largest ṡ, |s̈| and |s⃛| of a profile."""
    fastest = hardest = sharpest = 0.0
    for i in range(len(velocity)):
        h = time[i + 1] - time[i]
        last = acceleration[i] + h * jerk[i]
        middle = velocity[i] + h / 2 * (acceleration[i] + h / 4 * jerk[i])
        fastest = max(fastest, velocity[i], middle)
        hardest, sharpest = max(hardest, abs(acceleration[i]), abs(last)), max(sharpest, abs(jerk[i]))
    return fastest, hardest, sharpest


def _too_coarse(phase: Phase, period: float, factor: float) -> LimitsInfeasible:
    return LimitsInfeasible(
        f"no motion along the way keeps the limits at a sample period of {period:g} s: a phase of "
        f"{phase.duration:.6g} s exceeds them {factor:.6g} times"
    )


def _times(duration: float, period: float, whole: bool, least: int) -> Array:
    """0, period, 2 period, …, and a duration not shorter than the given one, in so many steps at least."""
    count = max(duration / period, least - 1 + _LAST_STEP if least > 1 else 0.0)
    if whole or count - math.floor(count) < 1e-9:
        return np.arange(math.ceil(count - 1e-9) + 1.0) * period
    if count > 1 and count - math.floor(count) < _LAST_STEP:
        count = math.floor(count) + _LAST_STEP
    return sample_times(count * period, period)
