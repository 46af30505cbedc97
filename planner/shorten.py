"""Path → quicker Path: shortcuts between poses along it, free and chosen together by their time. Compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.collision import World
from planner.connect import Connector
from planner.edges import LINE, Law, duration, moved
from planner.kernels import kernel
from planner.path import Path, as_path, as_steps
from planner.roadmap import quickest_steps

__all__ = ["shorten"]

_POSES, _ROUGH, _WAYS = 24, 14, 2
"""How many poses along a path shortcuts begin and end at, and how many ways of joining two are tried."""
_ROUNDS, _ROUGH_ROUNDS = np.array([0.0, 0.0, 0.2, 0.05]), np.zeros(2)
"""Where these poses are, round by round: evenly all along, or, where this is not 0, at the joints of the
path's pieces and so far from them, as a share of the piece."""
_NEAR = 3
"""How far shortcuts reach between poses at joints: the evenly spread ones' number over this."""
_GAIN = 0.995
"""A round that leaves more than this share of the time was the last."""


def shorten(path: Path, connector: Connector, rough: bool = False, fits: bool = False) -> Path:
    """The quickest path, by estimate, that joins some of the poses along the given one by the connector's
    motions. rough: in a third of the time, for a way that is optimized or dropped. fits: by arcs of other
    radii than the connector's, too, for a way through narrow passages.

    Start and end stay, the end's heading up to whole turns. The result is free if the path is.
    """
    count, rounds = (_ROUGH, _ROUGH_ROUNDS) if rough else (_POSES, _ROUNDS)
    start, steps, straight = as_steps(path)
    # A base that need not head where it goes may also pass poses turned.
    turns = connector.flows and not connector.steers
    shorter = _shortened(
        connector.world.kernel, connector.law, start[0], steps, count, rounds, connector.ways(_WAYS),
        turns, connector.fast_directions if turns else np.zeros(0), fits and not straight,
    )  # fmt: skip
    return as_path(start[0], shorter, straight)


@kernel
def _shortened(
    world: World, law: Law, start: Array, steps: Array, count: int, rounds: Array, ways: int, turns: bool,
    fast: Array, fits: bool,
) -> Array:  # fmt: skip
    """The steps of a quicker path from a pose (3,) than steps (k, 3), or those."""
    best, time = steps, duration(law, start[2], steps)
    for share in rounds:
        shorter = _shortcut(world, law, start, best, count, share, ways, turns, fast, fits)
        quicker = duration(law, start[2], shorter)
        if quicker < time:
            best = shorter
        if quicker > _GAIN * time:
            break
        time = quicker
    return best


@kernel
def _shortcut(
    world: World, law: Law, start: Array, steps: Array, count: int, share: float, ways: int, turns: bool,
    fast: Array, fits: bool,
) -> Array:  # fmt: skip
    at = np.zeros(len(steps) + 1)
    for k in range(len(steps)):
        x, y, turn = steps[k]
        at[k + 1] = at[k] + math.sqrt(x * x + y * y) + 0.1 * abs(turn)
    cuts = _beside(at, share) if share > 0.0 else _even(at, count)
    begin, own, place = _cut(start, steps, law.kind == LINE, at, cuts)
    poses, station = begin[place], np.arange(len(place))
    if turns:
        poses, station = _turned(poses, fast)
    reach = count // _NEAR if share > 0.0 else len(place)
    shorter, _ = quickest_steps(world, law, poses, station, reach, ways, begin[:-1], own, place, fits)
    return shorter


@kernel
def _even(at: Array, count: int) -> Array:
    """So many places or less, evenly from the first to the last of `at` (k,), or at one of these that is
    near."""
    cuts = np.linspace(0.0, at[-1], count)
    apart = cuts[1]
    for i in range(count):
        k = np.searchsorted(at, cuts[i])
        near = at[min(k, len(at) - 1)]
        if k > 0 and cuts[i] - at[k - 1] <= abs(near - cuts[i]):
            near = at[k - 1]
        if abs(near - cuts[i]) < apart / 2:
            cuts[i] = near
    return np.unique(cuts)


@kernel
def _beside(at: Array, share: float) -> Array:
    """The places at (k,), and those by a share of the way to the next from each, on either side."""
    off = share * np.diff(at)
    return np.unique(np.concatenate((at, at[:-1] + off, at[1:] - off)))


@kernel
def _cut(
    start: Array, steps: Array, straight: bool, at: Array, cuts: Array
) -> tuple[Array, Array, NDArray[np.int64]]:
    """The steps (k, 3) from a pose (3,), which begin and end at (k + 1,), cut at `cuts` (n,) too.

    Returns where they begin and the last ends (m + 1, 3), what they do (m, 3), and which begin at a cut
    (n,)."""
    places = np.unique(np.concatenate((at, cuts)))
    m = len(places) - 1
    begin, own = np.empty((m + 1, 3)), np.empty((m, 3))
    x, y, theta = start
    k = 0
    for i in range(m + 1):
        while k < len(steps) - 1 and at[k + 1] <= places[i]:
            x, y, theta = _moved(x, y, theta, steps[k], 1.0, straight)
            k += 1
        whole = at[k + 1] - at[k]
        begin[i, 0], begin[i, 1], begin[i, 2] = _moved(
            x, y, theta, steps[k], (places[i] - at[k]) / whole, straight
        )
        if i < m:
            own[i] = steps[k] * ((places[i + 1] - places[i]) / whole)
    return begin, own, np.searchsorted(places, cuts)


@kernel
def _moved(
    x: float, y: float, theta: float, step: Array, share: float, straight: bool
) -> tuple[float, float, float]:
    """The pose that a share of a step leads to."""
    p, q, turn = share * step[0], share * step[1], share * step[2]
    return (x + p, y + q, theta + turn) if straight else moved(x, y, theta, p, q, turn)


@kernel
def _turned(stations: Array, fast: Array) -> tuple[Array, NDArray[np.int64]]:
    """Poses (m, 3) that may be passed, and the station (m,) that each is at: first the stations (n, 3)
    themselves, then, but for the first and the last, as at the start, as at the goal, and so that a fast
    direction (rad, body frame) is that of the path."""
    n, each = len(stations), 4 if len(fast) > 0 else 3
    m = 2 + each * (n - 2)
    poses, station = np.empty((m, 3)), np.zeros(m, np.int64)
    poses[0], poses[m - 1], station[m - 1] = stations[0], stations[n - 1], n - 1
    for k in range(1, n - 1):
        i = 1 + each * (k - 1)
        poses[i : i + each], station[i : i + each] = stations[k], k
        poses[i + 1, 2], poses[i + 2, 2] = stations[0, 2], stations[n - 1, 2]
        if len(fast) > 0:
            dx, dy = stations[k + 1, 0] - stations[k - 1, 0], stations[k + 1, 1] - stations[k - 1, 1]
            least = np.inf
            for direction in fast:
                off = math.atan2(dy, dx) - direction - stations[k, 2]
                off -= math.tau * math.floor(off / math.tau + 0.5)
                if abs(off) < abs(least):
                    least = off
            poses[i + 3, 2] = stations[k, 2] + least
    return poses, station
