"""Time against map size and obstacle count for the same routes, and goals that cannot be reached."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.search import ours
from benchmarks.search.mobilities import Mobility
from benchmarks.search.report import milliseconds
from benchmarks.search.scenes import SEED, Query, free_poses, store
from drives.se2 import Array, Pose
from planner.environment import CollisionWorld
from planner.problem import Bounds, Circle, Environment

__all__ = ["obstacles", "sizes", "unreachable"]

_TILE, _CELL = 256, 0.1
_SIDE = _TILE * _CELL
_SIZES = (256, 512, 1024, 2048, 4096)
_ROUTES, _REPEATS, _GOALS = 8, 3, 20
_COUNTS = (10, 100, 1_000, 10_000)


def sizes(mobilities: Iterable[Mobility], root: Path, budget: float) -> None:
    """Routes within one tile of a town, alone and in ever more of it; then from edge to edge of the largest
    map, and of as much of it as the route needs."""
    print(
        f"\n{'map':12}{'mobility':13}{'prepared in':>12}{'median':>10}{'worst':>10}{'solved':>8}{'ratio':>7}"
    )
    maps = {(n, n): _town(n // _TILE, n // _TILE, root) for n in _SIZES}
    largest = _SIZES[-1]
    maps[_TILE, largest] = _town(1, largest // _TILE, root)
    for mobility in mobilities:
        tile, fit = maps[_TILE, _TILE], 0.0
        inside = list(_routes(tile, np.array([0.0, 0.0, _SIDE, _SIDE]), mobility, 0.5 * _SIDE))
        for n in _SIZES:
            middle = n // _TILE // 2 * _SIDE
            fit = _timed(f"{n} x {n}", maps[n, n], [_moved(q, middle, middle) for q in inside], mobility,
                         budget, fit)  # fmt: skip
        band, far = maps[_TILE, largest], (largest - _TILE) * _CELL
        ends = zip(inside, _routes(tile, np.array([0.0, 0.0, _SIDE, _SIDE]), mobility, 0.0), strict=False)
        across = [(a.start, _moved(b, far, 0.0).goal) for a, b in ends]
        fit = _timed(f"{largest} x {_TILE}", band, across, mobility, budget, 0.0)
        up = largest // _TILE // 2 * _SIDE
        _timed("  across", maps[largest, largest], [(_up(a, up), _up(b, up)) for a, b in across], mobility,
               budget, fit)  # fmt: skip


def obstacles(mobilities: Iterable[Mobility], budget: float) -> None:
    """Routes among ten obstacles, with ever more of them elsewhere."""
    print(f"\n{'obstacles':12}{'mobility':13}{'':12}{'median':>10}{'worst':>10}{'solved':>8}{'ratio':>7}")
    random = np.random.default_rng(SEED)
    half, around = 100.0, Bounds(-100.0, -100.0, 100.0, 100.0)
    near = [Circle(float(x), float(y), 0.5) for x, y in random.uniform(-8.0, 8.0, (_COUNTS[0], 2))]
    far = (
        Circle(float(x), float(y), 0.2)
        for x, y in random.uniform(-half, half, (2 * _COUNTS[-1], 2))
        if max(abs(x), abs(y)) > 12.0
    )
    every = (*near, *islice(far, _COUNTS[-1] - len(near)))
    for mobility in mobilities:
        few = Environment(around, every[: _COUNTS[0]])
        routes = list(_routes(few, np.array([-10.0, -10.0, 10.0, 10.0]), mobility, 12.0))
        least = 0.0
        for n in _COUNTS:
            ends = [(q.start, q.goal) for q in routes]
            least = _timed(f"{n}", Environment(around, every[:n]), ends, mobility, budget, least)


def unreachable(mobilities: Iterable[Mobility], root: Path, budget: float) -> None:
    """Goals, then starts, in rooms without a door or with one too narrow, on a map of 1000 x 1000 cells."""
    print(f"\n{'unreachable':12}{'mobility':13}{'':12}{'median':>10}{'worst':>10}{'proven':>8}")
    for mobility in mobilities:
        town = _cells(4, 4)[:1000, :1000]
        room, half = math.ceil((mobility.diagonal + 0.4) / _CELL), 2
        took, proven = [], 0
        for k in range(_GOALS):
            random, cells = np.random.default_rng([SEED, k]), town.copy()
            i, j = (int(v) for v in random.integers(2 * room, 1000 - 2 * room, 2))
            size = room // 2 + half
            cells[i - size : i + size, j - size : j + size] = 1
            cells[i - size + 1 : i + size - 1, j - size + 1 : j + size - 1] = 0
            if k % 2:
                door = int(mobility.width / _CELL) - 1
                cells[i - size, j - door // 2 : j - door // 2 + door] = 0
            environment = Environment(map=store(cells, _CELL, root))
            ours.prepare(environment, mobility)
            free = CollisionWorld.build(environment, mobility.robot.footprint)
            outside = next(free_poses(np.array([0.0, 0.0, 100.0, 100.0]), free, random))
            within = Pose(j * _CELL, i * _CELL, float(random.uniform(-math.pi, math.pi)))
            if not free.is_free(within):
                continue
            ends = (outside, within) if k % 4 < 2 else (within, outside)
            answer = ours.run_one(mobility, Query(k, environment, *ends), budget)
            took.append(answer.total)
            proven += answer.by.startswith("NoPathExists")
        print(f"{'':12}{mobility.name:13}{'':12}{milliseconds(float(np.median(took)))}"
              f"{milliseconds(max(took))}{proven:4}/{len(took):3}")  # fmt: skip


def _cells(rows: int, columns: int) -> NDArray[np.int8]:
    """A town of tiles of random blocks; the middle tile is the same in every town, whatever its size."""
    town = np.zeros((rows * _TILE, columns * _TILE), dtype=np.int8)
    for i in range(rows):
        for j in range(columns):
            random = np.random.default_rng([SEED, abs(i - rows // 2), abs(j - columns // 2)])
            tile = town[i * _TILE : (i + 1) * _TILE, j * _TILE : (j + 1) * _TILE]
            for y, x, high, wide in zip(
                *random.integers(0, _TILE, (2, 14)), *random.integers(10, 60, (2, 14)), strict=True
            ):
                tile[y : y + high, x : x + wide] = 1
    return town


def _town(rows: int, columns: int, root: Path) -> Environment:
    return Environment(map=store(_cells(rows, columns), _CELL, root))


def _routes(environment: Environment, area: Array, mobility: Mobility, apart: float) -> Iterator[Query]:
    """Random queries with ends in an area and at least so far apart (m), all of which can be planned."""
    free = CollisionWorld.build(environment, mobility.robot.footprint)
    poses = free_poses(area, free, np.random.default_rng(SEED))
    draw = found = 0
    while found < _ROUTES:
        query = Query(draw, environment, next(poses), next(poses))
        draw += 1
        way = math.hypot(query.goal.x - query.start.x, query.goal.y - query.start.y)
        if way >= apart and ours.run_one(mobility, query, 2.0).solved:
            found += 1
            yield query


def _moved(query: Query, x: float, y: float) -> tuple[Pose, Pose]:
    a, b = (Pose(p.x + x, p.y + y, p.theta) for p in (query.start, query.goal))
    return a, b


def _up(pose: Pose, y: float) -> Pose:
    return Pose(pose.x, pose.y + y, pose.theta)


def _timed(
    what: str, environment: Environment, ends: list[tuple[Pose, Pose]], mobility: Mobility, budget: float,
    least: float,
) -> float:  # fmt: skip
    """A line for routes on one world; the median (s). Its ratio to `least`, unless that is 0, is printed."""
    prepared = ours.prepare(environment, mobility)
    took, solved = [], 0
    for k, (start, goal) in enumerate(ends):
        plans = [ours.run_one(mobility, Query(k, environment, start, goal), budget) for _ in range(_REPEATS)]
        took.append(float(np.median([p.total for p in plans])))
        solved += plans[0].solved
    median = float(np.median(took))
    line = (
        f"{what:12}{mobility.name:13}{prepared * 1e3:9.0f} ms{milliseconds(median)}{milliseconds(max(took))}"
    )
    print(f"{line}{solved:4}/{len(ends):3}" + (f"{median / least:7.2f}" if least > 0 else ""), flush=True)
    return least or median
