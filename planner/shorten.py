"""Path → quicker Path: shortcuts between poses along it, chosen together by their time; those chosen are
checked."""

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

_STATIONS = 24
"""Poses along the path, more where it is longer than as many metres or has more pieces. Where they are more
than four times as many, shortcuts reach over so many of them at most: the cost is linear in the length."""
_LAZY = 200
"""How often a choice may turn out not to be free before all motions are checked."""
_ROUNDS = 4
_GAIN = 0.995
"""A round that leaves more than this share of the time was the last."""


def shorten(path: Path, connector: Connector) -> Path:
    """The quickest path, by estimate, that joins some of the poses along the given one by the connector's
    motions.

    Start and end stay, the end's heading up to whole turns. The result is free if the path is.
    """
    best, time = path, connector.duration(path)
    for _ in range(_ROUNDS):
        shorter = _shortcut(best, connector)
        quicker = connector.duration(shorter)
        if quicker >= time:
            return best
        done = quicker > _GAIN * time
        best, time = shorter, quicker
        if done:
            return best
    return best


def _shortcut(path: Path, connector: Connector) -> Path:
    start, steps, straight = as_steps(path)
    stations, own = _stations(start, steps, straight)
    poses, station = _turned(stations, connector)
    n = len(stations)
    span = n if n <= 4 * _STATIONS else _STATIONS
    ahead = station[None] - station[:, None]
    first, second = np.nonzero((ahead > 0) & (ahead <= span))
    order = np.argsort(station[second], kind="stable")
    first, second = first[order], second[order]
    motions = connector.motions(poses[first], poses[second])
    own_times = connector.durations(stations[:-1], own)
    edges, ways = _quickest_free(
        connector.world.kernel, first, second, motions.start, motions.times, motions.steps, straight,
        own, own_times, connector.reversal,
    )  # fmt: skip
    parts = [
        as_path(stations[first[i]], own[first[i]][None], straight) if way < 0 else motions.path(i, way)
        for i, way in zip(edges.tolist(), ways.tolist(), strict=True)
    ]
    return _unwrapped(path[0].start, parts)


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
    straight: bool, own: Array, own_times: Array, reversal: float,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:  # fmt: skip
    """The edges and ways that lead from pose 0 to the goal in the least time and are free.

    Edge e leads from pose first[e] to second[e]; no later edge leads to where it begins. The goal is the last
    station, which is as many as own has rows and one. start, times, steps, straight: Motions of the edges;
    own (n - 1, 3), own_times (n - 1,): the free steps from each station to the next, way -1 of the edge there.
    reversal s: of a change of direction.
    """
    edges_count, ways_count = times.shape
    goal = len(own)
    n = max(second.max(), first.max()) + 1
    times = times.copy()
    known = np.zeros(times.shape, dtype=np.bool_)
    heads = np.zeros((edges_count, ways_count, 2))
    if not straight:
        for e in range(edges_count):
            for way in range(ways_count):
                for k in range(steps.shape[2]):
                    v = steps[e, way, k, 0]
                    if v != 0.0:
                        heads[e, way, 1] = v
                        if heads[e, way, 0] == 0.0:
                            heads[e, way, 0] = v
    reach, by = np.empty((n, 2)), np.zeros((n, 2, 3), dtype=np.intp)
    edges, ways = np.empty(n, np.intp), np.empty(n, np.intp)
    attempt = 0
    while True:
        if attempt == _LAZY:
            for e in range(edges_count):
                for way in range(ways_count):
                    if not known[e, way] and times[e, way] < np.inf:
                        known[e, way] = True
                        if not motion_free(world, start[e], steps[e, way], straight):
                            times[e, way] = np.inf
        attempt += 1
        reach[:] = np.inf  # arriving backwards, forwards
        reach[0] = 0.0
        for e in range(edges_count):
            i, j = first[e], second[e]
            for way in range(-1 if j == i + 1 and j <= goal else 0, ways_count):
                if way < 0:
                    time = own_times[i]
                    begin = end = 0.0 if straight else own[i, 0]
                else:
                    time = times[e, way]
                    begin, end = heads[e, way, 0], heads[e, way, 1]
                for before in range(2):
                    total = reach[i, before] + time
                    if begin * (2 * before - 1) < 0.0:
                        total += reversal
                    # A way that neither drives forwards nor backwards changes nothing.
                    after = before if end == 0.0 else int(end > 0.0)
                    if total < reach[j, after]:
                        reach[j, after] = total
                        by[j, after, 0], by[j, after, 1], by[j, after, 2] = e, way, before
        j, head, length, found = goal, int(reach[goal, 1] < reach[goal, 0]), 0, True
        while j != 0:
            e, way, before = by[j, head]
            edges[length], ways[length] = e, way
            if way >= 0 and not known[e, way]:
                known[e, way] = True
                if not motion_free(world, start[e], steps[e, way], straight):
                    times[e, way] = np.inf
                    found = False
            j, head, length = first[e], before, length + 1
        if found:
            return edges[:length][::-1].copy(), ways[:length][::-1].copy()


def _unwrapped(start: Pose, steps: list[Path]) -> Path:
    """The steps one after the other, headings continuous though each began on its own branch."""
    pieces = []
    theta = start.theta
    for piece in (piece for step in steps for piece in step):
        turns = round((theta - piece.start.theta) / math.tau) * math.tau
        pieces.append(piece.turned(turns))
        theta = pieces[-1].end.theta
    return merge(pieces)


@kernel
def _stations(start: Array, steps: Array, straight: bool) -> tuple[Array, Array]:
    """Poses (n, 3) along steps (k, 3), their ends included, and the parts (n - 1, 3) of the steps between
    them."""
    way = np.sqrt(steps[:, 0] ** 2 + steps[:, 1] ** 2) + 0.1 * np.abs(steps[:, 2])
    wanted = max(_STATIONS, way.sum())
    shares = np.maximum(1, np.floor(wanted * way / way.sum()))
    n = int(shares.sum())
    stations, parts = np.empty((n + 1, 3)), np.empty((n, 3))
    i = 0
    for k in range(len(steps)):
        x, y, theta = start[k]
        for _ in range(int(shares[k])):
            p, q, turn = steps[k] / shares[k]
            stations[i] = x, y, theta
            parts[i] = p, q, turn
            x, y, theta = (x + p, y + q, theta + turn) if straight else moved(x, y, theta, p, q, turn)
            i += 1
        stations[i] = x, y, theta
    return stations, parts
