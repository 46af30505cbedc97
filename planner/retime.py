"""A motion → the fastest one along the same way, the wheels' jerk limited too.

The way is parametrized by the time σ at which the given motion is there. With φ(σ) the angle of a wheel,
φ′, φ″ and φ‴ its rate, acceleration and jerk in the given motion, a new law σ(t) has

    rate           φ′ σ̇
    acceleration   φ″ σ̇² + φ′ σ̈
    jerk           φ‴ σ̇³ + 3 φ″ σ̇ σ̈ + φ′ σ⃛

As the given motion starts and ends at rest, any σ̇ does, at the ends too; σ̇ = 1 is the motion itself. Between
fixed stations σ_k the new law is cubic: σ̇ and σ̈ at the stations are states, σ⃛ and the time to the next
station are controls of an optimal control problem.

Source: Verscheure et al. (2009), time-optimal path tracking.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from drives.drive import Drive, Limits
from drives.se2 import Array
from planner.stagewise import Program, Rows, Stage, program
from planner.trajectory import Driven, Flowing, Phase, Phases, Profile, Warped

__all__ = ["excess", "hastened", "retimed"]

_FEWEST, _MOST = 256, 1024
"""Intervals."""
_SPREAD = 384
"""Intervals at most where no more of them are given."""
_SPACING = 0.4
"""Between stations, in units of the time that acceleration takes to build up."""
_INSIDE = 4
"""Parts of an interval that its derivatives are taken from."""
_LEAST, _FASTEST = 1e-3, 20.0
"""Bounds of σ̇."""
_ROUNDS, _EXACT = 3, 2e-3
"""How often a law is sought, as long as the last one must be slowed by more than this share."""
_ITERATIONS = 100
_EFFORT = 0.3
"""What σ⃛ is weighed with, in units of a mean interval: it settles what the limits leave open."""


def hastened(motion: Phases, limits: Limits, is_over: Callable[[], bool] = lambda: False) -> Phases:
    """The motion, each of its phases retimed where jerk is limited and that may help, until is_over."""
    if not np.isfinite(limits.wheel_jerk).any():
        return motion

    def faster(phase: Phase) -> Phase:
        match phase:
            case Flowing():
                return retimed(phase, phase.time, motion.drive, limits, is_over)
            case Driven(fastest=False):
                return retimed(phase, phase.profile.time, motion.drive, limits, is_over)
            case _:
                return phase

    return Phases(motion.drive, tuple(faster(phase) for phase in motion.phases))


def excess(phase: Phase, knots: Array, drive: Drive, limits: Limits) -> float:
    """By what factor a phase must be slowed to keep all limits.

    knots (n,) s: times between which its wheels' accelerations are smooth, its ends included.
    """
    return _rates(phase, knots, drive, limits).excess()


def retimed(
    phase: Phase, knots: Array, drive: Drive, limits: Limits, is_over: Callable[[], bool] = lambda: False
) -> Phase:
    """The phase, or the fastest one found until is_over along the same way that keeps all limits.

    The phase starts and ends at rest without acceleration of the wheels. knots (n,) s: times between which
    its wheels' accelerations are smooth, its ends included.
    """
    if is_over():
        return phase
    stations = _stations(knots, _size(phase.duration, len(knots) - 1, limits))
    given = _rates(phase, stations, drive, limits)
    slack = given.excess()
    if not slack > 0 or not math.isfinite(slack):
        return phase
    best = phase
    for _ in range(_ROUNDS):
        law = _fastest(given, stations, slack)
        if law is None:
            break
        made = _rates(Warped(phase, law), _halved(law.time), drive, limits)
        slower = law.slowed(made.excess())
        if slower.duration < best.duration:
            best = Warped(phase, slower)
        if made.excess() < 1 + _EXACT or is_over():
            break
        # Between stations it goes too far somewhere: there let it keep away from the limits by as much.
        given = given.tightened(np.maximum(made.worst().reshape(-1, 2).max(1), 1.0))
    return best


def _halved(knots: Array) -> Array:
    return np.sort(np.concatenate([knots, (knots[:-1] + knots[1:]) / 2]))


@dataclass(frozen=True, slots=True, eq=False)
class _Rates:
    """How fast a motion is, at points of n intervals, both ends among them.

    first, second, third (n, points, r): rates of the wheels, and the body's speed if its acceleration is
    limited, with their first and second derivatives in time, all over the limit of acceleration: s, 1, 1/s.
    tight (r,): the limit of acceleration over that of jerk, s. fastest (n, points): the largest share of a
    speed limit.
    """

    first: Array
    second: Array
    third: Array
    tight: Array
    fastest: Array

    def excess(self) -> float:
        """By what factor the motion must be slowed to keep all limits."""
        return max(
            float(self.fastest.max()),
            math.sqrt(float(np.abs(self.second).max())),
            math.cbrt(float((np.abs(self.third) * self.tight).max())),
        )

    def worst(self) -> Array:
        """The largest share of a limit of acceleration or jerk over each interval (n,)."""
        shares: Array = np.maximum(np.abs(self.second), np.abs(self.third) * self.tight).max((1, 2))
        return shares

    def tightened(self, by: Array) -> _Rates:
        """The same over limits of acceleration and jerk that are smaller, by (n,) over each interval."""
        each = by[:, None, None]
        return replace(self, first=self.first * each, second=self.second * each, third=self.third * each)


def _rates(phase: Phase, stations: Array, drive: Drive, limits: Limits) -> _Rates:
    n = len(stations) - 1
    step = np.diff(stations) / _INSIDE
    inside = stations[:-1, None] + step[:, None] * np.arange(_INSIDE)
    sampled = Phases(drive, (phase,)).sample(np.append(inside.ravel(), stations[-1]))

    def split(values: Array) -> Array:
        """By interval, the points at its ends included (n, points, …)."""
        at = np.arange(n)[:, None] * _INSIDE + np.arange(_INSIDE + 1)
        parts: Array = values[at]
        return parts

    def change(values: Array) -> Array:
        """Derivative in time of values (n, points, …)."""
        slopes: Array = np.gradient(values, axis=1, edge_order=2)
        return slopes / step.reshape(-1, *[1] * (values.ndim - 1))

    twist = split(sampled.twist)
    vx, vy, omega = np.moveaxis(twist, -1, 0)
    dvx, dvy, _ = np.moveaxis(change(twist), -1, 0)
    speed = np.hypot(vx, vy)
    rate, acceleration = split(sampled.wheel_velocity), split(sampled.wheel_acceleration)
    still = np.maximum(speed, 1e-9)
    gained = (vx * dvx + vy * dvy) / still
    across = np.abs(omega * speed + (vx * dvy - vy * dvx) / still)
    bound = limits.wheel_acceleration
    fastest = [
        (np.abs(rate) / limits.wheel_speed).max(-1), speed / limits.linear_speed,
        np.abs(omega) / limits.angular_speed, np.sqrt(across / limits.lateral_acceleration),
        (np.abs(split(sampled.steering_rate)) / limits.steering_rate).max(-1, initial=0.0),
    ]  # fmt: skip
    first, second, third = rate / bound, acceleration / bound, change(acceleration) / bound
    tight = bound / limits.wheel_jerk
    if math.isfinite(limits.linear_acceleration):
        first, second, third = (
            np.concatenate([wheels, body[..., None]], -1)
            for wheels, body in (
                (first, speed / limits.linear_acceleration),
                (second, gained / limits.linear_acceleration),
                (third, np.zeros_like(speed)),
            )
        )
        tight = np.append(tight, 0.0)
    return _Rates(first, second, third, tight, np.max(fastest, 0))


def _size(duration: float, pieces: int, limits: Limits) -> int:
    """How many intervals to take."""
    ramps = limits.wheel_acceleration / limits.wheel_jerk
    wanted = max(min(duration / (_SPACING * float(ramps[ramps > 0].min())), _SPREAD), pieces)
    return min(max(math.ceil(wanted), _FEWEST), _MOST)


def _stations(knots: Array, size: int) -> Array:
    """Times (size + 1,) as evenly spread as may be, the knots among them, or some where they are too many."""
    if len(knots) > size + 1:
        knots = knots[np.linspace(0, len(knots) - 1, size + 1).round().astype(int)]
    parts = [1] * (len(knots) - 1)
    widest = [(-length, i) for i, length in enumerate(np.diff(knots).tolist())]
    heapq.heapify(widest)
    for _ in range(size - len(parts)):
        _, i = widest[0]
        parts[i] += 1
        heapq.heapreplace(widest, (-float(knots[i + 1] - knots[i]) / parts[i], i))
    ends = zip(knots[:-1], knots[1:], parts, strict=True)
    return np.append(np.concatenate([np.linspace(a, b, n, endpoint=False) for a, b, n in ends]), knots[-1])


def _distinct(given: _Rates) -> list[int]:
    """Of rates that always change alike, one."""
    kept: list[int] = []
    size = np.abs(given.first)
    for i in range(size.shape[-1]):
        if not any(
            given.tight[i] == given.tight[j] and np.allclose(size[..., i], size[..., j], 1e-6, 1e-6)
            for j in kept
        ):
            kept.append(i)
    return kept


def _fastest(given: _Rates, stations: Array, slack: float) -> Profile | None:
    """The fastest law through the stations, looking for it near the motion slowed by `slack`."""
    # An interval is about 1 in the unit of time.
    n = len(stations) - 1
    way = np.diff(stations)
    unit = float(way.mean())
    kept = _distinct(given)
    first, second, third = (
        each[..., kept] for each in (given.first / unit, given.second, given.third * unit)
    )
    tight, rows = given.tight[kept] / unit, len(kept)
    top = 1 / np.maximum(np.concatenate([given.fastest[:, 0], given.fastest[-1:, -1]]), 1 / _FASTEST)
    half = _INSIDE // 2
    middle = 1 / np.maximum(given.fastest[:, half], 1 / _FASTEST)
    parameters = np.concatenate([
        way[:, None] / unit, top[:-1, None], middle[:, None],
        *(each[:, at] for at in (0, -1, half) for each in (first, second, third)),
    ], 1)  # fmt: skip
    start = 1 / slack
    still = np.zeros(n)
    found = _solver(rows).solve(
        np.column_stack([np.full(n + 1, start), np.zeros(n + 1)]),
        np.column_stack([still, way / unit / start]), parameters, np.append(tight, [top[-1], n]), _ITERATIONS,
    )  # fmt: skip
    if found is None:
        return None
    (rate, change), (jerk, step) = found[0][:-1].T, found[1].T
    if not (step > 0).all():
        return None
    return Profile(
        np.concatenate([[0.0], np.cumsum(step)]) * unit, stations[:-1], rate, change / unit, jerk / unit**2
    )


@lru_cache(maxsize=32)
def _solver(rows: int) -> Program:
    """The solver for so many rates whose accelerations and jerks are limited."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    p, shared = ca.SX.sym("p", 3 + 9 * rows), ca.SX.sym("shared", rows + 2)
    rate, change, jerk, step = x[0], x[1], u[0], u[1]
    way, top, middle, tight, end = p[0], p[1], p[2], shared[:-2], shared[-2]
    (first, second, third, first_after, second_after, third_after, first_between, second_between,
     third_between) = ca.vertsplit(p[3:], rows)  # fmt: skip
    after = ca.vertcat(rate + step * (change + step * jerk / 2), change + step * jerk)
    moved = step * (rate + step * (change / 2 + step * jerk / 6))

    def jerks(x: Any, first: Any, second: Any, third: Any) -> Any:
        return tight * (third * x[0] ** 3 + 3 * second * x[0] * x[1] + first * jerk)

    # Half the time is not quite half the way.
    halfway = rate + step / 2 * (change + step / 4 * jerk)
    ahead = step / 2 * (rate + step / 4 * (change + step / 6 * jerk)) - way / 2
    limited = [
        halfway / middle,
        (second_between + ahead * third_between) * halfway**2
        + (first_between + ahead * second_between) * (change + step / 2 * jerk),
        second * rate**2 + first * change,
        jerks(x, first, second, third),
        jerks(after, first_after, second_after, third_after),
    ]
    stage = Stage(
        x, u, p, shared, after,
        cost=(step + _EFFORT * jerk**2) / shared[-1],
        held=[Rows([moved - way], 0, 0), Rows([rate / top], _LEAST, 1), Rows([step], _LEAST, math.inf),
              Rows(limited, -1, 1)],
        first=[Rows([change, jerk], 0, 0)],
        later=[],
        last=[Rows([rate / end], _LEAST, 1), Rows([change], 0, 0)],
        last_cost=ca.SX(0),
    )  # fmt: skip
    return program(stage, 1e-6, 1e-4)
