"""What stands between the API and where plans are computed: the local pool, or a cluster of them."""

from __future__ import annotations

import asyncio
import math
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from typing import Any, Generic, Literal, TypeVar

from api.errors import Refusal
from api.fair_queue import FairQueue, Ticket

__all__ = ["LOSSES", "RETRY_AFTER", "Loss", "Scheduler"]

Loss = Literal["deadline", "cancelled", "stopped", "memory", "crashed"]
"""Why a worker is replaced: it overran a deadline; its caller left; it did not take a job; it came to its
memory limit; it died."""

LOSSES: tuple[Loss, ...] = ("deadline", "cancelled", "stopped", "memory", "crashed")

RETRY_AFTER = 1
"""The least that a client who is turned away is told to wait, s."""

_FILLED = 2 / 3
"""The queue is filled up to this share of queue_wait. Thirty jobs, whose times are spread exponentially, take
half as long again as expected in one case of twenty."""


T = TypeVar("T", bound=Ticket)


class Scheduler(ABC, Generic[T]):
    """Runs one function call a worker at a time, in processes that it may kill, and has a queue before them
    that is fair between clients (`api.fair_queue`).

    size           workers that it has or is about to have
    queue_length   jobs that may wait for a worker
    queue_wait     s; a job is refused if it is expected to wait for longer, unless hardly any job waits;
                   jobs that take longer leave a worker to other clients
    queue_timeout  s; no job waits longer, whatever was expected

    shed      jobs refused so far because too many waited
    restarts  workers replaced so far because they were lost
    recycled  workers replaced so far because they had done enough
    losses    workers killed or dead so far, by reason
    draining  whether a shutdown has begun
    """

    def __init__(self, size: int, queue_length: int, queue_wait: float, queue_timeout: float) -> None:
        self._queue: FairQueue[T] = FairQueue(size, queue_wait)
        self.queue_length = queue_length
        self.queue_wait = queue_wait
        self.queue_timeout = queue_timeout
        self.shed = 0
        self.restarts = 0
        self.recycled = 0
        self.losses: Counter[Loss] = Counter()
        self.draining = False

    @property
    def size(self) -> int:
        return self._queue.size

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
    def spare(self) -> int:
        """Idle workers: no job waits that they may take."""

    @property
    def queued(self) -> int:
        """Jobs that wait for a worker."""
        return len(self._queue)

    def starts(self, ticket: Ticket) -> bool:
        """Whether such a job would be given a worker at once."""
        return self.ready and self.spare > 0 and self._queue.may_start(ticket)

    @abstractmethod
    def start(self) -> None:
        """Begins to bring the workers up; called once, in the event loop that all jobs come from."""

    def admit(self, ticket: Ticket) -> None:
        """Raises Refusal where such a job would not be taken at present: draining, overloaded."""
        if not self.ready:
            raise Refusal("draining", str(self.trouble), retry_after=RETRY_AFTER)
        if self.starts(ticket):
            return
        wait = self._queue.expected_wait(ticket)
        if len(self._queue) >= self.queue_length and not self._queue.last_of_the_longest(ticket.client):
            raise self._overloaded(f"{self.queued} plans already wait for {self.size} workers.", wait)
        if wait > _FILLED * self.queue_wait and not self._queue.has_room(ticket.client):
            raise self._overloaded(
                f"This plan would wait for {wait:.1f} s; {self.queued} wait already.", wait
            )

    async def run(
        self,
        function: Callable[..., Any],
        *args: Any,
        deadline: float,
        ticket: Ticket | None = None,
        progress: Callable[[Any], None] | None = None,
    ) -> Any:
        """What function(*args) returns or raises in a worker. The function is one of a module's.

        deadline s from the moment a worker takes the job; then its process is killed. ticket: whose job it
        is, and how long it will keep the worker. progress is called, in the event loop, with each value that
        the function hands to `api.workers.report`. If the caller is cancelled, so is the job.
        Raises Refusal: draining, overloaded, deadline-exceeded, worker-crashed.
        """
        asked = ticket or Ticket()
        self.admit(asked)
        if not self.starts(asked) and len(self._queue) >= self.queue_length:
            last = self._queue.last_of_the_longest(asked.client)
            assert last is not None
            self._shed(last, "Another client's plan took this one's place in the queue.")
        return await self._run(function, args, asked, deadline, progress)

    @abstractmethod
    async def apart(self, function: Callable[..., Any], *args: Any) -> Any:
        """What function(*args) returns or raises in a process of this machine that does nothing else. It
        does not queue with the plans. Raises Refusal: draining, deadline-exceeded, worker-crashed."""

    @abstractmethod
    async def _run(
        self,
        function: Callable[..., Any],
        args: tuple[Any, ...],
        asked: Ticket,
        deadline: float,
        progress: Callable[[Any], None] | None,
    ) -> Any:
        """`run`, of a job that is let in."""

    async def _insist(self, ticket: T) -> None:
        """Each queue_wait that this job waits: stops a job of a client that holds more than its share."""
        while True:
            await asyncio.sleep(self.queue_wait)
            if ticket in self._queue and (excess := self._queue.excess(ticket.client)) is not None:
                self._shed(excess, "The plan was stopped for another client, who waits for a worker.")

    @abstractmethod
    def _shed(self, ticket: T, detail: str) -> None:
        """Refuses a job that waits or is being done: overloaded."""

    @abstractmethod
    async def drain(self, grace: float) -> None:
        """Refuses new jobs, and waits up to `grace` s for those that have been taken."""

    @abstractmethod
    async def close(self) -> None:
        """Ends every job, and lets go of the workers."""

    @abstractmethod
    def kill(self) -> None:
        """The same without an event loop, where one has ended too soon."""

    def _overloaded(self, detail: str, wait: float) -> Refusal:
        """The refusal of a job, counted. wait: what it is told to wait, s."""
        self.shed += 1
        return Refusal("overloaded", detail, retry_after=max(RETRY_AFTER, math.ceil(wait)))
