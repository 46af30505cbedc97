"""What a service can do: throughput, latency, refusals past its capacity, and whether it stays as it is.

python -m benchmarks.load [--seconds S] [--soak MINUTES] [--workers N] [--request FILE]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import statistics
import sys
import time
from collections import Counter
from pathlib import Path

from benchmarks.load.client import Sample, Target
from benchmarks.load.service import Service, running

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "differential.json"
CLIENTS = (1, 2, 8, 32)
MOMENTS = ("start", "1 min", "middle", "end")


class Promises:
    """What is promised beside what was measured."""

    def __init__(self) -> None:
        self.broken = 0

    def check(self, what: str, measured: float, bound: float, unit: str = "") -> None:
        """A promise: measured <= bound."""
        kept = measured <= bound
        self.broken += not kept
        print(f"  {'kept  ' if kept else 'BROKEN'}  {what}: {measured:.4g}{unit}, at most {bound:.4g}{unit}")


def quantile(samples: list[Sample], share: float) -> float:
    """A quantile of the latencies, ms."""
    ordered = sorted(sample.seconds for sample in samples)
    return 1e3 * ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else float("nan")


def row(name: str, samples: list[Sample], seconds: float) -> str:
    """A line of the table: answers with a plan a second, and their latency."""
    made = [sample for sample in samples if sample.status == 200]
    figures = "".join(f"{quantile(made, share):10.0f}" for share in (0.5, 0.95, 0.99))
    others = Counter(sample.status for sample in samples if sample.status != 200)
    told = "  ".join(f"{status or 'no answer'}: {count}" for status, count in sorted(others.items()))
    return f"{name:24}{len(made) / seconds:8.1f}{figures}   {told}"


async def measure(service: Service, body: bytes, seconds: float, promises: Promises) -> float:
    """Prints everything but the soak; the capacity, plans a second."""
    target = Target(service.port, body)
    await target.closed(2 * service.workers, 3.0)
    print(f"{'':24}{'plans/s':>8}{'median':>10}{'95 %':>10}{'99 %':>10}   ms; other answers")
    capacity, alone, cpu = 0.0, [], {}
    for clients in CLIENTS:
        cpu[clients], began = -service.cpu(), time.perf_counter()
        samples = await target.closed(clients, seconds)
        took = time.perf_counter() - began  # until the last is answered
        cpu[clients] = 1e3 * (cpu[clients] + service.cpu()) / len(samples)
        print(row(f"{clients} clients", samples, took))
        capacity = max(capacity, sum(sample.status == 200 for sample in samples) / took)
        alone = alone or samples

    steady = await target.paced(0.8 * capacity, 3 * seconds)
    print(row("80 % of capacity", steady, 3 * seconds))
    promises.check("99 % / median at 80 %", quantile(steady, 0.99) / quantile(steady, 0.5), 3.0)

    queued = 1e3 * min(service.queue_wait, service.queue_length / capacity)
    lasting = max(seconds, 3e-3 * queued)
    flood = await target.paced(4 * capacity, lasting)
    print(row("4 x capacity", flood, lasting))
    taken = [sample for sample in flood if sample.status == 200]
    shed = [sample for sample in flood if sample.status == 429]
    print(f"  shed: {len(shed) / len(flood):.0%} of {len(flood)}; the queue's bound is {queued:.0f} ms")
    promises.check("95 % of those taken", quantile(taken, 0.95), 2 * quantile(alone, 0.95) + queued, " ms")
    promises.check("median of those shed", quantile(shed, 0.5), 20.0, " ms")
    promises.check("answered neither 200 nor 429", len(flood) - len(taken) - len(shed), 0)

    over = [1e3 * (sample.seconds - planning(sample)) for sample in alone if sample.status == 200]
    promises.check("median over planning, 1 client", statistics.median(over), 5.0, " ms")
    print(f"  CPU time of the server for a request: {cpu[1]:.1f} ms")
    return capacity


def planning(sample: Sample) -> float:
    """How long planning took, as the answer says, s."""
    total: float = json.loads(sample.body)["planning"]["timings"]["total"]
    return total


async def soak(service: Service, body: bytes, minutes: float, promises: Promises) -> None:
    """Keeps the service at its capacity, and weighs it."""
    target, samples, weights = Target(service.port, body), Counter[int](), []
    marks = [0.0, min(60.0, 20.0 * minutes), 30.0 * minutes, 60.0 * minutes]
    began = time.perf_counter()
    for mark in marks:
        while (left := began + mark - time.perf_counter()) > 0:
            part = await target.closed(2 * service.workers, min(left, 5.0))
            samples.update(sample.status for sample in part)
        weights.append(service.resident())
    print(f"{sum(samples.values())} requests in {minutes:g} min at capacity, by status: {dict(samples)}")
    print(f"{'resident, MB':24}" + "".join(f"{moment:>10}" for moment in MOMENTS))
    for name in weights[0]:
        figures = [weight.get(name, float("nan")) for weight in weights]
        print(f"{name:24}" + "".join(f"{figure:10.1f}" for figure in figures))
        growth = 100 * (figures[3] / figures[1] - 1)
        promises.check(f"growth of {name} after the first minute", growth, 5.0, " %")
    promises.check("requests lost", sum(samples.values()) - samples[200], 0)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="how long each step takes")
    parser.add_argument("--soak", type=float, default=10.0, metavar="MINUTES", help="0: none")
    parser.add_argument("--workers", type=int, help="planning processes; default: one a core")
    parser.add_argument("--request", type=Path, default=EXAMPLE, help="what is posted")
    asked = parser.parse_args()
    body, promises = asked.request.read_bytes(), Promises()
    with running(asked.workers) as service:
        bounds = f"a queue of {service.queue_length} places and {service.queue_wait:g} s"
        print(f"{service.workers} workers, {bounds}, {asked.request.name}")
        asyncio.run(measure(service, body, asked.seconds, promises))
        if asked.soak:
            asyncio.run(soak(service, body, asked.soak, promises))
    return 1 if promises.broken else 0


if __name__ == "__main__":
    sys.exit(main())
