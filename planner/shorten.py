"""Path → quicker Path: shortcuts between poses along it, every one checked, chosen together by their time."""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array, Pose
from planner.connect import Connector
from planner.path import Path, Piece, TwistPiece, merge

__all__ = ["shorten"]

_STATIONS = 24
"""Poses along the path, more where it is longer than as many metres or has more pieces. Where they are more
than four times as many, shortcuts reach over so many of them at most: the cost is linear in the length."""
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
    n = len(poses)
    first, second = np.triu_indices(n, 1)
    span = n if n <= 4 * _STATIONS else _STATIONS
    near = second - first <= span
    first, second = first[near], second[near]
    motions = connector.motions(poses[first], poses[second])
    # Of neighbours there is one way more: what the path itself does there.
    own = np.full(len(first), np.inf)
    own[second == first + 1] = connector.durations(parts)
    heads = np.zeros((len(first), 1, 2))
    heads[second == first + 1] = [[[_heads(part)] * 2] for part in parts]
    times = np.column_stack([np.where(motions.free(), motions.times, np.inf), own])
    heads = np.concatenate([motions.heads, heads], 1)
    pair = np.zeros((n, n), dtype=int)
    pair[first, second] = np.arange(len(first))
    # The least time to every pose, arriving backwards or forwards.
    reach = np.full((n, 2), np.inf)
    reach[0] = 0.0
    by = np.zeros((n, 2, 3), dtype=int)
    for j in range(1, n):
        least = max(0, j - span)
        edges = pair[least:j, j]
        for before, after in np.ndindex(2, 2):
            begin, end = heads[edges].transpose(2, 0, 1)
            # A way that neither drives forwards nor backwards changes nothing.
            arrives = np.where(end == 0, before, end > 0) == after
            turns = np.where(begin * (2 * before - 1) < 0, connector.reversal, 0.0)
            total = np.where(arrives, reach[least:j, before, None] + times[edges] + turns, np.inf)
            i, way = np.unravel_index(int(total.argmin()), total.shape)
            if total[i, way] < reach[j, after]:
                reach[j, after], by[j, after] = total[i, way], (least + i, way, before)
    steps: list[Path] = []
    j, head = n - 1, int(reach[n - 1].argmin())
    while j > 0:
        i, way, before = by[j, head].tolist()
        k = int(pair[i, j])
        steps.append((parts[i],) if way == motions.times.shape[1] else motions.path(k, way))
        j, head = i, before
    return _unwrapped(path[0].start, steps[::-1])


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
    count = max(_STATIONS, ways.sum())
    shares = np.maximum(1, np.floor(count * ways / ways.sum())).astype(int)
    parts = tuple(
        piece.part(k / n, (k + 1) / n)
        for piece, n in zip(path, shares.tolist(), strict=True)
        for k in range(n)
    )
    return np.array([parts[0].start, *(part.end for part in parts)]), parts
