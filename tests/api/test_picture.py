"""The picture of a plan: drawn for every kind of request, with what it promises in it."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from PIL import Image

from api import cli
from api.maps import MapStore
from api.occupancy import DecodedMap, read_map
from api.picture import GOAL, LIMIT, START, TRAIL, WHEELS, draw_plan
from drives import Ackermann, Differential, Drive, Mecanum, Synchro
from drives.drive import Limits
from drives.se2 import Pose
from planner.problem import Bounds, Circle, Environment, Footprint, Goal, Polygon, Problem, Robot

DRIVES: dict[str, Drive] = {
    "differential": Differential(0.1, 0.5),
    "mecanum": Mecanum(0.1, 0.4, 0.5),
    "ackermann": Ackermann(0.1, 0.6, 0.4),
    "synchro": Synchro(0.1, 3, 0.0),
}
FOOTPRINTS = {
    "circle": Footprint(np.zeros((1, 2)), 0.3),
    "rectangle": Footprint(np.array([[-0.2, -0.25], [0.6, -0.25], [0.6, 0.25], [-0.2, 0.25]])),
    "polygon": Footprint(np.array([[0.4, 0.0], [-0.3, 0.35], [-0.2, 0.0], [-0.3, -0.35]])),
}
WORLD = Environment(
    Bounds(-1, -2, 5, 2),
    (Circle(2.0, -1.0, 0.4), Polygon(np.array([[1.0, 1.2], [2.0, 1.2], [1.5, 1.8]]))),
)


def problem(
    drive: str | Drive, footprint: str = "rectangle", environment: Environment = WORLD, **limits: Any
) -> Problem:
    driven = DRIVES[drive] if isinstance(drive, str) else drive
    each = np.ones(len(driven.wheel_names))
    given = {"wheel_speed": 12 * each, "wheel_acceleration": 10 * each, "wheel_jerk": np.inf * each, **limits}
    robot = Robot(driven, FOOTPRINTS[footprint], Limits(**given))
    return Problem(robot, Pose(0.0, 0.0, 0.0), Goal(4.0, 1.0, 0.0), environment)


def answer(drive: str, samples: int = 101, duration: float = 5.0) -> dict[str, Any]:
    """An S-shaped drive with made-up wheels: a picture shows what it is given and checks nothing."""
    wheels, steered = DRIVES[drive].wheel_names, DRIVES[drive].steered_names
    u = np.linspace(0, 1, samples)
    bump = np.sin(np.pi * u) ** 2
    x, y = 4 * u * u * (3 - 2 * u), u * u * (3 - 2 * u)

    def listed(values: Any) -> list[float]:
        return [float(v) for v in values]

    return {
        "duration": duration,
        "length": 4.2,
        "schedule": {
            "time": listed(duration * u),
            "wheels": {
                name: {
                    "angle": listed(10 * u),
                    "velocity": listed((8 + i) * bump),
                    "acceleration": listed((5 + i) * np.cos(np.pi * u)),
                }
                for i, name in enumerate(wheels)
            },
            "steering": {name: {"angle": listed(0.4 * bump), "rate": listed(0 * u)} for name in steered},
        },
        "trajectory": {
            "x": listed(x), "y": listed(y), "theta": listed(0.4 * bump),
            "vx": listed(1.2 * bump), "vy": listed(0 * u), "omega": listed(0 * u),
        },
    }  # fmt: skip


def shades(picture: bytes) -> dict[Any, int]:
    """How many pixels have each colour."""
    with Image.open(io.BytesIO(picture)) as image:
        assert image.format == "PNG"
        assert image.width == 1800
        assert 550 <= image.height <= 1200
        return {colour: count for count, colour in image.convert("RGB").getcolors(image.width * image.height)}


def rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


@pytest.mark.parametrize("footprint", FOOTPRINTS)
@pytest.mark.parametrize("drive", DRIVES)
def test_shows_limits_start_goal_and_every_wheel(drive: str, footprint: str) -> None:
    seen = shades(draw_plan(problem(drive, footprint), answer(drive), "png"))
    for colour in (LIMIT, START, GOAL, *WHEELS[: len(DRIVES[drive].wheel_names)]):
        assert seen.get(rgb(colour), 0) > 50, colour


def test_the_swept_area_is_as_large_as_the_robot_is_wide() -> None:
    wide, narrow = (
        shades(draw_plan(problem("differential", footprint), answer("differential"), "png"))[rgb(TRAIL)]
        for footprint in ("circle", "polygon")
    )
    # 4.2 m long at about 160 pixels a metre, less what lies under lines, start and goal
    assert 0.5 < wide / (4.2 * 0.6 * 160**2) < 1.2
    assert wide != narrow


def test_a_steering_limit_adds_its_lines() -> None:
    without, limited = (
        shades(draw_plan(problem("ackermann", **limits), answer("ackermann"), "png"))[rgb(LIMIT)]
        for limits in ({}, {"steering_angle": 0.6})
    )
    assert limited > 1.5 * without


def test_wheels_with_limits_of_their_own() -> None:
    same, own = (
        shades(draw_plan(problem("differential", **limits), answer("differential"), "png"))[rgb(LIMIT)]
        for limits in ({}, {"wheel_speed": np.array([12.0, 9.0])})
    )
    assert own > 1.3 * same


def test_a_synchro_body_keeps_its_heading() -> None:
    plan = answer("synchro")
    straight, turned = (draw_plan(problem(Synchro(0.1, 3, h)), plan, "png") for h in (0.0, 0.7))
    assert straight != turned


def test_a_robot_that_stays_where_it_is() -> None:
    plan = answer("differential", samples=1, duration=0.0)
    assert shades(draw_plan(problem("differential"), plan, "png"))[rgb(GOAL)] > 50


def test_a_turn_on_the_spot() -> None:
    plan = answer("differential")
    for key in ("x", "y", "vx"):
        plan["trajectory"][key] = [0.0] * len(plan["schedule"]["time"])
    assert shades(draw_plan(problem("differential"), plan, "png"))[rgb(GOAL)] > 50


@pytest.fixture
def hall(tmp_path: Path) -> Callable[..., Path]:
    """hall(negate, yaw): a map_server yaml."""

    def made(negate: int = 0, yaw: float = 0.0) -> Path:
        grey = np.full((80, 140), 254, dtype=np.uint8)
        grey[:8], grey[-8:], grey[:, :8], grey[:, -8:] = 0, 0, 0, 0
        grey[20:30, 60:110] = 205
        Image.fromarray(255 - grey if negate else grey).save(tmp_path / "hall.pgm")
        (tmp_path / "hall.yaml").write_text(
            f"image: hall.pgm\nresolution: 0.05\norigin: [-1.0, -2.0, {yaw}]\nnegate: {negate}\n"
            "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
        )
        return tmp_path / "hall.yaml"

    return made


@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("yaw", [0.0, 0.6])
def test_the_map_lies_under_the_plan(
    hall: Callable[..., Path], negate: int, yaw: float, tmp_path: Path
) -> None:
    store = MapStore(tmp_path / "maps", 1)
    layer = store.layer(store.add(read_map(hall(negate, yaw), 10**6))[0]["id"])
    plan = answer("differential")
    mapped, bare = (
        shades(draw_plan(problem("differential", environment=world), plan, "png")).get(rgb("#3c4552"), 0)
        for world in (Environment(map=layer), Environment())
    )
    assert mapped > 2000
    assert bare < 100


@pytest.mark.parametrize("form", ["svg", "png"])
def test_drawing_changes_nothing_and_is_repeatable(form: Literal["svg", "png"]) -> None:
    asked, plan = problem("mecanum"), answer("mecanum")
    before = json.dumps(plan)
    first = draw_plan(asked, plan, form)
    assert json.dumps(plan) == before
    assert draw_plan(asked, plan, form) == first


def test_the_command_draws_a_plan_that_holds_its_request(
    body: dict[str, Any], planner_: Any, tmp_path: Path
) -> None:
    (tmp_path / "request.json").write_text(json.dumps(body))
    plan, picture = tmp_path / "plan.json", tmp_path / "plan.png"
    assert cli.main(["plan", str(tmp_path / "request.json"), "-o", str(plan)]) == 0
    assert cli.main(["picture", str(plan), "-o", str(picture)]) == 0
    assert shades(picture.read_bytes())[rgb(START)] > 50


def test_the_command_draws_a_plan_of_the_service_with_its_request_and_map(
    body: dict[str, Any], planner_: Any, hall: Callable[..., Path], tmp_path: Path
) -> None:
    asked, plan, picture = (tmp_path / name for name in ("request.json", "plan.json", "plan.svg"))
    asked.write_text(json.dumps(body))
    assert cli.main(["plan", str(asked), "--map", str(hall()), "-o", str(plan)]) == 0
    held = json.loads(plan.read_text())
    del held["request"]  # as the service answers
    plan.write_text(json.dumps(held))
    command = ["picture", str(plan), "-o", str(picture), "--map", str(hall())]
    assert cli.main(command) == 2
    assert cli.main([*command, "--request", str(asked)]) == 0
    assert b"<image" in picture.read_bytes()


def test_the_command_names_what_is_no_plan_or_another_robots(
    body: dict[str, Any], planner_: Any, tmp_path: Path, capsys: Any
) -> None:
    asked, plan = tmp_path / "request.json", tmp_path / "plan.json"
    asked.write_text(json.dumps(body))
    command = ["picture", str(plan), "-o", str(tmp_path / "plan.png"), "--request", str(asked)]
    plan.write_text("{}")
    assert cli.main(command) == 1
    assert "/schedule" in capsys.readouterr().err
    assert cli.main(["plan", str(asked), "-o", str(plan)]) == 0
    body["robot"]["drive"] = {"type": "omni", "wheel_radius": 0.1, "robot_radius": 0.3}
    asked.write_text(json.dumps(body))
    assert cli.main(command) == 2
    assert "another robot" in capsys.readouterr().err


def test_a_map_that_goes_while_its_plan_is_made_is_unknown(
    body: dict[str, Any], client: Any, planner_: Any, settings: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    decoded = DecodedMap(np.zeros((40, 40), dtype=np.int8), 0.25, Pose(-5.0, -5.0, 0.0))
    body["environment"]["map"] = {"id": MapStore(settings.data_dir / "maps", 1).add(decoded)[0]["id"]}
    assert client.post("/v1/plans?format=svg", json=body).status_code == 200
    made = planner_.made
    monkeypatch.setattr(
        planner_, "made", lambda _: (shutil.rmtree(planner_.problem.environment.map.directory), made(1.0))[1]
    )
    answer = client.post("/v1/plans?format=svg", json=body)
    assert (answer.status_code, answer.json()["code"]) == (404, "unknown-map")


def test_the_command_says_what_it_draws(
    body: dict[str, Any], planner_: Any, tmp_path: Path, capsys: Any
) -> None:
    (tmp_path / "request.json").write_text(json.dumps(body))
    assert cli.main(["plan", str(tmp_path / "request.json"), "--picture", str(tmp_path / "plan.gif")]) == 2
    assert "plan.gif is neither an .svg nor a .png" in capsys.readouterr().err
