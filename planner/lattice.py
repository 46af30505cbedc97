"""Short ways of a disc, as roomy as may be: A* over a lattice of its centres.

The lattice is kept in blocks that come to be where the search arrives: what it costs depends on the way, not
on the world's size.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.collision import COLUMNS, FIELD, ROWS, SOLIDS, STEP, World, field_bounds, solid
from planner.kernels import kernel
from planner.tree import nearest

__all__ = ["roomiest", "rooms", "shortest", "smooth"]

_SHYNESS = 3.0
"""How much dearer a metre is where the disc only just fits than where the footprint may turn."""
_USED = 4.0
"""How much dearer it is where an earlier route went."""
_SIDE = 16
_NODES = _SIDE * _SIDE
"""Nodes along a block of the lattice, and in it."""
_HALF = 1 << 14
"""Nodes that a lattice reaches at most to either side of where it begins."""
_COST, _PRICE, _PARENT, _PASSED = 0, 1, 2, 3
"""What is kept of a node: the cost (m) of the best way to it; the price of a metre, 0 where it is not known
yet, inf where the disc does not fit, negative once the node was looked at; the node before it; whether an
earlier route came by."""


@kernel
def _room(world: World, x: float, y: float, least: float, most: float) -> float:
    """Distance (m) from a point to what is closed: 0 where it is below `least`, at most about `most`."""
    low, high = field_bounds(world, x, y)
    if high < least:
        return 0.0
    if low < most:
        low = nearest(world, int(world[SOLIDS]), int(world[FIELD]), x, y, most)
        if low < least or solid(world, x, y, low):
            return 0.0
    return low


@kernel
def rooms(world: World, points: Array, most: float) -> Array:
    """Distances (n,) m from points (n, 2), own frame, to what is closed, at most `most`."""
    found = np.empty(len(points))
    for k in range(len(points)):
        found[k] = min(_room(world, points[k, 0], points[k, 1], 0.0, most), most)
    return found


@kernel
def _roomiest(
    world: World, x: float, y: float, room: float, least: float, most: float, spacing: float
) -> tuple[float, float, float]:
    """The point of a lattice's cell where there is most room, or about, and the room (m) that it has."""
    if room >= least + spacing / 2:
        return x, y, room
    room = _room(world, x, y, max(least - spacing, 0.0), most)
    step = spacing / 4
    for _ in range(6):
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            more = _room(world, x + dx * step, y + dy * step, room, most)
            if more > room + 1e-9:
                x, y, room = x + dx * step, y + dy * step, more
        step /= 2
    return x, y, room


@kernel
def roomiest(world: World, way: Array, least: float, most: float, spacing: float) -> Array:
    """The way (n, 2), each point but its ends moved to where its cell has most room; `least` and `most` as of
    `shortest`."""
    found = way.copy()
    for k in range(1, len(way) - 1):
        room = _room(world, way[k, 0], way[k, 1], least, most)
        x, y, _ = _roomiest(world, way[k, 0], way[k, 1], room, least, most, spacing)
        found[k, 0], found[k, 1] = x, y
    return found


@kernel
def smooth(world: World, way: Array, enough: float) -> Array:
    """The way (n, 2) without the lattice's corners; its ends stay, and points that would come nearer than
    `enough` (m) to what is closed, and nearer than they are."""
    way = way.copy()
    for _ in range(4):
        before = way.copy()
        for k in range(1, len(way) - 1):
            x = (before[k - 1, 0] + 2 * before[k, 0] + before[k + 1, 0]) / 4
            y = (before[k - 1, 1] + 2 * before[k, 1] + before[k + 1, 1]) / 4
            room = _room(world, x, y, 0.0, enough)
            if room >= enough or room >= _room(world, before[k, 0], before[k, 1], 0.0, enough):
                way[k, 0], way[k, 1] = x, y
    return way


@kernel
def _node(blocks: NDArray[np.int32], i: int, j: int) -> int:
    """Where node (i, j) is kept."""
    return int(blocks[j // _SIDE, i // _SIDE]) * _NODES + j % _SIDE * _SIDE + i % _SIDE


@kernel
def _opened(
    blocks: NDArray[np.int32], corners: list[tuple[int, int]], nodes: Array, i: int, j: int, beyond: int
) -> Array:
    """The nodes (n, 4) with all blocks that come within `beyond` nodes of (i, j)."""
    rows, columns = blocks.shape
    for row in range(max(j - beyond, 0) // _SIDE, min((j + beyond) // _SIDE + 1, rows)):
        for column in range(max(i - beyond, 0) // _SIDE, min((i + beyond) // _SIDE + 1, columns)):
            if blocks[row, column] < 0:
                begin = len(corners) * _NODES
                blocks[row, column] = len(corners)
                corners.append((column * _SIDE, row * _SIDE))
                if begin + _NODES > len(nodes):
                    nodes = np.concatenate((nodes, np.empty_like(nodes)))
                nodes[begin : begin + _NODES] = 0.0
                nodes[begin : begin + _NODES, _COST] = np.inf
    return nodes


@kernel
def _indices(corners: list[tuple[int, int]], node: int) -> tuple[int, int]:
    """(i, j) of a node, of the place where it is kept."""
    i, j = corners[node // _NODES]
    return i + node % _SIDE, j + node % _NODES // _SIDE


@kernel
def _price(
    world: World, x: float, y: float, least: float, most: float, spacing: float, aligned: bool, passed: bool
) -> float:
    """Of a metre at a node."""
    room = _room(world, x, y, least, most)
    if aligned:
        room = _roomiest(world, x, y, room, least, most, spacing)[2]
    if room < least:
        return np.inf
    shy = _SHYNESS * (most - room) / (most - least) if room < most else 0.0
    return (1.0 + shy) * (_USED if passed else 1.0)


@kernel
def shortest(
    world: World,
    start: tuple[float, float],
    goal: tuple[float, float],
    least: float,
    most: float,
    spacing: float,
    aligned: bool,
    used: Array,
    haste: float,
    work: int,
) -> tuple[Array, bool, tuple[float, float, float, float]]:
    """A way from start to goal (m, own frame) over nodes that have at least `least` m of room: its points
    (n, 2), both ends included, none: empty; whether every node within reach was looked at; the box of those
    that were (x_min, y_min, x_max, y_max).

    most: the room (m) beyond which more is worth nothing. spacing: the lattice's, m. aligned: whether nodes
    keep off the walls as far as their cells allow, so that there are some in a passage hardly wider than the
    disc. used (k, 2): points that were passed before. haste: how much heavier the way still to go weighs than
    what is behind: the heavier, the fewer nodes are looked at. work: how many of them may be.
    """
    (sx, sy), (gx, gy) = start, goal
    # Node (i, j) is at (ox + i * spacing, oy + j * spacing): the start is one of them.
    left, below = int(sx / spacing), int(sy / spacing)
    right = int(world[COLUMNS] * world[STEP] / spacing) + 2 - left
    above = int(world[ROWS] * world[STEP] / spacing) + 2 - below
    clipped = max(left, right, below, above) > _HALF
    i0, j0 = min(left, _HALF), min(below, _HALF)
    width, height = i0 + min(right, _HALF), j0 + min(above, _HALF)
    ox, oy = sx - i0 * spacing, sy - j0 * spacing
    blocks = np.full((height // _SIDE + 1, width // _SIDE + 1), -1, np.int32)
    corners = [(0, 0) for _ in range(0)]
    nodes = np.empty((16 * _NODES, 4))
    spread = max(1, int(most / spacing))
    for k in range(len(used)):
        ui, uj = int((used[k, 0] - ox) / spacing + 0.5), int((used[k, 1] - oy) / spacing + 0.5)
        nodes = _opened(blocks, corners, nodes, ui, uj, spread)
        for a in range(max(ui - spread, 0), min(ui + spread + 1, width)):
            for b in range(max(uj - spread, 0), min(uj + spread + 1, height)):
                nodes[_node(blocks, a, b), _PASSED] = 1.0
    nodes = _opened(blocks, corners, nodes, i0, j0, 0)
    first = _node(blocks, i0, j0)
    nodes[first, _COST], nodes[first, _PRICE] = 0.0, 1.0
    queue = [(math.hypot(gx - sx, gy - sy), first)]
    diagonal = math.sqrt(2.0) * spacing
    x_min, y_min, x_max, y_max = sx, sy, sx, sy
    last = -1
    while len(queue) > 0 and work > 0:
        _, node = heapq.heappop(queue)
        mine = nodes[node, _PRICE]
        if mine < 0.0:
            continue  # looked at already, on a shorter way
        work -= 1
        nodes[node, _PRICE] = -mine
        i, j = _indices(corners, node)
        x, y = ox + i * spacing, oy + j * spacing
        x_min, y_min, x_max, y_max = min(x_min, x), min(y_min, y), max(x_max, x), max(y_max, y)
        if (x - gx) ** 2 + (y - gy) ** 2 <= 2 * spacing * spacing:
            last = node
            break
        nodes = _opened(blocks, corners, nodes, i, j, 1)
        for b in range(max(j - 1, 0), min(j + 2, height)):
            for a in range(max(i - 1, 0), min(i + 2, width)):
                k = _node(blocks, a, b)
                px, py = ox + a * spacing, oy + b * spacing
                if nodes[k, _PRICE] == 0.0:
                    passed = nodes[k, _PASSED] > 0.0
                    nodes[k, _PRICE] = _price(world, px, py, least, most, spacing, aligned, passed)
                price = nodes[k, _PRICE]
                if price < 0.0 or price == np.inf:
                    continue
                step = spacing if a == i or b == j else diagonal
                cost = nodes[node, _COST] + step * 0.5 * (mine + price)
                if cost < nodes[k, _COST]:
                    nodes[k, _COST], nodes[k, _PARENT] = cost, node
                    ahead = math.sqrt((px - gx) ** 2 + (py - gy) ** 2)
                    heapq.heappush(queue, (cost + haste * ahead, k))
    box = (x_min, y_min, x_max, y_max)
    if last < 0:
        return np.empty((0, 2)), len(queue) == 0 and not clipped, box
    count = 2
    node = last
    while node != first:
        node = int(nodes[node, _PARENT])
        count += 1
    points = np.empty((count, 2))
    points[count - 1, 0], points[count - 1, 1] = gx, gy
    node = last
    for k in range(count - 2, -1, -1):
        i, j = _indices(corners, node)
        points[k, 0], points[k, 1] = ox + i * spacing, oy + j * spacing
        node = int(nodes[node, _PARENT])
    return points, False, box
