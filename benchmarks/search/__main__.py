"""Success, time and length of the search for a first plan, beside native C++ OMPL on the same queries.

python -m benchmarks.search [--maps DIR] [--part queries sizes obstacles unreachable] [--scene S ...]
                            [--mobility M ...] [--count N] [--budget S] [--no-native] [--refresh]
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.search import native, ours, report, scale
from benchmarks.search.known import Known
from benchmarks.search.mobilities import MOBILITIES, Mobility
from benchmarks.search.scenes import SEED, Query, Scene, free_poses, scenes, world
from planner.warm_up import warm_up

_MAPS = Path(__file__).resolve().parents[3] / "shared" / "maps"
_PARTS = ("queries", "sizes", "obstacles", "unreachable")
_SCENES = ("Berlin", "depot", "narrow", "parking")
_PATH = ("prepare", "search", "shorten")
_COUNT, _OTHERS = 200, 24
_PAIRS, _NEAR = 4000, 4.0
"""Motions whose checks are timed, and how long (m) they are at most, in each coordinate."""


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.search", description=__doc__.split("\n")[0])
    parser.add_argument("--maps", type=Path, default=_MAPS, help="folder of Berlin_0_256.map and depot.yaml")
    parser.add_argument("--part", nargs="+", choices=_PARTS, default=list(_PARTS))
    parser.add_argument("--scene", nargs="+", choices=_SCENES, default=list(_SCENES))
    parser.add_argument("--mobility", nargs="+", choices=list(MOBILITIES), default=list(MOBILITIES))
    parser.add_argument("--count", type=int, default=_COUNT, help=f"queries a mobility, {_OTHERS} off Berlin")
    parser.add_argument("--budget", type=float, default=2.0, help="seconds for each query, native's too")
    parser.add_argument("--no-native", action="store_true", help="the planner alone")
    parser.add_argument("--refresh", action="store_true", help="keep what is solved, and shorter ways")
    given = parser.parse_args()
    warm_up()
    program = "--no-native" if given.no_native else native.build()
    if isinstance(program, str):
        print(f"native OMPL is left out: {program}")
    maps = given.maps if (given.maps / "Berlin_0_256.map").exists() else None
    if maps is None:
        print(f"there are no maps in {given.maps}: generated scenes only")
    mobilities = [MOBILITIES[name] for name in given.mobility]
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        if "queries" in given.part:
            known = Known()
            print(report.HEADER)
            for scene in (s for s in scenes(maps, root) if s.name in given.scene):
                count = given.count if scene.name == "Berlin" else min(given.count, _OTHERS)
                for mobility in mobilities:
                    # More of the draws cannot be solved at all without reverse.
                    drawn = count if mobility.options.reverse else count * 5 // 4
                    _compare(scene, mobility, drawn, given.budget, program, known)
            if given.refresh:
                known.save()
        if "sizes" in given.part:
            scale.sizes(mobilities, root, given.budget)
        if "obstacles" in given.part:
            scale.obstacles(mobilities, given.budget)
        if "unreachable" in given.part:
            scale.unreachable(mobilities, root, given.budget)


def _compare(
    scene: Scene, mobility: Mobility, count: int, budget: float, program: Path | str, known: Known
) -> None:
    """One scene's rows of the table for one mobility."""
    queries = scene.queries(mobility, count)
    plans = ours.run(mobility, queries, budget)
    theirs = (
        [] if isinstance(program, str) else native.run(program, mobility, queries, scene.fineness, budget)
    )
    for query, made in zip(queries, plans, strict=True):
        if made.solved:
            known.add(scene.name, mobility.name, query, made.length, "planner")
    for query, found in zip(queries, theirs, strict=False):
        if found.holds:
            known.add(scene.name, mobility.name, query, found.length, "native OMPL")
    for query in queries:
        if query.via and known.length(scene.name, mobility.name, query) is None:
            length = ours.in_legs(mobility, query, budget)
            if length is not None:
                known.add(scene.name, mobility.name, query, length, "planner, in legs")
    best = [known.length(scene.name, mobility.name, query) for query in queries]
    solvable = [k for k, length in enumerate(best) if length is not None]
    times = [plans[k].total if plans[k].solved else math.inf for k in solvable]
    lengths = [(plans[k].length, best[k] or 0.0) for k in solvable if plans[k].solved]
    a, b = _pairs(queries[0], mobility)
    environment = queries[0].environment
    speed = _PAIRS / ours.time_motions(mobility, environment, a, b)
    print(report.row(scene.name, mobility.name, "planner", times, lengths, speed), flush=True)
    paths = [
        sum(plans[k].stages.get(s, 0.0) for s in _PATH) if plans[k].solved else math.inf for k in solvable
    ]
    print(report.row(scene.name, mobility.name, "  its path", paths))
    if theirs:
        assert isinstance(program, Path)
        first, total = (
            [getattr(theirs[k], name) if theirs[k].solved else math.inf for k in solvable]
            for name in ("first", "total")
        )
        lengths = [(theirs[k].length, best[k] or 0.0) for k in solvable if theirs[k].solved]
        speed = _PAIRS / native.time_motions(program, mobility, environment, scene.fineness, a, b)
        print(report.row(scene.name, mobility.name, "native, first", first))
        print(report.row(scene.name, mobility.name, "  with simplify", total, lengths, speed))
        refused = sum(found.solved and not found.holds for found in theirs)
        print(
            f"{report.ratios(times, paths, first, total)}; {refused} of its paths do not pass the exact check"
        )
    print(report.list_stages(plans))
    if len(solvable) < len(queries):
        print(f"{'':22}{len(queries) - len(solvable)} of {len(queries)} queries have never been solved")
    for line in report.list_slow([(queries[k].draw, plans[k]) for k in solvable]):
        print(line)


def _pairs(query: Query, mobility: Mobility) -> tuple[np.ndarray, np.ndarray]:
    """Poses of motions like those a search checks: from free ones to others near them."""
    random, free = np.random.default_rng(SEED), world(query, mobility)
    ends = np.array([query.start, query.goal])[:, :2]
    area = np.concatenate([ends.min(0) - _NEAR, ends.max(0) + _NEAR])
    poses = free_poses(area, free, random)
    a = np.array([next(poses) for _ in range(_PAIRS)])
    return a, a + random.uniform(-_NEAR, _NEAR, a.shape)


if __name__ == "__main__":
    main()
