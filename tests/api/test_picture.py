"""The picture of a plan: drawn for every kind of request, with what it promises in it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from api.picture import GOAL, LIMIT, START, WHEELS, draw_plan

CORNERS = ("front_left", "front_right", "rear_left", "rear_right")
DRIVES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "differential": (("left", "right"), ()),
    "mecanum": (CORNERS, ()),
    "ackermann": (CORNERS, CORNERS[:2]),
    "synchro": (("wheel_1", "wheel_2", "wheel_3"), ("wheel_1", "wheel_2", "wheel_3")),
}
FOOTPRINTS: dict[str, dict[str, Any]] = {
    "circle": {"type": "circle", "radius": 0.3},
    "rectangle": {"type": "rectangle", "length": 0.8, "width": 0.5, "offset": 0.2},
    "polygon": {"type": "polygon", "vertices": [[0.4, 0.0], [-0.3, 0.35], [-0.2, 0.0], [-0.3, -0.35]]},
}


def body(drive: str, footprint: str = "rectangle", **limits: Any) -> dict[str, Any]:
    return {
        "robot": {
            "drive": {"type": drive},
            "footprint": FOOTPRINTS[footprint],
            "limits": {"wheel_speed": 12.0, "wheel_acceleration": 10.0, **limits},
        },
        "start": {"x": 0.0, "y": 0.0, "theta": 0.0},
        "goal": {"x": 4.0, "y": 1.0, "theta": 0.0},
        "environment": {
            "bounds": {"x_min": -1, "y_min": -2, "x_max": 5, "y_max": 2},
            "obstacles": [
                {"type": "circle", "center": [2.0, -1.0], "radius": 0.4},
                {"type": "polygon", "vertices": [[1.0, 1.2], [2.0, 1.2], [1.5, 1.8]]},
            ],
        },
    }


def answer(drive: str, samples: int = 101, duration: float = 5.0) -> dict[str, Any]:
    """An S-shaped drive with made-up wheels: a picture shows what it is given and checks nothing."""
    wheels, steered = DRIVES[drive]
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


def shades(path: Path) -> dict[Any, int]:
    """How many pixels have each colour."""
    with Image.open(path) as image:
        assert image.format == "PNG"
        assert image.width == 1800
        assert 550 <= image.height <= 1200
        return {colour: count for count, colour in image.convert("RGB").getcolors(image.width * image.height)}


def rgb(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


@pytest.mark.parametrize("footprint", FOOTPRINTS)
@pytest.mark.parametrize("drive", DRIVES)
def test_shows_limits_start_goal_and_every_wheel(drive: str, footprint: str, tmp_path: Path) -> None:
    draw_plan(body(drive, footprint), answer(drive), tmp_path / "plan.png")
    seen = shades(tmp_path / "plan.png")
    wheels = DRIVES[drive][0]
    for colour in (LIMIT, START, GOAL, *WHEELS[: len(wheels)]):
        assert seen.get(rgb(colour), 0) > 50, colour


def test_a_steering_limit_adds_its_lines(tmp_path: Path) -> None:
    draw_plan(body("ackermann"), answer("ackermann"), tmp_path / "without.png")
    draw_plan(body("ackermann", steering_angle=0.6), answer("ackermann"), tmp_path / "with.png")
    without, limited = (shades(tmp_path / f"{name}.png")[rgb(LIMIT)] for name in ("without", "with"))
    assert limited > 1.5 * without


def test_wheels_with_limits_of_their_own(tmp_path: Path) -> None:
    request = body("differential")
    request["robot"]["limits"]["wheel_speed"] = {"left": 12.0, "right": 9.0}
    draw_plan(request, answer("differential"), tmp_path / "plan.png")
    draw_plan(body("differential"), answer("differential"), tmp_path / "same.png")
    assert shades(tmp_path / "plan.png")[rgb(LIMIT)] > 1.3 * shades(tmp_path / "same.png")[rgb(LIMIT)]


def test_a_synchro_body_keeps_its_heading(tmp_path: Path) -> None:
    request, plan = body("synchro"), answer("synchro")
    pictures = []
    for heading in (None, 0.0, 0.7):
        request["robot"]["drive"]["body_heading"] = heading
        draw_plan(request, plan, tmp_path / "plan.png")
        pictures.append((tmp_path / "plan.png").read_bytes())
    assert pictures[0] == pictures[1]  # absent: the start's heading, which is 0
    assert pictures[1] != pictures[2]


def test_a_robot_that_stays_where_it_is(tmp_path: Path) -> None:
    draw_plan(body("differential"), answer("differential", samples=1, duration=0.0), tmp_path / "plan.png")
    assert shades(tmp_path / "plan.png")[rgb(GOAL)] > 50


def test_a_turn_on_the_spot(tmp_path: Path) -> None:
    plan = answer("differential")
    for key in ("x", "y", "vx"):
        plan["trajectory"][key] = [0.0] * len(plan["schedule"]["time"])
    draw_plan(body("differential"), plan, tmp_path / "plan.png")
    assert shades(tmp_path / "plan.png")[rgb(GOAL)] > 50


@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("yaw", [0.0, 0.6])
def test_the_map_lies_under_the_plan(negate: int, yaw: float, tmp_path: Path) -> None:
    grey = np.full((80, 140), 254, dtype=np.uint8)
    grey[:8], grey[-8:], grey[:, :8], grey[:, -8:] = 0, 0, 0, 0
    grey[20:30, 60:110] = 205
    Image.fromarray(255 - grey if negate else grey).save(tmp_path / "hall.pgm")
    (tmp_path / "hall.yaml").write_text(
        f"image: hall.pgm\nresolution: 0.05\norigin: [-1.0, -2.0, {yaw}]\nnegate: {negate}\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    request = body("differential")
    request["environment"] = {"map": {"id": "0" * 64}}
    draw_plan(request, answer("differential"), tmp_path / "map.png", tmp_path / "hall.yaml")
    draw_plan(request, answer("differential"), tmp_path / "bare.png")
    wall, with_map, bare = rgb("#3c4552"), shades(tmp_path / "map.png"), shades(tmp_path / "bare.png")
    assert with_map.get(wall, 0) > 2000
    assert bare.get(wall, 0) < 100


def test_drawing_changes_nothing(tmp_path: Path) -> None:
    request, plan = body("mecanum"), answer("mecanum")
    before = json.dumps([request, plan])
    draw_plan(request, plan, tmp_path / "plan.png")
    assert json.dumps([request, plan]) == before
