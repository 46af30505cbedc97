"""What the certificate measures on columns of samples, compiled: numpy is slow at short rows."""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array
from planner.tree import kernel

__all__ = ["integrals", "lengths", "mean_rates", "outer", "worst"]


@kernel
def worst(value: Array, bound: Array) -> tuple[float, int, int, float]:
    """The largest value / bound (r, c), inf for what is no number; its row and column, the first such; and
    the largest value."""
    most, row, column, top = -1.0, 0, 0, 0.0
    for i in range(value.shape[0]):
        for j in range(value.shape[1]):
            v = value[i, j]
            if v <= most * bound[i, j] and v <= top:
                continue
            used = v / bound[i, j]
            if math.isnan(v) or math.isnan(used):
                v = used = np.inf
            top = max(top, v)
            if used > most:
                most, row, column = used, i, j
    return most, row, column, top


@kernel
def mean_rates(column: Array, over: Array) -> Array:
    """|change| (n - 1, c) of a column (n, c) from sample to sample, over times (n - 1,)."""
    found = np.empty((len(over), column.shape[1]))
    for i in range(len(over)):
        for j in range(column.shape[1]):
            found[i, j] = abs(column[i + 1, j] - column[i, j]) / over[i]
    return found


@kernel
def integrals(rate: Array, h: Array) -> Array:
    """Integrals (n - 1, c) of a rate (n, c) over intervals h (n - 1,), by the trapezoid rule."""
    found = np.empty((len(h), rate.shape[1]))
    for i in range(len(h)):
        for j in range(rate.shape[1]):
            found[i, j] = h[i] / 2 * (rate[i, j] + rate[i + 1, j])
    return found


@kernel
def outer(a: Array, b: Array, more: float) -> Array:
    """a[i] * b[j] + more."""
    found = np.empty((len(a), len(b)))
    for i in range(len(a)):
        for j in range(len(b)):
            found[i, j] = a[i] * b[j] + more
    return found


@kernel
def lengths(vectors: Array) -> Array:
    """Of the first two columns of vectors (n, c): (n, 1)."""
    found = np.empty((len(vectors), 1))
    for i in range(len(vectors)):
        found[i, 0] = math.sqrt(vectors[i, 0] ** 2 + vectors[i, 1] ** 2)
    return found
