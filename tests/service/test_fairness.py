"""What one client may cost the others: workers are shared by token, else by address."""

import json
import time

import pytest

from tests.service.service import QUICK, in_background, serving, slow, until

LONG = slow(30.0)


def by(client):
    """A header that names the client to a service that believes it."""
    return f"X-Forwarded-For: {client}"


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """A service behind a proxy, so that tests can choose their address."""
    with serving(tmp_path_factory.mktemp("data"), workers=2, forwarded_allow_ips="127.0.0.1") as server:
        yield server


@pytest.fixture(autouse=True)
def _idle_again(shared):
    yield
    until(lambda: shared.metric("wheelplan_workers_idle") == 2)


def waits(server, count, **headers):
    """How long each of some quick requests takes, s; all are answered with a plan."""
    times = []
    for _ in range(count):
        began = time.monotonic()
        assert server.plan(QUICK, **headers) == (200, None)
        times.append(time.monotonic() - began)
    return times


def test_four_long_plans_of_one_client_do_not_keep_another_waiting(shared):
    connections = [shared.open(LONG, by("192.0.2.1")) for _ in range(4)]
    until(lambda: shared.metric("wheelplan_queue_depth") >= 2)
    first, *others = waits(shared, 10, **{"X-Forwarded-For": "192.0.2.2"})
    assert first < 5.0  # a long plan is stopped after a second
    assert max(others) < 2.0
    for connection in connections:
        connection.close()


def test_long_plans_of_a_client_do_not_keep_its_own_quick_ones_waiting(shared):
    assert shared.plan(QUICK, **{"X-Forwarded-For": "192.0.2.11"}) == (200, None)
    connections = [shared.open(LONG, by("192.0.2.3")) for _ in range(4)]
    until(lambda: shared.metric("wheelplan_queue_depth") >= 2)
    assert max(waits(shared, 5, **{"X-Forwarded-For": "192.0.2.3"})) < 2.0
    for connection in connections:
        connection.close()


def test_two_long_plans_of_two_clients_are_made_at_once(shared):
    connections = [shared.open(LONG, by(f"192.0.2.{n}")) for n in (4, 5)]
    until(lambda: shared.metric("wheelplan_workers_idle") == 0)
    assert shared.metric("wheelplan_queue_depth") == 0
    for connection in connections:
        connection.close()


def test_a_client_that_floods_the_service_is_refused_and_others_are_not(shared):
    ends = time.monotonic() + 3.0

    def flood():
        statuses = []
        while time.monotonic() < ends:
            statuses.append(shared.plan(slow(0.3), **{"X-Forwarded-For": "192.0.2.6"})[0])
        return statuses

    joins = [in_background(flood) for _ in range(12)]
    time.sleep(1.0)
    times = waits(shared, 5, **{"X-Forwarded-For": "192.0.2.7"})
    statuses = [status for join in joins for status in join()]
    assert set(statuses) == {200, 429}
    assert max(times) < 2.0


def test_a_batch_of_long_plans_leaves_a_worker_to_others_and_loses_no_item(shared):
    asked = {"requests": [LONG] * 4}
    path = shared.call("/v1/batches", asked, **{"X-Forwarded-For": "192.0.2.8"})[1]["location"]
    until(lambda: json.loads(shared.call(path)[2])["running"] >= 1)
    assert max(waits(shared, 3, **{"X-Forwarded-For": "192.0.2.9"})) < 5.0
    counts = json.loads(shared.call(path)[2])
    assert (counts["running"], counts["waiting"]) == (1, 3)
    shared.call(path, method="DELETE")


def test_an_address_that_anybody_may_state_is_not_believed_unless_told_to(tmp_path):
    with serving(tmp_path, workers=2, queue_timeout=3.0) as server:
        connections = [server.open(LONG, by("192.0.2.1")) for _ in range(2)]
        until(lambda: server.metric("wheelplan_workers_idle") == 0)
        # It is the same client's, so nothing is stopped for it.
        assert server.plan(QUICK, **{"X-Forwarded-For": "192.0.2.2"}) == (429, "overloaded")
        assert server.metric("wheelplan_workers_idle") == 0
        for connection in connections:
            connection.close()


def test_clients_are_told_apart_by_token_and_a_plan_stopped_for_another_is_told_so(
    tmp_path,
):
    (tmp_path / "tokens").write_text("one\nother\n")
    with serving(tmp_path, "one", workers=2, tokens_file=tmp_path / "tokens") as server:

        def ask():
            return server.call("/v1/plans", slow(10.0), Authorization="Bearer one")

        joins = [in_background(ask) for _ in range(2)]
        until(lambda: server.metric("wheelplan_workers_idle") == 0)
        assert server.plan(QUICK, Authorization="Bearer other") == (200, None)
        answers = sorted((join() for join in joins), key=lambda answer: answer[0])
        assert [answer[0] for answer in answers] == [200, 429]
        assert int(answers[1][1]["retry-after"]) >= 1
        assert "another client" in json.loads(answers[1][2])["detail"]
