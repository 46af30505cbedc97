"""Batches: many plan requests in one, planned while nobody else needs the workers."""

from __future__ import annotations

import asyncio
import pickle
import time
import traceback
import uuid
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Any, NamedTuple

import orjson

from api.batch_schemas import MAX_NAME
from api.batch_store import BatchStore, Record, Results
from api.errors import Refusal, problem_document
from api.fair_queue import Ticket
from api.heartbeat import with_heartbeat
from api.log import log
from api.scheduler import Scheduler
from api.strict_json import write_json
from planner.errors import PlanningError
from planner.problem import Problem

__all__ = ["Batches"]

_GLANCE = 0.02
"""How often we look for a spare worker while others have them all, s."""

_PIECE = 1 << 18
"""Results are read in pieces of this size, bytes."""


class _Item(NamedTuple):
    """One request of a batch; `request` is the JSON value, pickled: it takes a tenth of the memory."""

    place: int
    name: str | None
    request: bytes


class _Prepared(NamedTuple):
    """An item that has been read: its problem, its place in the scheduler's queue, and what `held` keeps."""

    item: _Item
    problem: Problem
    ticket: Ticket
    held: ExitStack


@dataclass(eq=False, slots=True)
class _Batch:
    record: Record
    results: Results
    items: deque[_Item]
    client: str
    next: _Prepared | None = None
    lines: list[tuple[bool, bytes]] = field(default_factory=list)
    """Results that are not on disk yet: whether it is a plan, and the line."""
    running: set[asyncio.Task[None]] = field(default_factory=set)
    lock: asyncio.Lock = field(default_factory=asyncio.Lock)
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def drop(self) -> None:
        """Forgets the items that nobody has begun."""
        self.items.clear()
        if self.next is not None:
            self.next.held.close()
            self.next = None

    def tell(self) -> None:
        """Wakes those who follow the results."""
        news, self.news = self.news, asyncio.Event()
        news.set()


class Batches:
    """The batches of one server.

    Items of all running batches take turns. One is handed to the scheduler only if that would give it a
    worker at once, so that whoever waits for a single plan is never behind an item that waits, too.

    read: what an item asks for, and what has to be held until it is planned; raises Refusal or PlanningError
    ticket: its place in the scheduler's queue, for a client
    plan: the JSON of its answer; raises as read
    """

    def __init__(
        self,
        scheduler: Scheduler[Any],
        store: BatchStore,
        read: Callable[[Any, ExitStack], Problem],
        ticket: Callable[[Problem, str], Ticket],
        plan: Callable[[Problem, Ticket], Awaitable[bytes]],
        max_running: int,
    ) -> None:
        self.max_running = max_running
        self._scheduler = scheduler
        self._store = store
        self._read = read
        self._ticket = ticket
        self._plan = plan
        self._batches: dict[str, _Batch] = {}
        self._turns: deque[_Batch] = deque()
        self._stir = asyncio.Event()
        self._adding = asyncio.Lock()
        self._handing_out: asyncio.Task[None] | None = None

    @property
    def running(self) -> int:
        """Batches that have not ended."""
        return sum(batch.record.finished is None for batch in self._batches.values())

    @property
    def waiting(self) -> int:
        """Items that wait for a worker."""
        return sum(_counts(batch)["waiting"] for batch in self._batches.values())

    @property
    def set_aside(self) -> int:
        """Batches on disk that could not be read."""
        return self._store.set_aside

    def start(self) -> None:
        """Begins to hand out items."""
        self._handing_out = asyncio.create_task(self._hand_out_items())

    async def close(self) -> None:
        """Cancels what has not ended."""
        if self._handing_out is not None:
            self._handing_out.cancel()
            await asyncio.gather(self._handing_out, return_exceptions=True)
        await self._cancel_all()

    def admit(self) -> None:
        """Raises Refusal where no batch is taken at present: overloaded, draining."""
        if self._scheduler.draining:
            raise Refusal("draining", "The service is shutting down.", retry_after=1)
        if self.running >= self.max_running:
            raise Refusal("overloaded", f"{self.running} batches are running already.", retry_after=10)

    async def add(self, requests: Sequence[Any], client: str) -> dict[str, Any]:
        """Begins a client's batch of plan requests, JSON values; its document. Raises Refusal, as admit;
        OSError."""
        record = Record(uuid.uuid4().hex, len(requests), time.time())

        def prepare() -> tuple[Results, deque[_Item]]:
            items = deque(
                _Item(place, _name(request), pickle.dumps(request)) for place, request in enumerate(requests)
            )
            return self._store.create(record), items

        async with self._adding:
            self.admit()
            results, items = await asyncio.to_thread(prepare)
            batch = _Batch(record, results, items, client)
            self._batches[record.id] = batch
        self._turns.append(batch)
        self._stir.set()
        return _document(record, _counts(batch), self._store.keep)

    async def document(self, id: str) -> dict[str, Any]:
        """What is known of a batch. Raises Refusal: unknown-batch."""
        if (batch := self._batches.get(id)) is not None:
            return _document(batch.record, _counts(batch), self._store.keep)
        record = await asyncio.to_thread(self._store.load, id)
        return _document(record, {"running": 0, "waiting": 0}, self._store.keep)

    async def cancel(self, id: str) -> None:
        """Ends a batch; what it has done stays readable. Raises Refusal: unknown-batch."""
        if (batch := self._batches.get(id)) is None:
            await asyncio.to_thread(self._store.load, id)
        else:
            await self._end(batch)

    async def lines(self, id: str) -> AsyncIterator[bytes]:
        """The results as they come, until the batch ends, and an empty line after every 10 s without one.
        Raises Refusal: unknown-batch."""
        batch = self._batches.get(id)
        record = batch.record if batch is not None else await asyncio.to_thread(self._store.load, id)
        return self._follow(record, batch)

    async def _follow(self, record: Record, batch: _Batch | None) -> AsyncIterator[bytes]:
        offset = 0
        while True:
            news = batch.news if batch is not None else None
            if offset < record.size:
                size = min(record.size - offset, _PIECE)
                piece = await asyncio.to_thread(self._store.read, record.id, offset, size)
                if not piece:
                    raise OSError(f"The results of batch {record.id} are shorter than its record says.")
                yield piece
                offset += len(piece)
            elif record.finished is None and news is not None:
                async for sign in with_heartbeat(news.wait, b"\n"):
                    if not isinstance(sign, bytes):
                        break
                    yield sign
            else:
                return

    async def _hand_out_items(self) -> None:
        while True:
            batch = await self._next()
            try:
                await self._hand_out(batch)
            except Exception as error:
                await self._give_up(batch, error)

    async def _next(self) -> _Batch:
        """The next batch in turn that has an item to read, or one that would get a worker."""
        while True:
            for _ in range(len(self._turns)):
                batch = self._turns.popleft()
                if batch.record.finished is not None:
                    continue
                self._turns.append(batch)
                if batch.items if batch.next is None else self._scheduler.starts(batch.next.ticket):
                    return batch
            if self._scheduler.draining:  # a shutdown ends all batches that still have items to hand out
                for batch in [batch for batch in self._turns if batch.next is not None]:
                    await self._end(batch)
            self._stir.clear()
            # Not wait_for, which before Python 3.12 loses a cancellation that comes with the event.
            with suppress(TimeoutError):
                async with asyncio.timeout(_GLANCE if any(b.next for b in self._turns) else None):
                    await self._stir.wait()

    async def _hand_out(self, batch: _Batch) -> None:
        """Reads the next item of a batch, or hands the one that has been read to the scheduler."""
        if batch.next is None:
            item, held = batch.items.popleft(), ExitStack()
            try:
                problem = await asyncio.to_thread(self._problem, item, held)
            except Exception as error:
                held.close()
                await self._note(batch, item, "problem", _refusal(error))
                return
            batch.next = _Prepared(item, problem, self._ticket(problem, batch.client), held)
            if batch.record.finished is not None:
                batch.drop()
            return
        prepared, batch.next = batch.next, None
        task = asyncio.create_task(self._carry(batch, prepared))
        batch.running.add(task)
        task.add_done_callback(batch.running.discard)
        task.add_done_callback(lambda _: prepared.held.close())
        await asyncio.sleep(0)  # from its first step on, the scheduler knows of it

    def _problem(self, item: _Item, held: ExitStack) -> Problem:
        return self._read(pickle.loads(item.request), held)

    async def _carry(self, batch: _Batch, prepared: _Prepared) -> None:
        item = prepared.item
        try:
            try:
                kind, body = "plan", await self._plan(prepared.problem, prepared.ticket)
            except Exception as error:
                if _was_not_taken(error) and not self._scheduler.draining:  # somebody was quicker
                    batch.items.appendleft(item)
                    return
                kind, body = "problem", _refusal(error)
            finally:
                self._stir.set()
            await self._note(batch, item, kind, body)
        except Exception as error:
            await self._give_up(batch, error)

    async def _note(self, batch: _Batch, item: _Item, kind: str, body: bytes) -> None:
        """Adds a line to the results; the last one ends the batch."""
        head = orjson.dumps({"index": item.place, "name": item.name})[:-1]
        batch.lines.append((kind == "plan", b'%b,"%b":%b}\n' % (head, kind.encode(), body)))
        await asyncio.shield(self._write(batch))

    async def _write(self, batch: _Batch) -> None:
        """Writes the lines there are. Those that come while the disk is busy are written together."""
        async with batch.lock:
            lines, batch.lines = batch.lines, []
            if not lines or batch.record.finished is not None:
                return
            kept = replace(batch.record)
            try:
                await asyncio.to_thread(self._keep, batch, kept, lines)
            except OSError as error:
                batch.record.become(kept)
                log(event="results of a batch cannot be kept", batch=batch.record.id, error=repr(error))
                await self._finish(batch)
            else:
                # Nobody is told of a result before it is on disk.
                batch.record.become(kept)
                if batch.record.done + batch.record.failed == batch.record.total:
                    await self._finish(batch)
                batch.tell()

    def _keep(self, batch: _Batch, record: Record, lines: list[tuple[bool, bytes]]) -> None:
        try:
            for plan, line in lines:
                self._store.append(record, batch.results, line)
                record.done += plan
                record.failed += not plan
        finally:
            batch.results.sync()
            self._store.save(record)

    async def _give_up(self, batch: _Batch, error: Exception) -> None:
        """Ends a batch that something is wrong with, so that nobody waits for it."""
        failure = "".join(traceback.format_exception(error))
        log(event="a batch failed", batch=batch.record.id, failure=failure)
        await self._end(batch)

    async def _cancel_all(self) -> None:
        for batch in list(self._batches.values()):
            await self._end(batch)

    async def _end(self, batch: _Batch) -> None:
        async with batch.lock:
            await self._finish(batch)

    async def _finish(self, batch: _Batch) -> None:
        """Ends a batch, whose lock we hold; what is not done is cancelled."""
        record = batch.record
        if record.finished is not None:
            return
        record.cancelled = record.total - record.done - record.failed
        record.finished = time.time()
        batch.drop()
        for task in batch.running:
            task.cancel()
        try:
            await asyncio.to_thread(self._store.save, record)
            batch.results.close()
        except Exception as error:
            log(event="the record of a batch cannot be kept", batch=record.id, error=repr(error))
        self._batches.pop(record.id, None)
        batch.tell()


def _counts(batch: _Batch) -> dict[str, int]:
    record, running = batch.record, len(batch.running)
    if record.finished is not None:
        return {"running": 0, "waiting": 0}
    return {"running": running, "waiting": record.total - record.done - record.failed - running}


def _document(record: Record, counts: dict[str, int], keep: float) -> dict[str, Any]:
    return {
        "id": record.id,
        "total": record.total,
        "done": record.done,
        "failed": record.failed,
        **counts,
        "cancelled": record.cancelled,
        "created": _utc(record.created),
        "finished": _utc(record.finished) if record.finished is not None else None,
        "expires": _utc(record.finished + keep) if record.finished is not None else None,
    }


def _utc(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")


def _name(request: Any) -> str | None:
    name = request.get("name") if isinstance(request, dict) else None
    return name if isinstance(name, str) and len(name) <= MAX_NAME else None


def _was_not_taken(error: Exception) -> bool:
    return isinstance(error, Refusal) and error.code in ("overloaded", "draining")


def _refusal(error: Exception) -> bytes:
    """The problem document of an item that has no plan."""
    if not isinstance(error, Refusal | PlanningError):
        log(event="an item of a batch failed", failure="".join(traceback.format_exception(error)))
        error = Refusal("internal-error", "Something went wrong here. The log has more.")
    return write_json(problem_document(error))
