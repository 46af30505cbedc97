"""Path → quicker Path: shortcuts between poses along it, every one checked, chosen together by their time."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np

from drives.se2 import Pose
from planner.connect import Connector, is_path_free
from planner.path import Path, merge

__all__ = ["shorten"]

_ROUNDS = 4
_GAIN = 0.995
"""A round that leaves more than this share of the time was the last."""


def shorten(path: Path, connector: Connector, stations: int) -> Path:
    """The quickest path, by estimate, that joins some of the poses along the given one by the connector's motions.

    stations: how many poses along the path are considered. Start and end stay; the end's heading may change by
    whole turns. The result is free if the path is.
    """
    best, time = path, connector.durations([path])[0]
    for _ in range(_ROUNDS):
        shorter = _shortcut(best, connector, stations)
        quicker = connector.durations([shorter])[0]
        if quicker >= time:
            return best
        done = quicker > _GAIN * time
        best, time = shorter, quicker
        if done:
            return best
    return best


def _shortcut(path: Path, connector: Connector, stations: int) -> Path:
    poses, between = _stations(path, stations)
    last = len(poses) - 1
    # Every pair may be joined by what the path itself does there, or by the connector's own motions.
    joins: list[tuple[int, int, Path, bool]] = [(i, i + 1, step, True) for i, step in enumerate(between)]
    for i, j in combinations(range(last + 1), 2):
        joins += [(i, j, step, False) for step in connector.paths(poses[i], poses[j])]
    times = connector.durations([step for _, _, step, _ in joins])
    into: list[list[tuple[float, int]]] = [[] for _ in poses]
    for k, (_, j, _, _) in enumerate(joins):
        into[j].append((times[k], k))
    # Lazy: find the quickest chain as if all were free, check what it uses, and again without what is not.
    free = [known for *_, known in joins]
    while True:
        reach = [0.0] + [math.inf] * last
        by = [-1] * (last + 1)
        for j in range(1, last + 1):
            for cost, k in into[j]:
                if reach[joins[k][0]] + cost < reach[j]:
                    reach[j], by[j] = reach[joins[k][0]] + cost, k
        chain, j = [], last
        while j > 0:
            chain.append(by[j])
            j = joins[by[j]][0]
        blocked = [k for k in chain if not free[k] and not is_path_free(connector.world, joins[k][2])]
        for k in set(chain) - set(blocked):
            free[k] = True
        if not blocked:
            return _unwrapped(poses[0], [joins[k][2] for k in reversed(chain)])
        for k in blocked:
            into[joins[k][1]].remove((times[k], k))


def _unwrapped(start: Pose, steps: list[Path]) -> Path:
    """The steps one after the other, headings continuous though each began on its own branch."""
    pieces = []
    theta = start.theta
    for piece in (piece for step in steps for piece in step):
        turns = round((theta - piece.start.theta) / (2 * math.pi)) * 2 * math.pi
        pieces.append(piece.turned(turns))
        theta = pieces[-1].end.theta
    return merge(pieces)


def _stations(path: Path, count: int) -> tuple[list[Pose], list[Path]]:
    """Poses along the path, ends of pieces included, and the parts of the path between them."""
    ways = np.array([piece.length + 0.1 * abs(piece.turn) for piece in path])
    shares = np.maximum(1, np.floor(count * ways / ways.sum())).astype(int)
    parts = [
        piece.part(k / n, (k + 1) / n) for piece, n in zip(path, shares.tolist(), strict=True) for k in range(n)
    ]
    return [parts[0].start, *(part.end for part in parts)], [(part,) for part in parts]
