"""Poses in a row → the quickest free path through some of them: a roadmap without a search."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array, Pose
from planner.connect import Connector
from planner.edges import motion_free
from planner.environment import World
from planner.path import Path, as_path, merge
from planner.tree import kernel

__all__ = ["Known", "quickest_path"]

Known = tuple[Array, Array, NDArray[np.intp]]
"""A free path that leads by all stations: steps, where they begin and the last ends (m + 1, 3), what they do
(m, 3), and which of those begins (n,) are the stations."""


def quickest_path(
    poses: Array,
    station: NDArray[np.intp],
    reach: float,
    connector: Connector,
    ways: int,
    known: Known | None = None,
) -> Path | None:
    """The quickest free path, by estimate, from the first pose to the last station, by the connector's
    motions; None: there is none.

    poses (n, 3), and the station (n,) that each is at: 0, 1, 2, … in a row, and maybe others after them.
    reach: how many stations further a motion may lead. ways: how many of each pair are tried. known: a path
    whose steps from one station to the next may be taken, too.
    """
    first, second = _ahead(station, reach)
    order = np.lexsort((second, station[second]))
    first, second = first[order], second[order]
    motions = connector.motions(poses[first], poses[second], ways)
    n = int(station.max()) + 1
    begin, own, place = known or (poses[:1], np.zeros((0, 3)), np.zeros(n, np.intp))
    own_times = np.full(n - 1, np.inf)
    if known is not None:
        own_times = np.add.reduceat(connector.durations(begin[:-1], own), place[:-1])
    edges, chosen = _quickest_free(
        connector.world.kernel, first, second, motions.start, motions.times, motions.steps, motions.straight,
        own, place, own_times, connector.reversal,
    )  # fmt: skip
    if len(edges) == 0:
        return None
    parts = [
        motions.path(e, way)
        if way >= 0
        else as_path(begin[place[i]], own[place[i] : place[i + 1]], motions.straight)
        for e, i, way in zip(edges.tolist(), first[edges].tolist(), chosen.tolist(), strict=True)
    ]
    return _unwrapped(Pose(*poses[0].tolist()), parts)


def _ahead(station: NDArray[np.intp], reach: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """All pairs of poses, given the station of each, of which the second is ahead, by `reach` stations at
    most."""
    order = np.argsort(station, kind="stable")
    begin, end = (np.searchsorted(station[order], station + k, "right") for k in (0, reach))
    count = end - begin
    first = np.repeat(np.arange(len(station)), count)
    return first, order[np.arange(len(first)) + np.repeat(begin - np.cumsum(count) + count, count)]


@kernel
def _quickest_free(
    world: World, first: NDArray[np.intp], second: NDArray[np.intp], start: Array, times: Array, steps: Array,
    straight: bool, own: Array, place: NDArray[np.intp], own_times: Array, reversal: float,
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:  # fmt: skip
    """The edges and ways that lead from pose 0 to the last station in the least time and are free, or none.

    Edge e leads from pose first[e] to second[e], in the order of these; no later edge leads to where it
    begins. start, times, steps, straight: of the edges' Motions. own_times (n - 1,): of what the path does
    from one of its n stations to the next, free steps own[place[i] : place[i + 1]]; its way is -1.
    reversal s: of a change of direction.
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
    if min(reach[goal]) == np.inf:
        return edges[:0], chosen[:0]
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
