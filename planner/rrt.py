"""RRTConnect (Kuffner and LaValle, 2000), compiled: a tree of motions from the start and one from the goals
grow until they meet.

They grow in coordinates: of poses themselves, or of a Route. Which node is nearest is told by the distance of
coordinates, of curves, too: their lengths take longer to tell and lead no sooner to the goal.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.collision import World, pose_free
from planner.curves import SEGMENTS
from planner.edges import CURVE, curve, joined, moved
from planner.route import route_pose
from planner.tree import kernel

__all__ = ["CHECKED", "Space", "Trees", "driven", "grow", "roomier", "rooted"]

# Of the counts of trees.
_NEXT, CHECKED, _MET = 2, 3, 4


class Space(NamedTuple):
    """Where trees grow.

    legs, shape: of a Route; legs (0, 5): coordinates are poses. low, high (3,): what is drawn. turn: how far
    a radian is. stride: how far apart coordinates may be that a motion joins. kind, radius, reverse: see
    planner.edges.joined.
    """

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
    counts (6,): nodes of either, which is extended next, motions CHECKED, and the two nodes that met."""

    nodes: Array
    parents: NDArray[np.int64]
    counts: NDArray[np.int64]


def rooted(start: Array, goals: Array, room: int) -> Trees:
    """Trees of nothing but roots (6,) and (k, 6), and with room for so many more nodes."""
    size = room + len(goals)
    trees = Trees(np.empty((2, size, 6)), np.full((2, size), -1), np.zeros(6, np.int64))
    trees.nodes[0, 0], trees.nodes[1, : len(goals)] = start, goals
    trees.counts[:2] = 1, len(goals)
    return trees


def roomier(trees: Trees, more: int) -> Trees:
    """The same with room for so many more nodes."""
    nodes, parents, counts = trees
    missing = int(counts[:2].max()) + more - nodes.shape[1]
    if missing <= 0:
        return trees
    missing = max(missing, nodes.shape[1])
    nodes = np.concatenate([nodes, np.empty((2, missing, 6))], axis=1)
    return Trees(nodes, np.concatenate([parents, np.full((2, missing), -1)], axis=1), counts)


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
    trees.counts[CHECKED] += 1
    ax, ay, ath = node[3], node[4], node[5]
    if ahead:
        free = joined(world, space.kind, space.radius, space.reverse, ax, ay, ath, px, py, heading, steps)
    else:
        free = joined(world, space.kind, space.radius, space.reverse, px, py, heading, ax, ay, ath, steps)
    if free:
        k = trees.counts[tree]
        node = trees.nodes[tree, k]
        node[0], node[1], node[2], node[3], node[4], node[5] = x, y, theta, px, py, heading
        trees.parents[tree, k] = near
        trees.counts[tree] += 1
    return free, free and reached


@kernel
def grow(world: World, space: Space, trees: Trees, random: np.random.Generator, work: int) -> bool:
    """Whether the trees have met; they grow until then, or until about so many motions have been checked,
    twenty times as many poses drawn, or there is no more room for nodes."""
    counts = trees.counts
    steps = np.empty((SEGMENTS, 3))
    end, room = counts[CHECKED] + work, trees.nodes.shape[1]
    for _ in range(20 * work):
        if counts[CHECKED] >= end or max(counts[0], counts[1]) + 1 >= room:
            return False
        x = random.uniform(space.low[0], space.high[0])
        y = random.uniform(space.low[1], space.high[1])
        theta = random.uniform(space.low[2], space.high[2])
        px, py, heading = _pose(space, x, y, theta)
        if not pose_free(world, px, py, heading):
            continue
        tree = counts[_NEXT]
        other = 1 - tree
        grown, _ = _extended(world, space, trees, tree, x, y, theta, steps)
        if grown:
            last = counts[tree] - 1
            node = trees.nodes[tree, last]
            while counts[other] < room:
                grown, reached = _extended(world, space, trees, other, node[0], node[1], node[2], steps)
                if reached:
                    counts[_MET + tree], counts[_MET + other] = last, counts[other] - 1
                    return True
                if not grown:
                    break
        counts[_NEXT] = other
    return False


@kernel
def driven(world: World, space: Space, trees: Trees) -> Array:
    """The steps (k, 3) from the start to a goal, of trees that have met."""
    nodes, parents, counts = trees
    n = counts[_MET]
    back = [n]
    while parents[0, n] >= 0:
        n = parents[0, n]
        back.append(n)
    poses = [nodes[0, k, 3:] for k in back[::-1]]
    n = parents[1, counts[_MET + 1]]
    while n >= 0:
        poses.append(nodes[1, n, 3:])
        n = parents[1, n]
    found, steps, size = np.empty((SEGMENTS * len(poses), 3)), np.empty((SEGMENTS, 3)), 0
    for i in range(len(poses) - 1):
        (ax, ay, ath), (bx, by, bth) = poses[i], poses[i + 1]
        joined(world, space.kind, space.radius, space.reverse, ax, ay, ath, bx, by, bth, steps)
        for step in steps:
            if step.any():
                found[size], size = step, size + 1
    return found[:size].copy()
