"""Time against map size and obstacle count for the same routes, and goals that cannot be reached."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.search import ours
from benchmarks.search.mobilities import MOBILITIES, Mobility
from benchmarks.search.report import milliseconds
from benchmarks.search.scenes import SEED, Query, free_poses, store
from drives.se2 import Array, Pose
from planner.environment import CollisionWorld
from planner.problem import Bounds, Circle, Environment

__all__ = ["obstacles", "sizes", "unreachable"]

Route = tuple[Pose, Pose]

_TILE, _CELL = 256, 0.1
_SIDE = _TILE * _CELL
_SIZES = (256, 512, 1024, 2048, 4096)
_ROUTES, _REPEATS, _GOALS = 8, 3, 20
_COUNTS = (10, 100, 1_000, 10_000)


def sizes(mobilities: Iterable[Mobility], root: Path, budget: float) -> None:
    """Routes within one tile of a town, alone and in ever more of it; then from edge to edge of a row of
    tiles, alone and across the largest map."""
    print(f"\n{'map':12}{'mobility':13}{'median':>10}{'worst':>10}{'solved':>8}{'ratio':>7}")
    maps = {n: _town(n // _TILE, n // _TILE, root) for n in _SIZES}
    largest = _SIZES[-1]
    band, far = _town(1, largest // _TILE, root), (largest - _TILE) * _CELL
    for n, environment in maps.items():
        took = ours.prepare(environment, MOBILITIES["holonomic"])
        print(f"{f'{n} x {n}':12}looked at for the first time by a process: {took * 1e3:.0f} ms")
    tile = np.array([0.0, 0.0, _SIDE, _SIDE])
    for mobility in mobilities:
        inside = _routes(maps[_TILE], tile, tile, mobility, 0.5 * _SIDE, False)
        least = 0.0
        for n in _SIZES:
            middle = n // _TILE // 2 * _SIDE
            ends = [_moved(route, middle, middle) for route in inside]
            least = _timed(f"{n} x {n}", maps[n], ends, mobility, budget, least)
        across = _routes(band, tile, tile + np.array([far, 0.0, far, 0.0]), mobility, 0.0, False)
        least = _timed(f"{largest} x {_TILE}", band, across, mobility, budget, 0.0)
        ends = [_moved(route, 0.0, largest // _TILE // 2 * _SIDE) for route in across]
        _timed("  across", maps[largest], ends, mobility, budget, least)


def obstacles(mobilities: Iterable[Mobility], budget: float) -> None:
    """Routes among ten obstacles, with ever more of them elsewhere."""
    print(f"\n{'obstacles':12}{'mobility':13}{'median':>10}{'worst':>10}{'solved':>8}{'ratio':>7}")
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
        middle = np.array([-10.0, -10.0, 10.0, 10.0])
        routes = _routes(few, middle, middle, mobility, 12.0, True)
        least = 0.0
        for n in _COUNTS:
            least = _timed(f"{n}", Environment(around, every[:n]), routes, mobility, budget, least)


def unreachable(mobilities: Iterable[Mobility], root: Path, budget: float) -> None:
    """Goals, then starts, in rooms without a door or with one too narrow, on a map of 1000 x 1000 cells."""
    print(f"\n{'unreachable':12}{'mobility':13}{'median':>10}{'worst':>10}{'proven':>8}")
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
        print(f"{'':12}{mobility.name:13}{milliseconds(float(np.median(took)))}"
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


def _routes(
    environment: Environment, starts: Array, goals: Array, mobility: Mobility, apart: float, direct: bool
) -> list[Route]:
    """Random starts and goals in two areas, at least so far apart (m), that can be planned. direct:
    also those that need no search."""
    free = CollisionWorld.build(environment, mobility.robot.footprint)
    first, last = (
        free_poses(area, free, np.random.default_rng([SEED, k])) for k, area in enumerate((starts, goals))
    )
    found: list[Route] = []
    while len(found) < _ROUTES:
        a, b = next(first), next(last)
        if math.hypot(b.x - a.x, b.y - a.y) < apart:
            continue
        made = ours.run_one(mobility, Query(0, environment, a, b), 5.0)
        if made.solved and (direct or made.by != "direct"):
            found.append((a, b))
    return found


def _moved(route: Route, x: float, y: float) -> Route:
    a, b = (Pose(pose.x + x, pose.y + y, pose.theta) for pose in route)
    return a, b


def _timed(
    what: str, environment: Environment, ends: list[Route], mobility: Mobility, budget: float,
    least: float,
) -> float:  # fmt: skip
    """A line for routes on one world; the median (s). Its ratio to `least`, unless that is 0, is printed."""
    ours.prepare(environment, mobility)
    took, solved = [], 0
    for k, (start, goal) in enumerate(ends):
        plans = [ours.run_one(mobility, Query(k, environment, start, goal), budget) for _ in range(_REPEATS)]
        took.append(float(np.median([p.total for p in plans])))
        solved += plans[0].solved
    median = float(np.median(took))
    line = f"{what:12}{mobility.name:13}{milliseconds(median)}{milliseconds(max(took))}"
    print(f"{line}{solved:4}/{len(ends):3}" + (f"{median / least:7.2f}" if least > 0 else ""), flush=True)
    return least or median
