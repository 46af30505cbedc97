"""Batches over HTTP: what is taken, how it is counted, what the results say, and how long they last."""

import asyncio
import copy
import errno
import json
import threading
import time

import pytest

import planner.plan
from api.batch_store import BatchStore, Record
from api.batches import Batches
from api.errors import Refusal
from planner.errors import NoPathExists

COUNTS = ("total", "done", "failed", "running", "waiting", "cancelled")


def begin(client, *requests):
    """The path of a new batch."""
    answer = client.post("/v1/batches", json={"requests": requests})
    assert answer.status_code == 202, answer.text
    return answer.headers["location"]


def counts(client, path):
    document = client.get(path).json()
    return tuple(document[name] for name in COUNTS)


def ended(client, path):
    """The document of a batch, once it has ended."""
    until(lambda: client.get(path).json()["finished"] is not None)
    return client.get(path).json()


def lines(client, path):
    """The results by index."""
    answer = client.get(f"{path}/results")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/x-ndjson"
    found = [json.loads(line) for line in answer.text.splitlines()]
    assert len({line["index"] for line in found}) == len(found)
    return {line["index"]: line for line in found}


def echo(request, held):
    return request


def until(condition, within=20.0):
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < within
        time.sleep(0.01)


@pytest.fixture
def gate(planner_, monkeypatch):
    """Plans are made only while it is set."""
    gate = threading.Event()

    def held(problem, *args):
        gate.wait(20)
        return planner_(problem, *args)

    monkeypatch.setattr(planner.plan, "plan", held)
    yield gate
    gate.set()


def test_a_batch_is_answered_with_its_counts_and_ends_with_a_line_for_each_request(client, body):
    answer = client.post("/v1/batches", json={"requests": [body | {"name": f"run {i}"} for i in range(5)]})
    assert answer.status_code == 202
    document = answer.json()
    assert answer.headers["location"] == f"/v1/batches/{document['id']}"
    assert document["total"] == 5
    assert sum(document[name] for name in COUNTS[1:]) == 5
    document = ended(client, answer.headers["location"])
    assert [document[name] for name in COUNTS] == [5, 5, 0, 0, 0, 0]
    assert document["created"] <= document["finished"] < document["expires"]
    found = lines(client, answer.headers["location"])
    assert {index: line["name"] for index, line in found.items()} == {i: f"run {i}" for i in range(5)}


def test_a_result_is_what_a_single_request_is_answered(client, body):
    line = lines(client, begin(client, body))[0]
    alone = client.post("/v1/plans", json=body).json()
    assert list(line) == ["index", "name", "plan"]
    assert line["name"] is None
    assert line["plan"] | {"id": 0} == alone | {"id": 0}
    assert line["plan"]["id"] != alone["id"]


def test_one_bad_item_is_one_bad_result_with_pointers_into_the_item(client, body):
    bad = {
        "negative radius": ("/robot/drive/wheel_radius", -1.0),
        "not finite": ("/robot/limits/wheel_speed", float("1e999")),
        "boolean": ("/start/x", True),
        "unknown field": ("/options/hurry", 1),
    }
    requests = []
    for name, (pointer, value) in bad.items():
        request = copy.deepcopy(body) | {"name": name}
        *path, last = pointer.strip("/").split("/")
        place = request
        for step in path:
            place = place[step]
        place[last] = value
        requests += [request, body]
    text = json.dumps({"requests": requests}).replace("Infinity", "1e999")
    answer = client.post("/v1/batches", content=text, headers={"content-type": "application/json"})
    document = ended(client, answer.headers["location"])
    assert [document[name] for name in COUNTS] == [8, 4, 4, 0, 0, 0]
    found = lines(client, answer.headers["location"])
    for i, (name, (pointer, _)) in enumerate(bad.items()):
        problem = found[2 * i]["problem"]
        assert found[2 * i]["name"] == name
        assert (problem["status"], problem["code"]) == (422, "invalid-request")
        assert [error["pointer"] for error in problem["errors"]] == [pointer]
        assert "plan" in found[2 * i + 1]


@pytest.mark.parametrize("item", [None, 5, "x" * 5000, [], {}, {"name": 5}, {"name": "n" * 101}])
def test_an_item_that_is_no_request_at_all_is_one_bad_result_too(client, body, item):
    path = begin(client, item, body)
    ended(client, path)
    found = lines(client, path)
    assert found[0]["name"] is None
    assert found[0]["problem"]["code"] == "invalid-request"
    assert "x" * 100 not in json.dumps(found[0])
    assert "plan" in found[1]


def test_an_item_that_cannot_be_planned_has_the_problem_a_single_request_gets(client, body, planner_):
    planner_.raises = NoPathExists("There is a wall.", {"method": "flood"})
    alone = client.post("/v1/plans", json=body).json()
    path = begin(client, body, body | {"environment": {"map": {"id": "0" * 64}}})
    assert ended(client, path)["failed"] == 2
    found = lines(client, path)
    assert found[0]["problem"] == alone
    assert found[1]["problem"]["code"] == "unknown-map"


def test_an_item_that_breaks_the_planner_hurts_nobody_else_and_shows_nothing(client, body, monkeypatch):
    real = planner.plan.plan

    def broken(problem, *args):
        if problem.options.seed == 1:
            raise ZeroDivisionError("secret")
        return real(problem, *args)

    monkeypatch.setattr(planner.plan, "plan", broken)
    seeds = [body | {"options": {"seed": seed}} for seed in (0, 1, 2)]
    path = begin(client, *seeds)
    document = ended(client, path)
    assert (document["done"], document["failed"]) == (2, 1)
    problem = lines(client, path)[1]["problem"]
    assert (problem["status"], problem["code"]) == (500, "internal-error")
    assert "secret" not in json.dumps(problem)


@pytest.mark.parametrize(
    ("value", "pointer"),
    [
        ({}, "/requests"),
        ({"requests": []}, "/requests"),
        ({"requests": [0] * 1001}, "/requests"),
        ({"requests": {}}, "/requests"),
        ({"requests": [0], "priority": 9}, "/priority"),
        ([], ""),
    ],
)
def test_a_body_that_is_no_batch_is_refused_as_a_whole(client, value, pointer):
    answer = client.post("/v1/batches", json=value)
    assert answer.status_code == 422
    assert [error["pointer"] for error in answer.json()["errors"]] == [pointer]


def test_a_thousand_items_are_taken(client):
    path = begin(client, *[0] * 1000)
    assert ended(client, path)["failed"] == 1000
    assert len(lines(client, path)) == 1000


def test_a_batch_has_a_body_limit_of_its_own(settings, planner_, inline_app, body):
    with inline_app(max_batch_bytes=300_000, max_body_bytes=1000) as client:
        requests = [body] * 250
        assert 100_000 < len(json.dumps(requests)) < 300_000
        begin(client, *requests)
        answer = client.post("/v1/batches", json={"requests": requests * 4})
        assert answer.status_code == 413
        assert answer.json()["limit"] == 300_000


def test_other_types_and_texts_are_refused(client):
    assert client.post("/v1/batches", content=b"{").status_code == 415
    headers = {"content-type": "application/json"}
    assert client.post("/v1/batches", content=b"{", headers=headers).status_code == 400
    assert client.post("/v1/batches", json={}, headers={"accept": "text/csv"}).status_code == 406


@pytest.mark.parametrize("id", ["0" * 32, "x", "..%2f..%2fetc", "%00", "A" * 32, "0" * 5000])
def test_a_batch_that_is_not_there_is_unknown(client, id):
    for method, path in (("GET", ""), ("GET", "/results"), ("DELETE", "")):
        answer = client.request(method, f"/v1/batches/{id}{path}")
        assert answer.status_code == 404
        assert answer.json()["code"] in ("unknown-batch", "not-found")
        assert len(answer.text) < 1000


def test_results_are_offered_as_ndjson_only(client, body):
    path = begin(client, body)
    assert client.get(f"{path}/results", headers={"accept": "application/json"}).status_code == 406
    assert client.get(f"{path}/results", headers={"accept": "application/x-ndjson"}).status_code == 200


def test_too_many_batches_at_once_are_refused_until_one_ends(inline_app, gate, body):
    with inline_app(max_batches=2) as client:
        paths = [begin(client, body) for _ in range(2)]
        answer = client.post("/v1/batches", json={"requests": [body]})
        assert (answer.status_code, answer.json()["code"]) == (429, "overloaded")
        assert int(answer.headers["retry-after"]) >= 1
        gate.set()
        for path in paths:
            ended(client, path)
        begin(client, body)


def test_a_cancelled_batch_plans_no_further_and_its_results_stay_readable(inline_app, gate, body):
    with inline_app(size=1) as client:
        path = begin(client, {}, body, body, body)
        until(lambda: counts(client, path) == (4, 0, 1, 1, 2, 0))
        metrics = client.get("/metrics").text
        assert "\nwheelplan_batches 1.0\n" in metrics
        assert "\nwheelplan_batch_items 2.0\n" in metrics
        assert client.delete(path).status_code == 204
        assert counts(client, path) == (4, 0, 1, 0, 0, 3)
        gate.set()
        time.sleep(0.1)
        assert counts(client, path) == (4, 0, 1, 0, 0, 3)
        assert list(lines(client, path)) == [0]
        assert client.delete(path).status_code == 204


def test_items_of_several_batches_take_turns(inline_app, gate, body):
    with inline_app(size=1) as client:
        long = begin(client, *[body] * 20)
        until(lambda: counts(client, long)[3] == 1)
        short = begin(client, body, body)
        gate.set()
        assert ended(client, short)["finished"] < ended(client, long)["finished"]


def test_an_item_waits_while_no_worker_is_spare(inline_app, body):
    with inline_app(size=1) as client:
        pool = client.app.state.pool
        pool.busy = 1
        path = begin(client, body)
        time.sleep(0.2)
        assert counts(client, path) == (1, 0, 0, 0, 1, 0)
        pool.busy = 0
        assert ended(client, path)["done"] == 1


def test_an_item_that_finds_the_queue_full_after_all_is_tried_again(inline_app, body):
    with inline_app(size=1) as client:
        pool, real, refused = client.app.state.pool, client.app.state.pool.run, []

        async def run(*args, **more):
            if len(refused) < 3:
                refused.append(Refusal("overloaded", "full"))
                raise refused[-1]
            return await real(*args, **more)

        pool.run = run
        path = begin(client, body)
        assert ended(client, path)["done"] == 1
        assert len(refused) == 3


def test_what_a_server_has_finished_another_one_on_the_same_data_still_knows(inline_app, body):
    with inline_app() as client:
        path = begin(client, body, {})
        document, found = ended(client, path), lines(client, path)
    with inline_app() as client:
        assert client.get(path).json() == document
        assert lines(client, path) == found


def test_a_shutdown_cancels_what_is_not_done(inline_app, gate, body):
    with inline_app(size=1) as client:
        path = begin(client, {}, body, body)
        until(lambda: counts(client, path) == (3, 0, 1, 1, 1, 0))
        threading.Timer(1.0, gate.set).start()  # the thread that stands for a worker cannot be killed
    with inline_app() as client:
        assert counts(client, path) == (3, 0, 1, 0, 0, 2)
        assert client.get(path).json()["finished"]
        assert list(lines(client, path)) == [0]


def test_results_expire(inline_app, settings, body):
    with inline_app(batch_keep=0.5) as client:
        path = begin(client, body)
        ended(client, path)
        until(lambda: client.get(path).status_code == 404)
        assert client.get(f"{path}/results").json()["code"] == "unknown-batch"
        assert client.delete(path).status_code == 404
        begin(client, body)
        assert not (settings.data_dir / path.strip("/").replace("v1/", "")).exists()


def test_the_oldest_results_make_room_for_new_ones(inline_app, body):
    with inline_app() as client:
        size = len(client.get(f"{begin(client, body)}/results").content)
    with inline_app(batch_store_bytes=int(3.5 * size)) as client:
        paths = [begin(client, body) for _ in range(1)]
        for _ in range(4):
            ended(client, paths[-1])
            paths.append(begin(client, body))
        ended(client, paths[-1])
        assert [client.get(path).status_code for path in paths] == [404, 404, 200, 200, 200]


def test_a_batch_that_outgrows_the_store_is_cancelled_and_keeps_whole_lines(inline_app, body):
    with inline_app() as client:
        size = len(client.get(f"{begin(client, body)}/results").content)
    with inline_app(batch_store_bytes=int(2.5 * size)) as client:
        path = begin(client, *[body] * 5)
        ended(client, path)
        assert counts(client, path) == (5, 2, 0, 0, 0, 3)
        assert len(lines(client, path)) == 2


def test_a_full_disk_is_told_before_a_batch_is_taken(client, body, monkeypatch):
    def full(self, record):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(BatchStore, "save", full)
    answer = client.post("/v1/batches", json={"requests": [body]})
    assert (answer.status_code, answer.json()["code"]) == (507, "insufficient-storage")


def test_results_are_followed_while_the_batch_runs(tmp_path, settings):
    """The application's test client does not stream: this asks the batches themselves."""

    class Idle:
        ready, draining = True, False

        def starts(self, ticket):
            return True

    gates = [asyncio.Event() for _ in range(3)]

    async def plan(number, ticket):
        await gates[number].wait()
        return b'{"number":%d}' % number

    async def main():
        batches = Batches(Idle(), BatchStore(tmp_path, 60, 10**6), echo, lambda *_: None, plan, 1)
        batches.start()
        id = (await batches.add([0, 1, 2], ""))["id"]
        early, seen = await batches.lines(id), []
        for number in (1, 2, 0):
            gates[number].set()
            seen.append(json.loads(await anext(early)))
        assert [line["index"] for line in seen] == [1, 2, 0]
        assert [line["plan"]["number"] for line in seen] == [1, 2, 0]
        assert [piece async for piece in early] == []
        late = b"".join([piece async for piece in await batches.lines(id)])
        assert [json.loads(line) for line in late.splitlines()] == seen
        await batches.close()

    asyncio.run(asyncio.wait_for(main(), 20))


def test_closing_ends_even_in_the_moment_in_which_a_worker_is_free_again(tmp_path):
    class Busy:
        ready, draining = True, False

        def starts(self, ticket):
            return False

    async def main():
        batches = Batches(Busy(), BatchStore(tmp_path, 60, 10**6), echo, lambda *_: None, None, 1)
        batches.start()
        id = (await batches.add([0], ""))["id"]
        await asyncio.sleep(0.1)
        batches._stir.set()
        await batches.close()
        assert (await batches.document(id))["cancelled"] == 1

    asyncio.run(asyncio.wait_for(main(), 10))


@pytest.mark.parametrize("content", ["{", "null", '{"id": 5}'])
def test_a_bad_record_neither_refuses_new_batches_nor_stops_running_ones(inline_app, settings, body, content):
    with inline_app() as client:
        bad = begin(client, body)
        ended(client, bad)
        record = settings.data_dir / "batches" / bad.rpartition("/")[2] / "record.json"
        until(lambda: json.loads(record.read_text())["finished"])
        record.write_text(content)
        for _ in range(2):
            assert ended(client, begin(client, body, body))["done"] == 2
        assert client.get(bad).status_code == 404
        assert "\nwheelplan_batches_set_aside_total 1.0\n" in client.get("/metrics").text


def test_a_record_that_a_newer_version_has_written_is_read(inline_app, settings, body):
    with inline_app() as client:
        path = begin(client, body)
        document = ended(client, path)
        file = settings.data_dir / "batches" / path.rpartition("/")[2] / "record.json"
        file.write_text(json.dumps(json.loads(file.read_text()) | {"priority": 9}))
    with inline_app() as client:
        assert client.get(path).json() == document
        begin(client, body)


@pytest.mark.parametrize("broken", ["append", "save"])
def test_a_batch_that_breaks_the_store_ends_and_the_next_one_runs(client, body, monkeypatch, broken):
    real, spoilt = getattr(BatchStore, broken), []

    def break_(self, record, *args):
        midway = record.done + record.failed and not record.finished
        if midway or broken == "append":
            spoilt.append(record.id)
            if record.id == spoilt[0]:
                raise KeyError("a bug")
        return real(self, record, *args)

    monkeypatch.setattr(BatchStore, broken, break_)
    path = begin(client, {}, body, body)
    assert ended(client, path)["finished"]
    assert ended(client, begin(client, {}, body))["done"] == 1
    assert "\nwheelplan_batches 0.0\n" in client.get("/metrics").text


def test_an_item_whose_problem_cannot_be_written_ends_its_batch_alone(client, body, monkeypatch):
    monkeypatch.setattr("api.batches.write_json", lambda value: 1 / 0)
    assert ended(client, begin(client, body, {}))["cancelled"] >= 1
    monkeypatch.undo()
    assert ended(client, begin(client, {}, body))["done"] == 1


def test_results_that_are_shorter_than_their_record_end_the_answer(tmp_path):
    async def main():
        store = BatchStore(tmp_path, 60, 10**6)
        batches = Batches(None, store, echo, lambda *_: None, None, 1)
        record = Record("a" * 32, 1, time.time())
        results = store.create(record)
        store.append(record, results, b"line\n")
        record.failed, record.finished = 1, time.time()
        store.save(record)
        lines = await batches.lines(record.id)
        results.cut(0)
        results.close()
        with pytest.raises(OSError, match="shorter"):
            await anext(lines)

    asyncio.run(asyncio.wait_for(main(), 10))


def test_a_batch_that_must_leave_a_worker_free_does_not_hold_up_another(tmp_path):
    class Choosy:
        ready, draining = True, False

        def starts(self, ticket):
            return ticket != "long"

    async def plan(number, ticket):
        return b"{}"

    async def main():
        store = BatchStore(tmp_path, 60, 10**6)
        batches = Batches(Choosy(), store, echo, lambda problem, client: client, plan, 2)
        batches.start()
        long, short = [(await batches.add([0, 1], client))["id"] for client in ("long", "short")]
        async with asyncio.timeout(5):
            while (await batches.document(short))["done"] < 2:
                await asyncio.sleep(0.01)
        assert (await batches.document(long))["waiting"] == 2
        await batches.close()

    asyncio.run(main())


def test_while_nothing_comes_an_empty_line_tells_that_the_batch_runs(tmp_path, monkeypatch):
    class Idle:
        ready, draining = True, False

        def starts(self, ticket):
            return True

    gate = asyncio.Event()

    async def plan(number, ticket):
        await gate.wait()
        return b"{}"

    async def main():
        monkeypatch.setattr("api.heartbeat._SILENCE", 0.05)
        batches = Batches(Idle(), BatchStore(tmp_path, 60, 10**6), echo, lambda *_: None, plan, 1)
        batches.start()
        lines = await batches.lines((await batches.add([0], ""))["id"])
        assert [await anext(lines) for _ in range(3)] == [b"\n"] * 3
        gate.set()
        rest = [json.loads(line) for line in [line async for line in lines] if line.strip()]
        assert [line["index"] for line in rest] == [0]
        await batches.close()

    asyncio.run(asyncio.wait_for(main(), 20))


def test_a_result_is_counted_only_once_its_record_is_on_disk(client, body, monkeypatch):
    written, reached, save = threading.Event(), threading.Event(), BatchStore.save

    def late(store, record):
        if record.done:
            reached.set()
            written.wait(20)
        save(store, record)

    monkeypatch.setattr(BatchStore, "save", late)
    path = begin(client, body, body)
    try:
        assert reached.wait(20)
        assert counts(client, path)[1] == 0
    finally:
        written.set()
    assert ended(client, path)["done"] == 2
