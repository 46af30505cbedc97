"""Whole edges in one compiled call: words chosen by their time, and whether motions between poses are
free."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.curves import dubins_words, reeds_shepp_words, shortest_word
from planner.environment import World, linear_free, twist_free
from planner.tree import kernel

__all__ = ["curve_free", "lines_free", "pivot_free", "pivots_free", "quickest_words", "words_free"]


@kernel
def quickest_words(
    a: Array,
    b: Array,
    radius: float,
    reverse: bool,
    speed: Array,
    acceleration: Array,
    steering: float,
    reversal: float,
    ways: int,
) -> tuple[Array, Array, Array]:
    """The words from a (n, 3) to b (n, 3) that take least time, at most `ways` each, the quickest first.

    speed, acceleration (2,): on straights and on curves. steering s: from straight to the curve. reversal
    s: of a change of direction, beside what acceleration takes. Returns times (n, ways), curvature (n,
    ways, 5) 1/m, length (n, ways, 5) m.
    """
    n = len(a)
    times = np.full((n, ways), np.inf)
    curvatures, lengths = np.zeros((n, ways, 5)), np.zeros((n, ways, 5))
    for i in range(n):
        c, s = math.cos(a[i, 2]), math.sin(a[i, 2])
        dx, dy = (b[i, 0] - a[i, 0]) / radius, (b[i, 1] - a[i, 1]) / radius
        x, y, phi = c * dx + s * dy, c * dy - s * dx, b[i, 2] - a[i, 2]
        words, arcs, count = reeds_shepp_words(x, y, phi) if reverse else dubins_words(x, y, phi)
        for k in range(count):
            time, last, way = 0.0, -2.0, 0.0
            for j in range(words.shape[1]):
                ell = abs(arcs[k, j]) * radius
                if ell == 0.0:
                    continue
                curve = words[k, j]
                bent = 1 if curve != 0.0 else 0
                v, accel = speed[bent], acceleration[bent]
                time += ell / v + v / accel if ell * accel > v * v else 2 * math.sqrt(ell / accel)
                if last != -2.0:
                    time += abs(curve - last) * steering
                if way * arcs[k, j] < 0.0:
                    time += reversal
                last, way = curve, arcs[k, j]
            if time >= times[i, ways - 1]:
                continue
            place = ways - 1
            while place > 0 and times[i, place - 1] > time:
                times[i, place] = times[i, place - 1]
                curvatures[i, place] = curvatures[i, place - 1]
                lengths[i, place] = lengths[i, place - 1]
                place -= 1
            times[i, place] = time
            curvatures[i, place] = words[k] / radius
            lengths[i, place] = arcs[k] * radius
    return times, curvatures, lengths


@kernel
def word_free(world: World, x: float, y: float, theta: float, curvature: Array, length: Array) -> bool:
    """Whether arcs of curvature (5,) 1/m and length (5,) m, one after the other from a pose, are free."""
    for k in range(len(length)):
        ell = length[k]
        if ell == 0.0:
            continue
        turn = curvature[k] * ell
        if not twist_free(world, x, y, theta, ell, 0.0, turn):
            return False
        half = turn / 2
        chord = ell if abs(half) < 1e-9 else ell * math.sin(half) / half
        x, y, theta = x + chord * math.cos(theta + half), y + chord * math.sin(theta + half), theta + turn
    return True


@kernel
def curve_free(
    world: World,
    ax: float,
    ay: float,
    ath: float,
    bx: float,
    by: float,
    bth: float,
    radius: float,
    reverse: bool,
) -> bool:
    """Whether the shortest word from a to b is free everywhere."""
    c, s = math.cos(ath), math.sin(ath)
    dx, dy = (bx - ax) / radius, (by - ay) / radius
    curvature, length = shortest_word(c * dx + s * dy, c * dy - s * dx, bth - ath, reverse)
    return word_free(world, ax, ay, ath, curvature / radius, length * radius)


@kernel
def words_free(world: World, a: Array, curvature: Array, length: Array) -> NDArray[np.bool_]:
    """Whether words (n, ways, 5) from poses a (n, 3) are free, (n, ways)."""
    n, ways, _ = length.shape
    free = np.zeros((n, ways), dtype=np.bool_)
    for i in range(n):
        for k in range(ways):
            free[i, k] = word_free(world, a[i, 0], a[i, 1], a[i, 2], curvature[i, k], length[i, k])
    return free


@kernel
def lines_free(world: World, a: Array, step: Array) -> NDArray[np.bool_]:
    """Whether straight lines from poses a by step (n, 3) are free, (n,)."""
    free = np.zeros(len(a), dtype=np.bool_)
    for i in range(len(a)):
        x, y, theta = a[i, 0], a[i, 1], a[i, 2]
        free[i] = linear_free(world, x, y, theta, x + step[i, 0], y + step[i, 1], theta + step[i, 2])
    return free


@kernel
def pivots_free(world: World, a: Array, first: Array, way: Array, last: Array) -> NDArray[np.bool_]:
    """Whether turning by first, driving straight by way and turning by last (n, ways) is free, (n, ways)."""
    n, ways = way.shape
    free = np.zeros((n, ways), dtype=np.bool_)
    for i in range(n):
        for k in range(ways):
            x, y, theta = a[i, 0], a[i, 1], a[i, 2] + first[i, k]
            ex, ey = x + way[i, k] * math.cos(theta), y + way[i, k] * math.sin(theta)
            free[i, k] = (
                linear_free(world, x, y, theta, ex, ey, theta)
                and linear_free(world, x, y, a[i, 2], x, y, theta)
                and linear_free(world, ex, ey, theta, ex, ey, theta + last[i, k])
            )
    return free


@kernel
def pivot_free(
    world: World, ax: float, ay: float, ath: float, bx: float, by: float, bth: float, reverse: bool
) -> bool:
    """Whether turning towards b, driving there and turning on is free everywhere, forwards or backwards."""
    dx, dy = bx - ax, by - ay
    for sign in (1.0, -1.0):
        if sign < 0 and not reverse:
            break
        course = math.atan2(sign * dy, sign * dx)
        first = math.pi - (math.pi - (course - ath)) % math.tau
        last = math.pi - (math.pi - (bth - course)) % math.tau
        if (
            linear_free(world, ax, ay, ath + first, bx, by, ath + first)
            and linear_free(world, ax, ay, ath, ax, ay, ath + first)
            and linear_free(world, bx, by, ath + first, bx, by, ath + first + last)
        ):
            return True
    return False
