"""With the wheels' jerk limited: our durations over those of copp-py's TOPP3 on the same paths.

The path that TOPP3 times is that of our own plan, in the space of the actuators: how far each wheel has
rolled and stands steered. Its parameter is the way in that space, each wheel in units of its speed limit.
Where the wheels rest on the way, or turn back, the path is cut. Source: Wang et al., copp-py.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from benchmarks.duration.queries import query
from drives.drive import Limits
from drives.se2 import Array
from planner.errors import PlanningError
from planner.plan import Plan, plan
from planner.problem import Options, Problem

__all__ = ["main", "topp3"]

_JERK = 10.0
"""Jerk over acceleration, 1/s."""
_PERIOD = 0.001
_STATIONS = (100, 200)
"""Tried in turn, with either solver: it does not always converge. The best answer counts."""
_REST = 1e-4
"""Share of the speed limits below which wheels rest."""
_ROUNDS = 4


def main(drives: Iterable[str], limit: int) -> None:
    """Print the table."""
    print(f"{'drive':15}{'n':>3}{'ratio: median':>15}{'90 %':>7}{'worst':>7}{'jerk':>8}{'with/without':>14}"
          f"{'time: median':>14}{'worst':>7}  worst queries")  # fmt: skip
    for drive in drives:
        ratios, used, price, times, faults = [], [], [], [], []
        for draw in range(limit):
            problem = query(drive, "open", draw)
            begin = time.perf_counter()
            try:
                made = plan(_limited(problem, _PERIOD))
            except PlanningError as error:
                faults.append(f"{draw}: {type(error).__name__}: {error}")
                continue
            times.append(time.perf_counter() - begin)
            used.append(made.certificate.wheel_jerk_ratio)
            price.append(made.duration / plan(replace(problem, options=Options(time_budget=3.0))).duration)
            try:
                ratios.append((made.duration / topp3(made, _limited(problem, _PERIOD).robot.limits), draw))
            except (RuntimeError, ValueError) as error:
                faults.append(f"{draw}: TOPP3: {error}")
        line = f"{drive:15}{len(ratios):3}"
        if ratios:
            values = np.array([ratio for ratio, _ in ratios])
            line += f"{np.median(values):15.3f}{np.quantile(values, 0.9):7.3f}{values.max():7.3f}"
            line += f"{max(used):8.4f}{np.median(price):14.3f}{np.median(times):12.2f} s{max(times):5.2f} s  "
            line += ", ".join(f"{draw}: {ratio:.3f}" for ratio, draw in sorted(ratios, reverse=True)[:3])
        print(line, flush=True)
        for fault in faults:
            print("    " + fault[:150])


def _limited(problem: Problem, period: float) -> Problem:
    limits = replace(problem.robot.limits, wheel_jerk=_JERK * problem.robot.limits.wheel_acceleration)
    options = Options(time_budget=3.0, sample_period=period)
    return replace(problem, robot=replace(problem.robot, limits=limits), options=options)


def topp3(made: Plan, limits: Limits) -> float:
    """The duration (s) that TOPP3 gives to the path of a plan; time at rest on the way counts as it is."""
    given = made.schedule
    rate = given.wheel_velocity / limits.wheel_speed
    speed = np.hypot.reduce(rate, axis=1)
    moving = speed > _REST
    # Where the wheels turn back they rest, too, if only between two samples.
    back = np.flatnonzero((rate[:-1] * rate[1:]).sum(1) < 0)
    moving[np.where(speed[back] < speed[back + 1], back, back + 1)] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]).astype(int)))
    total, moved = 0.0, 0.0
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        rows = slice(max(first - 1, 0), min(end + 1, len(given.time)))
        own = float(given.time[rows][-1] - given.time[rows][0])
        moved += own
        total += own if own < 0.05 else _timed(made, limits, rows)
    return total + float(given.time[-1]) - moved


def _timed(made: Plan, limits: Limits, rows: slice) -> float:
    import copp_py as copp  # a development dependency

    found, fault = [], ""
    for stations in _STATIONS:
        for solver in ("topp3_socp", "topp3_lp"):
            try:
                found.append(_solved(made, limits, rows, stations, solver))
            except copp.CoppError as error:
                fault = str(error)
    if not found:
        raise RuntimeError(fault)
    return min(found)


def _solved(made: Plan, limits: Limits, rows: slice, stations: int, solver: str) -> float:
    import copp_py as copp

    s, q = _path(made, limits, rows, stations)
    n, wheels = len(s), len(limits.wheel_speed)
    robot = copp.Robot(wheels, capacity=n)
    robot.append_s(s)
    robot.set_q(*(part[:, :wheels] for part in q[:3]), 0, dddq=q[3][:, :wheels])
    # A steering rate is a limit on the speed along the path, here put on the wheels.
    steered = limits.steering_rate / np.maximum(np.abs(q[1][:, wheels:]).max(1, initial=0.0), 1e-9)
    fastest = np.minimum(limits.wheel_speed, np.abs(q[1][:, :wheels]) * steered[:, None] + 1e-6)
    robot.add_velocity_limits(fastest, -fastest, start_idx_s=0, length=n)
    for add, bound in (
        (robot.add_acceleration_limits, limits.wheel_acceleration),
        (robot.add_jerk_limits, limits.wheel_jerk),
    ):
        add(bound, -bound, start_idx_s=0, length=n)
    first, third = copp.solver.topp2_ra, getattr(copp.solver, solver)
    quick = first.Problem(robot.constraints, idx_s_interval=(0, n - 1), a_boundary=(0.0, 0.0))
    a, b, best = first.solve(quick, first.Options()), None, np.inf
    for _ in range(_ROUNDS):
        problem = third.Problem(robot.constraints, a, num_stationary_max=1, b_linearization=b)
        try:
            profile = third.solve(problem)
        except copp.CoppError:
            if best < np.inf:
                break
            raise
        duration = float(copp.interpolation.s_to_t_topp3(s, profile)[0])
        done = duration > best * (1 - 1e-4)
        best, a, b = min(best, duration), profile.a, profile.b
        if done:
            break
    return best


def _path(made: Plan, limits: Limits, rows: slice, stations: int) -> tuple[Array, list[Array]]:
    """Stations s (n,), and wheel and steering angles with their first three derivatives (n, dim) by s."""
    given = made.schedule
    time = given.time[rows]
    rate = np.hstack([given.wheel_velocity, given.steering_rate])[rows]
    change = np.hstack([given.wheel_acceleration, np.gradient(given.steering_rate, given.time, axis=0)])[rows]
    jerk = np.gradient(change, time, axis=0)
    angle = np.hstack([given.wheel_angle, given.steering_angle])[rows]
    weight = np.concatenate([1 / limits.wheel_speed, np.zeros(given.steering_rate.shape[1])])
    u, du, ddu = rate * weight, change * weight, jerk * weight
    v = np.maximum(np.hypot.reduce(u, axis=1), 1e-12)[:, None]
    dv = (u * du).sum(1, keepdims=True) / v
    ddv = ((du * du).sum(1, keepdims=True) + (u * ddu).sum(1, keepdims=True) - dv**2) / v
    d1 = rate / v
    d2 = (change - d1 * dv) / v**2
    d3 = (jerk - 3 * d2 * v * dv - d1 * ddv) / v**3
    s = np.concatenate([[0.0], np.cumsum(np.diff(time) * (v[1:, 0] + v[:-1, 0]) / 2)])
    slow = v[:, 0] < 0.02 * v.max()
    d2[slow], d3[slow] = 0.0, 0.0  # straight near rest
    d1[0], d1[-1] = d1[~slow][0], d1[~slow][-1]
    # Stations at equal steps of the cube root of the way from either end, where it is near.
    share = np.linspace(-1.0, 1.0, stations)
    at = s[-1] * (0.5 + np.sign(share) * (0.5 - 0.5 * (1 - np.abs(share)) ** 1.8))
    at[[0, -1]] = s[[0, -1]]
    return at, [np.stack([np.interp(at, s, column) for column in part.T], -1) for part in (angle, d1, d2, d3)]
