"""Planning in processes of its own: a solver that hangs or crashes costs one request, never the service.

A pool keeps one asyncio task (a keeper) per worker. The keeper takes the next job from the queue, hands it to
its worker, and waits for the answer, the deadline, or the caller's leaving; in the last two cases, and when
the worker dies or does not take the job, it starts another.
"""

from __future__ import annotations

import asyncio
import math
import os
import pickle
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import anyio
from opentelemetry import trace

from api.apart import apart
from api.errors import Refusal
from api.fair_queue import Ticket
from api.log import log
from api.scheduler import RETRY_AFTER, Loss, Scheduler
from api.settings import Settings
from api.worker import Worker, report, stop_fork_server

__all__ = ["Pool", "local_pool", "report"]

_HAND_OVER = 1.0
"""A worker that does not take a job within this time (s) is as good as dead."""

_CALM = 5.0
"""Workers no longer crash in a loop when the last crash is this long ago, s."""

_tracer = trace.get_tracer("wheelplan")


@dataclass(eq=False, slots=True, kw_only=True)
class _Job(Ticket):
    payload: bytes
    deadline: float
    answer: asyncio.Future[Any]
    progress: Callable[[Any], None] | None
    arrived: int
    taken: int = 0

    def reported(self, value: Any) -> None:
        if self.progress is not None and not self.answer.done():
            self.progress(value)


class Pool(Scheduler[_Job]):
    """`size` workers of this machine, each doing one job at a time.

    preload  modules that a worker has imported when it is up
    memory   what a worker may allocate, in bytes; 0: unlimited
    jobs     a worker is replaced after so many; 0: never. It is also replaced if a job leaves it with half of
             what it could allocate when it was new
    """

    def __init__(
        self,
        size: int,
        queue_length: int,
        preload: Sequence[str] = (),
        *,
        queue_wait: float = 60.0,
        queue_timeout: float = 60.0,
        memory: int = 0,
        jobs: int = 0,
    ) -> None:
        super().__init__(size, queue_length, queue_wait, queue_timeout)
        self._preload = list(preload)
        self._memory = memory
        self._jobs = jobs
        # One for each worker, and one to start its replacement.
        self._threads = ThreadPoolExecutor(2 * size, "worker-pipe")
        self._workers: set[Worker] = set()
        self._keepers: list[asyncio.Task[None]] = []
        self._offers: deque[asyncio.Future[_Job]] = deque()
        """Of idle workers: each takes the job that is set."""
        self._unanswered: set[asyncio.Future[Any]] = set()
        self._starting = 0
        self._started = False
        self._crashes = 0
        self._last_crash = -math.inf

    @property
    def ready(self) -> bool:
        return self._started and not self.draining

    @property
    def crash_loop(self) -> bool:
        """Whether worker after worker dies: three times as many of late as there are, and no job done."""
        return self._crashes >= 3 * self.size and time.monotonic() - self._last_crash < _CALM

    @property
    def trouble(self) -> str | None:
        if self.draining:
            return "The service is shutting down."
        if not self._started:
            return "The service is starting."
        return "The workers die one after the other." if self.crash_loop else None

    @property
    def live(self) -> int:
        return len(self._workers)

    @property
    def spare(self) -> int:
        return len(self._offers)

    def start(self) -> None:
        for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
            os.environ.setdefault(variable, "1")
        self._keepers = [asyncio.create_task(self._keep()) for _ in range(self.size)]

    async def _run(
        self,
        function: Callable[..., Any],
        args: tuple[Any, ...],
        asked: Ticket,
        deadline: float,
        progress: Callable[[Any], None] | None,
    ) -> Any:
        loop = asyncio.get_running_loop()
        job = _Job(
            client=asked.client, foreseen=asked.foreseen,
            payload=pickle.dumps((function, args, progress is not None)), deadline=deadline,
            answer=loop.create_future(), progress=progress, arrived=time.time_ns(),
        )  # fmt: skip
        self._unanswered.add(job.answer)
        self._queue.add(job)
        self._dispatch()
        insisting = asyncio.create_task(self._insist(job))
        giving_up = loop.call_later(self.queue_timeout, self._give_up, job)
        try:
            return await job.answer
        finally:
            insisting.cancel()
            giving_up.cancel()
            self._unanswered.discard(job.answer)
            self._queue.discard(job)
            _trace(job)

    async def apart(self, function: Callable[..., Any], *args: Any) -> Any:
        if not self.ready:
            raise Refusal("draining", str(self.trouble), retry_after=RETRY_AFTER)
        alone = partial(apart, function, *args, preload=self._preload, memory=self._memory)
        return await anyio.to_thread.run_sync(alone)

    def _dispatch(self) -> None:
        """Gives jobs to idle workers."""
        while self._offers and (job := self._next()) is not None:
            self._offers.popleft().set_result(job)

    def _next(self) -> _Job | None:
        while (job := self._queue.next()) is not None and job.answer.done():
            self._queue.done(job, 0.0)
        return job

    def _give_up(self, job: _Job) -> None:
        if job in self._queue:
            self._shed(job, f"No worker was free within {self.queue_timeout:g} s.")

    def _shed(self, job: _Job, detail: str) -> None:
        self._queue.discard(job)
        if not job.answer.done():
            job.answer.set_exception(self._overloaded(detail, self._queue.expected_wait(job)))

    async def drain(self, grace: float) -> None:
        self.draining = True
        if self._unanswered:
            await asyncio.wait(self._unanswered, timeout=grace)
        for answer in self._unanswered:
            if not answer.done():
                answer.set_exception(Refusal("draining", "Stopped by a shutdown.", retry_after=RETRY_AFTER))

    def kill(self) -> None:
        workers = tuple(self._workers)  # a thread may be adding one
        for worker in workers:
            worker.kill()
        for worker in workers:
            worker.join()
        if self._starting:
            stop_fork_server()

    async def close(self) -> None:
        self.draining = True
        for keeper in self._keepers:
            keeper.cancel()
        await asyncio.gather(*self._keepers, return_exceptions=True)
        self.kill()
        await asyncio.to_thread(self._threads.shutdown)
        for worker in self._workers:
            worker.unwatch()
            worker.discard()
        self._workers.clear()

    async def _keep(self) -> None:
        worker, done = await self._start_worker(), 0
        fresh: asyncio.Task[Worker] | None = None
        try:
            while True:
                job = await self._next_job(worker, fresh)
                if job is not None:
                    done += 1
                    loss = await self._work(worker, job)
                elif worker.ended.done():
                    loss = "crashed"
                else:  # its replacement is up
                    loss = None
                if loss:
                    await self._bury(worker, loss)
                    worker, done = await (fresh or self._start_worker()), 0
                    self.restarts += 1
                    fresh = None
                elif fresh is not None and fresh.done():
                    await self._dismiss(worker)
                    worker, done, fresh = fresh.result(), 0, None
                    self.recycled += 1
                elif fresh is None and (0 < self._jobs <= done or worker.swollen):
                    fresh = asyncio.create_task(self._start_worker())
        finally:
            if fresh is not None:
                fresh.cancel()

    async def _next_job(self, worker: Worker, fresh: asyncio.Task[Worker] | None) -> _Job | None:
        """None: the worker has died, or its replacement is up."""
        if worker.ended.done() or (fresh is not None and fresh.done()):
            return None
        if (job := self._next()) is not None:
            return job
        offer: asyncio.Future[_Job] = asyncio.get_running_loop().create_future()
        self._offers.append(offer)
        try:
            ends: set[asyncio.Future[Any]] = {offer, worker.ended, *((fresh,) if fresh else ())}
            await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        finally:
            with suppress(ValueError):
                self._offers.remove(offer)
        return offer.result() if offer.done() else None

    async def _work(self, worker: Worker, job: _Job) -> Loss | None:
        """Has the worker do the job. Not None: why the worker is dead or dying."""
        began = time.monotonic()
        loss = await self._carry(worker, job)
        if job.taken or job.answer.done():
            self._queue.done(job, time.monotonic() - began)
        else:  # it has not begun, so another worker can do it
            self._queue.put_back(job)
        self._dispatch()
        return loss

    async def _carry(self, worker: Worker, job: _Job) -> Loss | None:
        """Has the worker do the job. Not None: why the worker is dead or dying."""
        loop, first = asyncio.get_running_loop(), asyncio.FIRST_COMPLETED
        taken: asyncio.Future[Any] = loop.create_future()
        exchange: asyncio.Future[Any] = loop.run_in_executor(
            self._threads,
            worker.exchange,
            job.payload,
            lambda: loop.call_soon_threadsafe(taken.set_result, None),
            lambda value: loop.call_soon_threadsafe(job.reported, value),
        )
        # At shutdown nobody is left to hear how it ended.
        exchange.add_done_callback(lambda ended: ended.cancelled() or ended.exception())
        await asyncio.wait({taken, exchange, job.answer}, timeout=_HAND_OVER, return_when=first)
        if taken.done():
            job.taken = time.time_ns()
            await asyncio.wait({exchange, job.answer}, timeout=job.deadline, return_when=first)
        if exchange.done() and exchange.exception() is None:
            self._crashes = 0
            kind, value = exchange.result()
            if not job.answer.done():
                job.answer.set_result(value) if kind == "result" else job.answer.set_exception(value)
            return None
        loss: Loss
        if job.answer.done():
            loss = "cancelled"
        elif not taken.done():
            loss = "crashed" if exchange.done() else "stopped"
        elif exchange.done():
            loss = "memory" if worker.out_of_memory else "crashed"
            detail = f"The process that planned this request {self._obituary(loss)}. No other is affected."
            job.answer.set_exception(Refusal("worker-crashed", detail))
        else:
            loss = "deadline"
            detail = f"The plan was stopped after {job.deadline:g} s of planning."
            job.answer.set_exception(Refusal("deadline-exceeded", detail))
        worker.kill()
        await asyncio.wait({exchange})
        return loss

    def _obituary(self, loss: Loss) -> str:
        return f"needed more than {self._memory} bytes of memory" if loss == "memory" else "died"

    async def _dismiss(self, worker: Worker) -> None:
        self._workers.discard(worker)
        worker.unwatch()
        await asyncio.get_running_loop().run_in_executor(self._threads, worker.discard)

    async def _bury(self, worker: Worker, loss: Loss) -> None:
        await self._dismiss(worker)
        log(event="worker lost", reason=loss, pid=worker.pid, exit_code=worker.exit_code)
        self.losses[loss] += 1
        if loss not in ("deadline", "cancelled"):
            self._crashes += 1
            self._last_crash = time.monotonic()
        if self.crash_loop:
            await asyncio.sleep(RETRY_AFTER)

    async def _start_worker(self) -> Worker:
        failures = 0
        while True:
            self._starting += 1
            try:
                worker = await asyncio.get_running_loop().run_in_executor(self._threads, self._fork)
            except Exception as error:
                log(event="a worker did not start", error=repr(error))
                # A fork may fail once, on a machine under load; twice in a row is no accident.
                failures += 1
                if failures > 1:
                    self._started = self._started and bool(self._workers)
                    await asyncio.sleep(RETRY_AFTER)
            else:
                worker.watch()
                if not self._started:
                    log(event="ready")
                self._started = True
                return worker

    def _fork(self) -> Worker:
        try:
            worker = Worker(self._preload, self._memory)
            self._workers.add(worker)
        finally:
            self._starting -= 1
        return worker


def _trace(job: _Job) -> None:
    """The stages of a job, as children of the request's span. Without an OpenTelemetry SDK: nothing."""
    now = time.time_ns()
    _tracer.start_span("queue", start_time=job.arrived).end(job.taken or now)
    if job.taken:
        _tracer.start_span("plan", start_time=job.taken).end(now)


def local_pool(settings: Settings, size: int) -> Pool:
    """Workers of this machine, with the planner loaded and compiled."""
    return Pool(
        size,
        settings.queue_length,
        preload=["api.warm"],
        queue_wait=settings.queue_wait,
        queue_timeout=settings.queue_timeout,
        memory=settings.worker_memory,
        jobs=settings.worker_plans,
    )
