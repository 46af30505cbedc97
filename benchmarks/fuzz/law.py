"""Changed requests whose answers must take as long as the first one's (metamorphic laws).

Each law takes a request to the changed one, the largest share by which the new duration may differ, and the
factor by which time itself was scaled. A law that says nothing about a request gives None.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import yaml

from benchmarks.fuzz.kinematics import wheel_names
from benchmarks.fuzz.request import Case

__all__ = ["LAWS", "Changed"]

SAME, NEVER_SLOWER = 0.03, 0.01
_FAR = 1e5


@dataclass(frozen=True)
class Changed:
    """case: the changed one. times: what a duration of the first is multiplied by. slack: by what share the
    new duration may exceed that; below: whether it may be shorter by any amount."""

    case: Case
    times: float = 1.0
    slack: float = SAME
    below: bool = False


Law = Callable[[Case, np.random.Generator], Changed | None]


def mirror(case: Case, _: np.random.Generator) -> Changed | None:
    """The world seen in a mirror: left is right."""
    request = copy.deepcopy(case.request)
    if case.map is not None:
        return None
    robot = request["robot"]
    names = _mirrored_names(robot["drive"])
    limits = robot["limits"]
    for key, value in limits.items():
        if isinstance(value, dict):
            limits[key] = {name: value[names[name]] for name in value}
    footprint, drive = robot["footprint"], robot["drive"]
    if footprint["type"] == "polygon":
        footprint["vertices"] = [[x, -y] for x, y in footprint["vertices"]]
    for part in (*drive.get("modules", ()), *drive.get("wheels", ())):
        for key in {"y", "heading", "roller_angle"} & part.keys():
            part[key] = -part[key]
    for key in {"wheel_offset", "body_heading"} & drive.keys():
        drive[key] = -drive[key]
    for pose in (request["start"], request["goal"]):
        pose["y"] = -pose["y"]
        pose["theta"] = None if pose["theta"] is None else -pose["theta"]
    steering = request["start"].get("steering", {})
    request["start"] |= {"steering": {n: -steering[names[n]] for n in steering}} if steering else {}
    environment = request["environment"]
    if box := environment.get("bounds"):
        box["y_min"], box["y_max"] = -box["y_max"], -box["y_min"]
    for shape in environment.get("obstacles", ()):
        if shape["type"] == "circle":
            shape["center"][1] *= -1
        else:
            shape["vertices"] = [[x, -y] for x, y in shape["vertices"]]
    return Changed(replace(case, request=request))


def _mirrored_names(drive: dict[str, Any]) -> dict[str, str]:
    names = wheel_names(drive)
    if drive["type"] == "omni":
        return {name: names[-i % len(names)] for i, name in enumerate(names)}
    if drive["type"] in ("synchro", "swerve", "powered_caster", "swedish"):
        return {name: name for name in names}
    swap = {"left": "right", "right": "left"}
    return {name: "_".join(swap.get(part, part) for part in name.split("_")) for name in names}


def rotate(case: Case, rng: np.random.Generator) -> Changed | None:
    """The world turned; its bounds become walls."""
    angle = float(rng.uniform(-math.pi, math.pi))
    walled = walls(case, rng)
    return Changed(_moved(walled.case if walled else case, (0.0, 0.0), angle))


def translate(case: Case, rng: np.random.Generator) -> Changed | None:
    """The world moved by up to 1 km."""
    x, y = rng.uniform(-1000, 1000, 2).tolist()
    return Changed(_moved(case, (x, y), 0.0))


def walls(case: Case, _: np.random.Generator) -> Changed | None:
    """Walls in place of the bounds."""
    request = copy.deepcopy(case.request)
    environment = request["environment"]
    box = environment.pop("bounds", None)
    if box is None:
        return None
    x0, y0, x1, y1 = box["x_min"], box["y_min"], box["x_max"], box["y_max"]
    d = max(x1 - x0, y1 - y0)
    thick = [
        (x0 - d, y0 - d, x0, y1 + d),
        (x1, y0 - d, x1 + d, y1 + d),
        (x0, y0 - d, x1, y0),
        (x0, y1, x1, y1 + d),
    ]
    environment["obstacles"] = [*environment.get("obstacles", []), *(_rectangle(*each) for each in thick)]
    if case.map is None:
        environment["bounds"] = {"x_min": x0 - d, "y_min": y0 - d, "x_max": x1 + d, "y_max": y1 + d}
    return Changed(replace(case, request=request))


def far_obstacle(case: Case, rng: np.random.Generator) -> Changed | None:
    """An obstacle more, out of reach."""
    request = copy.deepcopy(case.request)
    box = request["environment"].get("bounds")
    if box is None:
        return None
    far = box["x_max"] + (box["x_max"] - box["x_min"]) * rng.uniform(1.0, 3.0)
    size = (box["x_max"] - box["x_min"]) * 0.1
    more = _rectangle(far, box["y_min"], far + size, box["y_min"] + size)
    request["environment"]["obstacles"] = [*request["environment"].get("obstacles", []), more]
    return Changed(replace(case, request=request))


def swap(case: Case, _: np.random.Generator) -> Changed | None:
    """From the goal to the start: a motion driven backwards in time."""
    request = copy.deepcopy(case.request)
    start, goal = request["start"], request["goal"]
    backwards = request["options"].get("reverse", True) and case.drive != "powered_caster"
    if goal["theta"] is None or "steering" in start or not backwards:
        return None
    if case.drive == "synchro":
        request["robot"]["drive"].setdefault("body_heading", start["theta"])
    request["start"], request["goal"] = dict(goal), dict(start)
    return Changed(replace(case, request=request))


def scale(case: Case, rng: np.random.Generator) -> Changed | None:
    """Lengths and times in other units."""
    request = copy.deepcopy(case.request)
    period = request["options"].get("sample_period", 0.02)
    length = float(rng.uniform(0.5, 2.0))
    time = float(np.clip(rng.uniform(0.5, 2.0), 0.001 / period, 0.1 / period))
    robot, environment = request["robot"], request["environment"]
    scales = {
        "wheel_speed": 1 / time, "wheel_acceleration": time**-2, "wheel_jerk": time**-3,
        "steering_rate": 1 / time, "steering_angle": 1.0,
        "linear_speed": length / time, "angular_speed": 1 / time,
        "linear_acceleration": length / time**2, "lateral_acceleration": length / time**2,
    }  # fmt: skip
    robot["limits"] = {key: _times(value, scales[key]) for key, value in robot["limits"].items()}
    drive, footprint = robot["drive"], robot["footprint"]
    for key in ("wheel_radius", "track_width", "wheelbase", "robot_radius", "caster_offset"):
        if key in drive:
            drive[key] *= length
    for part in (*drive.get("modules", ()), *drive.get("wheels", ())):
        for key in {"x", "y", "radius"} & part.keys():
            part[key] *= length
    if footprint["type"] == "polygon":
        footprint["vertices"] = [[x * length, y * length] for x, y in footprint["vertices"]]
    else:
        for key in {"length", "width", "offset", "radius"} & footprint.keys():
            footprint[key] *= length
    options = request["options"]
    options["sample_period"] = min(0.1, max(0.001, period * time))
    for key in {"min_clearance", "turning_radius"} & options.keys():
        options[key] *= length
    _place(request, lambda x, y: (x * length, y * length), 0.0)
    for shape in environment.get("obstacles", ()):
        if shape["type"] == "circle":
            shape["radius"] *= length
    files = case.map and _map_changed(case.map, lambda m: {
        "resolution": m["resolution"] * length,
        "origin": [m["origin"][0] * length, m["origin"][1] * length, m["origin"][2]],
    })  # fmt: skip
    return Changed(replace(case, request=request, map=files, known=case.known * time), times=time)


def wider(case: Case, rng: np.random.Generator) -> Changed | None:
    """Every actuator quicker: never slower."""
    request = copy.deepcopy(case.request)
    limits, by = request["robot"]["limits"], float(rng.uniform(1.1, 2.0))
    keys = {"wheel_speed", "wheel_acceleration", "wheel_jerk", "steering_rate"} & limits.keys()
    for key in keys if rng.random() < 0.5 else [str(rng.choice(sorted(keys)))]:
        limits[key] = _times(limits[key], by)
    return Changed(replace(case, request=request), slack=NEVER_SLOWER, below=True)


LAWS: dict[str, Law] = {
    law.__name__.replace("_", " "): law
    for law in (mirror, rotate, translate, walls, far_obstacle, swap, scale, wider)
}
"""By name."""


def _moved(case: Case, by: tuple[float, float], angle: float) -> Case:
    """Turned about the origin, then moved. Bounds are only moved."""
    request = copy.deepcopy(case.request)
    c, s = math.cos(angle), math.sin(angle)

    def place(x: float, y: float) -> tuple[float, float]:
        return c * x - s * y + by[0], s * x + c * y + by[1]

    turned = angle != 0.0
    box = request["environment"].pop("bounds", None) if turned else None
    _place(request, place, angle)
    if turned and case.map is None and box is not None:
        far = 2 * math.hypot(*(abs(v) for v in (max(map(abs, box.values())), max(map(abs, box.values())))))
        request["environment"]["bounds"] = {"x_min": -far, "y_min": -far, "x_max": far, "y_max": far}
    files = case.map and _map_changed(case.map, lambda m: {
        "origin": [*place(m["origin"][0], m["origin"][1]), m["origin"][2] + angle]
    })  # fmt: skip
    return replace(case, request=request, map=files)


def _place(
    request: dict[str, Any], place: Callable[[float, float], tuple[float, float]], angle: float
) -> None:
    """Puts every point of a request to its place, and turns its headings."""
    for pose in (request["start"], request["goal"]):
        pose["x"], pose["y"] = place(pose["x"], pose["y"])
        pose["theta"] = None if pose["theta"] is None else pose["theta"] + angle
    drive, environment = request["robot"]["drive"], request["environment"]
    if "body_heading" in drive:
        drive["body_heading"] += angle
    for shape in environment.get("obstacles", ()):
        if shape["type"] == "circle":
            shape["center"] = list(place(*shape["center"]))
        else:
            shape["vertices"] = [list(place(x, y)) for x, y in shape["vertices"]]
    if box := environment.get("bounds"):
        box["x_min"], box["y_min"] = place(box["x_min"], box["y_min"])
        box["x_max"], box["y_max"] = place(box["x_max"], box["y_max"])


def _map_changed(files: Any, change: Callable[[dict[str, Any]], dict[str, Any]]) -> Any:
    meta = yaml.safe_load(files.description)
    return replace(files, description=yaml.safe_dump(meta | change(meta)).encode())


def _times(value: Any, by: float) -> Any:
    return {key: each * by for key, each in value.items()} if isinstance(value, dict) else value * by


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> dict[str, Any]:
    return {"type": "polygon", "vertices": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]}
