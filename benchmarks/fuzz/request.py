"""One random valid request from one seed, together with what is known about its answer."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.fuzz.kinematics import HOLONOMIC, steered_names
from benchmarks.fuzz.motion import Motion, draw_motion
from benchmarks.fuzz.robot import DRIVES, draw_robot, log_uniform, reach, smallest_radius
from benchmarks.fuzz.scene import MapFiles, draw_scene

__all__ = ["Case", "draw_case"]

BUDGET = 3.0
_SCENES = {
    "tube": 0.34,
    "clutter": 0.24,
    "fence": 0.1,
    "crowd": 0.07,
    "map": 0.13,
    "open": 0.09,
    "near": 0.03,
}
_MOST_SAMPLES = 12_000
_EXAMPLE = 0.8
"""The length (m) of the robots of the quick cases."""


@dataclass(frozen=True)
class Case:
    """seed: what it was drawn from. scene: its kind. request: as a client posts it; with a map, its id is set
    when the map has been stored. motion: one that solves it; known s: it takes no longer, with its stops."""

    seed: int
    drive: str
    scene: str
    request: dict[str, Any]
    map: MapFiles | None
    motion: Motion
    known: float


def draw_case(seed: int, scene: str | None = None, quick: bool = False) -> Case:
    """The case of a seed; drives take turns. quick: a robot of ordinary size, and effort first."""
    rng = np.random.default_rng(seed)
    kind = DRIVES[seed % len(DRIVES)]
    scene = scene or str(rng.choice(list(_SCENES), p=list(_SCENES.values())))
    robot = draw_robot(rng, kind, _EXAMPLE if quick else None)
    size = reach(robot["footprint"])
    options = _options(rng, robot, size)
    if quick:
        options |= {"effort": "first", "time_budget": 30.0}
    start = _start(rng, size)
    length = size * (log_uniform(rng, 1e-9, 1e-2) if scene == "near" else log_uniform(rng, 0.2, 8.0))
    motion = draw_motion(rng, robot, options, start, length)
    if scene == "near":
        motion = _shrunk(motion, length)
    drawn = draw_scene(
        rng, "open" if scene == "near" else scene, robot, motion, options.get("min_clearance", 0.0)
    )
    x, y, theta = motion.goal.tolist()
    goal = {"x": x, "y": y, "theta": theta + math.tau * int(rng.choice([0, 0, 0, 0, 1, -3]))}
    if rng.random() < 0.07:
        goal["theta"] = None
    request: dict[str, Any] = {
        "robot": robot,
        "start": dict(zip(("x", "y", "theta"), start.tolist(), strict=True)),
        "goal": goal,
        "environment": drawn.environment,
        "options": options,
    }
    if steered_names(robot["drive"]) and rng.random() < 0.35:
        request["start"]["steering"] = _steering(rng, robot, float(start[2]))
    known = motion.duration(request)
    if known / options["sample_period"] > _MOST_SAMPLES:
        options["sample_period"] = min(0.1, known / _MOST_SAMPLES)
        known = motion.duration(request)
    return Case(seed, kind, scene, request, drawn.map, motion, known)


def _start(rng: np.random.Generator, size: float) -> Any:
    far = 1000.0 if rng.random() < 0.1 else 0.0
    turns = math.tau * int(rng.choice([0, 0, 0, 0, 1, -5]))
    x, y = rng.uniform(-5, 5, 2) * size
    return np.array([x + far, y - far, rng.uniform(-math.pi, math.pi) + turns])


def _options(rng: np.random.Generator, robot: dict[str, Any], size: float) -> dict[str, Any]:
    options: dict[str, Any] = {
        "time_budget": BUDGET,
        "effort": str(rng.choice(["good", "first", "best"], p=[0.9, 0.07, 0.03])),
        "seed": int(rng.integers(2**31)),
        "sample_period": 0.02 if rng.random() < 0.4 else log_uniform(rng, 0.001, 0.1),
    }
    holonomic = robot["drive"]["type"] in HOLONOMIC
    if rng.random() < 0.25:
        options["min_clearance"] = size * log_uniform(rng, 0.01, 0.5)
    if rng.random() < (0.05 if holonomic else 0.25):
        options["reverse"] = False
    if not holonomic and rng.random() < 0.15:
        options["turning_radius"] = max(size, smallest_radius(robot)) * log_uniform(rng, 0.3, 2.0)
    return options


def _shrunk(motion: Motion, length: float) -> Motion:
    """The motion with its turns shrunk as well, so that its goal is near its start."""
    piece = motion.pieces[0]
    turn = piece.omega if abs(piece.vx) + abs(piece.vy) > 0 else math.copysign(min(1.0, length), piece.omega)
    return Motion(motion.start, (type(piece)(piece.vx, piece.vy, min(1.0, max(-1.0, turn))),))


def _steering(rng: np.random.Generator, robot: dict[str, Any], theta: float) -> dict[str, float]:
    """Angles at which the steered wheels can stand together."""
    drive, names = robot["drive"], steered_names(robot["drive"])
    if drive["type"] == "synchro":
        turned = theta - drive.get("body_heading", theta)
        return {name: turned + math.tau * int(rng.integers(-1, 2)) for name in names}
    if drive["type"] == "tricycle":
        most = robot["limits"]["steering_angle"]
        return {names[0]: rng.uniform(-most, most)}
    if drive["type"] == "ackermann":
        curvature = rng.uniform(-1, 1) / smallest_radius(robot)
        half, base = drive["track_width"] / 2, drive["wheelbase"]
        return {
            name: math.atan(base * curvature / (1 - y * curvature))
            for name, y in zip(names, (half, -half), strict=True)
        }
    most = min(robot["limits"].get("steering_angle", 3.1), 3.1)
    return {name: rng.uniform(-most, most) for name in names}
