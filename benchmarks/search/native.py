"""The same queries through native C++ OMPL: compiled here, run as one process for a set of queries."""

from __future__ import annotations

import hashlib
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np

from benchmarks.search.mobilities import Mobility
from benchmarks.search.scenes import Fineness, Query, world
from drives.se2 import Array
from planner.curves import SEGMENTS
from planner.edges import CURVE, LINE, joined
from planner.environment import CollisionWorld
from planner.problem import Environment, Footprint

__all__ = ["Native", "build", "run", "time_motions"]

_SOURCE = Path(__file__).with_name("native.cpp")
_INCLUDES = ("/usr/include/eigen3", "/usr/local/include/eigen3")
_POINT = Footprint(np.zeros((1, 2)), 1e-9)


@dataclass(frozen=True, slots=True)
class Native:
    """One query: seconds to the first path, and with simplify; length m. holds: whether the simplified path
    passes the planner's exact check of its motions, which makes it a proof that there is one."""

    solved: bool
    first: float
    total: float
    length: float
    holds: bool


def build(folder: Path | None = None) -> Path | str:
    """The program, compiled unless it is there already; or why it cannot be."""
    folder = folder or Path(tempfile.gettempdir())
    program = folder / f"wheelplan-native-{hashlib.sha256(_SOURCE.read_bytes()).hexdigest()[:16]}"
    if program.exists():
        return program
    headers = [p for root in ("/usr/include", "/usr/local/include") for p in Path(root).glob("ompl-*")]
    includes = [f"-I{p}" for p in (*headers, *map(Path, _INCLUDES)) if p.exists()]
    made = program.with_suffix(".new")
    command = ["g++", "-O3", "-DNDEBUG", "-std=c++17", str(_SOURCE), *includes, "-lompl", "-o", str(made)]
    try:
        subprocess.run(command, check=True, capture_output=True, text=True)
    except FileNotFoundError:
        return "there is no g++"
    except subprocess.CalledProcessError as error:
        return f"g++ failed, is libompl-dev installed? {error.stderr.strip().splitlines()[:1]}"
    made.rename(program)
    return program


def run(
    program: Path, mobility: Mobility, queries: Sequence[Query], fineness: Fineness, limit: float
) -> list[Native]:
    """The queries, in their order; limit s: each."""
    with tempfile.TemporaryDirectory() as folder:
        lines = [f"limit {limit}"]
        for k, (_, alike) in enumerate(groupby(queries, key=lambda q: id(q.environment))):
            same = list(alike)
            lines += _setting(same[0].environment, mobility, fineness, Path(folder) / f"{k}.bin")
            lines += ["query " + _numbers((*q.start, *q.goal)) for q in same]
        answers = _ask(program, lines)
    return [_read(answer, mobility, query) for answer, query in zip(answers, queries, strict=True)]


def time_motions(
    program: Path, mobility: Mobility, environment: Environment, fineness: Fineness, a: Array, b: Array
) -> float:
    """Seconds that checking the motions from poses a (n, 3) to b takes."""
    with tempfile.TemporaryDirectory() as folder:
        lines = _setting(environment, mobility, fineness, Path(folder) / "field.bin")
        poses = _numbers(np.hstack([a, b]).ravel())
        (answer,) = _ask(program, [*lines, f"motions {len(a)} {poses}"])
    return float(answer.split()[0])


def _ask(program: Path, lines: list[str]) -> list[str]:
    done = subprocess.run([program], input="\n".join(lines), capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def _setting(environment: Environment, mobility: Mobility, fineness: Fineness, file: Path) -> list[str]:
    """The commands that describe a scene. Its distances are the planner's own, exact, at nodes a step
    apart."""
    step, resolution = fineness
    x0, y0, x1, y1 = _area(environment)
    columns, rows = round((x1 - x0) / step) + 1, round((y1 - y0) / step) + 1
    xs, ys = np.meshgrid(x0 + step * np.arange(columns), y0 + step * np.arange(rows))
    nodes = np.stack([xs.ravel(), ys.ravel(), np.zeros(xs.size)], -1)
    CollisionWorld.build(environment, _POINT).clearance(nodes).astype(np.float32).tofile(file)
    outline = mobility.outline
    return [
        f"field {file} {columns} {rows} {step} {x0} {y0}",
        f"footprint {len(outline)} {_numbers(outline.ravel())}",
        f"space {mobility.space} {mobility.radius} {resolution}",
    ]


def _area(environment: Environment) -> tuple[float, float, float, float]:
    bounds, layer = environment.bounds, environment.map
    if bounds is not None:
        return bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max
    assert layer is not None
    height, width = np.load(layer.directory / "cells.npy", mmap_mode="r").shape
    x, y = layer.origin.x, layer.origin.y
    return x, y, x + width * layer.resolution, y + height * layer.resolution


def _numbers(values: Sequence[float] | Array) -> str:
    return " ".join(repr(float(v)) for v in values)


def _read(answer: str, mobility: Mobility, query: Query) -> Native:
    solved, first, total, length, _, *states = (float(word) for word in answer.split())
    if not solved:
        return Native(False, first, total, 0.0, False)
    poses = np.array(states).reshape(-1, 3).tolist()
    free = world(query, mobility)
    reverse, steps = mobility.space != "Dubins", np.empty((SEGMENTS, 3))
    motion = free.kernel, LINE if mobility.space == "SE2" else CURVE, mobility.radius, reverse
    holds = all(joined(*motion, *a, *b, steps) for a, b in pairwise(poses))
    return Native(True, first, total, length, holds)
