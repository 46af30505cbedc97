"""Random robots of every drive, from 5 cm to 12 m, as a client describes them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchmarks.fuzz.kinematics import steered_names, wheel_names, wheels

__all__ = ["DRIVES", "draw_robot", "log_uniform", "outline", "reach", "smallest_radius"]

DRIVES = (
    "differential", "tracked", "skid_steer", "omni", "mecanum", "swedish", "tricycle", "ackermann", "synchro",
    "swerve", "powered_caster",
)  # fmt: skip
_SIZES = (0.05, 12.0)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Between low and high; its logarithm is uniform."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def draw_robot(rng: np.random.Generator, kind: str, size: float | None = None) -> dict[str, Any]:
    """The `robot` of a request. size m: the length of its footprint."""
    size = size or log_uniform(rng, *_SIZES)
    drive = _drive(rng, kind, size)
    return {"drive": drive, "footprint": _footprint(rng, size), "limits": _limits(rng, drive, size)}


def outline(footprint: dict[str, Any]) -> list[list[float]]:
    """The corners of a footprint that is no circle."""
    if footprint["type"] == "polygon":
        corners: list[list[float]] = footprint["vertices"]
        return corners
    half, side, ahead = footprint["length"] / 2, footprint["width"] / 2, footprint.get("offset", 0.0)
    return [[ahead - half, -side], [ahead + half, -side], [ahead + half, side], [ahead - half, side]]


def reach(footprint: dict[str, Any]) -> float:
    """Distance m of the farthest point from the body origin."""
    if footprint["type"] == "circle":
        return float(footprint["radius"])
    return max(math.hypot(x, y) for x, y in outline(footprint))


def smallest_radius(robot: dict[str, Any]) -> float:
    """The turning radius m of a car-like robot at its steering limit; 0 for the others."""
    drive = robot["drive"]
    if drive["type"] not in ("tricycle", "ackermann"):
        return 0.0
    inner = drive["track_width"] / 2 if drive["type"] == "ackermann" else 0.0
    return float(drive["wheelbase"] / math.tan(robot["limits"]["steering_angle"]) + inner)


def _drive(rng: np.random.Generator, kind: str, size: float) -> dict[str, Any]:
    drive: dict[str, Any] = {"type": kind, "wheel_radius": size * rng.uniform(0.04, 0.15)}
    if kind in ("differential", "tracked", "skid_steer", "mecanum", "tricycle", "ackermann"):
        drive["track_width"] = size * rng.uniform(0.3, 0.9)
    if kind in ("skid_steer", "mecanum", "tricycle", "ackermann"):
        drive["wheelbase"] = size * rng.uniform(0.35, 0.9)
    if kind in ("tracked", "skid_steer"):
        drive["slip_coefficient"] = rng.uniform(1.0, 2.0)
    if kind == "omni":
        drive["robot_radius"] = size * rng.uniform(0.2, 0.5)
        drive["wheel_count"] = int(rng.choice([3, 3, 4, 5]))
        drive["wheel_offset"] = rng.uniform(-math.pi, math.pi)
    if kind == "synchro":
        drive["wheel_count"] = int(rng.integers(1, 5))
        if rng.random() < 0.5:
            drive["body_heading"] = rng.uniform(-math.pi, math.pi)
    if kind == "swedish":
        return {"type": kind, "wheels": _swedish(rng, size)}
    if kind in ("swerve", "powered_caster"):
        drive["modules"] = _modules(rng, size)
    if kind == "powered_caster":
        drive["caster_offset"] = size * log_uniform(rng, 0.02, 0.2)
    return drive


def _swedish(rng: np.random.Generator, size: float) -> list[dict[str, Any]]:
    """Wheels round the origin that push in well spread directions, so that they reach every twist."""
    count = int(rng.integers(3, 6))
    made = []
    for i in range(count):
        at, arm = math.tau * i / count + rng.uniform(-0.2, 0.2), size * rng.uniform(0.3, 0.5)
        roller = float(rng.choice([0.0, math.pi / 4, -math.pi / 4, rng.uniform(-0.9, 0.9)]))
        made.append({
            "name": f"w{i}", "x": arm * math.cos(at), "y": arm * math.sin(at),
            "heading": at + math.pi / 2 - roller + rng.uniform(-0.3, 0.3), "roller_angle": roller,
            "radius": size * rng.uniform(0.04, 0.12),
        })  # fmt: skip
    return made


def _modules(rng: np.random.Generator, size: float) -> list[dict[str, Any]]:
    """Two to five, no two in one place."""
    count, around = int(rng.integers(2, 6)), rng.uniform(0, math.tau)
    made = []
    for i in range(count):
        at, arm = around + math.tau * i / count + rng.uniform(-0.4, 0.4), size * rng.uniform(0.15, 0.6)
        made.append({"name": f"m{i}", "x": arm * math.cos(at), "y": arm * math.sin(at)})
    return made


def _footprint(rng: np.random.Generator, size: float) -> dict[str, Any]:
    shape = rng.choice(["rectangle", "rectangle", "circle", "concave", "convex"])
    if shape == "circle":
        return {"type": "circle", "radius": size / 2}
    width = size * float(rng.choice([0.02, rng.uniform(0.2, 1.0), rng.uniform(0.2, 1.0), 0.5]))
    ahead = size * float(rng.choice([0.0, rng.uniform(-0.6, 0.6), rng.uniform(-0.3, 0.3)]))
    if shape == "rectangle":
        made = {"type": "rectangle", "length": size, "width": width}
        return made | ({"offset": ahead} if ahead else {})
    if shape == "convex":
        at = np.sort(rng.uniform(0, math.tau / 3, 3)) + math.tau / 3 * np.arange(3)
        points = np.stack([np.cos(at) * size / 2, np.sin(at) * max(width, 0.2 * size) / 2], 1)
    else:
        a, b = rng.uniform(0.25, 0.75, 2)
        forms = {
            "L": [[0, 0], [1, 0], [1, a], [b, a], [b, 1], [0, 1]],
            "U": [[0, 0], [1, 0], [1, 1], [0.7, 1], [0.7, a], [0.3, a], [0.3, 1], [0, 1]],
            "V": [[0, 0], [1, 0], [1, 1], [b, a], [0, 1]],
        }
        form = forms[str(rng.choice(list(forms)))]
        points = (np.array(form, dtype=float) - 0.5) * [size, max(width, 0.3 * size)]
        if rng.random() < 0.5:
            points = points @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    points = points + np.array([ahead, size * float(rng.choice([0.0, rng.uniform(-0.4, 0.4)]))])
    if rng.random() < 0.3:
        points = points[::-1]  # either winding
    return {"type": "polygon", "vertices": points.tolist()}


def _limits(rng: np.random.Generator, drive: dict[str, Any], size: float) -> dict[str, Any]:
    speed = math.sqrt(size) * log_uniform(rng, 0.1, 3.0)  # m/s
    rise, settle = log_uniform(rng, 0.1, 3.0), log_uniform(rng, 0.03, 1.0)  # s
    table = wheels(drive)
    radius = sum(wheel.radius for wheel in table) / len(table)
    limits: dict[str, Any] = {
        "wheel_speed": _per_wheel(rng, drive, speed / radius),
        "wheel_acceleration": _per_wheel(rng, drive, speed / radius / rise),
    }
    if rng.random() < 0.15:
        limits["wheel_jerk"] = _per_wheel(rng, drive, speed / radius / rise / settle)
    if steered_names(drive):
        limits["steering_rate"] = log_uniform(rng, 0.3, 10.0)
    if drive["type"] in ("tricycle", "ackermann"):
        limits["steering_angle"] = rng.uniform(0.35, 1.4)
    if drive["type"] == "swerve" and rng.random() < 0.1:
        limits["steering_angle"] = rng.uniform(1.7, 6.0)
    for name, value in {
        "linear_speed": speed, "angular_speed": speed / size, "linear_acceleration": speed / rise,
        "lateral_acceleration": speed**2 / size,
    }.items():  # fmt: skip
        if rng.random() < 0.1:
            limits[name] = value * log_uniform(rng, 0.2, 1.5)
    return limits


def _per_wheel(rng: np.random.Generator, drive: dict[str, Any], value: float) -> Any:
    if rng.random() < 0.65:
        return value
    return {name: value * log_uniform(rng, 0.4, 2.5) for name in wheel_names(drive)}
