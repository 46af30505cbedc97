"""RRTConnect (Kuffner and LaValle, 2000), compiled: one tree of motions from the start and one from the goals,
until they meet.

Trees grow in coordinates: of poses themselves, or of a Route. Draws are the compiled code's own, from a seed;
what is found depends on that and on nothing else.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.collision import World, pose_free
from planner.edges import CURVE, curve, joined, moved
from planner.route import route_pose
from planner.tree import kernel

__all__ = ["Space", "Trees", "chain", "driven", "grow", "roomier", "rooted", "seeded"]

class Space(NamedTuple):
    """Where trees grow. legs, shape: of a Route; legs (0, 5): coordinates are poses. low, high (3,): what is
    drawn. turn: how far a radian is. stride: how far apart coordinates may be that a motion joins. kind, radius,
    reverse: see planner.edges.joined."""

    legs: Array
    shape: Array
    low: Array
    high: Array
    turn: float
    stride: float
    kind: int
    radius: float
    reverse: bool


class Trees(NamedTuple):
    """Of the start and of the goals. nodes (2, n, 6): coordinates and pose. parents (2, n): -1 at roots.
    counts (6,): nodes of either, the one to be extended next, motions checked, and the nodes that met."""

    nodes: Array
    parents: NDArray[np.int64]
    counts: NDArray[np.int64]


def rooted(space: Space, starts: Array, goals: Array) -> Trees:
    """Trees of nothing but roots, at coordinates (1, 3) and (k, 3)."""
    room = 512
    trees = Trees(np.empty((2, room, 6)), np.full((2, room), -1), np.zeros(6, np.int64))
    for tree, roots in enumerate((starts, goals)):
        for at in roots:
            _add(trees, tree, *at, *_pose(space, *at), -1)
    return trees


def roomier(trees: Trees, more: int) -> Trees:
    """The same with room for so many more nodes."""
    nodes, parents, counts = trees
    missing = int(counts[:2].max()) + more + 64 - nodes.shape[1]
    if missing <= 0:
        return trees
    missing = max(missing, nodes.shape[1])
    nodes = np.concatenate([nodes, np.empty((2, missing, 6))], axis=1)
    return Trees(nodes, np.concatenate([parents, np.full((2, missing), -1)], axis=1), counts)


@kernel
def seeded(seed: int) -> None:
    """Begin the draws anew."""
    np.random.seed(seed)


@kernel
def _pose(space: Space, s: float, left: float, angle: float) -> tuple[float, float, float]:
    """The pose at coordinates."""
    if len(space.legs) == 0:
        return s, left, angle
    return route_pose(space.legs, space.shape, s, left, angle)


@kernel
def _nearest(space: Space, nodes: Array, count: int, x: float, y: float, theta: float) -> tuple[int, float]:
    """The node that coordinates are nearest to, and how far from it they are."""
    nearest, least = 0, np.inf
    for k in range(count):
        dx, dy, turn = x - nodes[k, 0], y - nodes[k, 1], theta - nodes[k, 2]
        turn -= math.tau * math.floor(turn / math.tau + 0.5)
        d = math.sqrt(dx * dx + dy * dy) + space.turn * abs(turn)
        if d < least:
            nearest, least = k, d
    return nearest, least


@kernel
def _towards(
    space: Space, a: Array, x: float, y: float, theta: float, share: float, ahead: bool, steps: Array
) -> tuple[float, float, float]:
    """The coordinates at a share of the way from a node's to others, or of the way back."""
    if space.kind == CURVE and len(space.legs) == 0:
        px, py, heading = a[0], a[1], a[2]
        if ahead:
            curve(px, py, heading, x, y, theta, space.radius, space.reverse, steps)
        else:
            curve(x, y, theta, px, py, heading, space.radius, space.reverse, steps)
            px, py, heading, share = x, y, theta, 1.0 - share
        length = 0.0
        for k in range(len(steps)):
            length += abs(steps[k, 0])
        left = share * length
        for k in range(len(steps)):
            part = min(1.0, left / abs(steps[k, 0])) if steps[k, 0] != 0.0 else 0.0
            px, py, heading = moved(px, py, heading, part * steps[k, 0], 0.0, part * steps[k, 2])
            left -= part * abs(steps[k, 0])
        return px, py, heading
    turn = theta - a[2]
    turn -= math.tau * math.floor(turn / math.tau + 0.5)
    angle = a[2] + share * turn
    angle -= math.tau * math.floor(angle / math.tau + 0.5)
    return a[0] + share * (x - a[0]), a[1] + share * (y - a[1]), angle


@kernel
def _add(
    trees: Trees, tree: int, s: float, left: float, angle: float, x: float, y: float, theta: float, parent: int
) -> None:
    k = trees.counts[tree]
    node = trees.nodes[tree, k]
    node[0], node[1], node[2], node[3], node[4], node[5] = s, left, angle, x, y, theta
    trees.parents[tree, k] = parent
    trees.counts[tree] += 1


@kernel
def _extended(
    world: World, space: Space, trees: Trees, tree: int, x: float, y: float, theta: float, steps: Array
) -> tuple[bool, bool]:
    """Whether a tree has grown by a motion towards coordinates, and whether it has reached them."""
    ahead = tree == 0
    near, d = _nearest(space, trees.nodes[tree], trees.counts[tree], x, y, theta)
    node = trees.nodes[tree, near]
    reached = d <= space.stride
    if not reached:
        x, y, theta = _towards(space, node, x, y, theta, space.stride / d, ahead, steps)
    px, py, heading = _pose(space, x, y, theta)
    if not pose_free(world, px, py, heading):
        return False, False
    trees.counts[3] += 1
    ax, ay, ath = node[3], node[4], node[5]
    if ahead:
        free = joined(
            world, space.kind, space.radius, space.reverse, ax, ay, ath, px, py, heading, steps
        )
    else:
        free = joined(
            world, space.kind, space.radius, space.reverse, px, py, heading, ax, ay, ath, steps
        )
    if free:
        _add(trees, tree, x, y, theta, px, py, heading, near)
    return free, free and reached


@kernel
def grow(world: World, space: Space, trees: Trees, work: int) -> bool:
    """Whether the trees have met; they grow until then, or until about so many motions have been checked, or
    twenty times as many draws, or there is no more room for nodes."""
    counts = trees.counts
    steps = np.empty((5, 3))
    end, room = counts[3] + work, trees.nodes.shape[1]
    for _ in range(20 * work):
        if counts[3] >= end or max(counts[0], counts[1]) + 1 >= room:
            return False
        x = np.random.uniform(space.low[0], space.high[0])
        y = np.random.uniform(space.low[1], space.high[1])
        theta = np.random.uniform(space.low[2], space.high[2])
        px, py, heading = _pose(space, x, y, theta)
        if not pose_free(world, px, py, heading):
            continue
        tree = counts[2]
        other = 1 - tree
        grown, _ = _extended(world, space, trees, tree, x, y, theta, steps)
        if grown:
            last = counts[tree] - 1
            node = trees.nodes[tree, last]
            while counts[other] < room:
                grown, reached = _extended(world, space, trees, other, node[0], node[1], node[2], steps)
                if reached:
                    counts[4 + tree], counts[4 + other] = last, counts[other] - 1
                    return True
                if not grown:
                    break
        counts[2] = other
    return False


@kernel
def chain(trees: Trees) -> Array:
    """The poses (n, 3) from the start to a goal, of trees that have met."""
    nodes, parents, counts = trees
    k, n = parents[1, counts[5]], counts[4]
    size = 1
    while parents[0, n] >= 0:
        n, size = parents[0, n], size + 1
    before = size
    while k >= 0:
        k, size = parents[1, k], size + 1
    found = np.empty((size, 3))
    n, k = counts[4], parents[1, counts[5]]
    for i in range(before - 1, -1, -1):
        found[i], n = nodes[0, n, 3:], parents[0, n]
    for i in range(before, size):
        found[i], k = nodes[1, k, 3:], parents[1, k]
    return found


@kernel
def driven(world: World, space: Space, poses: Array) -> Array:
    """The steps (k, 3) from pose to pose of a chain (n, 3)."""
    found, steps, size = np.empty((5 * len(poses), 3)), np.empty((5, 3)), 0
    for k in range(len(poses) - 1):
        (ax, ay, ath), (bx, by, bth) = poses[k], poses[k + 1]
        joined(world, space.kind, space.radius, space.reverse, ax, ay, ath, bx, by, bth, steps)
        for step in steps:
            if step.any():
                found[size], size = step, size + 1
    return found[:size].copy()
