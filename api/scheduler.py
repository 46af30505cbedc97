"""What stands between the API and where plans are computed: the local pool, or a cluster of them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from typing import Any, Literal

from api.errors import Refusal

__all__ = ["LOSSES", "RETRY_AFTER", "Loss", "Scheduler"]

Loss = Literal["deadline", "cancelled", "stopped", "memory", "crashed"]
"""Why a worker is replaced: it overran a deadline; its caller left; it did not take a job; it came to its
memory limit; it died."""

LOSSES: tuple[Loss, ...] = ("deadline", "cancelled", "stopped", "memory", "crashed")

RETRY_AFTER = 1
"""The least that a client who is turned away is told to wait, s."""

_OF_LATE = 16
"""What jobs take is averaged over about so many."""

_BENEFIT = 4
"""The first jobs are averaged with so many that took no time: one alone says little."""

_FILLED = 2 / 3
"""The queue is filled up to this share of queue_wait. Thirty jobs, whose times are spread exponentially, take
half as long again as expected in one case of twenty."""


class Scheduler(ABC):
    """Runs one function call a worker at a time, in processes that it may kill, and has a queue before them.

    size           workers that it has or is about to have
    queue_length   jobs that may wait for a worker
    queue_wait     s; a job is refused where those before it are expected to keep the workers for longer,
                   unless fewer wait than there are workers
    queue_timeout  s; no job waits longer, whatever was expected

    shed      jobs refused so far because too many waited
    restarts  workers replaced so far
    losses    workers killed or dead so far, by reason
    draining  whether a shutdown has begun
    """

    def __init__(self, size: int, queue_length: int, queue_wait: float, queue_timeout: float) -> None:
        self.size = size
        self.queue_length = queue_length
        self.queue_wait = queue_wait
        self.queue_timeout = queue_timeout
        self.shed = 0
        self.restarts = 0
        self.losses: Counter[Loss] = Counter()
        self.draining = False
        self._typical = 0.0
        self._learnt_from = _BENEFIT
        self._foreseen: list[float] = []

    @property
    @abstractmethod
    def ready(self) -> bool:
        """Whether jobs are taken: there has been a worker, and no shutdown has begun."""

    @property
    @abstractmethod
    def trouble(self) -> str | None:
        """Why a new client should go elsewhere; None: all is well."""

    @property
    @abstractmethod
    def live(self) -> int:
        """Workers that are up."""

    @property
    @abstractmethod
    def outstanding(self) -> int:
        """Jobs that wait or are being done. A worker that is being replaced counts as one."""

    @property
    def queued(self) -> int:
        """Jobs that wait for a worker."""
        return max(0, self.outstanding - self.size)

    @property
    def spare(self) -> int:
        """Idle workers that no queued job will take."""
        return max(0, self.size - self.outstanding)

    @property
    def expected_wait(self) -> float:
        """How long the jobs there are will keep the workers (s), going by what jobs took of late where it is
        not foreseen."""
        others = self.outstanding - len(self._foreseen)
        return (sum(self._foreseen) + others * self._typical) / max(1, self.size)

    @abstractmethod
    def start(self) -> None:
        """Begins to bring the workers up; called once, in the event loop that all jobs come from."""

    def admit(self) -> None:
        """Raises Refusal where a job would not be taken at present: draining, overloaded."""
        if not self.ready:
            raise Refusal("draining", str(self.trouble), retry_after=RETRY_AFTER)
        waiting = self.outstanding - self.size
        late = self.expected_wait > _FILLED * self.queue_wait
        if waiting >= self.queue_length or (waiting >= self.size and late):
            raise self._overloaded(f"{self.queued} plans already wait for {self.size} workers.")

    async def run(
        self,
        function: Callable[..., Any],
        *args: Any,
        deadline: float,
        foreseen: float | None = None,
        progress: Callable[[Any], None] | None = None,
    ) -> Any:
        """What function(*args) returns or raises in a worker. The function is one of a module's.

        deadline s from the moment a worker takes the job; then its process is killed. foreseen is how long
        the job will keep the worker (s), where that is known. progress is called, in the event loop, with
        each value that the function hands to `api.workers.report`. If the caller is cancelled, so is the job.
        Raises Refusal: draining, overloaded, deadline-exceeded, worker-crashed.
        """
        self.admit()
        known = [] if foreseen is None else [foreseen]
        self._foreseen += known
        try:
            return await self._run(function, args, deadline, progress, learn=foreseen is None)
        finally:
            for seconds in known:
                self._foreseen.remove(seconds)

    @abstractmethod
    async def apart(self, function: Callable[..., Any], *args: Any) -> Any:
        """What function(*args) returns or raises in a process of this machine that does nothing else. It
        does not queue with the plans. Raises Refusal: draining, deadline-exceeded, worker-crashed."""

    @abstractmethod
    async def _run(
        self,
        function: Callable[..., Any],
        args: tuple[Any, ...],
        deadline: float,
        progress: Callable[[Any], None] | None,
        learn: bool,
    ) -> Any:
        """`run`, of a job that is let in. learn: whether `_took` should hear what it took."""

    @abstractmethod
    async def drain(self, grace: float) -> None:
        """Refuses new jobs, and waits up to `grace` s for those that have been taken."""

    @abstractmethod
    async def close(self) -> None:
        """Ends every job, and lets go of the workers."""

    @abstractmethod
    def kill(self) -> None:
        """The same without an event loop, where one has ended too soon."""

    def _overloaded(self, detail: str) -> Refusal:
        """The refusal of a job, counted."""
        self.shed += 1
        wait = max(RETRY_AFTER, math.ceil(self.expected_wait))
        return Refusal("overloaded", detail, retry_after=wait)

    def _took(self, seconds: float) -> None:
        """Learns how long a worker was busy with a job. A rare long one says little of those to come, so
        that it counts as queue_wait at most."""
        self._learnt_from = min(self._learnt_from + 1, _OF_LATE)
        self._typical += (min(seconds, self.queue_wait) - self._typical) / self._learnt_from
