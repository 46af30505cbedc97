"""POST /v1/plans as server-sent events, and `wheelplan plan` that is interrupted."""

import json
import time

import pytest

from api import cli
from api.errors import Refusal
from planner.errors import NoPathFound

EVENTS = {"accept": "text/event-stream"}


def events(answer):
    """[(name, data)] of a body of server-sent events."""
    assert answer.headers["content-type"].startswith("text/event-stream")
    found = []
    for block in answer.text.removesuffix("\n\n").split("\n\n"):
        name, data = block.split("\n")
        found.append((name.removeprefix("event: "), json.loads(data.removeprefix("data: "))))
    return found


@pytest.mark.parametrize(("query", "headers"), [("", EVENTS), ("?format=events", {})])
def test_each_better_plan_is_an_event_and_the_last_is_final(client, body, planner_, query, headers):
    planner_.before = [0.4, 0.2]
    planner_.duration = 0.1
    told = events(client.post(f"/v1/plans{query}", json=body, headers=headers))
    assert [name for name, _ in told] == ["plan"] * 3
    assert [data["plan"]["duration"] for _, data in told] == [0.4, 0.2, 0.1]
    assert [data["final"] for _, data in told] == [False, False, True]
    elapsed = [data["elapsed"] for _, data in told]
    assert elapsed == sorted(elapsed)


def test_the_plan_of_an_event_is_what_the_json_answer_would_be(client, body, planner_):
    plain = client.post("/v1/plans", json=body).json()
    ((_, data),) = events(client.post("/v1/plans", json=body, headers=EVENTS))
    assert data["plan"] | {"id": ""} == plain | {"id": ""}


def test_what_fails_before_a_first_plan_is_a_plain_problem(client, body, planner_):
    planner_.raises = NoPathFound("nothing", tried=[])
    answer = client.post("/v1/plans", json=body, headers=EVENTS)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"


def test_what_fails_after_a_first_plan_is_the_last_event(client, body, planner_):
    planner_.before = [0.4]
    planner_.raises = Refusal("worker-crashed", "The process died.")
    (first, _), (last, problem) = events(client.post("/v1/plans", json=body, headers=EVENTS))
    assert (first, last) == ("plan", "problem")
    assert problem["code"] == "worker-crashed"


def test_an_interrupt_keeps_the_best_plan_so_far(body, planner_, tmp_path, capsysbinary):
    planner_.before, planner_.raises = [0.4, 0.2], KeyboardInterrupt()
    (tmp_path / "request.json").write_text(json.dumps(body))
    assert cli.main(["plan", str(tmp_path / "request.json")]) == 0
    out, err = capsysbinary.readouterr()
    assert json.loads(out)["duration"] == 0.2
    assert [line.rpartition(b"a motion of ")[2] for line in err.splitlines()] == [b"0.400 s", b"0.200 s"]


def test_an_interrupt_before_a_first_plan_ends_the_command(body, planner_, tmp_path):
    planner_.raises = KeyboardInterrupt()
    (tmp_path / "request.json").write_text(json.dumps(body))
    with pytest.raises(KeyboardInterrupt):
        cli.main(["plan", str(tmp_path / "request.json")])


def test_a_comment_tells_that_the_service_still_plans(client, body, planner_, monkeypatch):
    monkeypatch.setattr("api.heartbeat._SILENCE", 0.1)
    planner_.meanwhile = lambda _: time.sleep(0.35)
    answer = client.post("/v1/plans", json=body, headers=EVENTS)
    assert answer.text.count(": still planning\n\n") >= 3
    assert answer.text.startswith(":")
    assert answer.text.count("event: plan\n") == 1


def test_what_fails_after_a_comment_is_an_event(client, body, planner_, monkeypatch):
    monkeypatch.setattr("api.heartbeat._SILENCE", 0.1)
    planner_.meanwhile = lambda _: time.sleep(0.15)
    planner_.raises = NoPathFound("nothing", tried=[])
    answer = client.post("/v1/plans", json=body, headers=EVENTS)
    assert answer.status_code == 200
    assert answer.text.startswith(": still planning\n\n")
    assert '"no-path-found"' in answer.text.rpartition("event: problem\n")[2]
