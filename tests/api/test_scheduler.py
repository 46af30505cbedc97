"""Which scheduler the settings choose, and how many jobs any of them takes."""

import sys
from dataclasses import replace
from itertools import count

import pytest

from api.app import scheduler_of
from api.errors import Refusal
from api.fair_queue import Ticket
from api.workers import Pool


def test_the_local_pool_is_the_default(settings):
    pool = scheduler_of(replace(settings, workers=3, queue_length=7))
    assert isinstance(pool, Pool)
    assert (pool.size, pool.queue_length) == (3, 7)


def test_an_address_chooses_a_cluster(settings):
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    cluster = scheduler_of(replace(settings, scheduler="tcp://127.0.0.1:1", queue_length=7))
    assert cluster.queue_length == 7
    assert not cluster.ready


def test_what_is_no_address_is_refused_at_the_start(settings):
    with pytest.raises(ValueError, match="WHEELPLAN_SCHEDULER must be an address like tcp://"):
        scheduler_of(replace(settings, scheduler="localhost"))


def test_a_cluster_without_its_extra_says_what_is_missing(settings, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    for module in ("api.cluster", "api.supervisor"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    with pytest.raises(ValueError, match=r"wheelplan\[cluster\]"):
        scheduler_of(replace(settings, scheduler="tcp://127.0.0.1:1"))


class Busy(Pool):
    """Workers that are never done; a test says how long jobs took of late."""

    ready = True

    def __init__(self, took, queue_length=1000, size=2):
        super().__init__(size, queue_length, queue_wait=1.0)
        for seconds in took:
            self.offer()
            self._queue.done(self._queue.next(), seconds)

    @property
    def spare(self):
        return self.size - self._queue.held

    def offer(self, **asked):
        """A job that is taken. Raises Refusal."""
        ticket = Ticket(**asked)
        self.admit(ticket)
        self._queue.add(ticket)
        return ticket

    def expected_wait(self, client):
        return self._queue.expected_wait(Ticket(client=client))

    def begin(self):
        """Gives jobs to free workers."""
        while self.spare and self._queue.next():
            pass

    def taken(self, **asked):
        """How many jobs it takes until it refuses one, and that refusal. client may be a function."""
        for taken in range(2000):
            client = asked.get("client", "")
            try:
                self.offer(**asked | {"client": client() if callable(client) else client})
            except Refusal as refusal:
                return taken, refusal
            self.begin()
        return None


@pytest.mark.parametrize("seconds", [0.005, 0.02, 0.05, 0.2])
def test_the_queue_is_as_long_as_the_workers_need_two_thirds_of_its_wait_for(seconds):
    taken, refusal = Busy([seconds] * 200).taken()
    assert 0.6 < taken * seconds / 2 < 0.8
    assert (refusal.code, refusal.details) == ("overloaded", {"retry_after": 1})


@pytest.mark.parametrize("seconds", [0.7, 3.0, 30.0])
def test_one_job_for_each_worker_waits_however_long_jobs_take(seconds):
    pool = Busy([seconds] * 200)
    assert pool.taken()
    assert pool.queued == 2


def test_the_queue_is_never_longer_than_its_places():
    assert Busy([], queue_length=7).taken()[0] == 9
    assert Busy([0.001] * 200, queue_length=7).taken()[0] == 9


def test_a_rare_long_job_leaves_the_queue_almost_half_of_its_room():
    usual = [0.05] * 200
    assert Busy([*usual, 30.0]).taken()[0] > 0.4 * Busy(usual).taken()[0]


def test_what_jobs_take_now_counts_after_some_dozens():
    slower = Busy([0.05] * 1000 + [0.1] * 100).taken()[0]
    assert slower == pytest.approx(Busy([0.1] * 200).taken()[0], rel=0.15)


def test_a_flood_of_one_client_does_not_turn_another_away():
    pool = Busy([0.05] * 200)
    taken, _ = pool.taken(client="flood")
    assert taken == Busy([0.05] * 200).taken()[0]
    assert pool.taken(client="other")[0] > 10
    assert pool.expected_wait("third") < 0.1


def test_the_queue_keeps_its_wait_in_total_even_if_every_job_is_another_clients():
    pool, names = Busy([0.05] * 200), count()
    taken = pool.taken(client=lambda: str(next(names)))[0]
    assert 0.6 < taken * 0.05 / 2 < 0.8


def test_the_places_are_shared_so_that_one_client_cannot_take_them_all():
    pool = Busy([0.001] * 200, queue_length=8)
    assert pool.taken(client="flood")[0] == 10
    pool.admit(Ticket(client="other"))  # at the cost of the flood's newest
    with pytest.raises(Refusal):
        pool.admit(Ticket(client="flood"))


def test_short_jobs_are_taken_while_long_ones_leave_a_worker_free():
    pool = Busy([0.05] * 200)  # of a client that is still about
    assert pool.taken(client="long", foreseen=30.0)[1].details["retry_after"] >= 30
    assert pool.queued == 2
    for client in ("long", "other"):
        pool.admit(Ticket(client=client))
