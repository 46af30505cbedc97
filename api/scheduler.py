"""What stands between the API and where plans are computed: the local pool, or a cluster of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any, Protocol

from api.settings import Settings
from api.workers import Loss, Pool

__all__ = ["Scheduler", "local_pool"]


class Scheduler(Protocol):
    """Runs one function call a worker at a time, in processes that it may kill.

    shed      jobs refused so far because too many waited
    restarts  workers replaced so far
    losses    workers killed or dead so far, by reason
    draining  whether a shutdown has begun
    """

    shed: int
    restarts: int
    losses: Counter[Loss]
    draining: bool

    @property
    def ready(self) -> bool:
        """Whether jobs are taken: there has been a worker, and no shutdown has begun."""

    @property
    def trouble(self) -> str | None:
        """Why a new client should go elsewhere; None: all is well."""

    @property
    def live(self) -> int:
        """Workers that are up."""

    @property
    def queued(self) -> int:
        """Jobs that wait for a worker."""

    @property
    def spare(self) -> int:
        """Idle workers that no queued job will take."""

    def start(self) -> None:
        """Begins to bring the workers up; called once, in the event loop that all jobs come from."""

    def admit(self) -> None:
        """Raises Refusal where a job would not be taken at present: draining, overloaded."""

    async def run(
        self,
        function: Callable[..., Any],
        *args: Any,
        deadline: float,
        progress: Callable[[Any], None] | None = None,
    ) -> Any:
        """What function(*args) returns or raises in a worker. The function is one of a module's.

        deadline s from the moment a worker takes the job; then its process is killed. progress is called, in
        the event loop, with each value that the function hands to `api.workers.report`. If the caller is
        cancelled, so is the job. Raises Refusal: draining, overloaded, deadline-exceeded, worker-crashed.
        """

    async def drain(self, grace: float) -> None:
        """Refuses new jobs, and waits up to `grace` s for those that have been taken."""

    async def close(self) -> None:
        """Ends every job, and lets go of the workers."""

    def kill(self) -> None:
        """The same without an event loop, where one has ended too soon."""


def local_pool(settings: Settings, size: int) -> Pool:
    """Workers of this machine, with the planner loaded and compiled."""
    return Pool(
        size,
        settings.queue_length,
        preload=["api.warm"],
        queue_timeout=settings.queue_timeout,
        memory=settings.worker_memory,
    )
