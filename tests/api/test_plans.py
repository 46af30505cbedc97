"""POST /v1/plans: what comes back, in which form, and under which code."""

import csv
import io
import math

import numpy as np
import pytest

from api.errors import Refusal
from drives.se2 import Pose
from planner import errors as failures

AT = Pose(1.0, 2.0, 0.5)
NAN = float("nan")


def test_a_plan_has_the_members_of_the_contract(client, body):
    answer = client.post("/v1/plans", json=body)
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/json"
    plan = answer.json()
    assert list(plan) == ["id", "duration", "length", "schedule", "trajectory", "certificate", "planning"]
    assert list(plan["schedule"]) == ["time", "wheels", "steering"]
    assert list(plan["schedule"]["wheels"]) == ["left", "right"]
    assert list(plan["schedule"]["wheels"]["left"]) == ["angle", "velocity", "acceleration"]
    assert plan["schedule"]["steering"] == {}
    assert list(plan["trajectory"]) == ["x", "y", "theta", "vx", "vy", "omega"]
    assert {
        "closure_position", "closure_heading", "wheel_speed_ratio", "wheel_acceleration_ratio",
        "wheel_jerk_ratio", "steering_angle_ratio", "steering_rate_ratio", "slip", "clearance",
    } <= set(plan["certificate"])  # fmt: skip
    assert plan["planning"] == {"planner": "fake", "seed": 7, "refused": 0}
    assert plan["schedule"]["wheels"]["right"]["velocity"] == [1.2, 3.2, 5.2]
    assert plan["trajectory"]["omega"] == [2.3, 5.3, 8.3]


def test_every_plan_has_an_id_of_its_own(client, body):
    assert (
        client.post("/v1/plans", json=body).json()["id"] != client.post("/v1/plans", json=body).json()["id"]
    )


def steered(body):
    body["robot"]["drive"] = {"type": "tricycle", "wheel_radius": 0.1, "wheelbase": 1.0, "track_width": 0.6}
    body["robot"]["limits"] |= {"steering_angle": 1.2, "steering_rate": 1.0}
    return body


@pytest.mark.parametrize(
    ("query", "accept"), [("", "text/csv"), ("?format=csv", "*/*"), ("?format=csv", "image/png")]
)
def test_a_schedule_comes_as_csv_where_that_is_asked_for(client, body, query, accept):
    answer = client.post(f"/v1/plans{query}", json=steered(body), headers={"accept": accept})
    assert answer.headers["content-type"].startswith("text/csv")
    head, *rows = csv.reader(io.StringIO(answer.text))
    assert head == [
        "time", "x", "y", "theta", "front.velocity", "rear_left.velocity", "rear_right.velocity",
        "front.steering",
    ]  # fmt: skip
    assert [float(v) for v in rows[1]] == [0.02, 3.3, 4.3, 5.3, 3.3, 4.3, 5.3, 1.1]
    assert len(rows) == 3


@pytest.mark.parametrize(
    ("accept", "expected"),
    [
        ("application/json", "application/json"), ("text/*", "text/csv"),
        ("application/*;q=0.1", "application/json"),
        ("text/csv;q=0.5, application/json;q=0.4", "text/csv"), ("text/csv, */*;q=0", "text/csv"),
        ("text/html, */*;q=0.1", "application/json"), ("text/csv;q=0, */*", "application/json"),
    ],
)  # fmt: skip
def test_the_client_gets_the_type_it_likes_best(client, body, accept, expected):
    answer = client.post("/v1/plans", json=body, headers={"accept": accept})
    assert answer.headers["content-type"].split(";")[0] == expected


@pytest.mark.parametrize("accept", ["text/html", "application/json;q=0", "audio/*, */*;q=0"])
def test_an_accept_that_cannot_be_met_is_refused_before_planning(client, body, planner_, accept):
    answer = client.post("/v1/plans", json=body, headers={"accept": accept})
    assert (answer.status_code, answer.json()["code"]) == (406, "not-acceptable")
    assert planner_.problem is None


def test_an_unknown_format_is_an_invalid_request(client, body):
    answer = client.post("/v1/plans?format=xml", json=body)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid-request")
    assert answer.json()["errors"][0]["detail"].startswith("format is 'xml'; it must be one of json, csv")


def test_gzip_is_used_only_for_those_who_accept_it(client, body):
    packed = client.post("/v1/plans", json=body, headers={"accept-encoding": "gzip"})
    plain = client.post("/v1/plans", json=body, headers={"accept-encoding": "identity, gzip;q=0"})
    assert packed.headers["content-encoding"] == "gzip"
    assert "content-encoding" not in plain.headers
    assert packed.json()["schedule"] == plain.json()["schedule"]


@pytest.mark.parametrize(
    ("failure", "status", "more"),
    [
        (failures.InvalidGeometry("crosses itself", "/robot/footprint"), 422, {"errors"}),
        (failures.PoseInCollision("start", "hits", AT, -0.1), 422, {"pose", "clearance"}),
        (failures.PoseInCollision("goal", "hits", AT, -0.1), 422, {"pose", "clearance"}),
        (failures.PoseOutOfBounds("start", "outside", AT), 422, {"pose"}),
        (failures.PoseOutOfBounds("goal", "outside", AT), 422, {"pose"}),
        (failures.NoPathExists("a wall", {"radius": np.float64(0.3)}), 422, {"proof"}),
        (failures.NoPathFound("time is up", [{"planner": "RRTConnect"}]), 422, {"tried"}),
        (failures.LimitsInfeasible("too slow"), 422, set()),
        (failures.AuditFailed("slips", {"slip": 1.0}, ["slip"]), 500, {"certificate", "violations"}),
    ],
    ids=lambda value: getattr(value, "code", None),
)
def test_a_planning_failure_is_a_problem_with_its_details(client, body, planner_, failure, status, more):
    planner_.raises = failure
    answer = client.post("/v1/plans", json=body)
    problem = answer.json()
    assert answer.status_code == problem["status"] == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert problem["code"] == failure.code
    assert problem["detail"] == failure.message
    assert {"type", "title"} | more <= set(problem)


@pytest.mark.parametrize(
    ("refusal", "status"),
    [
        (Refusal("overloaded", "full", retry_after=1), 429),
        (Refusal("draining", "going", retry_after=1), 503),
        (Refusal("deadline-exceeded", "late"), 504),
        (Refusal("worker-crashed", "dead"), 500),
    ],
    ids=lambda value: getattr(value, "code", None),
)
def test_a_refusal_of_the_pool_is_a_problem(client, body, planner_, refusal, status):
    planner_.raises = refusal
    answer = client.post("/v1/plans", json=body)
    assert (answer.status_code, answer.json()["code"]) == (status, refusal.code)
    assert answer.headers.get("retry-after") == ("1" if status in (429, 503) else None)


def test_a_full_service_refuses_without_looking_at_the_body_and_counts_it(client, body, monkeypatch):
    def full(ticket):
        raise Refusal("overloaded", "full", retry_after=3)

    monkeypatch.setattr(client.app.state.pool, "admit", full)
    answer = client.post("/v1/plans", content=b"{", headers={"content-type": "application/json"})
    assert (answer.status_code, answer.headers["retry-after"]) == (429, "3")
    assert answer.headers["x-request-id"]
    told = client.get("/metrics").text
    assert 'wheelplan_refused_total{code="overloaded"} 1.0' in told
    assert 'wheelplan_requests_total{method="POST",route="/v1/plans",status="429"} 1.0' in told
    assert client.get("/v1/plans").status_code == 405
    inverse = {"drive": body["robot"]["drive"], "twist": {"vx": 1.0, "vy": 0.0, "omega": 0.0}}
    assert client.post("/v1/kinematics/inverse", json=inverse).status_code == 200


def test_a_full_service_asks_for_a_token_first(inline_app, body, tmp_path, monkeypatch):
    def full(ticket):
        raise Refusal("overloaded", "full", retry_after=3)

    (tmp_path / "tokens").write_text("right")
    client = inline_app(tokens_file=tmp_path / "tokens")
    monkeypatch.setattr(client.app.state.pool, "admit", full)
    answers = [client.post("/v1/plans", json=body, headers={"authorization": f"Bearer {token}"})
               for token in ("wrong", "right")]  # fmt: skip
    assert [answer.status_code for answer in answers] == [401, 429]


@pytest.mark.parametrize("failure", [RuntimeError("secret"), MemoryError("secret"), RecursionError("secret")])
def test_an_unexpected_failure_tells_nothing_but_the_request_id(client, body, planner_, failure):
    planner_.raises = failure
    answer = client.post("/v1/plans", json=body, headers={"x-request-id": "abc-1"})
    assert (answer.status_code, answer.json()["code"]) == (500, "internal-error")
    assert answer.json()["request_id"] == answer.headers["x-request-id"] == "abc-1"
    assert "secret" not in answer.text
    assert "Traceback" not in answer.text


@pytest.mark.parametrize("duration", [NAN, math.inf])
def test_a_plan_with_a_number_that_is_not_finite_is_never_sent(client, body, planner_, duration):
    planner_.duration = duration
    answer = client.post("/v1/plans", json=body)
    assert (answer.status_code, answer.json()["code"]) == (500, "audit-failed")


def test_the_problem_is_stated_as_the_request_states_it(client, body, planner_):
    body["robot"]["drive"] = {
        "type": "swerve", "wheel_radius": 0.05,
        "modules": [{"name": "b", "x": 1, "y": 0}, {"name": "a", "x": -1, "y": 0}],
    }  # fmt: skip
    body["robot"]["limits"] = {
        "wheel_speed": {"a": 1, "b": 2.0}, "wheel_acceleration": 3, "steering_rate": 4, "linear_speed": 5,
    }  # fmt: skip
    body["robot"]["footprint"] = {"type": "polygon", "vertices": [[0, 0], [0, 1], [1, 0]]}
    body["start"]["steering"] = {"a": 0.1, "b": 0.2}
    body["environment"]["obstacles"] = [{"type": "circle", "center": [1, 2], "radius": 3}]
    body["options"] |= {"turning_radius": 0.5, "reverse": False, "effort": "best"}
    assert client.post("/v1/plans", json=body).status_code == 200
    problem = planner_.problem
    limits = problem.robot.limits
    assert problem.robot.drive.wheel_names == ("b", "a")
    assert limits.wheel_speed.tolist() == [2.0, 1.0]
    assert limits.wheel_jerk.tolist() == [math.inf, math.inf]
    assert (limits.steering_rate, limits.steering_angle, limits.linear_speed) == (4.0, math.inf, 5.0)
    assert problem.steering.tolist() == [0.2, 0.1]
    assert problem.robot.footprint.vertices.tolist() == [[1, 0], [0, 1], [0, 0]]
    assert problem.goal.theta is None
    assert problem.environment.obstacles[0].radius == 3
    options = problem.options
    assert (options.turning_radius, options.reverse, options.effort, options.seed) == (0.5, False, "best", 7)


@pytest.mark.parametrize(
    ("shape", "vertices", "radius"),
    [
        ({"type": "circle", "radius": 0.4}, [[0, 0]], 0.4),
        (
            {"type": "rectangle", "length": 2, "width": 1, "offset": 1},
            [[0, -0.5], [2, -0.5], [2, 0.5], [0, 0.5]],
            0,
        ),
    ],
    ids=["circle", "rectangle"],
)
def test_a_footprint_becomes_a_polygon_grown_by_a_disc(client, body, planner_, shape, vertices, radius):
    body["robot"]["footprint"] = shape
    assert client.post("/v1/plans", json=body).status_code == 200
    footprint = planner_.problem.robot.footprint
    assert (footprint.vertices.tolist(), footprint.radius) == (vertices, radius)


@pytest.mark.parametrize(("given", "kept"), [({}, 0.25), ({"body_heading": 1.0}, 1.0)])
def test_a_synchro_body_keeps_the_heading_of_the_start_unless_told(client, body, planner_, given, kept):
    body["robot"]["drive"] = {"type": "synchro", "wheel_radius": 0.1, **given}
    body["robot"]["limits"]["steering_rate"] = 1.0
    body["start"]["theta"] = 0.25
    assert client.post("/v1/plans", json=body).status_code == 200
    assert planner_.problem.robot.drive.fixed_body_heading == kept


def test_a_map_that_is_not_in_store_is_unknown(client, body):
    body["environment"] = {"map": {"id": "0" * 64}}
    answer = client.post("/v1/plans", json=body)
    assert (answer.status_code, answer.json()["code"]) == (404, "unknown-map")
