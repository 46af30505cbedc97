"""What one worker, one client or one flood may cost the others: faults made on purpose in a real service."""

import http.client
import json
import os
import resource
import signal
import time
from functools import partial

import pytest

from tests.service.service import (
    QUICK,
    Server,
    alive,
    busiest,
    descendants,
    head,
    in_background,
    serving,
    slow,
    until,
)  # fmt: skip


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """One worker, one place in the queue, and little patience."""
    settings = {"workers": 1, "queue_length": 1, "queue_timeout": 3.0, "deadline_grace": 0.5}
    with serving(tmp_path_factory.mktemp("data"), **settings) as server:
        yield server


def whole(server, size):
    """Whether nothing of the last test is left."""
    return server.metric("wheelplan_workers_idle") == size and server.ready()


@pytest.fixture(autouse=True)
def _whole_again(request):
    yield
    for name, size in (("server", 2), ("small", 1)):
        if name in request.fixturenames:
            until(partial(whole, request.getfixturevalue(name), size))


def test_a_plan_ends_with_its_time_budget(server):
    began = time.monotonic()
    assert server.plan(slow(1.0)) == (200, None)
    assert 0.9 < time.monotonic() - began < 2.5


def test_a_worker_that_overruns_is_killed_and_replaced_within_a_second(small):
    before = small.lost("deadline")
    victim = in_background(small.plan, slow(1.0))
    time.sleep(0.3)
    pid = busiest(small)
    os.kill(pid, signal.SIGSTOP)  # it cannot keep its time budget now
    assert victim() == (504, "deadline-exceeded")
    began = time.monotonic()
    until(lambda: small.workers() and pid not in small.workers(), 1.0)
    assert small.plan(QUICK) == (200, None)
    assert time.monotonic() - began < 2.0
    assert small.lost("deadline") == before + 1


def test_workers_that_are_stopped_while_idle_cost_no_request(server):
    before = server.lost("stopped")
    for pid in server.workers():
        os.kill(pid, signal.SIGSTOP)
    joins = [in_background(server.plan, QUICK) for _ in range(2)]
    assert [join() for join in joins] == [(200, None)] * 2
    assert server.lost("stopped") == before + 2


def test_workers_that_all_die_idle_cost_no_request(server):
    pids = server.workers()
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    joins = [in_background(server.plan, QUICK) for _ in range(4)]
    assert [join() for join in joins] == [(200, None)] * 4
    assert not set(pids) & set(server.workers())


def test_workers_that_die_idle_are_replaced_before_a_request_comes(server):
    pids, crashed = server.workers(), server.lost("crashed")
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    until(lambda: server.lost("crashed") == crashed + 2, 10)
    until(lambda: len(server.workers()) == 2, 10)
    assert not set(pids) & set(server.workers())


def test_a_fork_server_that_dies_costs_no_request(server):
    os.kill(server.fork_server(), signal.SIGKILL)
    joins = [in_background(server.plan, QUICK) for _ in range(2)]
    assert [join() for join in joins] == [(200, None)] * 2


def test_workers_have_the_memory_limit_that_is_set(server):
    assert [resource.prlimit(pid, resource.RLIMIT_DATA)[0] for pid in server.workers()] == [2 << 30] * 2


def test_a_worker_at_its_memory_limit_fails_its_own_request_alone(server):
    before = server.lost("memory") + server.lost("crashed")  # a library may abort where it gets no memory
    for attempt in range(4):  # a plan may need no more than it has
        joins = [in_background(server.plan, slow(2.0)) for _ in range(2)]
        time.sleep(0.3)
        if attempt == 0:
            resource.prlimit(busiest(server), resource.RLIMIT_DATA, (1 << 20, 1 << 20))
        first, second = sorted(join() for join in joins)
        assert first == (200, None)
        if second != (200, None):
            break
    assert second == (500, "worker-crashed")
    assert server.lost("memory") + server.lost("crashed") == before + 1
    assert server.plan(QUICK) == (200, None)


def test_workers_that_crash_in_a_loop_make_the_service_unready_until_they_do_not(server):
    assert server.plan(QUICK) == (200, None)
    for _ in range(3):
        assert server.ready()
        before = server.lost("crashed")
        for pid in server.workers():
            os.kill(pid, signal.SIGKILL)
        until(lambda before=before: server.lost("crashed") == before + 2)
        until(lambda: server.metric("wheelplan_workers_idle") == 2 or not server.ready())
    until(lambda: server.call("/readyz")[0] == 503, 2)
    assert b"die one after the other" in server.call("/readyz")[2]
    assert server.call("/livez")[0] == 200
    until(server.ready, 30)
    assert server.plan(QUICK) == (200, None)


def test_a_client_who_leaves_the_queue_frees_its_place_within_half_a_second(small):
    running = small.open(slow(5.0))
    time.sleep(0.2)
    waiting = small.open(slow(5.0))
    until(lambda: small.metric("wheelplan_queue_depth") == 1, 3.0)
    waiting.close()
    until(lambda: small.metric("wheelplan_queue_depth") == 0, 0.5)
    running.close()


def test_a_full_queue_refuses_at_once_and_the_probes_still_answer(small):
    connections = [small.open(slow(5.0)) for _ in range(2)]
    until(lambda: small.metric("wheelplan_queue_depth") == 1, 3.0)
    before, times = small.metric("wheelplan_shed_total"), []
    for _ in range(5):
        began = time.monotonic()
        status, headers, body = small.call("/v1/plans", QUICK)
        times.append(time.monotonic() - began)
        assert (status, json.loads(body)["code"]) == (429, "overloaded")
        assert int(headers["retry-after"]) == json.loads(body)["retry_after"] >= 1
        assert small.call("/livez")[0] == 200
    assert sorted(times)[2] < 0.1
    assert small.metric("wheelplan_shed_total") >= before + 5
    for connection in connections:
        connection.close()


@pytest.mark.parametrize("length", ["Content-Length: 300000", "Transfer-Encoding: chunked"])
def test_a_refused_request_may_be_followed_by_another_and_its_body_is_not_looked_at(small, length):
    connections = [small.open(slow(5.0)) for _ in range(2)]
    until(lambda: small.metric("wheelplan_queue_depth") == 1, 3.0)
    body = b"no JSON" + b" " * (300_000 - 7)
    sent = b"%x\r\n%b\r\n0\r\n\r\n" % (len(body), body) if "chunked" in length else body
    with small.connect(head(length), timeout=10) as connection:
        connection.sendall(sent)
        for expected in (429, 200):
            answer = http.client.HTTPResponse(connection)
            answer.begin()
            assert answer.status == expected
            answer.read()
            connection.sendall(head(target="GET /livez"))
    for connection in connections:
        connection.close()


def test_a_plan_may_wait_behind_one_that_takes_longer_than_the_queue_should(tmp_path):
    with serving(tmp_path, workers=1, queue_wait=0.1) as server:
        for _ in range(2):
            assert server.plan(slow(1.0)) == (200, None)
        joins = [in_background(server.plan, slow(1.0)) for _ in range(3)]
        assert sorted(join()[0] for join in joins) == [200, 200, 429]


def test_no_plan_waits_longer_than_the_queue_timeout(small):
    running = small.open(slow(5.0))
    time.sleep(0.2)
    began = time.monotonic()
    status, headers, body = small.call("/v1/plans", QUICK)
    assert (status, json.loads(body)["code"]) == (429, "overloaded")
    assert 2.9 < time.monotonic() - began < 4.5
    assert int(headers["retry-after"]) >= 1
    running.close()


def test_a_shutdown_amid_the_start_ends_the_service_in_order(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))  # it would compile for half a minute
    server = Server(tmp_path, workers=2)
    try:
        until(lambda: server.port is not None)
        time.sleep(1.0)
        family = descendants(server.process.pid)
        server.process.terminate()
        assert server.process.wait(8) == 0
        until(lambda: not any(map(alive, family)), 5)
    finally:
        server.end()
