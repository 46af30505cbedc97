"""A queue that is fair between clients: start-time fair queueing (Goyal, Vin and Cheng, 1997) for workers.

Each client has a virtual time, which advances by the seconds that its jobs keep workers. A free worker takes
a job of the client whose virtual time is least; a client's own jobs are taken in order of arrival. A job
keeps its worker until it is done, so three limits are added:

- While others wait, a client that holds its share of the workers comes after them. The share is the number of
  workers over the number of clients that have jobs, rounded up.
- While others are about, a client's long jobs leave one worker free, unless there is only one. Later jobs of
  that client that are not long may pass them. A job is long if it is foreseen to take more than `patience` s,
  or if half of what its client asked for of late did. Others are about that had a job within a minute.
- A client that was alone may hold all workers for long. The scheduler then asks for a job to stop (`excess`).
"""

from __future__ import annotations

import math
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import count
from typing import Generic, TypeVar

__all__ = ["FairQueue", "Ticket"]

_OF_LATE = 16
"""Moving averages of what jobs take are over about so many."""

_BENEFIT = 4
"""The average over all clients begins with so many jobs that took no time: one alone says little."""

_RARE = 2.0
"""In the average of one client a job counts as so many times the patience at most. Otherwise a rare long one
would make the others long."""

_RECENT = 60.0
"""A client whose last job ended so long ago is no longer about, s."""

_REMEMBERED = 1024
"""Clients without jobs whose virtual time and average are remembered."""


@dataclass(eq=False, slots=True, kw_only=True)
class Ticket:
    """A job's place in the queue.

    client    who asked for it
    foreseen  how long it will keep a worker, s; None: not known
    """

    client: str = ""
    foreseen: float | None = None
    arrival: int = 0
    begun: float = 0.0
    charged: float = 0.0
    long: bool = False


T = TypeVar("T", bound=Ticket)


@dataclass(eq=False, slots=True)
class _Client(Generic[T]):
    """virtual: its virtual time, s; typical: what its jobs took of late, s; running: its jobs that workers
    do, unless these were asked to stop; held: how many these and those are; left: when it last had no job;
    unknown: its jobs that nothing is foreseen of; short and long: s foreseen of the others."""

    virtual: float = 0.0
    typical: float | None = None
    learnt_from: int = 0
    waiting: deque[T] = field(default_factory=deque)
    running: list[T] = field(default_factory=list)
    held: int = 0
    left: float = 0.0
    long_held: int = 0
    unknown: int = 0
    short: float = 0.0
    long: float = 0.0


class FairQueue(Generic[T]):
    """The jobs that wait for `size` workers, and how many of these each client holds.

    patience s: longer jobs are long, and an unforeseen job counts as no more in the average over all clients.
    clock: s, monotonic.
    """

    def __init__(self, size: int, patience: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.size = size
        self.patience = patience
        self._clock = clock
        self.held = 0
        """Workers that do a job of this queue."""
        self._busy: dict[str, _Client[T]] = {}
        self._idle: OrderedDict[str, _Client[T]] = OrderedDict()
        self._virtual = 0.0
        self._typical = 0.0
        self._learnt_from = _BENEFIT
        self._arrivals = count()
        self._length = 0

    def __len__(self) -> int:
        """Jobs that wait."""
        return self._length

    def __iter__(self) -> Iterator[T]:
        return (ticket for client in self._busy.values() for ticket in client.waiting)

    def waiting(self, client: str) -> int:
        """Jobs of a client that wait."""
        return len(self._client(client).waiting)

    def has_room(self, client: str) -> bool:
        """Whether a job of this client may wait however long jobs take: fewer jobs wait than there are
        workers, if of each client no more are counted than its share."""
        share = math.ceil(self.size / max(1, len(self._busy.keys() | {client})))
        counted = sum(min(share, len(other.waiting)) for other in self._busy.values())
        return counted < self.size and self.waiting(client) < share

    def may_start(self, ticket: Ticket) -> bool:
        """Whether a free worker may take such a job now."""
        client = self._client(ticket.client)
        if client.long_held < max(1, self.size - 1) or not self._is_long(client, ticket):
            return True
        return client.long_held < self.size and not self._others(ticket.client)

    def expected_wait(self, ticket: Ticket) -> float:
        """How long such a job would wait (s): until the workers have done the client's own jobs, and of
        each other client's at most as much."""
        long_held = sum(client.long_held for client in self._busy.values())
        # Short jobs pass the long ones as long as these leave workers to them.
        passes = long_held < self.size and (ticket.foreseen or 0.0) <= self.patience
        work = {name: self._work(client, passes) for name, client in self._busy.items()}
        own = work.pop(ticket.client, 0.0)
        most = own + (self._typical if ticket.foreseen is None else ticket.foreseen)
        workers = max(1, self.size - long_held if passes else self.size)
        return (own + sum(min(most, theirs) for theirs in work.values())) / workers

    def last_of_the_longest(self, client: str) -> T | None:
        """The newest job of the client with most jobs waiting, if this client has two fewer."""
        longest = max((other.waiting for other in self._busy.values()), key=len, default=deque[T]())
        return longest[-1] if len(longest) > self.waiting(client) + 1 else None

    def excess(self, client: str) -> T | None:
        """A job that should stop, since a job of this client waits: the newest of another client that holds
        more than its share, among those that are long or have been running for longer than `patience`."""
        share = math.ceil(self.size / max(1, len(self._busy)))
        ends = [
            ticket
            for name, other in self._busy.items()
            if name != client and len(other.running) > share
            for ticket in other.running
            if ticket.long or self._clock() - ticket.begun > self.patience
        ]
        newest = max(ends, key=lambda ticket: ticket.begun, default=None)
        if newest is not None:
            self._busy[newest.client].running.remove(newest)
        return newest

    def add(self, ticket: T) -> None:
        """A job that begins to wait."""
        client = self._busy.get(ticket.client)
        if client is None:
            client = self._busy[ticket.client] = self._client(ticket.client)
            self._idle.pop(ticket.client, None)
        ticket.arrival = next(self._arrivals)
        client.waiting.append(ticket)
        self._length += 1
        self._count(client, ticket, 1)

    def discard(self, ticket: T) -> None:
        """A job that nobody waits for any longer; one that does not wait is left alone."""
        client = self._busy.get(ticket.client)
        if client is not None and ticket in client.waiting:
            client.waiting.remove(ticket)
            self._length -= 1
            self._left(client, ticket)

    def next(self) -> T | None:
        """Gives a free worker to the job whose turn it is. None: none may have it."""
        share = math.ceil(self.size / max(1, len(self._busy)))
        turn, least = None, (True, math.inf, math.inf)
        for client in self._busy.values():
            ticket = next((each for each in client.waiting if self.may_start(each)), None)
            if ticket is None:
                continue
            rank = (client.held >= share, max(client.virtual, self._virtual), ticket.arrival)
            if rank < least:
                turn, least = (client, ticket), rank
        if turn is None:
            return None
        client, ticket = turn
        self._virtual = least[1]
        ticket.begun = self._clock()
        ticket.long = self._is_long(client, ticket)
        ticket.charged = self._expected(client, ticket)
        client.virtual = self._virtual + ticket.charged
        client.waiting.remove(ticket)
        self._length -= 1
        self._hold(client, ticket, 1)
        return ticket

    def put_back(self, ticket: T) -> None:
        """Takes the worker from a job that has not begun; it is the next of its client again."""
        client = self._busy[ticket.client]
        self._hold(client, ticket, -1)
        client.virtual -= ticket.charged
        client.waiting.appendleft(ticket)
        self._length += 1

    def done(self, ticket: T, seconds: float) -> None:
        """A job that no longer holds its worker, and how long it did."""
        client = self._busy[ticket.client]
        self._hold(client, ticket, -1)
        client.virtual += seconds - ticket.charged
        if ticket.foreseen is None:
            client.learnt_from = min(client.learnt_from + 1, _OF_LATE)
            before = client.typical or 0.0
            client.typical = before + (min(seconds, _RARE * self.patience) - before) / client.learnt_from
            # A rare long one says little of those to come.
            self._learnt_from = min(self._learnt_from + 1, _OF_LATE)
            self._typical += (min(seconds, self.patience) - self._typical) / self._learnt_from
        self._left(client, ticket)

    def _client(self, name: str) -> _Client[T]:
        return self._busy.get(name) or self._idle.get(name) or _Client()

    def _is_long(self, client: _Client[T], ticket: Ticket) -> bool:
        known = client.typical if ticket.foreseen is None else ticket.foreseen
        return (known or 0.0) > self.patience

    def _others(self, name: str) -> bool:
        """Whether other clients are about."""
        if self._busy.keys() - {name}:
            return True
        last = next((client for other, client in reversed(self._idle.items()) if other != name), None)
        return last is not None and self._clock() - last.left < _RECENT

    def _expected(self, client: _Client[T], ticket: Ticket) -> float:
        if ticket.foreseen is not None:
            return ticket.foreseen
        return self._typical if client.typical is None else client.typical

    def _work(self, client: _Client[T], short_only: bool) -> float:
        """How long the jobs of a client are expected to keep a worker, s."""
        return client.unknown * self._typical + client.short + (0.0 if short_only else client.long)

    def _hold(self, client: _Client[T], ticket: T, change: int) -> None:
        self.held += change
        client.held += change
        client.long_held += change * ticket.long
        if change > 0:
            client.running.append(ticket)
        elif ticket in client.running:
            client.running.remove(ticket)

    def _count(self, client: _Client[T], ticket: T, change: int) -> None:
        if ticket.foreseen is None:
            client.unknown += change
        elif ticket.foreseen > self.patience:
            client.long += change * ticket.foreseen
        else:
            client.short += change * ticket.foreseen

    def _left(self, client: _Client[T], ticket: T) -> None:
        self._count(client, ticket, -1)
        if not client.waiting and not client.held:
            client.short = client.long = 0.0  # not the rounding of sums and differences
            client.left = self._clock()
            del self._busy[ticket.client]
            self._idle[ticket.client] = client
            if len(self._idle) > _REMEMBERED:
                self._idle.popitem(last=False)
