"""Path → quicker Path: shortcuts between poses along it, chosen together by their time; those chosen are
checked."""

from __future__ import annotations

import math
from itertools import count

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array, Pose
from planner.connect import Connector
from planner.path import Path, Piece, TwistPiece, merge
from planner.tree import kernel

__all__ = ["shorten"]

_STATIONS = 24
"""Poses along the path, more where it is longer than as many metres or has more pieces. Where they are more
than four times as many, shortcuts reach over so many of them at most: the cost is linear in the length."""
_MOST_STATIONS = 1000
_LAZY = 40
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
    stations, parts = _stations(path)
    poses, station = _turned(stations, connector)
    n = len(stations)
    span = n if n <= 4 * _STATIONS else _STATIONS
    ahead = station[None] - station[:, None]
    first, second = np.nonzero((ahead > 0) & (ahead <= span))
    order = np.argsort(station[second], kind="stable")
    first, second = first[order], second[order]
    motions = connector.motions(poses[first], poses[second])
    # Of neighbours there is one way more: what the path itself does there.
    here = np.flatnonzero((second == first + 1) & (second < n))
    own = np.full(len(first), np.inf)
    own[here] = connector.durations(parts)[first[here]]
    heads = np.zeros((len(first), 1, 2))
    heads[here] = np.array([_heads(part) for part in parts])[first[here], None, None]
    times, heads = np.column_stack([motions.times, own]), np.concatenate([motions.heads, heads], 1)
    known = np.zeros(times.shape, dtype=np.bool_)
    known[here, -1] = True
    for attempt in count():
        if attempt == _LAZY:
            known[:, :-1] = motions.free()
            times[~known] = np.inf
        edges, ways = _quickest(first, second, times, heads, n - 1, connector.reversal)
        asked = [key for key in zip(edges.tolist(), ways.tolist(), strict=True) if not known[key]]
        for i, way in asked:
            known[i, way] = motions.free(slice(i, i + 1), slice(way, way + 1))[0, 0]
            if not known[i, way]:
                times[i, way] = np.inf
        if all(known[key] for key in asked):
            break
    steps: list[Path] = [
        (parts[first[i]],) if way == motions.times.shape[1] else motions.path(i, way)
        for i, way in zip(edges.tolist(), ways.tolist(), strict=True)
    ]
    return _unwrapped(path[0].start, steps)


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
def _quickest(
    first: NDArray[np.intp], second: NDArray[np.intp], times: Array, heads: Array, goal: int, reversal: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The edges and ways that lead from pose 0 to the goal in the least time.

    Edge e leads from pose first[e] to second[e]; no later edge leads to where it begins. times (e, ways) s,
    heads (e, ways, 2) as of Motions. reversal s: of a change of direction.
    """
    n = max(second.max(), first.max()) + 1
    reach = np.full((n, 2), np.inf)  # arriving backwards, forwards
    reach[0] = 0.0
    by = np.zeros((n, 2, 3), dtype=np.intp)
    for e in range(len(first)):
        i, j = first[e], second[e]
        for way in range(times.shape[1]):
            for before in range(2):
                total = reach[i, before] + times[e, way]
                begin, end = heads[e, way, 0], heads[e, way, 1]
                if begin * (2 * before - 1) < 0.0:
                    total += reversal
                # A way that neither drives forwards nor backwards changes nothing.
                after = before if end == 0.0 else int(end > 0.0)
                if total < reach[j, after]:
                    reach[j, after] = total
                    by[j, after, 0], by[j, after, 1], by[j, after, 2] = e, way, before
    edges, ways = np.empty(n, np.intp), np.empty(n, np.intp)
    j, head, length = goal, int(reach[goal, 1] < reach[goal, 0]), 0
    while j != 0:
        e, way, before = by[j, head]
        edges[length], ways[length] = e, way
        j, head, length = first[e], before, length + 1
    return edges[:length][::-1].copy(), ways[:length][::-1].copy()


def _heads(piece: Piece) -> float:
    """1 where a piece drives forwards, -1 backwards, 0 neither."""
    return float(np.sign(piece.twist.vx)) if isinstance(piece, TwistPiece) else 0.0


def _unwrapped(start: Pose, steps: list[Path]) -> Path:
    """The steps one after the other, headings continuous though each began on its own branch."""
    pieces = []
    theta = start.theta
    for piece in (piece for step in steps for piece in step):
        turns = round((theta - piece.start.theta) / math.tau) * math.tau
        pieces.append(piece.turned(turns))
        theta = pieces[-1].end.theta
    return merge(pieces)


def _stations(path: Path) -> tuple[Array, Path]:
    """Poses (n, 3) along the path, ends of pieces included, and the parts of the path between them."""
    ways = np.array([piece.length + 0.1 * abs(piece.turn) for piece in path])
    wanted = min(max(_STATIONS, ways.sum()), _MOST_STATIONS)
    shares = np.maximum(1, np.floor(wanted * ways / ways.sum())).astype(int)
    parts = tuple(
        piece.part(k / n, (k + 1) / n)
        for piece, n in zip(path, shares.tolist(), strict=True)
        for k in range(n)
    )
    return np.array([parts[0].start, *(part.end for part in parts)]), parts
