"""Textbook kinematics of the eleven drives, written from the contract for the check alone.

A wheel at (x, y) m in the body frame with heading β rolls at rate φ̇. With p = (vx - yω, vy + xω), the
velocity of its axis, e(a) = (cos a, sin a) and n(a) = (-sin a, cos a) (Siegwart and Nourbakhsh 2004,
sect. 3.2.3):

    rolling    e(β + γ)·p = r cos γ φ̇           γ: angle of the rollers, 0 for a standard wheel
    sliding    n(β)·p = b (ω + β̇)              b: trail of a caster, else 0; Swedish wheels slide freely
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["HOLONOMIC", "Array", "Wheel", "solve", "steered_names", "wheel_names", "wheels"]

Array = NDArray[np.float64]

HOLONOMIC = ("omni", "mecanum", "swedish", "swerve", "powered_caster")
"""Drives that move sideways."""


@dataclass(frozen=True)
class Wheel:
    """x, y m; heading rad (of a steered wheel: at steering angle 0); radius m; roller rad, None if it has no
    rollers; steers: whether its heading is a steering angle; trail m of a caster."""

    name: str
    x: float
    y: float
    heading: float
    radius: float
    roller: float | None = None
    steers: bool = False
    trail: float = 0.0


def wheels(drive: dict[str, Any]) -> list[Wheel]:
    """The wheels of a drive in the contract's order. Those of a synchro drive stand at the origin."""
    kind, r = drive["type"], drive.get("wheel_radius", 0.0)
    half = drive.get("track_width", 0.0) / 2 * drive.get("slip_coefficient", 1.0)
    base = drive.get("wheelbase", 0.0)
    corners = {"front_left": (1, 1), "front_right": (1, -1), "rear_left": (-1, 1), "rear_right": (-1, -1)}
    if kind in ("differential", "tracked"):
        return [Wheel("left", 0.0, half, 0.0, r), Wheel("right", 0.0, -half, 0.0, r)]
    if kind == "skid_steer":  # wheels of one side turn alike, so only the side matters
        return [Wheel(name, 0.0, side * half, 0.0, r) for name, (_, side) in corners.items()]
    if kind == "mecanum":
        return [
            Wheel(name, front * base / 2, side * half, 0.0, r, -front * side * math.pi / 4)
            for name, (front, side) in corners.items()
        ]
    if kind == "omni":
        count = drive.get("wheel_count", 3)
        angles = [drive.get("wheel_offset", 0.0) + math.tau * i / count for i in range(count)]
        arm = drive["robot_radius"]
        return [
            Wheel(f"wheel_{i + 1}", arm * math.cos(a), arm * math.sin(a), a - math.pi / 2, r, 0.0)
            for i, a in enumerate(angles)
        ]
    if kind == "swedish":
        return [
            Wheel(w["name"], w["x"], w["y"], w["heading"], w["radius"], w["roller_angle"])
            for w in drive["wheels"]
        ]
    if kind in ("tricycle", "ackermann"):
        fronts = {"front": 0.0} if kind == "tricycle" else {"front_left": half, "front_right": -half}
        front = [Wheel(name, base, y, 0.0, r, steers=True) for name, y in fronts.items()]
        return [*front, Wheel("rear_left", 0.0, half, 0.0, r), Wheel("rear_right", 0.0, -half, 0.0, r)]
    if kind == "synchro":
        return [
            Wheel(f"wheel_{i + 1}", 0.0, 0.0, 0.0, r, steers=True) for i in range(drive.get("wheel_count", 3))
        ]
    trail = drive.get("caster_offset", 0.0)
    return [Wheel(m["name"], m["x"], m["y"], 0.0, r, steers=True, trail=trail) for m in drive["modules"]]


def wheel_names(drive: dict[str, Any]) -> list[str]:
    """In the contract's order."""
    return [wheel.name for wheel in wheels(drive)]


def steered_names(drive: dict[str, Any]) -> list[str]:
    """The wheels that steer, in the contract's order."""
    return [wheel.name for wheel in wheels(drive) if wheel.steers]


def solve(drive: dict[str, Any], rate: Array, angle: Array, swing: Array) -> tuple[Array, Array]:
    """Twists (n, 3) that fit wheel rates (n, m), steering angles and steering rates (n, k) best, by least
    squares, and the largest equation (n,) m/s that each leaves unmet."""
    if drive["type"] == "synchro":  # its twist is in the frame of the wheels
        along = rate * drive["wheel_radius"]
        twist = np.stack([along.mean(1), np.zeros(len(rate)), swing.mean(1)], 1)
        return twist, np.hypot(np.ptp(along, 1), np.ptp(swing, 1))
    table, n = wheels(drive), len(rate)
    rows, wanted, steered = [], [], 0
    for i, wheel in enumerate(table):
        turn, turning = np.zeros(n), np.zeros(n)
        if wheel.steers:
            turn, turning = angle[:, steered], swing[:, steered]
            steered += 1
        heading, roller = wheel.heading + turn, wheel.roller or 0.0
        rows.append(_component(wheel, heading + roller))
        wanted.append(wheel.radius * math.cos(roller) * rate[:, i])
        if wheel.roller is None:
            across = _component(wheel, heading + math.pi / 2)
            rows.append(across - np.array([0.0, 0.0, wheel.trail]))
            wanted.append(wheel.trail * turning)
    a, b = np.stack(rows, 1), np.stack(wanted, 1)
    # Columns of one size, so that small robots are as well conditioned as large ones.
    size = max(max(math.hypot(w.x, w.y) for w in table), 1e-6)
    scaled = a / np.array([1.0, 1.0, size])
    turned = scaled.transpose(0, 2, 1)
    found = np.linalg.solve(turned @ scaled, turned @ b[..., None])[..., 0] / np.array([1.0, 1.0, size])
    return found, np.abs((a @ found[..., None])[..., 0] - b).max(1)


def _component(wheel: Wheel, direction: Array) -> Array:
    """Rows (n, 3) on (vx, vy, ω): the component of the axis' velocity along a direction (n,) rad."""
    c, s = np.cos(direction), np.sin(direction)
    return np.stack([c, s, wheel.x * s - wheel.y * c], 1)
