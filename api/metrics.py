"""What Prometheus may ask: requests, planning times, and the state of the workers."""

from __future__ import annotations

from collections.abc import Iterator

from prometheus_client import CollectorRegistry, Counter, Histogram, ProcessCollector
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from api.scheduler import Scheduler

__all__ = ["Metrics"]

_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)


class Metrics:
    """The metrics of one application, in a registry of their own."""

    def __init__(self, pool: Scheduler) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        self.registry.register(_Workers(pool))
        self.requests = Counter(
            "wheelplan_requests", "Requests answered.", ["method", "route", "status"], registry=self.registry
        )
        self.planning = Histogram(
            "wheelplan_planning_seconds", "Time a worker took for a plan, by drive.", ["drive"],
            buckets=_SECONDS, registry=self.registry,
        )  # fmt: skip
        self.refused = Counter(
            "wheelplan_refused", "Plans not made, by problem code.", ["code"], registry=self.registry
        )


class _Workers(Collector):
    def __init__(self, pool: Scheduler) -> None:
        self.pool = pool

    def collect(self) -> Iterator[Metric]:
        yield GaugeMetricFamily("wheelplan_workers", "Workers that are up.", self.pool.live)
        yield GaugeMetricFamily("wheelplan_queue_depth", "Plans that wait for a worker.", self.pool.queued)
        yield CounterMetricFamily("wheelplan_worker_restarts", "Workers replaced.", self.pool.restarts)
        yield CounterMetricFamily(
            "wheelplan_shed", "Plans refused because the queue was full.", self.pool.shed
        )
