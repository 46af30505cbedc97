"""Path → quicker Path: shortcuts between poses along it, free and chosen together by their time."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array, Pose
from planner.connect import Connector
from planner.edges import motion_free, moved
from planner.environment import World
from planner.path import Path, as_path, as_steps, merge
from planner.tree import kernel

__all__ = ["shorten"]

_QUICK, _THOROUGH = (24, 2), (48, 4)
"""How many poses along a path shortcuts begin and end at, and how many ways of joining two are tried."""
_ROUNDS = (0.0, 0.0, 0.2, 0.05)
"""Where these poses are, round by round: evenly all along, or, where this is not 0, at the joints of the path's
pieces and so far from them, as a share of the piece."""
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
    ahead = station[None] - station[:, None]
    first, second = np.nonzero((ahead > 0) & (ahead <= (_NEAR * count if share else np.inf)))
    order = np.lexsort((second, station[second]))
    first, second = first[order], second[order]
    motions = connector.motions(poses[first], poses[second], ways)
    own_times = np.add.reduceat(connector.durations(begin[:-1], own), place[:-1])
    edges, chosen = _quickest_free(
        connector.world.kernel, first, second, motions.start, motions.times, motions.steps, straight,
        own, place, own_times, connector.reversal,
    )  # fmt: skip
    parts = [
        motions.path(e, way) if way >= 0 else as_path(begin[place[i]], own[place[i] : place[i + 1]], straight)
        for e, i, way in zip(edges.tolist(), first[edges].tolist(), chosen.tolist(), strict=True)
    ]
    return _unwrapped(path[0].start, parts)


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
    """The steps (k, 3) from poses start (k, 3), which begin and end at (k + 1,), cut at the places `cuts` (n,),
    too: where they begin and the last ends (m + 1, 3), what they do (m, 3), and which begin at a cut (n,)."""
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


@kernel
def _quickest_free(
    world: World, first: NDArray[np.intp], second: NDArray[np.intp], start: Array, times: Array, steps: Array,
    straight: bool, own: Array, place: NDArray[np.intp], own_times: Array, reversal: float,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:  # fmt: skip
    """The edges and ways that lead from pose 0 to the last station in the least time and are free.

    Edge e leads from pose first[e] to second[e], in the order of these; no later edge leads to where it
    begins. start, times, steps, straight: of the edges' Motions. own_times (n - 1,): of what the path does
    from one of its n stations to the next, free steps own[place[i] : place[i + 1]]; its way is -1. reversal s:
    of a change of direction.
    """
    count, ways = times.shape
    goal = len(own_times)
    times = np.column_stack((times, np.full(count, np.inf)))
    heads = np.zeros((count, ways + 1, 2))
    known = np.zeros(times.shape, dtype=np.bool_)
    for e in range(count):
        i = first[e]
        if second[e] == i + 1 and i < goal:
            times[e, ways], known[e, ways] = own_times[i], True
            if not straight:
                _head(own[place[i] : place[i + 1]], heads[e, ways])
        for way in range(0 if straight else ways):
            _head(steps[e, way], heads[e, way])
    n = second.max() + 1
    reach, by = np.full((n, 2), np.inf), np.zeros((n, 2, 3), dtype=np.intp)
    reach[0] = 0.0  # arriving backwards, forwards
    stop = 0
    while stop < count:
        begin, j = stop, second[stop]
        while stop < count and second[stop] == j:
            stop += 1
        for after in range(2):
            while True:
                least = np.inf
                for e in range(begin, stop):
                    for way in range(ways + 1):
                        if not times[e, way] < least:
                            continue
                        leaves, arrives = heads[e, way]
                        for before in range(2):
                            # A way that neither drives forwards nor backwards changes nothing.
                            if (before if arrives == 0.0 else int(arrives > 0.0)) != after:
                                continue
                            total = reach[first[e], before] + times[e, way]
                            if leaves * (2 * before - 1) < 0.0:
                                total += reversal
                            if total < least:
                                least = total
                                by[j, after, 0], by[j, after, 1], by[j, after, 2] = e, way, before
                e, way = by[j, after, 0], by[j, after, 1]
                if least == np.inf or known[e, way]:
                    break
                known[e, way] = motion_free(world, start[e], steps[e, way], straight)
                if not known[e, way]:
                    times[e, way] = np.inf
            reach[j, after] = least
    edges, chosen = np.empty(n, np.intp), np.empty(n, np.intp)
    j, head, length = goal, int(reach[goal, 1] < reach[goal, 0]), 0
    while j != 0:
        e, way, before = by[j, head]
        edges[length], chosen[length] = e, way if way < ways else -1
        j, head, length = first[e], before, length + 1
    return edges[:length][::-1].copy(), chosen[:length][::-1].copy()


@kernel
def _head(steps: Array, heads: Array) -> None:
    """Whether twists (k, 3) begin and end forwards (> 0), backwards (< 0) or neither (0), into heads (2,)."""
    for k in range(len(steps)):
        if steps[k, 0] != 0.0:
            heads[1] = steps[k, 0]
            if heads[0] == 0.0:
                heads[0] = steps[k, 0]


def _unwrapped(start: Pose, steps: list[Path]) -> Path:
    """The steps one after the other, headings continuous though each began on its own branch."""
    pieces = []
    theta = start.theta
    for piece in (piece for step in steps for piece in step):
        turns = round((theta - piece.start.theta) / math.tau) * math.tau
        pieces.append(piece.turned(turns))
        theta = pieces[-1].end.theta
    return merge(pieces)
