"""Path → quicker Path: shortcuts between poses along it, free and chosen together by their time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.connect import Connector
from planner.edges import moved
from planner.path import Path, as_steps
from planner.roadmap import quickest_path
from planner.tree import kernel

__all__ = ["shorten"]

_QUICK, _THOROUGH = (24, 2), (48, 4)
"""How many poses along a path shortcuts begin and end at, and how many ways of joining two are tried."""
_ROUNDS = (0.0, 0.0, 0.2, 0.05)
"""Where these poses are, round by round: evenly all along, or, where this is not 0, at the joints of the
path's pieces and so far from them, as a share of the piece."""
_NEAR = 1 / 3
"""How far shortcuts reach between poses at joints, as a share of the evenly spread ones' number."""
_GAIN = 0.995
"""A round that leaves more than this share of the time was the last."""


def shorten(path: Path, connector: Connector, quick: bool = False) -> Path:
    """The quickest path, by estimate, that joins some of the poses along the given one by the connector's
    motions. quick: a few milliseconds' worth of it.

    Start and end stay, the end's heading up to whole turns. The result is free if the path is.
    """
    count, ways = _QUICK if quick else _THOROUGH
    best, time = path, connector.duration(path)
    for share in _ROUNDS:
        shorter = _shortcut(best, connector, count, share, ways)
        quicker = connector.duration(shorter)
        if quicker < time:
            best = shorter
        if quicker > _GAIN * time:
            break
        time = quicker
    return best


def _shortcut(path: Path, connector: Connector, count: int, share: float, ways: int) -> Path:
    start, steps, straight = as_steps(path)
    at = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + 0.1 * np.abs(steps[:, 2]))])
    cuts = _beside(at, share) if share else _even(at, count)
    begin, own, place = _cut(start, steps, straight, at, cuts)
    poses, station = _turned(begin[place], connector)
    reach = _NEAR * count if share else math.inf
    shorter = quickest_path(poses, station, reach, connector, ways, (begin, own, place))
    assert shorter is not None  # there is the path itself
    return shorter


def _even(at: Array, count: int) -> Array:
    """So many places or less, evenly from the first to the last of `at` (k,), or at one of these that is
    near."""
    cuts = np.linspace(0.0, at[-1], count)
    near = at[np.abs(at[:, None] - cuts).argmin(0)]
    found: Array = np.unique(np.where(np.abs(near - cuts) < cuts[1] / 2, near, cuts))
    return found


def _beside(at: Array, share: float) -> Array:
    """The places at (k,), and those by a share of the way to the next from each, on either side."""
    off = share * np.diff(at)
    found: Array = np.unique(np.concatenate([at, at[:-1] + off, at[1:] - off]))
    return found


def _cut(
    start: Array, steps: Array, straight: bool, at: Array, cuts: Array
) -> tuple[Array, Array, NDArray[np.intp]]:
    """The steps (k, 3) from poses start (k, 3), which begin and end at (k + 1,), cut at `cuts` (n,) too.

    Returns where they begin and the last ends (m + 1, 3), what they do (m, 3), and which begin at a cut
    (n,)."""
    places = np.unique(np.concatenate([at, cuts]))
    k = np.minimum(np.searchsorted(at, places, side="right"), len(steps)) - 1
    whole = np.diff(at)[k]
    begin = _moved(start[k], steps[k] * ((places - at[k]) / whole)[:, None], straight)
    own = steps[k[:-1]] * (np.diff(places) / whole[:-1])[:, None]
    return begin, own, np.searchsorted(places, cuts)


@kernel
def _moved(start: Array, steps: Array, straight: bool) -> Array:
    """The poses (n, 3) that steps (n, 3) from start (n, 3) lead to."""
    if straight:
        return start + steps
    out = np.empty_like(start)
    for i in range(len(start)):
        x, y, theta = start[i]
        p, q, turn = steps[i]
        out[i] = moved(x, y, theta, p, q, turn)
    return out


def _turned(stations: Array, connector: Connector) -> tuple[Array, NDArray[np.intp]]:
    """Poses (m, 3) that may be passed, the stations (n, 3) first, and the station (m,) that each is at.

    A base that need not head where it goes may also head as it does at the start or the goal, or so that it
    is fast in the direction of the path.
    """
    n = len(stations)
    if connector.steers or not connector.flows:
        return stations, np.arange(n)
    step = stations[2:, :2] - stations[:-2, :2]
    course, heading = np.arctan2(step[:, 1], step[:, 0]), stations[1:-1, 2]
    turns = [np.full(n - 2, theta) for theta in (stations[0, 2], stations[-1, 2])]
    fast = connector.fast_directions
    if len(fast):
        off = np.remainder(course[:, None] - fast - heading[:, None] + math.pi, math.tau) - math.pi
        turns.append(heading + off[np.arange(n - 2), np.abs(off).argmin(1)])
    variants = [np.column_stack([stations[1:-1, :2], turn]) for turn in turns]
    every = [np.arange(n), *(np.arange(1, n - 1) for _ in variants)]
    return np.concatenate([stations, *variants]), np.concatenate(every)
