"""What Prometheus may ask: requests, planning times, and the state of the workers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from prometheus_client import CollectorRegistry, Counter, Histogram, ProcessCollector
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from api.batches import Batches
from api.bounds import Allowance
from api.log import dropped
from api.planning import Answer
from api.scheduler import LOSSES, Scheduler
from planner.problem import Problem

__all__ = ["Metrics"]

_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
_RATIOS = (1.0, 1.02, 1.05, 1.1, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0)


class Metrics:
    """The metrics of one application, in a registry of their own."""

    def __init__(self, pool: Scheduler[Any], batches: Batches, bodies: Allowance) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        self.registry.register(_Workers(pool))
        self.registry.register(_Batches(batches))
        self.registry.register(_Server(bodies))
        self.requests = Counter(
            "wheelplan_requests", "Requests answered.", ["method", "route", "status"], registry=self.registry
        )
        self.planning = Histogram(
            "wheelplan_planning_seconds", "Time that planning took.", ["drive", "planner"],
            buckets=_SECONDS, registry=self.registry,
        )  # fmt: skip
        self.durations = Histogram(
            "wheelplan_duration_ratio",
            "A motion's duration over the least time in which its busiest wheel could turn as far.",
            ["drive"], buckets=_RATIOS, registry=self.registry,
        )  # fmt: skip
        self.uncertified = Counter(
            "wheelplan_motions_refused", "Motions that failed their certificate.",
            ["drive"], registry=self.registry,
        )  # fmt: skip
        self.refused = Counter(
            "wheelplan_refused", "Plans not made, by problem code.", ["code"], registry=self.registry
        )

    def planned(self, problem: Problem, answer: Answer) -> None:
        """Counts a plan that was made."""
        drive = problem.robot.drive.kind
        self.planning.labels(drive, answer.planner).observe(answer.seconds)
        self.durations.labels(drive).observe(answer.duration_ratio)
        self.uncertified.labels(drive).inc(answer.refused)


class _Workers(Collector):
    def __init__(self, pool: Scheduler[Any]) -> None:
        self.pool = pool

    def collect(self) -> Iterator[Metric]:
        yield GaugeMetricFamily("wheelplan_workers", "Workers that are up.", self.pool.live)
        yield GaugeMetricFamily("wheelplan_workers_idle", "Workers with nothing to do.", self.pool.spare)
        yield GaugeMetricFamily("wheelplan_queue_depth", "Plans that wait for a worker.", self.pool.queued)
        yield CounterMetricFamily("wheelplan_worker_restarts", "Workers replaced.", self.pool.restarts)
        yield CounterMetricFamily(
            "wheelplan_workers_recycled", "Workers replaced after they had done enough.", self.pool.recycled
        )
        lost = CounterMetricFamily("wheelplan_workers_lost", "Workers killed or dead.", labels=["reason"])
        for reason in LOSSES:
            lost.add_metric([reason], self.pool.losses[reason])
        yield lost
        yield CounterMetricFamily("wheelplan_shed", "Plans refused because too many waited.", self.pool.shed)


class _Batches(Collector):
    def __init__(self, batches: Batches) -> None:
        self.batches = batches

    def collect(self) -> Iterator[Metric]:
        yield GaugeMetricFamily("wheelplan_batches", "Batches that have not ended.", self.batches.running)
        yield GaugeMetricFamily(
            "wheelplan_batch_items", "Requests of batches that wait for a worker.", self.batches.waiting
        )
        yield CounterMetricFamily(
            "wheelplan_batches_set_aside", "Batches on disk that could not be read.", self.batches.set_aside
        )


class _Server(Collector):
    def __init__(self, bodies: Allowance) -> None:
        self.bodies = bodies

    def collect(self) -> Iterator[Metric]:
        yield GaugeMetricFamily("wheelplan_body_bytes", "Bytes of request bodies held.", self.bodies.held)
        yield CounterMetricFamily("wheelplan_log_dropped", "Lines of the log dropped.", dropped())
