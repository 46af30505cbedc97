"""A lower bound of the clearance along a rolled motion.

The distance from the footprint to obstacles changes by no more than the footprint's points move. Between two
looks that find distances f and g, while no point moves by more than l, it is at least (f + g - l) / 2. If the
points move along straight lines, it is at least the height of the triangle with sides f, g and base l: no
point of an obstacle is nearer than f to the first position of a body point, nor nearer than g to the second.
Stretches of the motion are halved until one of the bounds suffices.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from drives.se2 import Array
from planner.kernels import kernel
from planner.problem import Footprint
from planner.rolling import POWERS
from planner.tolerances import CLEARANCE_ACCURACY, CLEARANCE_SHARE, SATURATED

__all__ = ["Surroundings", "least_clearance", "ways"]

_COARSE = 0.64
"""Motion of the footprint between the first looks, m."""


class Surroundings(Protocol):
    """Whoever knows how far the footprint is from obstacles and bounds; negative: how deep in them."""

    def clearance(self, poses: Array) -> Array:
        """Distance (n,) m at poses (n, 3), exact up to 1 m; beyond that, a lower bound will do."""


def ways(path: Array, bounds: Array, reach: float) -> Array:
    """How far (n,) m points within `reach` of the origin have moved at each sample, at most. path (4n - 3, 4)
    of a Rolled; bounds (n - 1, 2) of its speed and turn rate in every interval."""
    steps = np.diff(path[::4, 3]) * (bounds[:, 0] + reach * bounds[:, 1])
    return np.concatenate([[0.0], np.cumsum(steps)])


def least_clearance(
    world: Surroundings, path: Array, way: Array, footprint: Footprint, fixed: float | None, asked: float
) -> tuple[float, Array]:
    """A lower bound (m, within ±SATURATED) of the clearance, and the pose and time (4,) where it was found
    least. It is below the true one by CLEARANCE_ACCURACY at most, or by CLEARANCE_SHARE of the true one's
    distance from `asked`, if that is more.

    path (4n - 3, 4) of a Rolled; way (n,): how far the footprint has moved at the samples; fixed rad: the
    heading that the footprint keeps, None if it turns with the body.
    """
    if fixed is not None:
        path = path.copy()
        path[:, 2] = fixed
    reach = 0.0 if fixed is not None else float(np.hypot(*footprint.vertices.T).max())

    def look(places: Array) -> tuple[Array, float, float]:
        near = np.ascontiguousarray(world.clearance(_poses(path, places)[:, :3]))
        return near, *_least(near, places)

    places = np.unique(np.searchsorted(way, np.arange(0.0, way[-1], _COARSE)).clip(0, len(way) - 1))
    places = np.unique(np.concatenate([[0.0], places, [len(way) - 1.0]]))
    near, nearest, where = look(places)
    low = nearest
    stretches = np.column_stack([places[:-1], places[1:], near[:-1], near[1:]])
    while len(stretches) and abs(nearest) < math.inf:
        enough = nearest - max(CLEARANCE_ACCURACY, CLEARANCE_SHARE * abs(nearest - asked))
        stretches, places, bound = _halved(stretches, path, way, reach, footprint.radius, enough)
        low = min(low, bound)
        if len(places):
            near, least, place = look(places)
            nearest, where = min((nearest, where), (least, place))
            stretches[::2, 3] = stretches[1::2, 2] = near
    return max(min(low, nearest, SATURATED), -SATURATED), _poses(path, np.array([where]))[0]


@kernel
def _least(near: Array, places: Array) -> tuple[float, float]:
    """The smallest of clearances (n,) and its place. Those that are not numbers become -inf."""
    least, where = np.inf, 0.0
    for i in range(len(near)):
        if not near[i] >= -np.inf:
            near[i] = -np.inf
        if near[i] < least:
            least, where = near[i], places[i]
    return least, where


@kernel
def _poses(path: Array, places: Array) -> Array:
    """Poses and times (k, 4) at places (k,): i + u is the share u of interval i. Between the instants of an
    interval the motion is the quartic through them."""
    found = np.empty((len(places), 4))
    for k in range(len(places)):
        i = min(int(places[k]), max((len(path) - 5) // 4, 0))
        u = places[k] - i
        for c in range(4):
            found[k, c] = path[4 * i, c]
            if u > 0.0:
                for power in range(1, 5):
                    coefficient = 0.0
                    for b in range(5):
                        coefficient += POWERS[power, b] * (path[4 * i + b, c] - path[4 * i, c])
                    found[k, c] += coefficient * u**power
    return found


@kernel
def _halved(
    stretches: Array, path: Array, way: Array, reach: float, radius: float, enough: float
) -> tuple[Array, Array, float]:
    """Halves of those stretches (n, 4) along which the clearance may fall below `enough`; the places at which
    the halves meet; the least bound of the other stretches, inf if there are none. A stretch is its begin and
    end (places) and the clearances there."""
    count, low = 0, np.inf
    found, middles = np.empty((2 * len(stretches), 4)), np.empty(len(stretches))
    for begin, end, first, last in stretches:
        i, j = int(begin), math.ceil(end)
        inside = j - i == 1
        moved = (way[j] - way[i]) * (end - begin if inside else 1.0)
        bound = (first + last - moved) / 2
        if bound < enough and inside and first > -radius and last > -radius:
            bound = max(bound, _straight(path, i, begin - i, end - i, first, last, reach, radius, enough))
        if bound >= enough or end - begin < 1e-9:
            low = min(low, bound)
            continue
        if inside:
            middle = begin + (end - begin) / 2
        else:
            middle = float(min(max(np.searchsorted(way, (way[i] + way[j]) / 2), i + 1), j - 1))
        found[2 * count] = begin, middle, first, first
        found[2 * count + 1] = middle, end, last, last
        middles[count] = middle
        count += 1
    return found[: 2 * count], middles[:count], low


@kernel
def _straight(
    path: Array,
    i: int,
    u: float,
    v: float,
    first: float,
    last: float,
    reach: float,
    radius: float,
    enough: float,
) -> float:
    """A lower bound of the clearance between the shares u and v of interval i from the clearances there, -inf
    if there is none: the triangle's height, less how far the footprint's points leave their chords."""
    q = np.empty((5, 3))  # coefficients of x, y and theta
    for power in range(5):
        for c in range(3):
            q[power, c] = 0.0
            for b in range(5):
                q[power, c] += POWERS[power, b] * path[4 * i + b, c]
    chord = np.zeros(3)
    for c in range(3):
        for power in range(1, 5):
            chord[c] += q[power, c] * (v**power - u**power)
    dx, dy, turned = chord[0], chord[1], abs(chord[2])
    moved = math.sqrt(dx * dx + dy * dy) + reach * turned
    f, g = first + radius, last + radius
    if moved >= f + g:
        return -np.inf
    if moved * moved <= abs(f * f - g * g):
        height = min(f, g)
    else:
        foot = (moved * moved + f * f - g * g) / (2 * moved)
        height = math.sqrt(max(f * f - foot * foot, 0.0))
    if height - radius < enough:
        return -np.inf
    # Second derivatives by the share, in metres, along the chord and across it. They are parabolas: between
    # these three points they exceed them by less than `rest`.
    size = math.sqrt(dx * dx + dy * dy + (reach * turned) ** 2)
    if size == 0.0:
        return height - radius
    along = across = 0.0
    for w in (u, (u + v) / 2, v):
        ax = 2 * q[2, 0] + 6 * w * q[3, 0] + 12 * w * w * q[4, 0]
        ay = 2 * q[2, 1] + 6 * w * q[3, 1] + 12 * w * w * q[4, 1]
        at = reach * (2 * q[2, 2] + 6 * w * q[3, 2] + 12 * w * w * q[4, 2])
        part = (ax * dx + ay * dy + at * reach * chord[2]) / size
        along = max(along, abs(part))
        across = max(across, math.sqrt(max(ax * ax + ay * ay + at * at - part * part, 0.0)))
    rest = 3 * (v - u) ** 2 * math.sqrt(q[4, 0] ** 2 + q[4, 1] ** 2 + (reach * q[4, 2]) ** 2)
    along, across = along + rest, across + rest
    share = v - u
    if share * share * along > 2 * size:
        return -np.inf  # the footprint may turn back within the stretch
    bow = math.sqrt(2.0) * share * share * across / 8 + reach * turned * turned / 8
    return float(height - radius - bow)
