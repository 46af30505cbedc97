"""Starts a Dask cluster of two workers and the service in front of it, posts a batch, and shows who planned
how much.

    python examples/cluster.py [--plans N]

Needs the extra `cluster`, and httpx. Exit status 0 where every plan was made.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import httpx
from demo import Failure, service
from distributed import Client, LocalCluster

EXAMPLES = Path(__file__).resolve().parent


def requests(count: int) -> list[dict[str, Any]]:
    """The example requests, one for each drive, as often as it takes, each time with another seed."""
    files = sorted(EXAMPLES.glob("*.json"))
    examples = [json.loads(file.read_text()) | {"name": file.stem} for file in files]
    return [
        example | {"options": example.get("options", {}) | {"seed": i // len(examples)}}
        for i, example in enumerate(itertools.islice(itertools.cycle(examples), count))
    ]


def results(url: str, batch: Sequence[Any]) -> Iterator[dict[str, Any]]:
    """The results of a batch as they come."""
    with httpx.Client(base_url=url, timeout=None, trust_env=False) as http:
        taken = http.post("/v1/batches", json={"requests": batch})
        if taken.status_code != 202:
            raise Failure(f"the batch was answered {taken.status_code}: {taken.text}")
        with http.stream("GET", f"{taken.headers['Location']}/results") as answer:
            yield from map(json.loads, answer.iter_lines())


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--plans", type=int, default=33, help="how many")
    batch = requests(parser.parse_args().plans)
    # One core a worker; what a plan's libraries would start on their own is in its way.
    cluster = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=40)
    try:
        with tempfile.TemporaryDirectory() as folder, cluster, Client(cluster) as dask:
            os.environ["WHEELPLAN_SCHEDULER"] = cluster.scheduler_address
            with service(Path(folder)) as url:
                while httpx.get(f"{url}/readyz", trust_env=False).json().get("workers", 0) < 2:
                    time.sleep(0.2)
                began = time.perf_counter()
                dask.get_task_stream()  # from here on Dask keeps a record
                failed = [line for line in results(url, batch) if "plan" not in line]
                took = time.perf_counter() - began
            tasks = [task for task in dask.get_task_stream() if task["key"].startswith("wheelplan-")]
    except (Failure, OSError) as reason:
        print(f"demo: {reason}", file=sys.stderr)
        return 1
    print(f"{'worker':32}{'plans':>7}{'busy':>9}")
    busy = 0.0
    for worker, theirs in itertools.groupby(sorted(tasks, key=place), place):
        spans = [span["stop"] - span["start"] for task in theirs for span in task["startstops"]]
        busy += sum(spans)
        print(f"{worker:32}{len(spans):7}{sum(spans):7.2f} s")
    print(f"\n{len(batch)} plans in {took:.2f} s, {busy / took:.2f} at a time.")
    for line in failed:
        print(f"{line['name']}: {line['problem']['code']}", file=sys.stderr)
    return 1 if failed else 0


def place(task: dict[str, Any]) -> str:
    """The address of the Dask worker that did it."""
    return str(task["worker"])


if __name__ == "__main__":
    sys.exit(main())
