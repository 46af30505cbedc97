"""Random valid requests for every drive, planned and checked; exit status 1 if a target is missed.

python -m benchmarks.fuzz [--count N] [--seed S] [--jobs J] [--no-laws] [--replay SEED [--out DIR]]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from benchmarks.fuzz.report import missed_targets, print_report, remarks
from benchmarks.fuzz.request import draw_case
from benchmarks.fuzz.trial import Outcome, Trial, run, try_case, use_processor_time
from planner.warm_up import warm_up

_NICE = 10
_TELL = 100


def main() -> int:
    """The command; its exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=200, help="requests, seeds S, S + 1, …")
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--no-laws", action="store_true", help="leave out the metamorphic laws")
    parser.add_argument("--replay", type=int, metavar="SEED", help="print the request of a seed, and plan it")
    parser.add_argument("--out", type=Path, help="with --replay: write request and map into this folder")
    given = parser.parse_args()
    if given.replay is not None:
        return _replay(given.replay, given.out)
    use_processor_time()
    warm_up()  # compiles once what the processes would each compile
    began = time.perf_counter()
    seeds = range(given.seed, given.seed + given.count)
    trials = _run(list(seeds), given.jobs, not given.no_laws)
    print_report(trials)
    print(f"\n{len(trials)} requests in {time.perf_counter() - began:.0f} s")
    missed = missed_targets(trials)
    for sentence in missed:
        print(f"MISSED: {sentence}")
    return 1 if missed else 0


def _run(seeds: list[int], jobs: int, laws: bool) -> list[Trial]:
    """The trials of seeds, in their order. Each thread has a process, and a new one if that dies."""
    left, lock = iter(seeds), threading.Lock()
    done: dict[int, Trial] = {}

    def take() -> Iterator[int]:
        while True:
            with lock:
                seed = next(left, None)
            if seed is None:
                return
            yield seed

    def work() -> None:
        pool = ProcessPoolExecutor(1, initializer=_begin)
        for seed in take():
            try:
                done[seed] = pool.submit(run, seed, laws).result()
            except BrokenProcessPool:
                pool.shutdown(wait=False)
                pool = ProcessPoolExecutor(1, initializer=_begin)
                done[seed] = _died(seed, "the process died")
            except Exception as error:
                done[seed] = _died(seed, f"the fuzz itself: {error!r}")
            for line in remarks(done[seed]):
                print(f"{seed}: {line}", file=sys.stderr, flush=True)
            if len(done) % _TELL == 0:
                print(f"{len(done)} of {len(seeds)}", file=sys.stderr, flush=True)
        pool.shutdown()

    threads = [threading.Thread(target=work) for _ in range(max(1, jobs))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return [done[seed] for seed in sorted(done)]


def _died(seed: int, why: str) -> Trial:
    case = draw_case(seed)
    effort = case.request["options"]["effort"]
    return Trial(seed, case.drive, case.scene, effort, case.known, Outcome("5xx", error=why))


def _begin() -> None:
    os.nice(_NICE)
    use_processor_time()
    warm_up()


def _replay(seed: int, out: Path | None) -> int:
    case = draw_case(seed)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        if case.map is not None:
            (out / "map.yaml").write_bytes(case.map.description)
            (out / "map.pgm").write_bytes(case.map.image)
        (out / "request.json").write_text(json.dumps(case.request, indent=1))
    else:
        print(json.dumps(case.request))
    use_processor_time()
    warm_up()
    outcome = try_case(case)
    said = (
        f"{case.drive}, {case.scene}: {outcome.status}, {outcome.duration:.4f} s, known {case.known:.4f} s, "
    )
    print(f"{said}planned in {outcome.seconds:.2f} s {outcome.error}", file=sys.stderr)
    for fault in outcome.faults:
        print(f"  {fault.detail}{' (between samples)' if fault.between else ''}", file=sys.stderr)
    return int(outcome.status != "planned" or bool(outcome.faults))


if __name__ == "__main__":
    sys.exit(main())
