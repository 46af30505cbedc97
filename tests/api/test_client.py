"""The client against the application, over a real socket; only the planner is a fake."""

from __future__ import annotations

import copy
import http.server
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
import uvicorn
from PIL import Image

from api.app import create_app
from api.client import Client, Problem
from api.settings import Settings
from planner.errors import NoPathExists
from tests.api.conftest import FakePlanner, InlinePool


@pytest.fixture
def wheelplan(settings: Settings, planner_: FakePlanner) -> Iterator[Client]:
    listening = socket.create_server(("127.0.0.1", 0))
    server = uvicorn.Server(uvicorn.Config(create_app(settings, InlinePool()), log_level="error"))
    thread = threading.Thread(target=server.run, args=([listening],))
    thread.start()
    while not server.started:
        time.sleep(0.01)
    with Client(f"http://127.0.0.1:{listening.getsockname()[1]}") as client:
        yield client
    server.should_exit = True
    thread.join()


def test_a_plan_is_an_answer_with_its_fields(wheelplan: Client, body: dict[str, Any]) -> None:
    plan = wheelplan.plan(body)
    assert plan.duration == 0.04
    assert plan.schedule.wheels["right"].velocity == [1.2, 3.2, 5.2]
    assert plan.trajectory.omega == [2.3, 5.3, 8.3]


def test_a_plan_in_another_form(wheelplan: Client, body: dict[str, Any]) -> None:
    assert wheelplan.plan_as(body, "csv").startswith(b"time,x,y,theta,left.velocity")


def test_improvements_come_one_by_one(wheelplan: Client, body: dict[str, Any], planner_: FakePlanner) -> None:
    planner_.before = [0.4, 0.2]
    told = list(wheelplan.plan_stream(body))
    assert [better.plan.duration for better in told] == [0.4, 0.2, 0.04]
    assert [better.final for better in told] == [False, False, True]


def test_a_problem_after_a_first_plan_is_raised(
    wheelplan: Client, body: dict[str, Any], planner_: FakePlanner
) -> None:
    planner_.before, planner_.raises = [0.4], NoPathExists("a wall", {"radius": 0.3})
    told = wheelplan.plan_stream(body)
    assert next(told).plan.duration == 0.4
    with pytest.raises(Problem, match="no-path-exists"):
        next(told)


@pytest.mark.parametrize("stream", [False, True])
def test_a_refusal_has_its_code_and_its_pointers(
    wheelplan: Client, body: dict[str, Any], stream: bool
) -> None:
    body["robot"]["limits"]["wheel_speed"] = -1.0
    del body["start"]["x"]
    with pytest.raises(Problem, match="wheel_speed is -1") as refused:
        list(wheelplan.plan_stream(body)) if stream else wheelplan.plan(body)
    assert (refused.value.code, refused.value.status) == ("invalid-request", 422)
    assert set(refused.value.pointers) == {"/robot/limits/wheel_speed", "/start/x"}
    assert refused.value.retry_after is None


def test_a_batch_gives_a_plan_or_a_problem_for_each_request(wheelplan: Client, body: dict[str, Any]) -> None:
    bad = copy.deepcopy(body)
    del bad["start"]["x"]
    good, refused = sorted(wheelplan.batch([body | {"name": "dock-7"}, bad]), key=lambda result: result.index)
    assert (good.name, good.problem, refused.plan) == ("dock-7", None, None)
    assert good.plan is not None
    assert good.plan.duration == 0.04
    assert refused.problem is not None
    assert refused.problem.pointers == ["/start/x"]


def test_signs_of_life_are_no_results(
    wheelplan: Client, body: dict[str, Any], planner_: FakePlanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("api.heartbeat._SILENCE", 0.05)
    planner_.meanwhile = lambda _: time.sleep(0.3)
    assert [result.index for result in wheelplan.batch([body])] == [0]
    assert [improvement.final for improvement in wheelplan.plan_stream(body)] == [True]


def test_a_batch_that_is_left_early_is_cancelled(
    wheelplan: Client, body: dict[str, Any], planner_: FakePlanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, started = planner_.made, []

    def slowly(duration: float) -> Any:
        started.append(duration)
        time.sleep(0.2)
        return made(duration)

    monkeypatch.setattr(planner_, "made", slowly)
    batch = wheelplan.batch([body] * 20)
    next(batch)
    batch.close()
    count = len(started)
    time.sleep(0.5)
    assert len(started) <= count + 1 < 20


def test_kinematics_there_and_back(wheelplan: Client) -> None:
    drive = {"type": "differential", "wheel_radius": 0.1, "track_width": 0.5}
    wheels = wheelplan.inverse(drive, {"vx": 0.5, "vy": 0.0, "omega": 0.2}).wheels
    assert wheels == pytest.approx({"left": 4.5, "right": 5.5})
    answer = wheelplan.forward(drive, wheels)
    assert (answer.twist.vx, answer.twist.omega) == pytest.approx((0.5, 0.2))
    assert answer.slip == pytest.approx(0, abs=1e-12)


def test_maps_are_stored_listed_and_deleted(wheelplan: Client, tmp_path: Any) -> None:
    Image.new("L", (30, 20), 254).save(tmp_path / "hall.png")
    (tmp_path / "hall.yaml").write_text(
        "image: hall.png\nresolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    stored = wheelplan.upload_map(tmp_path / "hall.yaml", tmp_path / "hall.png")
    assert (stored.width, stored.height, stored.free) == (30, 20, 600)
    assert wheelplan.maps() == [stored]
    wheelplan.delete_map(stored.id)
    assert wheelplan.maps() == []
    with pytest.raises(Problem) as refused:
        wheelplan.delete_map(stored.id)
    assert refused.value.code == "unknown-map"


def test_the_catalogue_and_the_limits(wheelplan: Client, settings: Settings) -> None:
    assert len(wheelplan.drives()) == 11
    assert wheelplan.limits().max_map_cells == settings.max_map_cells


def test_an_answer_of_something_in_between_is_a_problem_too(body: dict[str, Any]) -> None:
    class Proxy(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self.send_error(502)

        def log_message(self, *_: Any) -> None:
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Proxy) as proxy:
        threading.Thread(target=proxy.handle_request).start()
        client = Client(f"http://127.0.0.1:{proxy.server_port}")
        with client, pytest.raises(Problem, match="502 Bad Gateway") as refused:
            client.plan(body)
    assert (refused.value.code, refused.value.status) == ("unknown", 502)
