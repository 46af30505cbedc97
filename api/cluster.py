"""Plans on a Dask cluster: each Dask worker supervises processes as the local pool does.

This end of it keeps the queue and submits as many jobs at a time as the cluster offers planning processes;
Dask decides where. The other end is `api.supervisor`, a plugin that every Dask worker gets from us.
"""

from __future__ import annotations

import asyncio
import pickle
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import anyio
from distributed import Client
from distributed.client import FutureCancelledError
from distributed.scheduler import KilledWorker

from api.apart import apart
from api.errors import Refusal
from api.fair_queue import Ticket
from api.log import adopt, log
from api.scheduler import RETRY_AFTER, Loss, Scheduler
from api.supervisor import NAME, Supervisor, carry, reported

__all__ = ["Cluster"]

adopt("distributed")  # its own handlers write from the event loop

_GLANCE = 1.0
"""How often we ask how many processes there are, s."""

_SILENCE = 5.0
"""A Dask scheduler that does not answer for so long is gone, s."""

_TRAVEL = 10.0
"""What a job may take beyond its deadline: to travel, and to begin anew where its Dask worker is lost, s."""

_LOSSES: dict[str, Loss] = {"deadline-exceeded": "deadline", "worker-crashed": "crashed"}


@dataclass(eq=False, slots=True, kw_only=True)
class _Turn(Ticket):
    """A place in the queue, and its turn to submit a job."""

    given: asyncio.Future[None]
    job: asyncio.Task[Any] | None = None
    refusal: Refusal | None = None


class Cluster(Scheduler[_Turn]):
    """The processes of a Dask cluster, for all servers that use it. `address`: of the Dask scheduler, as
    tcp://host:port."""

    def __init__(
        self, address: str, queue_length: int, queue_wait: float, queue_timeout: float, memory: int = 0
    ) -> None:
        super().__init__(0, queue_length, queue_wait, queue_timeout)
        self.address = address
        self._memory = memory
        self._stopped = False
        self._client: Client | None = None
        self._connection: asyncio.Task[None] | None = None
        self._jobs: set[asyncio.Task[Any]] = set()
        self._begun: dict[str, asyncio.Future[str]] = {}

    @property
    def trouble(self) -> str | None:
        if self.draining:
            return "The service is shutting down."
        if self._client is None:
            return "There is no connection to the cluster."
        return None if self.size else "The cluster has no worker that is up."

    @property
    def ready(self) -> bool:
        return self.trouble is None

    @property
    def live(self) -> int:
        return self.size

    @property
    def spare(self) -> int:
        return max(0, self.size - self._queue.held)

    def start(self) -> None:
        self._connection = asyncio.create_task(self._connect())

    async def _run(
        self,
        function: Callable[..., Any],
        args: tuple[Any, ...],
        asked: Ticket,
        deadline: float,
        progress: Callable[[Any], None] | None,
    ) -> Any:
        turn = _Turn(
            client=asked.client, foreseen=asked.foreseen,
            given=asyncio.get_running_loop().create_future(),
        )  # fmt: skip
        self._queue.add(turn)
        self._wake()
        insisting = asyncio.create_task(self._insist(turn))
        job = turn.job = asyncio.create_task(
            self._carry(turn, pickle.dumps((function, args)), deadline, progress)
        )
        job.add_done_callback(lambda _: self._leave(turn))  # also of a job that is cancelled before it begins
        self._jobs.add(job)
        try:
            return await job
        except asyncio.CancelledError:
            if turn.refusal is not None and job.cancelled():
                raise turn.refusal from None
            if self._stopped and job.cancelled():
                raise Refusal("draining", "Stopped by a shutdown.", retry_after=RETRY_AFTER) from None
            raise
        finally:
            insisting.cancel()
            self._jobs.discard(job)

    async def apart(self, function: Callable[..., Any], *args: Any) -> Any:
        alone = partial(apart, function, *args, preload=["api.maps"], memory=self._memory)
        return await anyio.to_thread.run_sync(alone)

    async def drain(self, grace: float) -> None:
        self.draining = True
        if self._jobs:
            await asyncio.wait(self._jobs, timeout=grace)
        self._stop()

    async def close(self) -> None:
        self.draining = True
        self._stop()
        if self._connection is not None:
            self._connection.cancel()
            await asyncio.gather(self._connection, return_exceptions=True)

    def kill(self) -> None:
        """Nothing: when we are gone, Dask releases our jobs."""

    def _stop(self) -> None:
        self._stopped = True
        for job in self._jobs:
            job.cancel()

    async def _connect(self) -> None:
        """Keeps the connection, and counts the cluster's processes."""
        while not self._stopped:  # not only cancelled: a library may lose a cancellation
            try:
                async with Client(
                    self.address, asynchronous=True, set_as_default=False, timeout=_SILENCE
                ) as client:
                    async with asyncio.timeout(_SILENCE):
                        await client.register_plugin(Supervisor(), name=NAME)
                    client.subscribe_topic(NAME, self._note_beginning)
                    self._client = client
                    log(event="connected", cluster=self.address)
                    while client.status == "running" and not self._stopped:
                        async with asyncio.timeout(_SILENCE):
                            self._resize(await _offered(client))
                        await asyncio.sleep(_GLANCE)
            except Exception as error:
                log(event="no connection", cluster=self.address, error=repr(error))
            finally:
                self._client = None
                self._resize(0)
            await asyncio.sleep(_GLANCE)

    def _resize(self, size: int) -> None:
        if size != self.size:
            log(event="cluster", workers=size)
        self._queue.size = size
        self._wake()

    def _wake(self) -> None:
        while self.spare and (turn := self._queue.next()) is not None:
            turn.given.set_result(None)

    def _shed(self, turn: _Turn, detail: str) -> None:
        self._queue.discard(turn)
        refusal = self._overloaded(detail, self._queue.expected_wait(turn))
        if not turn.given.done():
            turn.given.set_exception(refusal)
        elif turn.job is not None:
            turn.refusal = refusal
            turn.job.cancel()

    def _leave(self, turn: _Turn) -> None:
        self._queue.discard(turn)
        if turn.given.done() and turn.given.exception() is None:
            self._queue.done(turn, time.monotonic() - turn.begun)
            self._wake()

    async def _carry(
        self, turn: _Turn, payload: bytes, deadline: float, progress: Callable[[Any], None] | None
    ) -> Any:
        await asyncio.wait({turn.given}, timeout=self.queue_timeout)
        if not turn.given.done():
            self._shed(turn, f"No worker was free within {self.queue_timeout:g} s.")
        turn.given.result()
        try:
            return await self._have_done(payload, deadline, progress)
        except Refusal as refusal:
            if loss := _LOSSES.get(refusal.code):
                self._count(loss)
            raise
        except asyncio.CancelledError:
            self._count("cancelled")
            raise

    def _count(self, loss: Loss) -> None:
        self.losses[loss] += 1
        self.restarts += 1  # by the Dask worker

    async def _have_done(
        self, payload: bytes, deadline: float, progress: Callable[[Any], None] | None
    ) -> Any:
        if (client := self._client) is None:
            raise Refusal("draining", "The connection to the cluster was lost.", retry_after=RETRY_AFTER)
        key = f"{NAME}-{uuid.uuid4().hex}"
        listener = asyncio.create_task(self._listen(client, key, progress)) if progress else None
        future = client.submit(
            carry, key, payload, deadline, progress is not None,
            key=key, pure=False, resources={NAME: 1},
        )  # fmt: skip
        try:
            async with asyncio.timeout(deadline + _TRAVEL):
                done, outcome = await future
        except TimeoutError:
            detail = f"The cluster did not answer within {deadline + _TRAVEL:g} s."
            raise Refusal("deadline-exceeded", detail) from None
        except FutureCancelledError:
            detail = "The connection to the cluster was lost."
            raise Refusal("draining", detail, retry_after=RETRY_AFTER) from None
        except KilledWorker:
            detail = "Every worker of the cluster that began this plan died."
            raise Refusal("worker-crashed", detail) from None
        finally:
            future.release()
            if listener is not None:
                listener.cancel()
        if not done:
            raise outcome
        return outcome

    async def _listen(self, client: Client, key: str, progress: Callable[[Any], None]) -> None:
        """Hands on what the job reports."""
        begun = self._begun[key] = asyncio.get_running_loop().create_future()
        try:
            place = await begun
            while True:
                answers = await client.run(reported, key, workers=[place])
                for value in answers[place]:
                    progress(value)
        finally:
            del self._begun[key]

    def _note_beginning(self, event: tuple[float, Any]) -> None:
        key, place = event[1]
        if (begun := self._begun.get(key)) is not None and not begun.done():
            begun.set_result(place)


async def _offered(client: Client) -> int:
    assert client.scheduler is not None
    cluster = await client.scheduler.identity()
    return sum(
        int(worker["resources"].get(NAME, 0))
        for worker in cluster["workers"].values()
        if worker["status"] == "running"
    )
