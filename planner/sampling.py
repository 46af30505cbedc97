"""How paths and motions are sampled, compiled: grids, a profile's polynomials, columns of a schedule."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.kernels import kernel

__all__ = ["between", "fill", "integral", "polynomials", "refined", "union"]

_BETWEEN = np.array([0.0, 0.25, 0.5, 0.75, 1 - 1e-6])
_STEERING_STEP, _WHEEL_STEP = 0.04, 0.03
"""Largest change of a steering angle (rad), and of a wheel's w relative to the largest w, over one grid
interval."""
_PARTS = 8
"""Parts that an interval is cut into at once, at most."""


@kernel
def polynomials(
    time: Array, position: Array, velocity: Array, acceleration: Array, jerk: Array, t: Array
) -> tuple[Array, Array, Array]:
    """A profile's s, ṡ and s̈ at times t (n,)."""
    s, v, a = np.empty(len(t)), np.empty(len(t)), np.empty(len(t))
    last, i = len(position) - 1, 0
    for k in range(len(t)):
        if t[k] < time[i]:
            i = 0
        while i < last and time[i + 1] <= t[k]:
            i += 1
        u = t[k] - time[i]
        s[k] = position[i] + u * (velocity[i] + u * (acceleration[i] / 2 + u * jerk[i] / 6))
        v[k], a[k] = velocity[i] + u * (acceleration[i] + u * jerk[i] / 2), acceleration[i] + u * jerk[i]
    return s, v, a


@kernel
def integral(s: Array, w: Array, dw: Array) -> Array:
    """Integrals (n, m) of w (n, m) from the first of s (n,), by Euler–Maclaurin: the trapezoid rule and its
    end correction, fourth order in the steps."""
    turned = np.zeros(w.shape)
    for i in range(len(s) - 1):
        h = s[i + 1] - s[i]
        for j in range(w.shape[1]):
            gained = h / 2 * (w[i, j] + w[i + 1, j]) + h * h / 12 * (dw[i, j] - dw[i + 1, j])
            turned[i + 1, j] = turned[i, j] + gained
    return turned


@kernel
def fill(
    row: int,
    here: NDArray[np.intp],
    share: Array,
    rate: Array,
    acceleration: Array,
    w: Array,
    dw: Array,
    steering: Array,
    swing: Array,
    tangent: Array,
    angle: Array,
    wheel_angle: Array,
    wheel_velocity: Array,
    wheel_acceleration: Array,
    steering_angle: Array,
    steering_rate: Array,
    twist: Array,
) -> None:
    """Write the motion from `row` of a schedule's columns on, at n times: ṡ and s̈ (n,) are `rate` and
    `acceleration`, the law and the wheels' angles those in the rows `here` (n,), and further on by `share` of
    a unit of s."""
    for k in range(len(here)):
        i, at, u, v, a = row + k, here[k], share[k], rate[k], acceleration[k]
        for j in range(w.shape[1]):
            wheel_angle[i, j] = angle[at, j] + u * w[at, j]
            wheel_velocity[i, j] = w[at, j] * v
            wheel_acceleration[i, j] = w[at, j] * a + dw[at, j] * v * v
        for j in range(steering.shape[1]):
            steering_angle[i, j] = steering[at, j] + u * swing[at, j]
            steering_rate[i, j] = swing[at, j] * v
        for j in range(3):
            twist[i, j] = tangent[at, j] * v


@kernel
def union(grid: Array, at: Array) -> tuple[Array, NDArray[np.intp]]:
    """The points of a grid and of `at`, both in order, those alike but for rounding as one; and where `at`
    are among them."""
    every, here = np.empty(len(grid) + len(at)), np.empty(len(at), np.intp)
    apart = 1e-12 * (grid[-1] - grid[0])
    n = i = k = 0
    before = 0.0
    while i < len(grid) or k < len(at):
        theirs = k < len(at) and (i == len(grid) or at[k] < grid[i])
        value = at[k] if theirs else grid[i]
        if n == 0 or value - before > apart:
            every[n] = value
            n += 1
        before = value
        if theirs:
            here[k] = n - 1
            k += 1
        else:
            i += 1
    return every[:n].copy(), here


@kernel
def refined(grid: Array, steering: Array, wheel: Array) -> Array:
    """The grid (n,), its coarse intervals halved as often as their changes of steering angles and w call for,
    a few times at most."""
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
        while parts[i] < min(most, _PARTS):
            parts[i] *= 2
        size += parts[i]
    fine, k = np.empty(size), 0
    for i in range(len(parts)):
        for part in range(parts[i]):
            fine[k] = grid[i] + (grid[i + 1] - grid[i]) * part / parts[i]
            k += 1
    fine[k] = grid[-1]
    return fine


@kernel
def between(time: Array, position: Array, velocity: Array, acceleration: Array) -> tuple[Array, Array, Array]:
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
