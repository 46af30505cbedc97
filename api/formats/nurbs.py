"""A curve through dense points as a clamped cubic B-spline with as few knots as its tolerances need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drives.se2 import Array

__all__ = ["DEGREE", "Curve", "fit"]

DEGREE = 3


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A NURBS of degree 3 whose weights are all 1, C² within.

    knots (n + 4,) from 0 to 1, the first and the last four times; points (n, 2) m: control points, the first
    and the last on the curve. Against the points it was fitted to, at equal arc length: position m, the
    largest distance; direction rad, the largest angle between the curve and the directions.
    """

    knots: Array
    points: Array
    position: float
    direction: float


def fit(points: Array, directions: Array, position: float, direction: float) -> Curve:
    """The curve through points (n >= 2, 2) m, no two in a row alike, that passes them within `position` m and
    points there in their directions (n,) rad within `direction` rad.

    It interpolates some of the points and takes the directions at both ends; where it is too far from others,
    one more in between joins, so that at the latest it passes through all.
    """
    from scipy.interpolate import make_interp_spline  # only workers need it

    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    s /= s[-1]
    tangents = np.column_stack([np.cos(directions), np.sin(directions)])
    scale = np.hypot(*np.diff(points, axis=0).T).sum()
    ends = [(1, scale * tangents[0])], [(1, scale * tangents[-1])]
    chosen = np.array([0, len(s) - 1])
    while True:
        spline = make_interp_spline(s[chosen], points[chosen], DEGREE, bc_type=ends)
        off = np.hypot(*(spline(s) - points).T)
        along = spline(s, 1)
        turned = np.abs(
            np.arctan2(
                tangents[:, 0] * along[:, 1] - tangents[:, 1] * along[:, 0], (tangents * along).sum(axis=1)
            )
        )
        poor = np.flatnonzero((off > position) | (turned > direction))
        after = np.unique(np.searchsorted(chosen, poor).clip(1, len(chosen) - 1))
        low, high = chosen[after - 1], chosen[after]
        wide = high - low > 1
        low, high = low[wide], high[wide]
        if not low.size:
            return Curve(spline.t, spline.c, float(off.max()), float(turned.max()))
        added = np.searchsorted(s, (s[low] + s[high]) / 2).clip(low + 1, high - 1)
        chosen = np.union1d(chosen, added)
