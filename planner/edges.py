"""Whole motions in one compiled call: how a mobility joins two poses, how long that takes, and whether it is
free.

A motion is an array of steps (k, 3) in turn: twists held for unit time or, of lines, displacements in the
world. Steps of zero are none.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.collision import INNER_RADIUS, World, surely_hits
from planner.curves import (
    DUBINS,
    DUBINS_END,
    REEDS_SHEPP,
    REEDS_SHEPP_END,
    SEGMENTS,
    shortest,
    solve_word,
    word_reaches,
    word_segment,
)
from planner.estimate import step_duration
from planner.kernels import kernel
from planner.sweep import linear_free, twist_free

__all__ = [
    "CURVE",
    "LINE",
    "NOTHING",
    "OVERLAPPING",
    "PIVOT",
    "Law",
    "bound",
    "duration",
    "joined",
    "motion_free",
    "motions_between",
    "motions_free",
    "moved",
    "next_free",
    "step_times",
    "ways_between",
]

LINE, PIVOT, CURVE = 0, 1, 2
"""Straight lines in SE(2); turns on the spot and straights; words of Dubins, or of Reeds and Shepp."""

_PROBES, _FAR = 16, 4.0
"""How many poses on a step are looked at, at most, before all of it is; and how far apart they may be, in
radii of the largest disc inside the footprint."""

OVERLAPPING = 0.5
"""Share of the time to steer, or to turn on the spot, that is lost where the robot drives
meanwhile, roughly."""

NOTHING = 1e-9
"""Ways (m) and turns (rad) below this are rounding, not motion."""


class Law(NamedTuple):
    """How a robot moves, for compiled code.

    kind: LINE, PIVOT or CURVE; reverse, flows, radius (m): its Connector's. pace: see planner.estimate. Of
    curves: speed, push (2,), the largest speed and acceleration on straights and on them; lean m, steering
    stands at atan(lean·curvature); slowness s, of steering by 1 rad. reversal s: of a change of direction,
    beside the time of the motions before and after it.
    """

    kind: int
    reverse: bool
    flows: bool
    radius: float
    pace: Array
    speed: Array
    push: Array
    lean: float
    slowness: float
    reversal: float


@kernel
def _wrapped(angle: float) -> float:
    """The same angle in (-π, π], zero where it is only rounding."""
    inside = math.pi - (math.pi - angle) % math.tau
    return 0.0 if abs(inside) < NOTHING else inside


# ---------------------------------------------------------------- the ways between two poses


@kernel
def ways_between(law: Law, a: Array, b: Array, times: Array, steps: Array) -> None:
    """The quickest ways from pose a (3,) to b, by estimate, into times (ways or more,) s, inf where there is
    no such way, and steps (ways, k, 3); of curves quickest first."""
    times[:] = np.inf
    steps[:] = 0.0
    if law.kind == LINE:
        steps[0, 0, 0], steps[0, 0, 1] = b[0] - a[0], b[1] - a[1]
        steps[0, 0, 2] = math.pi - (math.pi - (b[2] - a[2])) % math.tau
        times[0] = _step_time(law, a[2], steps[0, 0])
    elif law.kind == PIVOT:
        dx, dy = b[0] - a[0], b[1] - a[1]
        distance = math.sqrt(dx * dx + dy * dy)
        for way in range(min(2 if law.reverse else 1, len(steps))):
            sign = 1.0 - 2.0 * way
            course = math.atan2(sign * dy, sign * dx) if distance >= NOTHING else a[2]
            steps[way, 0, 2], steps[way, 1, 0] = _wrapped(course - a[2]), sign * distance
            steps[way, 2, 2] = _wrapped(b[2] - course)
            times[way] = 0.0
            for k in range(3):
                times[way] += _step_time(law, a[2], steps[way, k])
    else:
        _quickest_words(law, a, b, times, steps)


@kernel
def _quickest_words(law: Law, a: Array, b: Array, times: Array, steps: Array) -> None:
    """The words from a to b that take least time, of times and steps as they were."""
    ways = len(steps)
    radius, speed, push = law.radius, law.speed, law.push
    steering = math.atan(law.lean / radius) * law.slowness
    top = speed.max() / radius
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = (b[0] - a[0]) / radius, (b[1] - a[1]) / radius
    x, y, phi = c * dx + s * dy, c * dy - s * dx, b[2] - a[2]
    sine, cosine = math.sin(phi), math.cos(phi)
    for row in range(REEDS_SHEPP if law.reverse else DUBINS, REEDS_SHEPP_END if law.reverse else DUBINS_END):
        word = solve_word(row, x, y, phi, sine, cosine, times[ways - 1] * top)
        if not word[0] < np.inf:
            continue
        time, last, way = 0.0, -2.0, 0.0
        for j in range(SEGMENTS):
            bent, length = word_segment(row, j, word)
            ell = abs(length) * radius
            if ell == 0.0:
                continue
            v, accel = speed[int(bent != 0.0)], push[int(bent != 0.0)]
            time += ell / v + v / accel if ell * accel > v * v else 2 * math.sqrt(ell / accel)
            if last != -2.0:
                time += abs(bent - last) * steering
            if way * length < 0.0:
                time += law.reversal
            last, way = bent, length
        if time >= times[ways - 1] or not word_reaches(row, word, x, y, sine, cosine):
            continue
        place = ways - 1
        while place > 0 and times[place - 1] > time:
            times[place] = times[place - 1]
            steps[place] = steps[place - 1]
            place -= 1
        times[place] = time
        _write_word(row, word, radius, steps[place])


@kernel
def _write_word(row: int, word: tuple[float, float, float, float], radius: float, steps: Array) -> None:
    """A word's twists into steps (SEGMENTS, 3)."""
    for j in range(SEGMENTS):
        bent, length = word_segment(row, j, word)
        steps[j, 0], steps[j, 1] = length * radius, 0.0
        steps[j, 2] = bent / radius * steps[j, 0]


@kernel
def motions_between(law: Law, a: Array, b: Array, ways: int) -> tuple[Array, Array]:
    """Times (n, ways) and steps (n, ways, SEGMENTS, 3) of the ways from poses a (n, 3) to b: see
    ways_between."""
    times, steps = np.empty((len(a), ways)), np.empty((len(a), ways, SEGMENTS, 3))
    for i in range(len(a)):
        ways_between(law, a[i], b[i], times[i], steps[i])
    return times, steps


@kernel
def bound(law: Law, a: Array, b: Array) -> float:
    """What curves from a pose to another take at least, s."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    way, v, accel = math.sqrt(dx * dx + dy * dy), law.speed.max(), law.push.max()
    return way / v + v / accel if way * accel > v * v else 2 * math.sqrt(way / accel)


# ---------------------------------------------------------------- how long motions take


@kernel
def _step_time(law: Law, theta: float, step: Array) -> float:
    """Estimate (s) for a step from a pose of this heading."""
    time = step_duration(law.pace, theta, step[0], step[1], step[2], law.kind == LINE, law.flows)
    if law.kind == PIVOT and law.flows and step[0] == 0.0 and step[1] == 0.0:
        time *= OVERLAPPING
    return time


@kernel
def step_times(law: Law, theta: Array, steps: Array) -> Array:
    """Estimates (n,) s for steps (n, 3) from poses of headings theta (n,)."""
    times = np.empty(len(steps))
    for k in range(len(steps)):
        times[k] = _step_time(law, theta[k], steps[k])
    return times


@kernel
def duration(law: Law, theta: float, steps: Array) -> float:
    """Estimate (s) for a path of steps (k, 3) from a pose of heading theta: changes of direction and steering
    on the way included."""
    time, last, leant = 0.0, 0.0, np.nan
    for k in range(len(steps)):
        time += _step_time(law, theta, steps[k])
        theta += steps[k, 2]
        if law.kind == LINE:
            continue
        if steps[k, 0] != 0.0:
            if last * steps[k, 0] < 0.0:
                time += law.reversal
            last = steps[k, 0]
        if law.kind == CURVE:
            lean = math.atan(law.lean * steps[k, 2] / steps[k, 0])
            if k > 0:
                time += abs(lean - leant) * law.slowness
            leant = lean
    return time


# ---------------------------------------------------------------- whether motions are free


@kernel
def moved(x: float, y: float, theta: float, vx: float, vy: float, turn: float) -> tuple[float, float, float]:
    """The pose that holding a twist for unit time leads to."""
    half = 0.5 * turn
    sinc = math.sin(half) / half if abs(half) > 1e-9 else 1.0
    c, s = math.cos(theta + half) * sinc, math.sin(theta + half) * sinc
    return x + c * vx - s * vy, y + s * vx + c * vy, theta + turn


@kernel
def _blocked(
    world: World, x: float, y: float, theta: float, p: float, q: float, turn: float, straight: bool
) -> bool:
    """Whether the largest disc inside the footprint surely hits something at one of a few poses on a step."""
    way = math.sqrt(p * p + q * q)
    count = 2
    while count < _PROBES and way > count * _FAR * world[INNER_RADIUS]:
        count *= 2
    stride = count
    while stride > 1:
        for k in range(stride // 2, count, stride):
            share = k / count
            if straight:
                px, py, heading = x + share * p, y + share * q, theta + share * turn
            else:
                px, py, heading = moved(x, y, theta, share * p, share * q, share * turn)
            if surely_hits(world, px, py, heading):
                return True
        stride //= 2
    return False


@kernel
def motion_free(world: World, start: Array, steps: Array, straight: bool) -> bool:
    """Whether steps (k, 3) from a pose (3,) are free; straight: whether they are lines."""
    for exact in range(2):
        x, y, theta = start[0], start[1], start[2]
        for k in range(len(steps)):
            p, q, turn = steps[k, 0], steps[k, 1], steps[k, 2]
            if p == 0.0 and q == 0.0 and turn == 0.0:
                continue
            if exact == 0:
                if _blocked(world, x, y, theta, p, q, turn, straight):
                    return False
            elif straight:
                if not linear_free(world, x, y, theta, x + p, y + q, theta + turn):
                    return False
            elif not twist_free(world, x, y, theta, p, q, turn):
                return False
            x, y, theta = (x + p, y + q, theta + turn) if straight else moved(x, y, theta, p, q, turn)
    return True


@kernel
def motions_free(world: World, start: Array, steps: Array, straight: bool) -> NDArray[np.bool_]:
    """Whether motions of steps (n, ways, k, 3) from poses start (n, 3) are free, (n, ways)."""
    free = np.zeros(steps.shape[:2], dtype=np.bool_)
    for i in range(steps.shape[0]):
        for way in range(steps.shape[1]):
            free[i, way] = motion_free(world, start[i], steps[i, way], straight)
    return free


@kernel
def next_free(
    world: World,
    start: Array,
    steps: Array,
    straight: NDArray[np.bool_],
    order: NDArray[np.int64],
    place: int,
) -> int:
    """The first place in `order`, from a given one on, of a motion that is free, -1: none. Motions of steps
    (n, k, 3) from poses start (n, 3); straight (n,): whether they are lines."""
    for p in range(place, len(order)):
        i = order[p]
        if motion_free(world, start[i], steps[i], straight[i]):
            return p
    return -1


@kernel
def _curve(
    ax: float, ay: float, ath: float, bx: float, by: float, bth: float, radius: float, reverse: bool,
    steps: Array,
) -> None:  # fmt: skip
    """The shortest word from a to b, into steps (SEGMENTS, 3)."""
    c, s = math.cos(ath), math.sin(ath)
    dx, dy = (bx - ax) / radius, (by - ay) / radius
    row, word = shortest(c * dx + s * dy, c * dy - s * dx, bth - ath, reverse)
    _write_word(row, word, radius, steps)


@kernel
def joined(
    world: World, kind: int, radius: float, reverse: bool,
    ax: float, ay: float, ath: float, bx: float, by: float, bth: float, steps: Array,
) -> bool:  # fmt: skip
    """Whether the shortest motion from a to b is free, and that into steps (SEGMENTS, 3); of two that turn
    on the spot, forwards and backwards, the first that is."""
    steps[:] = 0.0
    if kind == LINE:
        turn = math.pi - (math.pi - (bth - ath)) % math.tau
        steps[0, 0], steps[0, 1], steps[0, 2] = bx - ax, by - ay, turn
        return motion_free(world, np.array([ax, ay, ath]), steps[:1], True)
    if kind == CURVE:
        _curve(ax, ay, ath, bx, by, bth, radius, reverse, steps)
        return motion_free(world, np.array([ax, ay, ath]), steps, False)
    dx, dy = bx - ax, by - ay
    distance = math.sqrt(dx * dx + dy * dy)
    for sign in (1.0, -1.0):
        if sign < 0 and not reverse:
            break
        course = math.atan2(sign * dy, sign * dx) if distance >= NOTHING else ath
        first, last = _wrapped(course - ath), _wrapped(bth - course)
        steps[0, 2], steps[1, 0], steps[2, 2] = first, sign * distance, last
        if motion_free(world, np.array([ax, ay, ath]), steps, False):
            return True
    return False
