"""Who gets a worker: clients take turns by the time they use, and nobody holds all workers for long."""

from collections import Counter
from math import ceil

import pytest

from api.fair_queue import FairQueue, Ticket


class Simulation:
    """Workers that take as long for a job as the test says, in simulated time."""

    def __init__(self, size, patience=1.0):
        self.queue = FairQueue(size, patience, clock=lambda: self.now)
        self.running = []
        self.now = 0.0
        self.served = Counter()
        self.waits = {}

    def ask(self, client, seconds, foreseen=None):
        ticket = Ticket(client=client, foreseen=foreseen)
        self.queue.add(ticket)
        self.waits[ticket] = (self.now, seconds)
        self.begin()
        return ticket

    def begin(self):
        while len(self.running) < self.queue.size and (ticket := self.queue.next()) is not None:
            asked, seconds = self.waits[ticket]
            self.waits[ticket] = self.now - asked
            self.running.append((self.now + seconds, seconds, ticket))

    def step(self):
        """Until the next job is done; it."""
        self.running.sort(key=lambda each: each[0])
        self.now, seconds, ticket = self.running.pop(0)
        self.served[ticket.client] += seconds
        self.queue.done(ticket, seconds)
        self.begin()
        return ticket

    def holders(self):
        return Counter(ticket.client for _, _, ticket in self.running)


def test_a_single_client_uses_all_workers_first_come_first_served():
    simulation = Simulation(3)
    asked = [simulation.ask("one", 0.1) for _ in range(9)]
    assert simulation.holders() == {"one": 3}
    assert [simulation.step() for _ in range(9)] == asked


@pytest.mark.parametrize(("ours", "theirs"), [(0.05, 0.05), (0.05, 0.8), (0.3, 0.02)])
def test_clients_that_always_wait_get_the_same_time_however_long_their_jobs_are(ours, theirs):
    simulation, lengths = Simulation(2), {"ours": ours, "theirs": theirs}
    for client, seconds in lengths.items():
        for _ in range(50):
            simulation.ask(client, seconds)
    while simulation.now < 60:
        client = simulation.step().client
        simulation.ask(client, lengths[client])
    assert simulation.served["ours"] == pytest.approx(simulation.served["theirs"], rel=0.05)


def test_a_newcomer_does_not_wait_behind_a_flood_and_idling_saves_up_no_time():
    simulation = Simulation(2)
    for _ in range(200):
        simulation.ask("flood", 0.1)
    for _ in range(100):
        simulation.step()
    newcomers = [simulation.ask("newcomer", 0.1) for _ in range(100)]
    for _ in range(20):
        simulation.step()
    assert simulation.waits[newcomers[0]] <= 0.1
    assert simulation.served["newcomer"] == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize(("size", "clients"), [(2, 2), (4, 2), (4, 3), (3, 5)])
def test_nobody_holds_more_than_the_share_while_others_wait(size, clients):
    simulation = Simulation(size)
    for _ in range(40):
        simulation.ask("0", 0.7)
    for client in range(1, clients):
        for _ in range(40):
            simulation.ask(str(client), 0.1 * client)
    for _ in range(size):
        simulation.step()
    while all(simulation.queue.waiting(str(client)) for client in range(clients)):
        assert max(simulation.holders().values()) <= ceil(size / clients)
        simulation.step()


@pytest.mark.parametrize("size", [1, 2, 4])
def test_a_clients_long_jobs_leave_a_worker_free_while_others_are_about(size):
    simulation = Simulation(size)
    simulation.ask("short", 0.1)
    simulation.step()
    for _ in range(size + 3):
        simulation.ask("long", 30.0, foreseen=30.0)
    assert simulation.holders() == {"long": max(1, size - 1)}
    if size > 1:
        assert simulation.waits[simulation.ask("short", 0.1)] == 0.0


def test_a_client_that_is_alone_uses_all_workers_for_long_jobs_too():
    simulation = Simulation(2)
    simulation.ask("other", 0.1)
    simulation.step()
    for _ in range(6):
        simulation.ask("long", 30.0, foreseen=30.0)
    assert simulation.holders() == {"long": 1}
    for _ in range(3):
        simulation.step()
    assert simulation.now > 60
    assert simulation.holders() == {"long": 2}


@pytest.mark.parametrize("foreseen", [30.0, None])
def test_if_another_client_waits_the_newest_long_job_beyond_the_share_is_to_stop(foreseen):
    simulation = Simulation(2)
    first = simulation.ask("long", 30.0, foreseen=foreseen)
    simulation.now += 0.5
    newest = simulation.ask("long", 30.0, foreseen=foreseen)
    assert simulation.queue.excess("long") is None
    simulation.now += 2.0
    simulation.ask("other", 0.1)
    assert simulation.queue.excess("other") is newest
    assert simulation.queue.excess("other") is None  # the other one is within the share
    assert first in simulation.queue._busy["long"].running


def test_nothing_stops_that_is_short_or_within_its_clients_share():
    simulation = Simulation(2)
    for client in ("one", "two"):
        simulation.ask(client, 30.0, foreseen=30.0)
    simulation.ask("three", 0.1)
    assert simulation.queue.excess("three") is None
    simulation = Simulation(2)
    for _ in range(4):
        simulation.ask("one", 0.5)
    simulation.ask("two", 0.1)
    assert simulation.queue.excess("two") is None


def test_a_clients_short_jobs_pass_its_own_long_ones():
    simulation = Simulation(2)
    simulation.ask("other", 0.1)
    simulation.step()
    for _ in range(3):
        simulation.ask("one", 30.0, foreseen=30.0)
    assert simulation.waits[simulation.ask("one", 0.1)] == 0.0


def test_jobs_are_long_when_half_of_their_clients_jobs_were_of_late_and_one_of_many_is_not_enough():
    simulation = Simulation(2)
    for _ in range(2):
        simulation.ask("one", 5.0)
        simulation.step()
    simulation.ask("two", 0.1)
    simulation.step()
    simulation.ask("one", 5.0)
    simulation.ask("one", 5.0)
    assert simulation.holders() == {"one": 1}
    for _ in range(40):
        simulation.ask("two", 0.05)
    simulation.ask("two", 30.0)
    for _ in range(45):
        simulation.ask("two", 0.05)
    while simulation.queue.waiting("two") > 10:
        simulation.step()
    assert not simulation.queue._is_long(simulation.queue._client("two"), Ticket(client="two"))


def test_a_job_that_was_not_taken_is_the_next_of_its_client_and_costs_nothing():
    queue = FairQueue(1, 1.0)
    first, second = Ticket(client="one"), Ticket(client="one")
    queue.add(first)
    queue.add(second)
    assert queue.next() is first
    queue.put_back(first)
    assert (len(queue), queue.held) == (2, 0)
    assert queue.next() is first
    queue.done(first, 0.1)
    queue.discard(second)
    assert (len(queue), queue.held, queue.next()) == (0, 0, None)


def test_of_the_longest_row_the_newest_gives_way():
    queue = FairQueue(1, 1.0)
    rows = {client: [Ticket(client=client) for _ in range(n)] for client, n in (("a", 2), ("b", 4))}
    for ticket in rows["a"] + rows["b"]:
        queue.add(ticket)
    assert queue.last_of_the_longest("new") is rows["b"][-1]
    assert queue.last_of_the_longest("a") is rows["b"][-1]
    assert queue.last_of_the_longest("b") is None


def test_what_is_remembered_of_clients_that_left_is_bounded():
    simulation = Simulation(1)
    for client in range(5000):
        simulation.ask(str(client), 0.01)
        simulation.step()
    assert len(simulation.queue._idle) <= 1024
    assert not simulation.queue._busy
