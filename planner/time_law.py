"""Path → Trajectory: when to be where, as fast as the wheels allow. The only file that imports toppra and
ruckig.

Everything happens in actuator space (see drives.drive). Along one piece, with w(s), w′(s) of every wheel
and δ′(s) of every steered one, the limits are linear in (s̈, ṡ²), which is what TOPPRA solves (Pham and
Pham, 2018). Where w is constant they do not depend on s at all, and Ruckig's state-to-state law is exact,
jerk included (Berscheid and Kröger, 2021). Where it is not and jerk is limited, TOPPRA's law is smoothed;
planner.retime finds a faster one. Between pieces the robot is at rest; there the steered wheels are turned
to where the next piece needs them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import ruckig
from toppra.constraint import DiscretizationType, LinearConstraint
from toppra.constraint.linear_constraint import canlinear_colloc_to_interpolate
from toppra.interpolator import AbstractGeometricPath
from toppra.solverwrapper.cy_seidel_solverwrapper import seidelWrapper

from drives.drive import ActuatorPath, BodyPath, Drive, InadmissibleTwist, Limits
from drives.se2 import Array
from planner import rows, sampling
from planner.errors import LimitsInfeasible
from planner.path import Curve
from planner.retime import excess
from planner.trajectory import Driven, Phase, Phases, Profile, Steer

__all__ = ["cruising_speed", "time_path"]

_GRID_SWINGING, _GRID_MAX = 96, 3000
"""Intervals to begin with where wheels trail; points at most."""
_GRID = (1 - np.cos(np.linspace(0.0, math.pi, 49))) / 2
"""Points to begin with: closer together towards the ends, where s gains little in much time."""
_TINY, _RELATIVE, _TRIES = 1e-8, 1e-4, 10
"""By how much ṡ² is kept below what TOPPRA finds controllable, the smaller of absolute and relative, and how
often it is lowered by ten times that where rounding has made a step infeasible."""
_SMOOTHING = (0.5, 0.7, 1.0, 1.5)
"""Tried in turn: how far apart the control points of a smoothed law are, in units of the time in which
acceleration builds up."""
_CONTROLS = 1000
"""How many of them there are at most."""


def time_path(path: Sequence[Curve], drive: Drive, limits: Limits, steering: Array | None = None) -> Phases:
    """The fastest motion along a path that stops between its pieces.

    steering (k,) rad: where the steered wheels stand at the start; None: as the first motion needs.
    Raises LimitsInfeasible.
    """
    phases: list[Phase] = []
    for piece in path:
        sampled, law = _grid(piece, drive, limits, steering)
        needed = law.steering[0]
        if steering is not None and drive.steers_at_rest:
            steer = Steer.at_most(piece.start, steering, needed, limits.steering_rate)
            phases += [] if steer is None else [steer]
        phases.append(_driven(piece, sampled, law, drive, limits))
        steering = law.steering[-1]
    return Phases(drive, tuple(phases))


def cruising_speed(drive: Drive, limits: Limits, path: BodyPath) -> Array:
    """The largest ṡ (n,) that limits of rates alone allow along a path. Trailing wheels are taken to
    have swung round."""
    _, _, x_max = rows.limit_rows(path, drive.settled.actuators(path), limits)
    speed: Array = np.sqrt(x_max)
    return speed


def _grid(
    piece: Curve, drive: Drive, limits: Limits, steering: Array | None
) -> tuple[BodyPath, ActuatorPath]:
    """The piece at points over [0, 1] close enough to resolve the actuators, and their law there: at its
    ends, where w is constant and steering linear in s."""
    path = piece.body_path(np.array([0.0, 1.0]))
    if drive.settled is not drive:  # Trailing wheels swing all along, whatever the tangent does.
        path = piece.body_path(np.linspace(0.0, 1.0, _GRID_SWINGING + 1))
    elif path.tangent_derivative.any():
        path = piece.body_path(_GRID)
    try:
        while True:
            law = drive.actuators(path, steering, limits.steering_angle)
            if len(path.s) == 2:
                return path, law
            grid = sampling.refined(path.s, law.steering, law.wheel)
            if len(grid) == len(path.s) or len(grid) > _GRID_MAX:
                return path, law
            path = piece.body_path(grid)
    except InadmissibleTwist as error:
        raise LimitsInfeasible(f"the steering limits do not allow the path: {error}") from error


def _driven(piece: Curve, path: BodyPath, law: ActuatorPath, drive: Drive, limits: Limits) -> Driven:
    """The piece from rest to rest: as fast as may be where jerk is unlimited or w is constant."""
    grid, needed = path.s, law.steering[0]
    a, b, x_max = rows.limit_rows(path, law, limits)
    constant = rows.is_constant(a, b)
    if constant:
        with np.errstate(divide="ignore"):
            jerk = float(np.min(limits.wheel_jerk / np.abs(law.wheel[0])))
        profile = _steady(float(np.abs(a).max()), float(x_max.min()), jerk)
    else:
        profile = _slowed(_sharp(grid, a, b, x_max), piece, drive, limits, needed)
    if constant or not np.isfinite(limits.wheel_jerk).any():
        return Driven(piece, profile, grid, needed, fastest=True, law=law)
    ramp = float((limits.wheel_acceleration / limits.wheel_jerk).max())
    tried = []
    for share in _SMOOTHING:
        smooth = _smoothed(profile, max(share * ramp, profile.duration / _CONTROLS))
        over = excess(Driven(piece, smooth, grid, needed), _halved(smooth.time), drive, limits)
        tried.append(smooth.slowed(over))
    return Driven(piece, min(tried, key=lambda smooth: smooth.duration), grid, needed)


def _sharp(grid: Array, a: Array, b: Array, x_max: Array) -> Profile:
    """The fastest s(t) from rest at 0 to rest at 1, but for jerk."""
    for scheme in (DiscretizationType.Interpolation, DiscretizationType.Collocation):
        found = _toppra(grid, a, b, x_max, scheme)
        if found is not None:
            return found
    # Where the law is too steep for TOPPRA's own tolerances.
    return _bounded(a, b, x_max)


def _halved(knots: Array) -> Array:
    return np.sort(np.concatenate([knots, (knots[:-1] + knots[1:]) / 2]))


def _slowed(profile: Profile, piece: Curve, drive: Drive, limits: Limits, steering: Array) -> Profile:
    """The profile, slowed as a whole by what it exceeds a limit between the points that it was made for."""
    s, x, acceleration = sampling.between(
        profile.time, profile.position, profile.velocity, profile.acceleration
    )
    path = piece.body_path(s)
    a, b, x_max = rows.limit_rows(path, drive.actuators(path, steering, limits.steering_angle), limits)
    return profile.slowed(math.sqrt(rows.most_used(a, b, x_max, x, acceleration)))


def _steady(a: float, x_max: float, jerk: float) -> Profile:
    """Ruckig's law under |a·s̈| <= 1 and ṡ² <= x_max, slowed as a whole by what rounding makes it exceed."""
    profile = _ruckig(math.sqrt(x_max), 1 / a if a > 0 else math.inf, jerk)
    x, acceleration = profile.velocity.max() ** 2, np.abs(profile.acceleration).max()
    return profile.slowed(math.sqrt(max(1.0, a * acceleration, x / x_max)))


def _ruckig(speed: float, acceleration: float, jerk: float) -> Profile:
    """Rest to rest over a unit of s under constant limits (any may be inf; speed or acceleration is
    finite)."""
    if not math.isfinite(acceleration):
        return Profile(np.array([0.0, 1 / speed]), *(np.array([x]) for x in (0.0, speed, 0.0, 0.0)))
    # In units of time in which acceleration is 1: Ruckig's tolerances are absolute.
    unit = 1 / math.sqrt(acceleration)
    given = ruckig.InputParameter(1)
    given.target_position = [1.0]
    given.max_velocity = [min(speed * unit, 1e6)]
    given.max_acceleration = [1.0]
    if math.isfinite(jerk):
        given.max_jerk = [jerk * unit**3]
    found = ruckig.Trajectory(1)
    try:
        result = ruckig.Ruckig(1).calculate(given, found)
    except ruckig.RuckigError:  # limits too far apart for its arithmetic
        result = ruckig.Result.Error
    if result != ruckig.Result.Working:
        raise LimitsInfeasible(f"no motion meets the limits: {result}")
    p = found.profiles[0][0]
    segments = [each for each in zip(p.t, p.p, p.v, p.a, p.j, strict=False) if each[0] > 0]
    duration, way, v, a, j = (np.array(column) for column in zip(*segments, strict=True))
    time = np.concatenate([[0.0], np.cumsum(duration)])
    return Profile(time * unit, way, v / unit, a / unit**2, j / unit**3)


class _Samples(AbstractGeometricPath):  # type: ignore[misc]
    """What TOPPRA wants to know of a path whose constraints are already sampled: its interval."""

    dof = 1
    path_interval = np.array([0.0, 1.0])

    def __call__(self, points: Array, order: int = 0) -> Array:
        return points if order == 0 else np.full_like(points, float(order == 1))


class _ActuatorConstraint(LinearConstraint):  # type: ignore[misc]
    """|a·u + b·x| <= 1 and 0 <= x <= x_max at the grid points, with u = s̈ and x = ṡ²."""

    def __init__(self, a: Array, b: Array, x_max: Array, scheme: DiscretizationType) -> None:
        super().__init__()
        self.a, self.b, self.x_max = a, b, x_max
        self.identical = True
        self.set_discretization_type(scheme)

    def compute_constraint_params(
        self, path: AbstractGeometricPath, gridpoints: Array, *_: object
    ) -> tuple[object, ...]:
        rows = self.a.shape[1]
        identity = np.eye(rows)
        x_bound = np.column_stack([np.zeros_like(self.x_max), self.x_max])
        a, b, c = self.a, self.b, np.zeros_like(self.a)
        f, g = np.vstack([identity, -identity]), np.ones(2 * rows)
        if self.get_discretization_type() == DiscretizationType.Interpolation:
            a, b, c, f, g, _, _ = canlinear_colloc_to_interpolate(
                a, b, c, f, g, None, None, gridpoints, identical=True
            )
        return a, b, c, f, g, None, x_bound


def _toppra(grid: Array, a: Array, b: Array, x_max: Array, scheme: DiscretizationType) -> Profile | None:
    # In a unit of time near the answer: TOPPRA's tolerances are absolute.
    used = np.abs(a).max(0) > 1e-9
    unit = 2 * math.sqrt(np.abs(a).max()) + float(np.trapezoid(1 / np.sqrt(x_max), grid))
    limited = _ActuatorConstraint(
        a[:, used] / unit**2, b[:, used] / unit**2, np.minimum(x_max * unit**2, 1e6), scheme
    )
    rate = np.sqrt(_controlled(limited, grid))
    if not np.isfinite(rate).all():
        return None
    rate /= unit
    mean = (rate[:-1] + rate[1:]) / 2
    if (mean <= 0).any():
        return None
    h = np.diff(grid)
    acceleration = (rate[1:] ** 2 - rate[:-1] ** 2) / (2 * h)
    time = np.concatenate([[0.0], np.cumsum(h / mean)])
    return Profile(time, grid[:-1], rate[:-1], acceleration, np.zeros_like(h))


def _controlled(limited: _ActuatorConstraint, grid: Array) -> Array:
    """The largest ṡ² (n,) from rest to rest, nan if there is none: TOPPRA's two passes (Pham and Pham, 2018,
    algorithm 1) over its solver. From rest, rest can be kept: no ṡ² is too low to be controllable.

    No program is solved whose answer is plain: where ṡ² can be at its own bound from one point to the next,
    or once it is as large as is controllable and can stay so."""
    solver = seidelWrapper([limited], _Samples(), grid)
    solver.setup_solver()
    solve, last = solver.solve_stagewise_optim, len(grid) - 1
    x = np.full(len(grid), np.nan)
    step = 2 * np.diff(grid)
    top, double = limited.x_max.tolist(), step.tolist()
    holding, holds = rows.holding(limited.a, limited.b, limited.x_max, step)
    change, free = holding.tolist(), holds.tolist()
    most = [*top[:-1], 0.0]
    upwards = np.array([1e-9, -1.0])
    for i in range(last - 1, -1, -1):
        if free[i] and most[i + 1] == top[i + 1]:
            continue
        u, found = solve(i, None, upwards, math.nan, math.nan, 0.0, most[i + 1])
        most[i] = max(float(found), 0.0)
        if math.isnan(found):
            return x
        change[i], free[i] = float(u), abs(found + double[i] * u - most[i + 1]) < 0.1 * _TINY
    ahead = np.column_stack([-step, np.full(last, -1.0)])
    x[0] = at = 0.0
    for i in range(last):
        if free[i] and most[i] - at <= 2 * _TINY:
            x[i + 1] = at = min(most[i + 1], max(0.0, at + double[i] * change[i]))
            continue
        for _ in range(_TRIES):
            u = float(solve(i, None, ahead[i], at, at, 0.0, most[i + 1])[0])
            if not math.isnan(u):
                break
            x[i] = at = max(at - _TINY, (1 - 10 * _RELATIVE) * at)
        at += double[i] * u
        x[i + 1] = at = min(most[i + 1], max(0.0, at - _TINY, (1 - _RELATIVE) * at))
    solver.close_solver()
    return x


def _smoothed(sharp: Profile, spacing: float) -> Profile:
    """A law without jumps of acceleration, near one with them: a cubic B-spline, its control points `spacing`
    s apart on the sharp one.

    It keeps to the values of the sharp law, begins and ends at rest without acceleration, and takes two
    intervals longer.
    """
    intervals = max(1, math.ceil(sharp.duration / spacing))
    h = sharp.duration / intervals
    s, _, _ = sharp.at(h * np.arange(intervals + 1.0))
    s = np.concatenate([np.zeros(3), np.clip(s[1:-1], 0.0, 1.0), np.ones(3)])
    one, two, three = (np.diff(s, order) for order in (1, 2, 3))
    return Profile(
        h * np.arange(len(three) + 1.0), (s[:-3] + 4 * s[1:-2] + s[2:-1]) / 6,
        (one[:-2] + one[1:-1]) / (2 * h), two[:-1] / h**2, three / h**3,
    )  # fmt: skip


def _bounded(a: Array, b: Array, x_max: Array) -> Profile:
    """Ruckig's law under bounds on ṡ and s̈ that hold for all s at once: valid, not fastest."""
    v = math.sqrt(x_max.min()) * np.geomspace(0.02, 1.0, 60)
    acceleration = (1 - np.abs(b).max() * v**2) / np.abs(a).max()
    v, acceleration = v[acceleration > 0], acceleration[acceleration > 0]
    if len(v) == 0:
        raise LimitsInfeasible("the acceleration limits do not allow the path")
    # Rest to rest over a unit of s: cruise and ramps, or what a short move needs.
    best = np.argmin(np.maximum(1 / v, np.sqrt(4 / acceleration)) + v / acceleration)
    return _ruckig(float(v[best]), float(acceleration[best]), math.inf)
