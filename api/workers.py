"""Planning in processes of its own: a solver that hangs or crashes costs one request, never the service.

A pool keeps one asyncio task (a keeper) per worker. The keeper takes the next job from the queue, hands it to
its worker through a pipe, and waits for the answer, the deadline, or the caller's leaving; in the last two
cases, and when the worker dies, it starts another. Workers are forked from a fork server that has imported
and warmed the planner once, so that a replacement is ready in milliseconds. The kernel ends them when the
server is gone.
"""

from __future__ import annotations

import asyncio
import fcntl
import os
import pickle
import signal
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from api.errors import Refusal
from api.log import log

__all__ = ["Pool", "report"]


_RETRY_AFTER = 1
"""What a client who is turned away is told to wait, and what we wait before starting a worker again, s."""

_LONGEST_START = 600.0
"""The first worker waits for the fork server to import and compile everything, s."""


@dataclass(eq=False, slots=True)
class _Job:
    payload: bytes
    deadline: float
    answer: asyncio.Future[Any]
    progress: Callable[[Any], None] | None

    def reported(self, value: Any) -> None:
        if self.progress is not None and not self.answer.done():
            self.progress(value)


@dataclass(eq=False, slots=True)
class _Worker:
    process: BaseProcess
    pipe: Connection
    lifeline: Connection

    def discard(self) -> None:
        """Kills the process. Nobody may be using the pipe."""
        self.process.kill()
        self.lifeline.close()
        self.process.join()
        self.pipe.close()


class Pool:
    """`size` workers, each doing one job at a time, and a queue of `queue_length` jobs in front of them.

    preload: modules that the fork server imports before it forks a worker; a worker is up when it has them.
    """

    def __init__(self, size: int, queue_length: int, preload: Sequence[str] = ()) -> None:
        self.size = size
        self.queue_length = queue_length
        self.restarts = 0
        self.shed = 0
        self.draining = False
        self._context = get_context("forkserver")
        self._preload = list(preload)
        self._context.set_forkserver_preload(self._preload)
        self._threads = ThreadPoolExecutor(size, "worker-pipe")
        self._workers: set[_Worker] = set()
        self._keepers: list[asyncio.Task[None]] = []
        self._jobs: asyncio.Queue[_Job] = asyncio.Queue()
        self._waiting: set[_Job] = set()
        self._unanswered: set[asyncio.Future[Any]] = set()
        self._idle = 0
        self._started = False

    @property
    def ready(self) -> bool:
        """Whether jobs are taken: a worker has been up, and no shutdown has begun."""
        return self._started and not self.draining

    @property
    def live(self) -> int:
        """Workers that are up."""
        return len(self._workers)

    @property
    def queued(self) -> int:
        """Jobs that wait for a worker."""
        return max(0, len(self._waiting) - self._idle)

    @property
    def spare(self) -> int:
        """Idle workers that no queued job will take."""
        return max(0, self._idle - len(self._waiting))

    def start(self) -> None:
        """Begins to start the workers; `ready` once the first is up."""
        for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
            os.environ.setdefault(variable, "1")
        self._keepers = [asyncio.create_task(self._keep()) for _ in range(self.size)]

    async def run(
        self,
        function: Callable[..., Any],
        *args: Any,
        deadline: float,
        progress: Callable[[Any], None] | None = None,
    ) -> Any:
        """What function(*args) returns or raises in a worker. The function is one of a module's.

        deadline s from the moment a worker takes the job. progress is called, in the event loop, with each
        value that the function hands to `report`. If the caller is cancelled, so is the job. Raises
        Refusal: draining, overloaded, deadline-exceeded, worker-crashed.
        """
        if not self.ready:
            why = "The service is shutting down." if self.draining else "No worker is up yet."
            raise Refusal("draining", why, retry_after=_RETRY_AFTER)
        if len(self._waiting) - self._idle >= self.queue_length:
            self.shed += 1
            detail = f"{self.queued} plans already wait for {self.size} workers."
            raise Refusal("overloaded", detail, retry_after=_RETRY_AFTER)
        payload = pickle.dumps((function, args, progress is not None))
        job = _Job(payload, deadline, asyncio.get_running_loop().create_future(), progress)
        self._waiting.add(job)
        self._unanswered.add(job.answer)
        self._jobs.put_nowait(job)
        try:
            return await job.answer
        finally:
            self._waiting.discard(job)
            self._unanswered.discard(job.answer)

    async def drain(self, grace: float) -> None:
        """Refuses new jobs, and waits up to `grace` s for those that have been taken."""
        self.draining = True
        if self._unanswered:
            await asyncio.wait(self._unanswered, timeout=grace)
        for answer in self._unanswered:
            if not answer.done():
                answer.set_exception(Refusal("draining", "Stopped by a shutdown.", retry_after=_RETRY_AFTER))

    def kill(self) -> None:
        """Kills every worker, so that no thread of ours waits for one any longer."""
        for worker in self._workers:
            worker.process.kill()

    async def close(self) -> None:
        """Kills every worker and waits for its end."""
        self.draining = True
        for keeper in self._keepers:
            keeper.cancel()
        await asyncio.gather(*self._keepers, return_exceptions=True)
        self.kill()
        await asyncio.to_thread(self._threads.shutdown)
        for worker in self._workers:
            worker.discard()
        self._workers.clear()

    async def _keep(self) -> None:
        worker = await self._start_worker()
        while True:
            self._idle += 1
            try:
                job = await self._jobs.get()
            finally:
                self._idle -= 1
            if job.answer.done():
                continue
            if worker.pipe.poll():  # it never speaks unasked: this is its end
                worker = await self._replace(worker)
            self._waiting.discard(job)
            if not await self._carry(worker, job):
                worker = await self._replace(worker)

    async def _carry(self, worker: _Worker, job: _Job) -> bool:
        """Has the worker do the job. False: the worker is dead or dying."""
        loop = asyncio.get_running_loop()

        def exchange_() -> tuple[bool, Any]:
            worker.pipe.send_bytes(job.payload)
            while (message := pickle.loads(worker.pipe.recv_bytes()))[0] is None:
                loop.call_soon_threadsafe(job.reported, message[1])
            done, outcome = message
            return done, outcome

        exchange = loop.run_in_executor(self._threads, exchange_)
        # At shutdown nobody is left to hear how it ended.
        exchange.add_done_callback(lambda ended: ended.cancelled() or ended.exception())
        await asyncio.wait({exchange, job.answer}, timeout=job.deadline, return_when=asyncio.FIRST_COMPLETED)
        if not exchange.done():
            worker.process.kill()
            if not job.answer.done():
                detail = f"The plan was stopped after {job.deadline:g} s of planning."
                job.answer.set_exception(Refusal("deadline-exceeded", detail))
            with suppress(EOFError, OSError):
                await exchange
            return False
        try:
            done, outcome = exchange.result()
        except Exception:  # the pipe ended, or what came through it cannot be read
            if not job.answer.done():
                detail = "The process that planned this request died. No other request is affected."
                job.answer.set_exception(Refusal("worker-crashed", detail))
            return False
        if not job.answer.done():
            job.answer.set_result(outcome) if done else job.answer.set_exception(outcome)
        return True

    async def _replace(self, worker: _Worker) -> _Worker:
        self.restarts += 1
        log(event="worker replaced", pid=worker.process.pid)
        self._workers.discard(worker)
        await asyncio.get_running_loop().run_in_executor(self._threads, worker.discard)
        return await self._start_worker()

    async def _start_worker(self) -> _Worker:
        failures = 0
        while True:
            try:
                worker = await asyncio.get_running_loop().run_in_executor(self._threads, self._fork)
            except Exception as error:
                log(event="a worker did not start", error=repr(error))
                # A fork may fail once, on a machine under load; twice in a row is no accident.
                failures += 1
                if failures > 1:
                    self._started = self._started and bool(self._workers)
                    await asyncio.sleep(_RETRY_AFTER)
            else:
                if not self._started:
                    log(event="ready")
                self._started = True
                return worker

    def _fork(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        watched, lifeline = self._context.Pipe(duplex=False)
        process = self._context.Process(target=_work, args=(theirs, watched, self._preload), daemon=True)
        worker = _Worker(process, ours, lifeline)
        try:
            process.start()
            theirs.close()
            watched.close()
            if not ours.poll(_LONGEST_START):
                raise OSError(f"not up after {_LONGEST_START:g} s")
            ours.recv_bytes()
        except BaseException:
            lifeline.close()
            if process.pid is not None:
                process.kill()
            raise
        self._workers.add(worker)
        return worker


_listener: Connection | None = None
"""In a worker: where the caller of the present job hears of its progress, if it wants to."""


def report(value: Any) -> None:
    """Tells the caller of the present job how far it is. Outside a worker, or where nobody asked: nothing."""
    if _listener is not None:
        _listener.send_bytes(pickle.dumps((None, value), pickle.HIGHEST_PROTOCOL))


def _work(pipe: Connection, lifeline: Connection, preload: Sequence[str]) -> None:
    """A worker: does one job after the other until the pipe closes."""
    # Signals to the whole process group are the server's to answer; its plans in flight may finish.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    # The server holds the other end of the lifeline. When it dies the kernel raises SIGIO here, whose default
    # is the end of the process, even while a solver holds the interpreter's lock.
    fcntl.fcntl(lifeline, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(lifeline, fcntl.F_SETFL, fcntl.fcntl(lifeline, fcntl.F_GETFL) | os.O_ASYNC)
    for module in preload:  # the fork server has them, unless it could not import them
        import_module(module)
    with suppress(EOFError, OSError):
        pipe.send_bytes(b"up")
        while True:
            pipe.send_bytes(_outcome(pipe, pipe.recv_bytes()))


def _outcome(pipe: Connection, payload: bytes) -> bytes:
    global _listener
    try:
        function, args, listens = pickle.loads(payload)
        _listener = pipe if listens else None
        return pickle.dumps((True, function(*args)), pickle.HIGHEST_PROTOCOL)
    except BaseException as error:
        error.add_note(traceback.format_exc())
        try:
            answer = pickle.dumps((False, error))
            pickle.loads(answer)
        except Exception:
            stand_in = RuntimeError(f"{type(error).__name__}: {error}")
            stand_in.add_note(traceback.format_exc())
            answer = pickle.dumps((False, stand_in))
        return answer
