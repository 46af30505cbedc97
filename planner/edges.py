"""Whole edges in one compiled call: words chosen by their time, and whether motions between poses are
free."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.curves import (
    DUBINS,
    DUBINS_END,
    REEDS_SHEPP,
    REEDS_SHEPP_END,
    SEGMENTS,
    shortest_word,
    solve_word,
    word_reaches,
    word_segment,
)
from planner.environment import World, linear_free, twist_free
from planner.tree import kernel

__all__ = ["curve_free", "motion_free", "motions_free", "pivot_free", "quickest_words"]


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
) -> tuple[Array, Array]:
    """The words from a (n, 3) to b (n, 3) that take least time, at most `ways` each, the quickest first.

    speed, acceleration (2,): on straights and on curves. steering s: from straight to the curve. reversal
    s: of a change of direction, beside what acceleration takes. Returns times (n, ways), and the twists
    (n, ways, 5, 3) that are held for unit time in turn.
    """
    n = len(a)
    times, steps = np.full((n, ways), np.inf), np.zeros((n, ways, SEGMENTS, 3))
    top = speed.max() / radius
    for i in range(n):
        c, s = math.cos(a[i, 2]), math.sin(a[i, 2])
        dx, dy = (b[i, 0] - a[i, 0]) / radius, (b[i, 1] - a[i, 1]) / radius
        x, y, phi = c * dx + s * dy, c * dy - s * dx, b[i, 2] - a[i, 2]
        sine, cosine = math.sin(phi), math.cos(phi)
        for row in range(REEDS_SHEPP if reverse else DUBINS, REEDS_SHEPP_END if reverse else DUBINS_END):
            word = solve_word(row, x, y, phi, sine, cosine, times[i, ways - 1] * top)
            if not word[0] < np.inf:
                continue
            time, last, way = 0.0, -2.0, 0.0
            for j in range(SEGMENTS):
                curve, length = word_segment(row, j, word)
                ell = abs(length) * radius
                if ell == 0.0:
                    continue
                bent = 1 if curve != 0.0 else 0
                v, accel = speed[bent], acceleration[bent]
                time += ell / v + v / accel if ell * accel > v * v else 2 * math.sqrt(ell / accel)
                if last != -2.0:
                    time += abs(curve - last) * steering
                if way * length < 0.0:
                    time += reversal
                last, way = curve, length
            if time >= times[i, ways - 1] or not word_reaches(row, word, x, y, sine, cosine):
                continue
            place = ways - 1
            while place > 0 and times[i, place - 1] > time:
                times[i, place] = times[i, place - 1]
                steps[i, place] = steps[i, place - 1]
                place -= 1
            times[i, place] = time
            for j in range(SEGMENTS):
                curve, length = word_segment(row, j, word)
                steps[i, place, j, 0] = length * radius
                steps[i, place, j, 2] = curve / radius * steps[i, place, j, 0]
    return times, steps


@kernel
def motion_free(world: World, start: Array, steps: Array, straight: bool) -> bool:
    """Whether a motion is free: steps (k, 3) in turn from a pose (3,), displacements in the world where
    `straight`, else twists held for unit time. Steps of zero are none."""
    x, y, theta = start[0], start[1], start[2]
    for k in range(len(steps)):
        p, q, turn = steps[k, 0], steps[k, 1], steps[k, 2]
        if p == 0.0 and q == 0.0 and turn == 0.0:
            continue
        if straight:
            if not linear_free(world, x, y, theta, x + p, y + q, theta + turn):
                return False
            x, y, theta = x + p, y + q, theta + turn
        else:
            if not twist_free(world, x, y, theta, p, q, turn):
                return False
            x, y, theta = moved(x, y, theta, p, q, turn)
    return True


@kernel
def moved(x: float, y: float, theta: float, vx: float, vy: float, turn: float) -> tuple[float, float, float]:
    """The pose that holding a twist for unit time leads to."""
    half = 0.5 * turn
    sinc = math.sin(half) / half if abs(half) > 1e-9 else 1.0
    c, s = math.cos(theta + half) * sinc, math.sin(theta + half) * sinc
    return x + c * vx - s * vy, y + s * vx + c * vy, theta + turn


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
    steps = np.zeros((len(length), 3))
    for k in range(len(length)):
        steps[k, 0], steps[k, 2] = length[k] * radius, length[k] * curvature[k]
    return motion_free(world, np.array([ax, ay, ath]), steps, False)


@kernel
def motions_free(world: World, start: Array, steps: Array, straight: bool) -> NDArray[np.bool_]:
    """Whether motions of steps (n, ways, k, 3) from poses start (n, 3) are free, (n, ways): see
    motion_free."""
    free = np.zeros(steps.shape[:2], dtype=np.bool_)
    for i in range(steps.shape[0]):
        for way in range(steps.shape[1]):
            free[i, way] = motion_free(world, start[i], steps[i, way], straight)
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
