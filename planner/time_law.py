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
from numpy.typing import NDArray
from toppra.constraint import DiscretizationType, LinearConstraint
from toppra.constraint.linear_constraint import canlinear_colloc_to_interpolate
from toppra.interpolator import AbstractGeometricPath
from toppra.solverwrapper.cy_seidel_solverwrapper import seidelWrapper

from drives.drive import ActuatorPath, BodyPath, Drive, InadmissibleTwist, Limits
from drives.se2 import Array, Pose
from planner.errors import LimitsInfeasible
from planner.path import Curve
from planner.retime import excess
from planner.trajectory import Driven, Phase, Phases, Profile, Steer
from planner.tree import kernel

__all__ = ["cruising_speed", "time_path"]

_GRID_SWINGING, _GRID_MAX, _PARTS = 96, 3000, 8
"""Intervals to begin with where wheels trail; points, and parts that an interval is cut into at once, at
most."""
_GRID = (1 - np.cos(np.linspace(0.0, math.pi, 49))) / 2
"""Points to begin with: closer together towards the ends, where s gains little in much time."""
_TINY, _RELATIVE, _TRIES = 1e-8, 1e-4, 10
"""By how much ṡ² is kept below what TOPPRA finds controllable, the smaller of absolute and relative, and how
often it is lowered by ten times that where rounding has made a step infeasible."""
_BETWEEN = np.array([0.0, 0.25, 0.5, 0.75, 1 - 1e-6])
_STEERING_STEP, _WHEEL_STEP = 0.04, 0.03
"""Largest change of a steering angle (rad), and of a wheel's w relative to the largest w, over one grid
interval."""
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
            _steer(phases, piece.start, steering, needed, limits)
        phases.append(_driven(piece, sampled, law, drive, limits))
        steering = law.steering[-1]
    return Phases(drive, tuple(phases))


def cruising_speed(drive: Drive, limits: Limits, path: BodyPath) -> Array:
    """The largest ṡ (n,) that limits of rates alone allow along a path. Trailing wheels are taken to
    have swung round."""
    _, _, x_max = _rows(path, drive.settled.actuators(path), limits)
    speed: Array = np.sqrt(x_max)
    return speed


def _steer(phases: list[Phase], pose: Pose, before: Array, after: Array, limits: Limits) -> None:
    change = float(np.max(np.abs(after - before), initial=0.0))
    if change > 1e-12:
        phases.append(Steer(pose, before, after, change / limits.steering_rate))


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
            grid = _refined(path.s, law.steering, law.wheel)
            if len(grid) == len(path.s) or len(grid) > _GRID_MAX:
                return path, law
            path = piece.body_path(grid)
    except InadmissibleTwist as error:
        raise LimitsInfeasible(f"the steering limits do not allow the path: {error}") from error


@kernel
def _refined(grid: Array, steering: Array, wheel: Array) -> Array:
    """The grid (n,), its coarse intervals cut into as many parts as their changes of steering angles and w
    call for, a few at most."""
    scale, size = 1e-300, 1
    for w in wheel.flat:
        scale = max(scale, abs(w))
    parts = np.ones(len(grid) - 1, np.int64)
    for i in range(len(parts)):
        most = 1.0
        for j in range(steering.shape[1]):
            most = max(most, abs(steering[i + 1, j] - steering[i, j]) / _STEERING_STEP)
        for j in range(wheel.shape[1]):
            most = max(most, abs(wheel[i + 1, j] - wheel[i, j]) / (_WHEEL_STEP * scale))
        parts[i] = math.ceil(min(most, _PARTS))
        size += parts[i]
    fine, k = np.empty(size), 0
    for i in range(len(parts)):
        for part in range(parts[i]):
            fine[k] = grid[i] + (grid[i + 1] - grid[i]) * part / parts[i]
            k += 1
    fine[k] = grid[-1]
    return fine


def _driven(piece: Curve, path: BodyPath, law: ActuatorPath, drive: Drive, limits: Limits) -> Driven:
    """The piece from rest to rest: as fast as may be where jerk is unlimited or w is constant."""
    grid, needed = path.s, law.steering[0]
    a, b, x_max = _rows(path, law, limits)
    constant = _constant(a, b)
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


@kernel
def _constant(a: Array, b: Array) -> bool:
    """Whether the rows a, b (n, r) of limits are the same all along."""
    most = spread = 0.0
    for j in range(a.shape[1]):
        low = high = a[0, j]
        for i in range(len(a)):
            low, high = min(low, a[i, j]), max(high, a[i, j])
            if abs(b[i, j]) > 1e-9:
                return False
        most, spread = max(most, abs(low), abs(high)), max(spread, high - low)
    return bool(spread <= 1e-9 * most)


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
    s, x, acceleration = _between(profile.time, profile.position, profile.velocity, profile.acceleration)
    path = piece.body_path(s)
    a, b, x_max = _rows(path, drive.actuators(path, steering, limits.steering_angle), limits)
    return profile.slowed(math.sqrt(_used(a, b, x_max, x, acceleration)))


@kernel
def _between(
    time: Array, position: Array, velocity: Array, acceleration: Array
) -> tuple[Array, Array, Array]:
    """s, ṡ² and s̈ at points of every segment of a profile without jerk, where s gains."""
    most = len(_BETWEEN) * len(position)
    s, x, change = np.empty(most), np.empty(most), np.empty(most)
    n, last = 0, -1.0
    for i in range(len(position)):
        for share in _BETWEEN:
            u = share * (time[i + 1] - time[i])
            at = min(1.0, max(0.0, position[i] + u * (velocity[i] + u * acceleration[i] / 2)))
            if at > last:
                s[n], x[n], change[n] = at, (velocity[i] + u * acceleration[i]) ** 2, acceleration[i]
                n, last = n + 1, at
    return s[:n].copy(), x[:n].copy(), change[:n].copy()


@kernel
def _used(a: Array, b: Array, x_max: Array, x: Array, acceleration: Array) -> float:
    """The largest share of a limit that ṡ² and s̈ (n,) use, at least 1."""
    most = 1.0
    for i in range(len(a)):
        most = max(most, x[i] / x_max[i])
        for j in range(a.shape[1]):
            most = max(most, abs(a[i, j] * acceleration[i] + b[i, j] * x[i]))
    return most


def _rows(path: BodyPath, law: ActuatorPath, limits: Limits) -> tuple[Array, Array, Array]:
    """a, b (n, r) and x_max (n,): |a·s̈ + b·ṡ²| <= 1 and ṡ² <= x_max say all the limits but jerk."""
    body = (
        limits.linear_speed, limits.angular_speed, limits.linear_acceleration, limits.lateral_acceleration,
        limits.steering_rate,
    )  # fmt: skip
    # Copies, so that one kernel serves them all.
    a, b, x_max = _all_rows(*(np.array(each, dtype=np.float64, order="C") for each in (
        path.tangent, path.tangent_derivative, law.wheel, law.wheel_derivative, law.steering_derivative,
        limits.wheel_speed, limits.wheel_acceleration, body,
    )))  # fmt: skip
    return a, b, x_max


@kernel
def _all_rows(
    along: Array,
    change: Array,
    wheel: Array,
    wheel_change: Array,
    steering_change: Array,
    wheel_speed: Array,
    wheel_acceleration: Array,
    body: Array,
) -> tuple[Array, Array, Array]:
    speed, turn, acceleration, side, steering_rate = body
    n, m = wheel.shape
    a, b, x_max = np.empty((n, m + 1)), np.empty((n, m + 1)), np.empty(n)
    for i in range(n):
        vx, vy, omega = along[i, 0], along[i, 1], along[i, 2]
        v = math.sqrt(vx * vx + vy * vy)
        tangential = bend = 0.0
        if v > 0.0:
            tangential = (vx * change[i, 0] + vy * change[i, 1]) / v
            bend = (vx * change[i, 1] - vy * change[i, 0]) / v
        # Turn of the direction of travel in the world: of the body, and of the velocity in the body.
        slowest = max(v / speed, abs(omega) / turn, math.sqrt(abs(omega * v + bend) / side))
        for j in range(m):
            a[i, j] = wheel[i, j] / wheel_acceleration[j]
            b[i, j] = wheel_change[i, j] / wheel_acceleration[j]
            slowest = max(slowest, abs(wheel[i, j]) / wheel_speed[j])
        a[i, m], b[i, m] = v / acceleration, tangential / acceleration
        for j in range(steering_change.shape[1]):
            slowest = max(slowest, abs(steering_change[i, j]) / steering_rate)
        x_max[i] = 1.0 / (slowest * slowest) if slowest > 0.0 else np.inf
    return a, b, x_max


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
    unit = 2 * math.sqrt(np.abs(a).max()) + 1 / math.sqrt(x_max.min())
    rows = _ActuatorConstraint(
        a[:, used] / unit**2, b[:, used] / unit**2, np.minimum(x_max * unit**2, 1e6), scheme
    )
    rate = np.sqrt(_controlled(rows, grid))
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


def _controlled(rows: _ActuatorConstraint, grid: Array) -> Array:
    """The largest ṡ² (n,) from rest to rest, nan if there is none: TOPPRA's two passes (Pham and Pham, 2018,
    algorithm 1) over its solver. From rest, rest can be kept: no ṡ² is too low to be controllable.

    No program is solved whose answer is plain: where ṡ² can be at its own bound from one point to the next,
    or once it is as large as is controllable and can stay so."""
    solver = seidelWrapper([rows], _Samples(), grid)
    solver.setup_solver()
    solve, last = solver.solve_stagewise_optim, len(grid) - 1
    x = np.full(len(grid), np.nan)
    step = 2 * np.diff(grid)
    top, double = rows.x_max.tolist(), step.tolist()
    holding, holds = _holding(rows.a, rows.b, rows.x_max, step)
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


@kernel
def _holding(a: Array, b: Array, x_max: Array, step: Array) -> tuple[Array, NDArray[np.bool_]]:
    """s̈ (n - 1,) that keeps ṡ² at its bound from one point to the next, and whether the rows allow it."""
    u, free = np.empty(len(step)), np.empty(len(step), np.bool_)
    for i in range(len(step)):
        u[i], free[i] = (x_max[i + 1] - x_max[i]) / step[i], True
        for k in (i, i + 1):
            for j in range(a.shape[1]):
                free[i] &= abs(a[k, j] * u[i] + b[k, j] * x_max[k]) <= 1.0
    return u, free


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
