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
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PPoly
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from drives.drive import ActuatorPath, Drive, Limits
from drives.se2 import Array
from planner.errors import LimitsInfeasible
from planner.rows import limit_rows
from planner.schedule import sample_times
from planner.trajectory import Driven, Flowing, Phase, Phases, Profile, Steer, Warped
from planner.usage import rolled, slow_factors

__all__ = ["on_grid", "phase_on_grid"]

_TRIES = 16
"""How often a phase is slowed down at most."""
_EXACT, _SPARE = 2e-4, 1e-4
"""Share of a limit that may be exceeded, and by which a phase is slowed down more than it exceeds one."""
_LOCAL, _MUCH = 0.5, 0.001
"""If limits are exceeded by more than the second share at worst, and by less than the first share of that on
average, the motion is slowed down only there."""
_CORRECTIONS, _MISS = 5, 1e-8
"""How often the end is corrected, and the miss (m, rad) that needs no correction."""
_LAST_STEP = 0.05
"""Shortest last step in sample periods. Differences over a shorter one are rounding."""
_ROLLS, _CLOSE = 2, 5e-6
"""How often the end is aimed at anew by what rolling the samples misses, and the miss (m, rad) that is close
enough."""
_STRAY = 1e-4
"""Distance (m, rad) between the end of a path and the end of a motion along it at most."""
_LEAST_SPREAD = 1.02
"""By how much a motion is slowed down where wheels slip, at least."""
_AROUND = 2
"""Samples before and after those between which wheels slip, where the motion is slowed down, too."""
_TURN = 0.1
"""Angular speed (rad/s) for each m/s of speed that a correction may change at least."""


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


def phase_on_grid(phase: Phase, drive: Drive, limits: Limits, period: float, whole: bool) -> Phase:
    """The phase on the grid, from rest to rest within all limits.

    whole: it takes whole sample periods (s). Raises LimitsInfeasible.
    """
    if isinstance(phase, Steer):
        return _steered(phase, limits.steering_rate, period, whole)
    if isinstance(phase, Driven) and phase.law is not None and len(phase.grid) == 2:
        return _evenly_driven(phase, phase.law, limits, period, whole)
    given, jerk_limited = _given(phase), bool(np.isfinite(limits.wheel_jerk).any())
    least = 3 if jerk_limited or isinstance(given, Flowing) else 2
    pace = _Pace(np.array([0.0, phase.duration]), np.array([0.0, phase.duration]))
    goal = given.poses(given.time)[-1] if isinstance(given, Flowing) else np.zeros(3)
    aim = goal.copy()
    factor, rolls = math.inf, _ROLLS
    before: tuple[_Pace, float] | None = None
    locally = True
    for _ in range(_TRIES):
        time = _times(pace.duration, period, whole or jerk_limited, least)
        pace = pace.slowed(time[-1] / pace.duration)
        spread = _Spread(phase, time, pace, drive, jerk_limited, aim)
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
        elif (np.ptp(sampled.steering_angle, 0) == 0.0).all():
            return made
        else:
            slips, poses = rolled(sampled, drive)
            miss = goal - poses[-1] if isinstance(given, Flowing) else np.zeros(3)
            if isinstance(given, Driven):
                # It cannot be led back to its path, so it must not stray.
                slips *= max(1.0, float(np.abs(poses[-1] - sampled.pose[-1]).max()) / _STRAY)
            if slips.max() > 1.0:
                slower = np.maximum(np.cbrt(slips), _LEAST_SPREAD)
                pace, before, locally = pace.spread(time, np.where(slips > 1.0, slower, 1.0)), None, True
            elif np.abs(miss).max() < _CLOSE or rolls == 0:
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
    return replace(phase, profile=_profile(time, np.ones(len(inner)), quadratic=False))


@dataclass(frozen=True, slots=True, eq=False)
class _Pace:
    """When a motion is where: at times `when` (k,) where the given phase is at times `then` (k,), in
    proportion between them."""

    then: Array
    when: Array

    @property
    def duration(self) -> float:
        return float(self.when[-1])

    def __call__(self, time: Array) -> Array:
        """Times of the given phase (n,) for times of the motion."""
        times: Array = np.interp(time, self.when, self.then)
        return times

    def slowed(self, by: float) -> _Pace:
        """The same, slower throughout."""
        return _Pace(self.then, self.when * by)

    def spread(self, time: Array, by: Array) -> _Pace:
        """Slower over each interval (n,) between times (n + 1,), and a little around it."""
        wide = maximum_filter1d(by, 2 * _AROUND + 1, mode="nearest")
        smooth = uniform_filter1d(
            uniform_filter1d(wide, _AROUND + 1, mode="nearest"), _AROUND + 1, mode="nearest"
        )
        return _Pace(self(time), np.append(0.0, np.cumsum(np.diff(time) * smooth)))


def _evenly_driven(phase: Driven, law: ActuatorPath, limits: Limits, period: float, whole: bool) -> Driven:
    """A path along which every actuator turns in proportion to s: its limits do not depend on s."""
    push, _, x_max = limit_rows(phase.piece.body_path(phase.grid), law, limits)
    jerk = float((np.abs(law.wheel[0]) / limits.wheel_jerk).max())
    pace, duration = _Pace(np.array([0.0, phase.duration]), np.array([0.0, phase.duration])), phase.duration
    for _ in range(_TRIES):
        time = _times(duration, period, whole or jerk > 0.0, 3 if jerk > 0.0 else 1)
        profile = _followed(phase, time, pace.slowed(time[-1] / phase.duration), jerk > 0.0)
        step = np.diff(time)
        ends = np.abs([profile.acceleration, profile.acceleration + step * profile.jerk])
        middle = profile.velocity + step / 2 * (profile.acceleration + step / 4 * profile.jerk)
        factor = max(
            float(max(profile.velocity.max(), middle.max())) / math.sqrt(float(x_max.min())),
            math.sqrt(float(ends.max() * np.abs(push).max())),
            math.cbrt(float(np.abs(profile.jerk).max()) * jerk),
        )
        if factor <= 1 + _EXACT:
            return replace(phase, profile=profile)
        duration = float(time[-1]) * min(factor, 1.5) + _SPARE * phase.duration
    raise _too_coarse(phase, period, factor)


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


def _given(phase: Phase) -> Phase:
    while isinstance(phase, Warped):
        phase = phase.phase
    return phase


@dataclass(frozen=True, slots=True, eq=False)
class _Spread:
    """A phase, spread over the times (n + 1,) of samples at a pace. aim (3,): where a Flowing one ends."""

    phase: Phase
    time: Array
    pace: _Pace
    drive: Drive
    jerk_limited: bool
    aim: Array

    def over(self) -> Phase:
        """The phase whose velocities are splines."""
        match _given(self.phase):
            case Driven() as given:
                ends = given.piece.body_path(np.array([0.0, 1.0]))
                rolls = bool(self.drive.actuators(ends, given.steering).wheel.any())
                quadratic = self.jerk_limited and rolls
                return replace(given, profile=_followed(self.phase, self.time, self.pace, quadratic))
            case Flowing() as given:
                return self._flowing(given)
        raise TypeError(f"{type(self.phase).__name__} has no velocities to put on a grid")

    def _flowing(self, given: Flowing) -> Flowing:
        """A motion whose coordinates are splines on the grid."""
        kind, time = _Coordinates(given, self.drive, self.jerk_limited), self.time
        ends = _values(self.phase, np.array([0.0, self.phase.duration]), kind)
        ends[:, kind.velocity] = 0.0
        begin, end = _cells(time, kind.quadratic)
        first, last = self.pace(begin), self.pace(end)
        means = _means(self.phase, first, last, kind)
        means[:, kind.velocity] *= ((last - first) / (end - begin))[:, None]
        controls = list(np.concatenate([ends[:1], means, ends[1:]]).T)
        for left in reversed(range(_CORRECTIONS + 1)):
            made = _assembled(given, time, controls, kind)
            pose = made.poses(time)
            miss = self.aim - pose[-1]
            if left == 0 or np.abs(miss).max() < _MISS:
                break
            _correct(controls, made, pose, miss, kind)
        return made


# ---------------------------------------------------------------- splines


def _cells(time: Array, quadratic: bool) -> tuple[Array, Array]:
    """Begin and end (m,) of the cells whose means are control points, those at the ends left out: the
    intervals between samples, or as much around each sample as lies within the shorter of its intervals."""
    if quadratic:
        return time[:-1], time[1:]
    step = np.diff(time)
    half = np.minimum(step[:-1], step[1:]) / 2
    return time[1:-1] - half, time[1:-1] + half


def _polynomials(step: Array, controls: Array, quadratic: bool) -> Array:
    """Coefficients (n, 3) of the spline over intervals that last step (n,)."""
    if not quadratic:
        slope = np.diff(controls) / step
        return np.stack([controls[:-1], slope, np.zeros_like(slope)], 1)
    apart = np.concatenate([step[:1], step[:-1] + step[1:], step[-1:]]) / 2
    slope = np.diff(controls) / apart
    at = controls[:-1] + slope * np.append(0.0, step / 2)
    return np.stack([at[:-1], slope[:-1], np.diff(slope) / (2 * step)], 1)


def _profile(time: Array, means: Array, quadratic: bool) -> Profile:
    """s(t) from 0 to 1, at rest at both ends, its velocity a spline of such means."""
    if len(time) == 2:
        return Profile(time, np.zeros(1), np.zeros(1), 6 / time[1:] ** 2, -12 / time[1:] ** 3)
    controls = np.concatenate([[0.0], means, [0.0]])
    if quadratic:
        controls[1:-1] -= np.linspace(controls[1], controls[-2], len(means))
    step = np.diff(time)
    velocity, change, bow = _polynomials(step, controls, quadratic).T
    way = np.cumsum(np.append(0.0, step * (velocity + step * (change / 2 + step * bow / 3))))
    end = way[-1]
    return Profile(time, way[:-1] / end, velocity / end, change / end, 2 * bow / end)


def _followed(phase: Phase, time: Array, pace: _Pace, quadratic: bool) -> Profile:
    """The profile on the grid of a phase that has one, or of one that follows it at other times."""
    begin, end = _cells(time, quadratic)
    way = _position(phase, pace(end)) - _position(phase, pace(begin))
    return _profile(time, way / (end - begin), quadratic)


def _position(phase: Phase, time: Array) -> Array:
    """s at times (n,) of a phase that has a profile, or of one that follows it at other times."""
    if isinstance(phase, Warped):
        then, _, _ = phase.profile.at(time)
        return _position(phase.phase, np.clip(then, 0.0, phase.phase.duration))
    assert isinstance(phase, Driven)
    position, _, _ = phase.profile.at(time)
    return position


# ---------------------------------------------------------------- coordinates


class _Coordinates:
    """What the coordinates of a Flowing phase are.

    bent: whether column 1 is a curvature; its slope, a steering rate, is zero at both ends. velocity (c,):
    the other columns. quadratic: whether the splines have degree two: all of them, since limits couple their
    slopes. calm: whether accelerations are zero at both ends. straight: whether the direction of the velocity
    is constant over the first and the last interval, as wheels are steered to follow it.
    """

    def __init__(self, phase: Flowing, drive: Drive, jerk_limited: bool) -> None:
        law = drive.rolling_law()
        size = phase.coefficients.shape[2]
        steered = bool(law.steered.any()) and law.trail == 0.0
        self.bent = phase.curves
        bends = np.arange(size) == (1 if phase.curves else -1)
        self.quadratic = jerk_limited or phase.curves or steered
        self.calm = jerk_limited
        self.straight = steered and not phase.curves and not jerk_limited
        self.velocity = ~bends


def _values(phase: Phase, time: Array, kind: _Coordinates) -> Array:
    """Coordinates (n, c) at times of a Flowing phase, or of one that follows it at other times."""
    if isinstance(phase, Warped):
        then, rate, _ = phase.profile.at(time)
        inner = _values(phase.phase, np.clip(then, 0.0, phase.phase.duration), kind)
        return np.where(kind.velocity, inner * rate[:, None], inner)
    assert isinstance(phase, Flowing)
    values: Array = _piecewise(phase)(time)
    return values


def _piecewise(phase: Flowing) -> PPoly:
    return PPoly(phase.coefficients[:, ::-1].swapaxes(0, 1), phase.time)


def _means(phase: Phase, begin: Array, end: Array, kind: _Coordinates) -> Array:
    """Mean coordinates (m, c) between times (m,) of the phase."""
    if isinstance(phase, Flowing):
        whole = _piecewise(phase).antiderivative()
        means: Array = (whole(end) - whole(begin)) / (end - begin)[:, None]
        return means
    first, middle, last = (_values(phase, time, kind) for time in (begin, (begin + end) / 2, end))
    simpson: Array = (first + 4.0 * middle + last) / 6.0
    return simpson


def _assembled(given: Flowing, time: Array, controls: list[Array], kind: _Coordinates) -> Flowing:
    """The motion of splines with these control points, the ends brought to what they must be."""
    step = np.diff(time)
    for column, velocity in zip(controls, kind.velocity, strict=True):
        if not velocity:
            column[1], column[-1] = column[0], column[-2]
        elif kind.calm:
            column[1:-1] -= np.linspace(column[1], column[-2], len(column) - 2)
        elif kind.straight:
            column[1] = column[2] * (step[0] / (step[1] + 2 * step[0]))
            column[-2] = column[-3] * (step[-1] / (step[-2] + 2 * step[-1]))
    columns = [_polynomials(step, column, kind.quadratic) for column in controls]
    return replace(given, time=time, coefficients=np.stack(columns, 2), steering_limit=math.inf)


def _correct(controls: list[Array], motion: Flowing, pose: Array, miss: Array, kind: _Coordinates) -> None:
    """Change the control points by as little as moves the end by `miss` (3,).

    pose (n + 1, 3): at the samples. Changes are weighed with the square of the speed, so that a motion keeps
    its direction, and rests when it rested.
    """
    step, twist = np.diff(motion.time), motion.twists(motion.time)
    fastest = max(float(np.hypot(*twist[:, :2].T).max()), 1e-9)
    turning = max(float(np.abs(twist[:, 2]).max()), _TURN * fastest)
    ahead = (twist[:, 0] ** 2 + twist[:, 1] ** 2) / fastest**2
    pace = np.maximum(ahead, (twist[:, 2] / turning) ** 2)
    share = _shares(step, kind.quadratic)
    parts: list[tuple[Array, Array]] = []
    normal = np.zeros((3, 3))
    for j, effect_at_samples in enumerate(_effects(pose, twist, kind)):
        turns = j == len(controls) - 1
        weight = _at_controls(pace if turns else ahead, kind.quadratic)
        effect = _at_controls(effect_at_samples, kind.quadratic)
        if kind.velocity[j]:
            weight *= (turning if turns else fastest) ** 2
        else:
            most = max(float(np.abs(controls[j]).max()), 1e-3)
            weight *= most**2 - controls[j] ** 2
        weight[[0, -1]] = 0.0
        parts.append((weight, effect))
        normal += effect.T @ ((weight * share)[:, None] * effect)
    force = np.linalg.lstsq(normal, miss, rcond=1e-9)[0]
    for j, (weight, effect) in enumerate(parts):
        controls[j] += weight * (effect @ force)


def _at_controls(values: Array, quadratic: bool) -> Array:
    """Values (n + 1, …) at samples, at the control points of a spline."""
    if not quadratic:
        return values.copy()
    return np.concatenate([values[:1], (values[:-1] + values[1:]) / 2, values[-1:]])


def _shares(step: Array, quadratic: bool) -> Array:
    """How long (s) each control point counts."""
    if quadratic:
        return np.concatenate([[0.0], step, [0.0]])
    shares: Array = (np.append(step, 0.0) + np.append(0.0, step)) / 2
    return shares


def _effects(pose: Array, twist: Array, kind: _Coordinates) -> list[Array]:
    """By how much the end moves (n + 1, 3) for each unit of a coordinate that is held for a second, at
    samples whose poses and twists (n + 1, 3) are given."""
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    one, zero = np.ones_like(c), np.zeros_like(c)
    x, y = (pose[-1] - pose)[:, :2].T
    turn = np.stack([-y, x, one], 1)
    ahead, aside = np.stack([c, s, zero], 1), np.stack([-s, c, zero], 1)
    if kind.bent:
        v, omega = twist[:, 0], twist[:, 2]
        bend = np.divide(omega, v, out=np.zeros_like(c), where=np.abs(v) > 1e-9)
        return [ahead + bend[:, None] * turn, v[:, None] * turn]
    return [ahead, aside, turn] if len(kind.velocity) == 3 else [ahead, turn]
