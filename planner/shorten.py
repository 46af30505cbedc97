"""Path → quicker Path: shortcuts between poses along it, every one checked, chosen together by their time."""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array, Pose
from planner.connect import Connector
from planner.path import Path, merge

__all__ = ["shorten"]

_STATIONS = 24
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
    poses, parts = _stations(path)
    first, second = np.triu_indices(len(poses), 1)
    motions = connector.motions(poses[first], poses[second])
    times = np.where(motions.free(), motions.times, np.inf)
    # Of every pair the quickest way; neighbours may also be joined by what the path itself does there.
    way = times.argmin(1)
    time = times[np.arange(len(way)), way]
    own = np.full(len(time), np.inf)
    own[second == first + 1] = connector.durations(parts)
    cost = np.full((len(poses), len(poses)), np.inf)
    cost[first, second] = np.minimum(time, own)
    reach, by = np.zeros(len(poses)), np.zeros(len(poses), dtype=int)
    for j in range(1, len(poses)):
        total = reach[:j] + cost[:j, j]
        by[j] = total.argmin()
        reach[j] = total[by[j]]
    chain = [len(poses) - 1]
    while chain[-1] > 0:
        chain.append(int(by[chain[-1]]))
    pair = np.zeros(cost.shape, dtype=int)
    pair[first, second] = np.arange(len(first))
    steps: list[Path] = []
    for i, j in zip(chain[:0:-1], chain[-2::-1], strict=True):
        k = int(pair[i, j])
        steps.append((parts[i],) if own[k] <= time[k] else motions.path(k, int(way[k])))
    return _unwrapped(path[0].start, steps)


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
    shares = np.maximum(1, np.floor(_STATIONS * ways / ways.sum())).astype(int)
    parts = tuple(
        piece.part(k / n, (k + 1) / n)
        for piece, n in zip(path, shares.tolist(), strict=True)
        for k in range(n)
    )
    return np.array([parts[0].start, *(part.end for part in parts)]), parts
