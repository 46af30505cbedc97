"""Path → quicker Path: shortcuts between poses along it, every one checked, chosen together by their time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drives.se2 import Array, Pose
from planner.connect import Connector, is_path_free
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


@dataclass(slots=True)
class _Join:
    """One way from station i to station j."""

    i: int
    j: int
    time: float
    pair: int
    way: int
    path: Path | None = None


def _shortcut(path: Path, connector: Connector) -> Path:
    poses, between = _stations(path)
    last = len(poses) - 1
    first, second = np.triu_indices(last + 1, 1)
    motions = connector.motions(poses[first], poses[second])
    # Every pair may be joined by the connector's motions; neighbours also by what the path itself does there.
    into: list[list[_Join]] = [[] for _ in poses]
    pairs, ways = np.nonzero(np.isfinite(motions.times))
    for pair, way, time in zip(
        pairs.tolist(), ways.tolist(), motions.times[pairs, ways].tolist(), strict=True
    ):
        i, j = int(first[pair]), int(second[pair])
        into[j].append(_Join(i, j, time, pair, way))
    known = set()
    for i, step in enumerate(between):
        join = _Join(i, i + 1, connector.duration(step), -1, -1, step)
        into[i + 1].append(join)
        known.add(id(join))
    # Lazy: find the quickest chain as if all were free, check what it uses, and again without what is not.
    while True:
        chain = _quickest(into)
        blocked = False
        for join in chain:
            if id(join) in known:
                continue
            join.path = motions.path(join.pair, join.way)
            if is_path_free(connector.world, join.path):
                known.add(id(join))
            else:
                into[join.j] = [other for other in into[join.j] if other is not join]
                blocked = True
        if not blocked:
            return _unwrapped(path[0].start, [join.path or () for join in chain])


def _quickest(into: list[list[_Join]]) -> list[_Join]:
    """The chain of joins from the first station to the last that takes least time."""
    reach = [0.0] + [math.inf] * (len(into) - 1)
    by: list[_Join | None] = [None] * len(into)
    for j in range(1, len(into)):
        for join in into[j]:
            time = reach[join.i] + join.time
            if time < reach[j]:
                reach[j], by[j] = time, join
    chain: list[_Join] = []
    last = by[-1]
    while last is not None:
        chain.append(last)
        last = by[last.i]
    return chain[::-1]


def _unwrapped(start: Pose, steps: list[Path]) -> Path:
    """The steps one after the other, headings continuous though each began on its own branch."""
    pieces = []
    theta = start.theta
    for piece in (piece for step in steps for piece in step):
        turns = round((theta - piece.start.theta) / math.tau) * math.tau
        pieces.append(piece.turned(turns))
        theta = pieces[-1].end.theta
    return merge(pieces)


def _stations(path: Path) -> tuple[Array, list[Path]]:
    """Poses (n, 3) along the path, ends of pieces included, and the parts of the path between them."""
    ways = np.array([piece.length + 0.1 * abs(piece.turn) for piece in path])
    shares = np.maximum(1, np.floor(_STATIONS * ways / ways.sum())).astype(int)
    parts = [
        piece.part(k / n, (k + 1) / n)
        for piece, n in zip(path, shares.tolist(), strict=True)
        for k in range(n)
    ]
    poses = np.array([parts[0].start, *(part.end for part in parts)])
    return poses, [(part,) for part in parts]
