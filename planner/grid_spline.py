"""Splines in time whose knots are a client's samples: of the way along a path, or of a motion's coordinates.

Control points are means of the given velocity over cells. See client_grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PPoly
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from drives.drive import Drive
from drives.se2 import Array
from planner.kernels import kernel
from planner.trajectory import Driven, Flowing, Phase, Phases, Profile, Warped

__all__ = ["Pace", "Spread", "followed", "given_phase", "profile_of"]

_CORRECTIONS, _MISS = 5, 1e-7
"""How often the end is corrected, and the miss (m, rad) that needs no correction."""
_AROUND = 2
"""Samples before and after those between which wheels slip, where the motion is slowed down, too."""
_BACKWARDS = 1e-6
"""Speed (m/s) backwards at a knot that is rounding."""
_TURN = 0.1
"""Angular speed (rad/s) for each m/s of speed that a correction may change at least."""


@dataclass(frozen=True, slots=True, eq=False)
class Pace:
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

    def slowed(self, by: float) -> Pace:
        """The same, slower throughout."""
        return Pace(self.then, self.when * by)

    def spread(self, time: Array, by: Array) -> Pace:
        """Slower over each interval (n,) between times (n + 1,), and a little around it."""
        wide = maximum_filter1d(by, 2 * _AROUND + 1, mode="nearest")
        smooth = uniform_filter1d(
            uniform_filter1d(wide, _AROUND + 1, mode="nearest"), _AROUND + 1, mode="nearest"
        )
        return Pace(self(time), np.append(0.0, np.cumsum(np.diff(time) * smooth)))


def given_phase(phase: Phase, drive: Drive) -> Phase:
    """The phase that is followed at other times, if one is. A Flowing one gets the steering that it begins
    with, so that the motion on the grid takes the same branch of every steering angle (see Drive.actuators).
    """
    while isinstance(phase, Warped):
        phase = phase.phase
    if isinstance(phase, Flowing) and drive.steers_at_rest:
        begin = Phases(drive, (phase,)).sample(np.zeros(1))
        return replace(phase, steering=begin.steering_angle[0], steering_limit=math.inf)
    return phase


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """A phase, spread over the times (n + 1,) of samples at a pace. given: its given_phase; aim (3,): where a
    Flowing one ends."""

    phase: Phase
    given: Phase
    time: Array
    pace: Pace
    drive: Drive
    jerk_limited: bool
    aim: Array

    def over(self) -> Phase:
        """The phase whose velocities are splines."""
        match self.given:
            case Driven() as given:
                quadratic = self.jerk_limited and self._rolls(given)
                return replace(given, profile=followed(self.phase, self.time, self.pace, quadratic))
            case Flowing() as given:
                return self._flowing(given)
        raise TypeError(f"{type(self.phase).__name__} has no velocities to put on a grid")

    def _rolls(self, given: Driven) -> bool:
        """Whether a wheel turns."""
        ends = given.piece.body_path(np.array([0.0, 1.0]))
        return bool(self.drive.actuators(ends, given.steering).wheel.any())

    def _flowing(self, given: Flowing) -> Flowing:
        """A motion whose coordinates are splines on the grid."""
        kind, time = _Coordinates(given, self.drive, self.jerk_limited), self.time
        ends = _values(self.phase, np.array([0.0, self.phase.duration]), kind)
        ends[:, kind.velocity] = 0.0
        begin, end = _cells(time, kind.quadratic)
        first, last = self.pace(begin), self.pace(end)
        means = _means(self.phase, first, last, kind)
        means[:, kind.velocity] *= ((last - first) / (end - begin))[:, None]
        controls = list(np.ascontiguousarray(np.concatenate([ends[:1], means, ends[1:]]).T))
        for left in reversed(range(_CORRECTIONS + 1)):
            made = _assembled(given, time, controls, kind)
            pose = made.poses(time)
            miss = self.aim - pose[-1]
            if left == 0 or np.abs(miss).max() < _MISS:
                break
            _correct(controls, made, pose, miss, kind)
        return made


# ---------------------------------------------------------------- splines


@kernel
def _cells(time: Array, quadratic: bool) -> tuple[Array, Array]:
    """Begin and end (m,) of the cells whose means are control points, those at the ends left out: the
    intervals between samples, or as much around each sample as lies within the shorter of its intervals."""
    if quadratic:
        return time[:-1].copy(), time[1:].copy()
    begin, end = np.empty(len(time) - 2), np.empty(len(time) - 2)
    for i in range(len(begin)):
        half = min(time[i + 1] - time[i], time[i + 2] - time[i + 1]) / 2
        begin[i], end[i] = time[i + 1] - half, time[i + 1] + half
    return begin, end


@kernel
def _polynomials(step: Array, controls: Array, quadratic: bool) -> Array:
    """Coefficients (n, 3) of the spline over intervals that last step (n,)."""
    n = len(step)
    found = np.zeros((n, 3))
    if not quadratic:
        for i in range(n):
            found[i, 0], found[i, 1] = controls[i], (controls[i + 1] - controls[i]) / step[i]
        return found
    slope = 2 * (controls[1] - controls[0]) / step[0]
    for i in range(n):
        apart = (step[i] + step[i + 1]) / 2 if i + 1 < n else step[i] / 2
        after = (controls[i + 2] - controls[i + 1]) / apart
        found[i, 0], found[i, 1] = controls[i + 1] - slope * step[i] / 2, slope
        found[i, 2] = (after - slope) / (2 * step[i])
        slope = after
    return found


def profile_of(time: Array, means: Array, quadratic: bool) -> Profile:
    """s(t) from 0 to 1, at rest at both ends, its velocity a spline of such means."""
    return Profile(time, *_profile(time, means, quadratic))


@kernel
def _profile(time: Array, means: Array, quadratic: bool) -> tuple[Array, Array, Array, Array]:
    """The columns (n,) of that profile."""
    n, m = len(time) - 1, len(means)
    way, velocity, change, jerk = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    if n == 1:
        way[0], velocity[0], change[0], jerk[0] = 0.0, 0.0, 6.0 / time[1] ** 2, -12.0 / time[1] ** 3
        return way, velocity, change, jerk
    controls = np.zeros(m + 2)
    for i in range(m):
        # Of degree two it begins and ends without acceleration.
        lift = means[0] + (means[m - 1] - means[0]) * i / max(m - 1, 1) if quadratic else 0.0
        controls[i + 1] = means[i] - lift
    step = time[1:] - time[:-1]
    parts, end = _polynomials(step, controls, quadratic), 0.0
    for i in range(n):
        way[i], h = end, step[i]
        end += h * (parts[i, 0] + h * (parts[i, 1] / 2 + h * parts[i, 2] / 3))
    for i in range(n):
        way[i], velocity[i], change[i] = way[i] / end, parts[i, 0] / end, parts[i, 1] / end
        jerk[i] = 2.0 * parts[i, 2] / end
    return way, velocity, change, jerk


def followed(phase: Phase, time: Array, pace: Pace, quadratic: bool) -> Profile:
    """The profile on the grid of a phase that has one, or of one that follows it at other times."""
    begin, end = _cells(time, quadratic)
    way = _position(phase, pace(end)) - _position(phase, pace(begin))
    return profile_of(time, way / (end - begin), quadratic)


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
        self.forward = bool((phase.coefficients[:, 0, 0] > -_BACKWARDS).all())


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
            _start_calmly(column)
            _start_calmly(column[::-1])
        elif kind.straight:
            column[1] = column[2] * (step[0] / (step[1] + 2 * step[0]))
            column[-2] = column[-3] * (step[-1] / (step[-2] + 2 * step[-1]))
    if kind.forward:
        # A spline lies between its control points.
        np.maximum(controls[0], 0.0, out=controls[0])
    columns = [_polynomials(step, column, kind.quadratic) for column in controls]
    return replace(given, time=time, coefficients=np.stack(columns, 2))


def _start_calmly(column: Array) -> None:
    """Make a column of control points (n,) begin with slope zero: subtract the first one after the start, and
    ever less of it from those that follow, until the column is as near to zero again."""
    first = float(column[1])
    back = np.flatnonzero(column[1:] * np.sign(first) < abs(first))
    size = int(back[0]) if len(back) else len(column) - 1
    column[1 : 1 + size] -= first * np.linspace(1.0, 0.0, max(size, 2))[:size]


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
