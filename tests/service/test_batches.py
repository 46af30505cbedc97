"""Batches on a real service: they yield to single requests, outlive a crash and a client, and end with it."""

import http.client
import json
import os
import signal
import time

import pytest

from api.batch_store import BatchStore
from tests.service.service import QUICK, busiest, in_background, serving, slow, until


def begin(server, *requests):
    status, headers, body = server.call("/v1/batches", {"requests": requests})
    assert status == 202, body
    return headers["location"]


def document(server, path):
    return json.loads(server.call(path)[2])


def ended(server, path):
    until(lambda: document(server, path)["finished"])
    return document(server, path)


def follow(server, path):
    """A response that streams the results."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    connection.request("GET", f"{path}/results")
    return connection.getresponse()


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    """A service with one worker."""
    with serving(tmp_path_factory.mktemp("data"), workers=1) as server:
        yield server


def test_results_stream_in_the_order_of_their_completion_while_the_batch_runs(server):
    path = begin(server, slow(3.0) | {"name": "slow"}, QUICK | {"name": "quick"}, {"name": "bad"})
    results = follow(server, path)
    first = [json.loads(results.readline()) for _ in range(2)]
    assert {line["name"] for line in first} == {"quick", "bad"}
    assert document(server, path)["finished"] is None
    last = json.loads(results.readline())
    assert last["name"] == "slow"
    assert last["plan"]["duration"] > 0
    assert results.readline() == b""  # the stream ends with the batch
    assert document(server, path)["finished"]


def test_single_requests_wait_for_no_more_than_the_item_in_work(one):
    path = begin(one, *[slow(1.0)] * 8)
    until(lambda: document(one, path)["running"] == 1)
    waits = []
    for _ in range(3):
        began = time.monotonic()
        assert one.call("/v1/plans", QUICK)[0] == 200
        waits.append(time.monotonic() - began)
        time.sleep(0.05)
    assert document(one, path)["waiting"] >= 2
    assert max(waits) < 3.0  # an item takes a second, the whole batch eight
    one.call(path, method="DELETE")


def test_a_crashed_item_is_one_bad_result(one):
    path = begin(one, slow(20.0) | {"name": "crash"}, QUICK | {"name": "next"})
    until(lambda: document(one, path)["running"] == 1)
    os.kill(busiest(one), signal.SIGKILL)
    assert (ended(one, path)["done"], document(one, path)["failed"]) == (1, 1)
    lines = [json.loads(line) for line in one.call(f"{path}/results")[2].splitlines()]
    assert lines[0]["name"] == "crash"
    assert (lines[0]["problem"]["status"], lines[0]["problem"]["code"]) == (500, "worker-crashed")
    assert lines[1]["name"] == "next"
    assert lines[1]["plan"]["duration"] > 0


def test_cancelling_frees_the_worker_at_once(one):
    path = begin(one, *[slow(20.0)] * 3)
    until(lambda: document(one, path)["running"] == 1)
    assert one.call(path, method="DELETE")[0] == 204
    began = time.monotonic()
    assert one.call("/v1/plans", QUICK)[0] == 200
    assert time.monotonic() - began < 5.0
    counts = document(one, path)
    assert (counts["cancelled"], counts["running"], counts["waiting"]) == (3, 0, 0)


def test_a_client_who_leaves_the_results_does_not_stop_the_batch(server):
    path = begin(server, QUICK, slow(1.0), QUICK)
    results = follow(server, path)
    results.readline()
    results.close()
    assert ended(server, path)["done"] == 3
    assert len(server.call(f"{path}/results")[2].splitlines()) == 3


def test_a_batch_ends_with_its_server_and_what_it_has_done_stays(tmp_path):
    def half_done(server):
        path = begin(server, {}, QUICK, *[slow(20.0)] * 3)
        until(lambda: document(server, path)["running"] == 1 and document(server, path)["done"] == 1)
        return path

    with serving(tmp_path, workers=1) as server:
        killed = half_done(server)
        server.process.kill()
        server.process.wait()
    with serving(tmp_path, workers=1) as server:
        counts = document(server, killed)
        assert (counts["done"], counts["failed"], counts["cancelled"]) == (1, 1, 3)
        assert len(server.call(f"{killed}/results")[2].splitlines()) == 2
        drained = half_done(server)
        stream = follow(server, drained)
        server.process.terminate()
        assert len(stream.read().splitlines()) == 2
        assert server.process.wait(20) == 0
    record = BatchStore(tmp_path / "batches", 60, 10**9).load(drained.rpartition("/")[2])
    assert (record.done, record.failed, record.cancelled) == (1, 1, 3)


@pytest.mark.parametrize("content", ["", "{", "[]", '{"id": 1}', "{}"])
def test_a_bad_record_costs_no_other_batch(tmp_path, content):
    bad = tmp_path / "batches" / ("b" * 32)
    bad.mkdir(parents=True)
    (bad / "record.json").write_text(content)
    with serving(tmp_path, workers=1) as server:
        for _ in range(2):
            assert ended(server, begin(server, QUICK))["done"] == 1
        assert server.metric("wheelplan_batches_set_aside_total") == 1
        assert sum(b"a batch cannot be read" in line for line in server.log) == 1
    assert (tmp_path / "batches" / f"{bad.name}.bad" / "record.json").read_text() == content


def test_results_of_a_server_whose_clock_was_ahead_are_kept_no_longer_than_others(tmp_path):
    place = tmp_path / "batches" / ("b" * 32)
    place.mkdir(parents=True)
    (place / "results.ndjson").touch()
    ahead = time.time() + 1e6
    record = {"id": place.name, "total": 1, "created": ahead, "cancelled": 1, "finished": ahead, "newer": 1}
    (place / "record.json").write_text(json.dumps(record))
    with serving(tmp_path, workers=1, batch_keep=4.0) as server:
        path = f"/v1/batches/{place.name}"
        assert server.call(path)[0] == 200
        until(lambda: server.call(path)[0] == 404, 8)


def test_a_silent_answer_gives_a_sign_of_life_every_ten_seconds(tmp_path):
    with serving(tmp_path, workers=1, queue_wait=60, queue_timeout=60) as server:
        path = begin(server, slow(14.0))
        until(lambda: document(server, path)["running"] == 1)
        results = in_background(server.call, f"{path}/results")
        began = time.monotonic()
        events = server.call("/v1/plans?format=events", QUICK)[2]  # waits for the batch's only item
        assert time.monotonic() - began > 11.0
        assert events.startswith(b": still planning\n\n")
        assert events.count(b"event: plan\n") == 1
        assert results()[2].startswith(b"\n{")
