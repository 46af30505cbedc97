"""What is true of every answer, and what operators ask."""

import json
import re
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from api.app import create_app
from api.errors import CODES
from api.settings import Settings
from api.workers import Pool
from planner.problem import MAX_SAMPLES
from tests.api.conftest import InlinePool

CONTRACT = {
    "malformed-json": 400, "unsupported-media-type": 415, "not-acceptable": 406, "payload-too-large": 413,
    "invalid-request": 422, "invalid-geometry": 422, "inadmissible-twist": 422, "start-in-collision": 422,
    "goal-in-collision": 422, "start-out-of-bounds": 422, "goal-out-of-bounds": 422, "no-path-exists": 422,
    "no-path-found": 422, "limits-infeasible": 422, "unknown-map": 404, "deadline-exceeded": 504,
    "worker-crashed": 500, "audit-failed": 500, "overloaded": 429, "draining": 503,
}  # fmt: skip


def test_the_codes_are_those_of_the_contract_and_those_of_http_and_of_the_stores():
    own = {
        "malformed-http": 400, "unauthorized": 401, "not-found": 404, "method-not-allowed": 405,
        "request-timeout": 408, "internal-error": 500, "unknown-batch": 404, "map-corrupt": 500,
        "too-many-samples": 422, "busy": 503,
        "insufficient-storage": 507, "quota-exceeded": 507,
    }  # fmt: skip
    assert {code: status for code, (status, _) in CODES.items()} == CONTRACT | own


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [
        ("GET", "/nowhere", 404, "not-found"),
        ("POST", "/", 405, "method-not-allowed"),
        ("GET", "/v2/plans", 404, "not-found"),
        ("GET", "/v1/maps/a/b", 404, "not-found"),
        ("GET", "/v1/plans", 405, "method-not-allowed"),
        ("PUT", "/v1/maps", 405, "method-not-allowed"),
        ("DELETE", "/livez", 405, "method-not-allowed"),
        ("BREW", "/livez", 405, "method-not-allowed"),
    ],
)
def test_a_wrong_path_or_method_is_a_problem_too(client, method, path, status, code):
    answer = client.request(method, path)
    assert (answer.status_code, answer.json()["code"]) == (status, code)
    assert answer.headers["content-type"] == "application/problem+json"
    assert {"type", "title", "status", "detail", "code"} <= set(answer.json())
    assert (status == 405) == ("allow" in answer.headers)


def test_a_wrong_method_is_told_all_the_right_ones(client):
    assert client.put("/v1/maps").headers["allow"] == "GET, POST"
    assert client.put("/v1/maps/x").headers["allow"] == "DELETE, GET"


@pytest.mark.parametrize("path", ["/v1/drives", "/v1/maps", "/v1/kinematics/inverse"])
def test_json_is_not_forced_on_who_does_not_accept_it(client, path):
    method = "POST" if "kinematics" in path else "GET"
    answer = client.request(method, path, headers={"accept": "text/html"})
    assert (answer.status_code, answer.json()["code"]) == (406, "not-acceptable")


@pytest.mark.parametrize("path", ["/livez", "/v1/drives", "/nowhere", "/v1/maps/x"])
def test_every_answer_has_a_request_id(client, path):
    assert re.fullmatch("[0-9a-f]{32}", client.get(path).headers["x-request-id"])
    assert client.get(path, headers={"x-request-id": "mine-1"}).headers["x-request-id"] == "mine-1"
    assert client.get(path, headers={"x-request-id": "no good"}).headers["x-request-id"] != "no good"


def test_probes_are_answered(client):
    assert client.get("/livez").json() == {"status": "ok"}
    assert client.get("/readyz").json()["status"] == "ready"


def test_a_service_without_workers_is_alive_but_not_ready(settings, body):
    class Starting(Pool):
        def start(self):
            pass

    with TestClient(create_app(settings, Starting(1, 1))) as client:
        assert client.get("/livez").status_code == 200
        for answer in (client.get("/readyz"), client.post("/v1/plans", json=body)):
            assert (answer.status_code, answer.json()["code"]) == (503, "draining")
            assert answer.headers["retry-after"] == "1"


def test_a_service_whose_workers_die_one_after_the_other_is_not_ready_but_tries(settings, planner_, body):
    class Dying(InlinePool):
        trouble = "The workers die one after the other."

    with TestClient(create_app(settings, Dying())) as client:
        answer = client.get("/readyz")
        assert (answer.status_code, answer.json()["code"]) == (503, "draining")
        assert "die" in answer.json()["detail"]
        assert client.post("/v1/plans", json=body).status_code == 200


def test_limits_are_those_that_hold(client, settings, body):
    limits = client.get("/v1/limits").json()
    assert limits["max_time_budget"] == settings.max_time_budget
    assert limits["max_body_bytes"] == settings.max_body_bytes
    assert limits["max_samples"] == settings.max_samples == MAX_SAMPLES
    body["options"]["time_budget"] = limits["max_time_budget"]
    body["options"]["sample_period"] = limits["sample_period"][1]
    body["start"]["x"] = limits["max_coordinate"]
    body["robot"]["limits"]["wheel_speed"] = limits["max_rate"]
    assert client.post("/v1/plans", json=body).status_code == 200


def test_metrics_count_requests_plans_and_refusals(client, body, planner_):
    from planner.errors import LimitsInfeasible

    client.post("/v1/plans", json=body)
    planner_.raises = LimitsInfeasible("no")
    client.post("/v1/plans", json=body)
    client.get("/v1/maps/" + "0" * 64)
    client.get("/elsewhere/" + "x" * 50)
    text = client.get("/metrics").text
    for line in (
        'wheelplan_requests_total{method="POST",route="/v1/plans",status="200"} 1.0',
        'wheelplan_requests_total{method="GET",route="/v1/maps/{id}",status="404"} 1.0',
        'wheelplan_requests_total{method="GET",route="none",status="404"} 1.0',
        'wheelplan_planning_seconds_count{drive="differential",planner="fake"} 1.0',
        'wheelplan_duration_ratio_count{drive="differential"} 1.0',
        'wheelplan_motions_refused_total{drive="differential"} 0.0',
        'wheelplan_workers_lost_total{reason="deadline"} 0.0',
        'wheelplan_refused_total{code="limits-infeasible"} 1.0',
        "wheelplan_queue_depth 0.0",
        "wheelplan_worker_restarts_total 0.0",
        "wheelplan_shed_total 0.0",
    ):
        assert line in text


def test_methods_that_do_not_exist_do_not_multiply_the_metrics(client):
    for i in range(5):
        client.request(f"BREW{i}", "/livez")
    assert "BREW" not in client.get("/metrics").text


def test_one_line_is_logged_per_request_but_none_for_good_probes(client, body, caplog, planner_):
    caplog.set_level("INFO", "wheelplan")
    client.get("/livez")
    planner_.raises = RuntimeError("secret")
    client.post("/v1/plans", json=body, headers={"x-request-id": "abc"})
    (line,) = [json.loads(record.message) for record in caplog.records]
    assert {key: line[key] for key in ("method", "path", "status", "request_id")} == {
        "method": "POST", "path": "/v1/plans", "status": 500, "request_id": "abc",
    }  # fmt: skip
    assert "RuntimeError: secret" in line["failure"]


def test_settings_come_from_the_environment():
    given = {"WHEELPLAN_PORT": "9000", "WHEELPLAN_DATA_DIR": "/maps", "WHEELPLAN_MAX_TIME_BUDGET": "5.5"}
    settings = Settings.from_environment(given)
    assert (settings.port, str(settings.data_dir), settings.max_time_budget) == (9000, "/maps", 5.5)
    assert (settings.host, settings.max_maps) == ("127.0.0.1", 1000)


@pytest.mark.parametrize(
    "given",
    [{"WHEELPLAN_PORT": "http"}, {"WHEELPLAN_PORT": "65536"}, {"WHEELPLAN_WORKERS": "0"},
     {"WHEELPLAN_WORKERS": "1.5"}, {"WHEELPLAN_QUEUE_LENGTH": "-1"}, {"WHEELPLAN_MAX_TIME_BUDGET": "nan"},
     {"WHEELPLAN_QUEUE_TIMEOUT": "0"}, {"WHEELPLAN_WORKER_MEMORY": "-1"},
     {"WHEELPLAN_RECEIVE_TIMEOUT": "inf"}],
    ids=str,
)  # fmt: skip
def test_a_bad_setting_is_refused_at_the_start_by_the_name_of_its_variable_and_its_value(given):
    ((name, value),) = given.items()
    with pytest.raises(ValueError, match=name) as caught:
        Settings.from_environment(given)
    assert value in str(caught.value)


def test_a_page_for_operators_names_every_setting_and_every_metric(settings):
    page = (Path(__file__).parents[2] / "docs" / "operations.md").read_text()
    names = [row[0] for row in settings.table()]
    families = create_app(settings, InlinePool()).state.metrics.registry.collect()
    suffix = {"counter": "_total"}
    names += [family.name + suffix.get(family.type, "") for family in families]
    assert [name for name in names if f"`{name}" not in page] == []


def test_a_page_for_operators_gives_the_settings_defaults():
    page = (Path(__file__).parents[2] / "docs" / "operations.md").read_text()
    given = {row[0].strip("` "): row[1].strip() for line in page.splitlines()
             if len(row := line.split("|")[1:3]) == 2}  # fmt: skip
    machine = {
        "WHEELPLAN_DATA_DIR",
        "WHEELPLAN_WORKERS",
        "WHEELPLAN_QUEUE_LENGTH",
        "WHEELPLAN_MAX_CONNECTIONS",
    }
    for name, _, default, _ in Settings().table():
        assert name in machine or given[name] == (default or "none"), name
