"""Where the queries are: maps as an upload stores them, and generated scenes, all with fixed seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from api.maps import MapStore
from api.occupancy import DecodedMap, read_map
from benchmarks.search import narrow
from benchmarks.search.mobilities import Mobility
from drives.se2 import Array, Pose
from planner.environment import CollisionWorld
from planner.problem import Environment, Goal, MapLayer, Problem

__all__ = ["SEED", "Fineness", "Query", "Scene", "free_poses", "problem", "scenes", "store", "world"]

SEED = 2024
_BERLIN, _CELL = "Berlin_0_256.map", 0.5
_MAX_CELLS = 1 << 25


@dataclass(frozen=True, slots=True)
class Query:
    """One start and goal, in one environment. draw names it within its scene and mobility; via: poses on a
    way between them, where one is known."""

    draw: int
    environment: Environment
    start: Pose
    goal: Pose
    via: tuple[Pose, ...] = ()


class Fineness(NamedTuple):
    """step m: from node to node of the distance field; resolution m: from pose to pose of a motion."""

    step: float
    resolution: float


@dataclass(frozen=True, slots=True)
class Scene:
    """Queries of a kind, and how finely native OMPL checks them."""

    name: str
    fineness: Fineness
    queries: Callable[[Mobility, int], list[Query]]


def problem(query: Query, mobility: Mobility, **options: float | str) -> Problem:
    """The query as the planner is asked it."""
    goal = Goal(*query.goal)
    return Problem(mobility.robot, query.start, goal, query.environment, mobility.asked(**options))


def world(query: Query, mobility: Mobility) -> CollisionWorld:
    """What the robot may hit."""
    return CollisionWorld.build(query.environment, mobility.robot.footprint)


def store(cells: NDArray[np.int8], resolution: float, root: Path) -> MapLayer:
    """A map of cells, 0 free and 1 occupied, row 0 at the bottom, as it is after its upload."""
    maps = MapStore(root, max_maps=1000)
    return maps.layer(maps.add(DecodedMap(np.ascontiguousarray(cells), resolution, Pose(0, 0, 0)))[0]["id"])


def scenes(maps: Path | None, root: Path) -> list[Scene]:
    """All there are. maps: the folder of the maps, None: only what is generated; root: the store's."""
    fine = Fineness(0.025, 0.05)
    generated = [
        Scene("narrow", fine, lambda mobility, n: _generated(narrow.passage, mobility, n)),
        Scene("parking", fine, lambda mobility, n: _generated(narrow.slot, mobility, n)),
    ]
    if maps is None:
        return generated
    berlin, positions = _berlin(maps, root)
    decoded = read_map(maps / "depot.yaml", _MAX_CELLS)
    kept = MapStore(root, max_maps=1000)
    depot = Environment(map=kept.layer(kept.add(decoded)[0]["id"]))
    return [
        Scene("Berlin", Fineness(0.125, 0.1), lambda mobility, n: _along(positions, berlin, mobility, n)),
        Scene("depot", Fineness(0.05, 0.1), lambda mobility, n: _drawn(depot, mobility, n)),
        *generated,
    ]


def free_poses(area: Array, free: CollisionWorld, random: np.random.Generator) -> Iterator[Pose]:
    """Random free poses in an area (x_min, y_min, x_max, y_max), without end."""
    while True:
        x, y = random.uniform(area[:2], area[2:])
        pose = Pose(float(x), float(y), float(random.uniform(-math.pi, math.pi)))
        if free.is_free(pose):
            yield pose


def _berlin(maps: Path, root: Path) -> tuple[Environment, list[Array]]:
    """The map, and the positions ((sx, sy), (gx, gy)) m of its scenarios' starts and goals."""
    rows = (maps / _BERLIN).read_text().splitlines()[4:]
    closed = np.array([[cell not in ".GS" for cell in row] for row in rows], dtype=np.int8)[::-1]
    lines = [line.split() for line in (maps / f"{_BERLIN}.scen").read_text().splitlines()[1:]]
    cells = np.array([line[4:8] for line in lines], dtype=np.float64).reshape(-1, 2, 2)
    # Scenarios count rows from the top.
    cells[..., 1] = len(rows) - 1 - cells[..., 1]
    return Environment(map=store(closed, _CELL, root)), list((cells + 0.5) * _CELL)


def _along(positions: list[Array], environment: Environment, mobility: Mobility, n: int) -> list[Query]:
    """Scenarios in a random order, the first n whose ends have room at one of a few random headings; then,
    where those are too few, draws anywhere."""
    found: list[Query] = []
    draw, free = -1, CollisionWorld.build(environment, mobility.robot.footprint)
    for draw, k in enumerate(np.random.default_rng(SEED).permutation(len(positions))):
        random = np.random.default_rng([SEED, draw])
        ends = []
        for x, y in positions[k]:
            poses = [Pose(float(x), float(y), float(a)) for a in random.uniform(-math.pi, math.pi, 8)]
            ends += [pose for pose in poses if free.is_free(pose)][:1]
        if len(ends) == 2:
            found.append(Query(draw, environment, ends[0], ends[1]))
        if len(found) == n:
            return found
    more = _drawn(environment, mobility, n - len(found))
    return found + [Query(draw + 1 + q.draw, q.environment, q.start, q.goal) for q in more]


def _drawn(environment: Environment, mobility: Mobility, n: int) -> list[Query]:
    """Starts and goals anywhere on a map."""
    layer = environment.map
    assert layer is not None
    height, width = np.load(layer.directory / "cells.npy", mmap_mode="r").shape
    area = np.array([0.0, 0.0, width * layer.resolution, height * layer.resolution])
    free = CollisionWorld.build(environment, mobility.robot.footprint)
    found = []
    for draw in range(n):
        poses = free_poses(area, free, np.random.default_rng([SEED, draw]))
        found.append(Query(draw, environment, next(poses), next(poses)))
    return found


def _generated(
    make: Callable[[Mobility, np.random.Generator], narrow.Made],
    mobility: Mobility,
    n: int,
) -> list[Query]:
    """The first n draws of which both ends have room."""
    found: list[Query] = []
    for draw in count():
        if len(found) == n:
            break
        query = Query(draw, *make(mobility, np.random.default_rng([SEED, draw])))
        free = world(query, mobility)
        if free.is_free(query.start) and free.is_free(query.goal):
            found.append(query)
    return found
