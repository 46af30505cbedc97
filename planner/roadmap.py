"""Poses in a row → the quickest free path through some of them: a roadmap without a search. Compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.collision import World
from planner.connect import Connector
from planner.curves import SEGMENTS
from planner.edges import CURVE, LINE, Law, bound, motion_free, step_times
from planner.fits import FITS, all_ways
from planner.kernels import kernel
from planner.path import Path, as_path

__all__ = ["merged", "quickest_path", "quickest_steps"]

_SAME_DIRECTION, _NOTHING = 1e-9, 1e-12
_NONE = np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int64)


def quickest_path(poses: Array, reach: int, connector: Connector, ways: int) -> Path | None:
    """The quickest free path, by estimate, from the first to the last of poses (n, 3) by the connector's
    motions; None: there is none. reach: how many poses further a motion may lead. ways: how many of each
    pair are tried."""
    steps, found = quickest_steps(
        connector.world.kernel,
        connector.law,
        poses,
        np.arange(len(poses)),
        reach,
        connector.ways(ways),
        *_NONE,
        False,
    )
    return as_path(poses[0], steps, connector.law.kind == LINE) if found else None


@kernel
def quickest_steps(
    world: World, law: Law, poses: Array, station: NDArray[np.int64], reach: int, ways: int,
    begin: Array, own: Array, place: NDArray[np.int64], fits: bool,
) -> tuple[Array, bool]:  # fmt: skip
    """The steps (k, 3) of the quickest free path, by estimate, from the first pose to the last by the
    motions of a law, and whether there is one.

    poses (n, 3), and the station (n,) that each is at: 0, 1, 1, 2, … in order, the first and the last
    alone at theirs. reach: how many stations further a motion may lead. ways: how many of each pair are
    tried.
    begin, own, place: a free path that leads by the first pose at each station: its steps own (m, 3), where
    these begin, begin (m, 3), and which of those begins (stations,) are the stations; empty: there is none.
    fits: whether twists whose radii fit are tried, too (see planner.fits); they are not lines.
    """
    n, straight, few = len(poses), law.kind == LINE, ways
    ways = few + FITS if fits else few
    # A path may arrive backwards or forwards: where changes of direction cost nothing, no matter which.
    heads = 1 if straight or law.reversal == 0.0 else 2
    own_times = step_times(law, begin[:, 2], own)
    first = np.searchsorted(station, station)
    reached, soonest, by = np.full((n, heads), np.inf), np.zeros(n), np.zeros((n, heads, 3), np.int64)
    chosen = np.zeros((n, heads, SEGMENTS, 3))
    reached[0] = 0.0
    times, steps = np.empty((n, ways + 1)), np.empty((n, ways, SEGMENTS, 3))
    told, known = np.empty(n, np.bool_), np.empty((n, ways + 1), np.bool_)
    quickest, ends = np.empty(n), np.zeros((n, ways + 1, 2))
    for j in range(1, n):
        low, high = np.searchsorted(station, station[j] - reach), first[j]
        for i in range(low, high):
            times[i], known[i], told[i] = np.inf, False, law.kind != CURVE
            if told[i]:
                all_ways(law, poses[i], poses[j], few, times[i, :ways], steps[i])
                if heads == 2:
                    _mark(steps[i], ends[i])
            else:
                times[i, 0] = bound(law, poses[i], poses[j])
            quickest[i] = _least(times[i])
        before = first[high - 1]
        if len(place) > 0 and j == first[j]:
            k, stop = place[station[j] - 1], place[station[j]]
            times[before, ways], known[before, ways] = own_times[k:stop].sum(), True
            quickest[before] = min(quickest[before], times[before, ways])
            if heads == 2:
                _head(own[k:stop], ends[before, ways])
        for after in range(heads):
            while True:
                least, e, way, head = np.inf, 0, 0, 0
                for i in range(low, high):
                    if not soonest[i] + quickest[i] < least:
                        continue
                    for w in range(ways + 1):
                        if not soonest[i] + times[i, w] < least:
                            continue
                        for h in range(heads):
                            total = reached[i, h] + times[i, w]
                            if heads == 2 and (told[i] or w == ways):
                                leaves, arrives = ends[i, w]
                                # A way that neither drives forwards nor backwards changes nothing.
                                if (h if arrives == 0.0 else int(arrives > 0.0)) != after:
                                    continue
                                if leaves * (2 * h - 1) < 0.0:
                                    total += law.reversal
                            if total < least:
                                least, e, way, head = total, i, w, h
                if least == np.inf or known[e, way]:
                    break
                if told[e]:
                    known[e, way] = motion_free(world, poses[e], steps[e, way], straight)
                    if not known[e, way]:
                        times[e, way] = np.inf
                else:
                    last = times[e, ways]
                    all_ways(law, poses[e], poses[j], few, times[e, :ways], steps[e])
                    times[e, ways], told[e] = last, True
                    if heads == 2:
                        _mark(steps[e], ends[e])
                quickest[e] = _least(times[e])
            reached[j, after] = least
            by[j, after, 0], by[j, after, 1], by[j, after, 2] = e, way, head
            if least < np.inf and way < ways:
                chosen[j, after] = steps[e, way]
        soonest[j] = _least(reached[j])
    head = int(np.argmin(reached[n - 1]))
    if reached[n - 1, head] == np.inf:
        return np.empty((0, 3)), False
    found = np.empty((len(own) + n * SEGMENTS, 3))
    j, size = n - 1, len(found)
    while j != 0:
        i, way = by[j, head, 0], by[j, head, 1]
        part = chosen[j, head] if way < ways else own[place[station[i]] : place[station[j]]]
        size -= len(part)
        found[size : size + len(part)] = part
        j, head = i, by[j, head, 2]
    return merged(found[size:], straight), True


@kernel
def _least(values: Array) -> float:
    least = np.inf
    for value in values:
        least = min(least, value)
    return least


@kernel
def _mark(steps: Array, ends: Array) -> None:
    """_head of each of some ways (ways, k, 3), into ends."""
    for way in range(len(steps)):
        _head(steps[way], ends[way])


@kernel
def _head(steps: Array, ends: Array) -> None:
    """Whether twists (k, 3) begin and end forwards (> 0), backwards (< 0) or neither (0), into ends (2,)."""
    ends[:] = 0.0
    for k in range(len(steps)):
        if steps[k, 0] != 0.0:
            ends[1] = steps[k, 0]
            if ends[0] == 0.0:
                ends[0] = steps[k, 0]


@kernel
def merged(steps: Array, straight: bool) -> Array:
    """The same steps without empty ones, and with neighbours joined where the motion simply goes on; turns
    on the spot, one after the other, are what they come to."""
    found, n = np.empty_like(steps), 0
    for k in range(len(steps)):
        x, y, turn = steps[k]
        if n > 0:
            u, v, w = found[n - 1]
            p, q = math.sqrt(u * u + v * v + w * w), math.sqrt(x * x + y * y + turn * turn)
            pivots = not straight and u == 0.0 and v == 0.0 and x == 0.0 and y == 0.0
            if not pivots and min(p, q) >= _SAME_DIRECTION:
                off = (u / p - x / q) ** 2 + (v / p - y / q) ** 2 + (w / p - turn / q) ** 2
                pivots = off < _SAME_DIRECTION**2
            if pivots:
                n -= 1
                x, y, turn = x + u, y + v, turn + w
        if math.sqrt(x * x + y * y) >= _NOTHING or abs(turn) >= _NOTHING:
            found[n, 0], found[n, 1], found[n, 2] = x, y, turn
            n += 1
    return found[:n].copy()
