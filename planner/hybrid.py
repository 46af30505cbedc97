"""Hybrid A*: a search over short motions, one pose kept for each cell of (x, y, theta). Compiled.

It follows passages that are only a little wider than the footprint, in which samples are hardly ever free:
there the cells that can be reached are few. Elsewhere its cost grows with the room, so its work is limited.

Source: Dolgov, Thrun, Montemerlo and Diebel (2010), Path planning for autonomous vehicles in unknown
semi-structured environments.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.collision import RADIUS, REACH, World
from planner.curves import SEGMENTS
from planner.edges import CURVE, LINE, Law, motion_free, moved, step_times
from planner.fits import FITS, all_ways
from planner.kernels import kernel

__all__ = ["hybrid_steps"]

_STRIDE = 4.0
"""Length of a motion, in cells."""
_BENDS = np.array([0.0, 1.0, -1.0, 2.0, -2.0, 4.0, -4.0, np.inf, -np.inf])
"""Turns of curved motions, in cells of theta; the last two as sharp as may be."""
_WEIGHT = 1.3
"""By how much distance to the goal counts for more than it takes at least."""
_NEAR = 0.5
"""The goal is tried from poses less than this share of the way from the start to it, or _WITHIN strides."""
_WITHIN, _EVERY = 16.0, 16
"""And from every so many of the others."""
_WAYS, _WAYS_WORK = 2, 8
"""Ways to the goal beside those whose radii fit, and how many checks of motions all of them cost."""


@kernel
def hybrid_steps(
    world: World, law: Law, start: Array, goal: Array, angle: float, reversal: float, limit: int
) -> tuple[Array, int]:
    """Steps (k, 3), see planner.edges, of a free path from pose start (3,) to goal, none if it found none,
    and how many motions were checked, at most about `limit`.

    angle rad: size of a cell; in x and y it is as far as that turns the footprint. reversal s: cost of a
    change of direction, and of a stop to turn on the spot. law: one that flows.
    """
    straight = law.kind == LINE
    cell = angle * (world[REACH] + world[RADIUS])
    stride = _STRIDE * cell
    moves = _moves(law, stride, angle)
    costs = step_times(law, np.zeros(len(moves)), moves)
    slowness = costs[0] / stride
    for k in range(len(moves)):
        way = math.sqrt(moves[k, 0] ** 2 + moves[k, 1] ** 2)
        if way > 0.0:
            slowness = min(slowness, costs[k] / way)
    most = limit // 4 + 2
    pose, cost, parent = np.empty((most, 3)), np.empty(most), np.empty(most, np.int64)
    step, closed = np.zeros((most, 3)), np.zeros(most, np.bool_)
    table, owner = _table(most)
    pose[0], cost[0], parent[0], count, checked = start, 0.0, -1, 1, 0
    _claim(table, owner, _key(start, start, cell, angle), 0)
    queue = [(_WEIGHT * slowness * _distance(start, goal), 0)]
    whole, best, end = _distance(start, goal), np.inf, -1
    last, times, ways = np.zeros((SEGMENTS, 3)), np.empty(_WAYS + FITS), np.zeros((_WAYS + FITS, SEGMENTS, 3))
    popped = 0
    while len(queue) > 0 and checked < limit:
        estimate, i = heapq.heappop(queue)
        if i < 0 or estimate >= best:
            break
        if closed[i]:
            continue
        closed[i] = True
        popped += 1
        # Straight to the goal?
        distance = _distance(pose[i], goal)
        if distance < max(_NEAR * whole, _WITHIN * stride) or popped % _EVERY == 1:
            all_ways(law, pose[i], goal, _WAYS, times, ways)
            checked += _WAYS_WORK
            for _ in range(len(times)):
                way = int(np.argmin(times))
                time = cost[i] + times[way] + _change(law, step[i], ways[way, 0], reversal)
                if not time < best:
                    break
                checked += 1
                if motion_free(world, pose[i], ways[way], straight):
                    best, end, last = time, i, ways[way].copy()
                    heapq.heappush(queue, (best, -1))
                    break
                times[way] = np.inf
        for k in range(len(moves)):
            p, q, turn = moves[k]
            if straight:
                c, s = math.cos(pose[i, 2]), math.sin(pose[i, 2])
                p, q = c * p - s * q, s * p + c * q
                x, y, theta = pose[i, 0] + p, pose[i, 1] + q, pose[i, 2] + turn
            else:
                x, y, theta = moved(pose[i, 0], pose[i, 1], pose[i, 2], p, q, turn)
            there = np.array([x, y, theta])
            total = cost[i] + costs[k] + _change(law, step[i], moves[k], reversal)
            key = _key(start, there, cell, angle)
            j = _owner(table, owner, key)
            if j >= 0 and (closed[j] or cost[j] <= total):
                continue
            if count == most:
                break
            checked += 1
            if not motion_free(world, pose[i], np.array([[p, q, turn]]), straight):
                continue
            j, count = count, count + 1
            pose[j], cost[j], parent[j] = there, total, i
            step[j, 0], step[j, 1], step[j, 2] = p, q, turn
            _claim(table, owner, key, j)
            heapq.heappush(queue, (total + _WEIGHT * slowness * _distance(there, goal), j))
    if end < 0:
        return np.empty((0, 3)), checked
    depth, i = 0, end
    while parent[i] >= 0:
        depth, i = depth + 1, parent[i]
    steps, i = np.zeros((depth + SEGMENTS, 3)), end
    for k in range(depth - 1, -1, -1):
        steps[k], i = step[i], parent[i]
    steps[depth:] = last
    return steps, checked


@kernel
def _distance(a: Array, b: Array) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)


@kernel
def _moves(law: Law, stride: float, angle: float) -> Array:
    """Motions (n, 3) to try from every pose: twists, or displacements in the body frame."""
    moves, n = np.zeros((32, 3)), 0
    if law.kind == LINE:
        for k in range(8):
            for turn in (0.0, 2 * angle, -2 * angle):
                moves[n, 0] = stride * math.cos(k * math.pi / 4)
                moves[n, 1], moves[n, 2] = stride * math.sin(k * math.pi / 4), turn
                n += 1
    else:
        sharpest = stride / law.radius if law.kind == CURVE else 8 * angle
        for sign in (1.0, -1.0) if law.reverse else (1.0, 1.0):
            if n > 0 and sign > 0.0:
                break
            for bend in _BENDS:
                turn = min(max(bend * angle, -sharpest), sharpest)
                if abs(bend) < np.inf and abs(turn) == sharpest:
                    continue  # the sharpest comes last
                moves[n, 0], moves[n, 2] = sign * stride, turn
                n += 1
    if law.kind != CURVE:
        for turn in (angle, -angle, 4 * angle, -4 * angle):
            moves[n, 2] = turn
            n += 1
    return moves[:n].copy()


@kernel
def _change(law: Law, before: Array, after: Array, reversal: float) -> float:
    """Cost (s) of what lies between two steps: stops, and steering."""
    if law.kind == LINE or not before.any():
        return 0.0
    if before[0] * after[0] < 0.0 or (before[0] == 0.0) != (after[0] == 0.0):
        return reversal
    if law.kind == CURVE and after[0] != 0.0:
        bent = math.atan(law.lean * after[2] / after[0]) - math.atan(law.lean * before[2] / before[0])
        return abs(bent) * law.slowness
    return 0.0


# ---------------------------------------------------------------- cells: a hash table, open addressing


@kernel
def _key(start: Array, pose: Array, cell: float, angle: float) -> int:
    """Of the cell that a pose is in."""
    i = math.floor((pose[0] - start[0]) / cell + 0.5) + (1 << 19)
    j = math.floor((pose[1] - start[1]) / cell + 0.5) + (1 << 19)
    turns = (pose[2] - start[2]) % math.tau
    k = math.floor(turns / angle + 0.5) % math.ceil(math.tau / angle)
    key: int = (((i << 20) | j) << 20) | k
    return key


@kernel
def _table(most: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    size = 16
    while size < 2 * most:
        size *= 2
    return np.full(size, -1, np.int64), np.full(size, -1, np.int64)


@kernel
def _place(table: NDArray[np.int64], key: int) -> int:
    mask = len(table) - 1
    # Neighbouring cells must not have neighbouring places: every bit of the key counts (Steele, 2014).
    mixed = (key ^ (key >> 32)) * 0x7FB5D329728EA185
    mixed = (mixed ^ (mixed >> 29)) * 0x1DADEF4BC2DD44D5
    place = (mixed ^ (mixed >> 32)) & mask
    while table[place] != -1 and table[place] != key:
        place = (place + 1) & mask
    return int(place)


@kernel
def _owner(table: NDArray[np.int64], owner: NDArray[np.int64], key: int) -> int:
    """The pose that a cell keeps, -1: none."""
    pose: int = owner[_place(table, key)]
    return pose


@kernel
def _claim(table: NDArray[np.int64], owner: NDArray[np.int64], key: int, pose: int) -> None:
    place = _place(table, key)
    table[place], owner[place] = key, pose
