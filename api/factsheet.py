"""A VDA 5050 factsheet becomes a robot: what it says of wheels, limits and envelope, and what it leaves open.

Fields by the specification, VDA5050/VDA5050, tags 2.1.0 and 3.0.0: "agvGeometry", "speedMax" … are of 2.1,
"mobileRobotGeometry", "maximumSpeed" … of 3.0.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import AliasChoices, BaseModel, ConfigDict

from api.fields import LARGEST_LENGTH, LARGEST_RATE, quantity
from api.schemas import MAX_VERTICES, MAX_WHEELS
from drives.se2 import Array

__all__ = ["Factsheet", "RobotOfFactsheet", "robot_of"]

_SAME = 1e-3
"""Positions and diameters this close are alike, m"""


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False, frozen=True)


def _either(old: str, new: str, description: str, unit: str = "", default: Any = ..., **more: Any) -> Any:
    """A field that is called `old` in 2.1 and `new` in 3.0."""
    return quantity(description, unit, default, validation_alias=AliasChoices(old, new), **more)


_LENGTH = {"gt": 0, "le": LARGEST_LENGTH}
_PLACE = {"ge": -LARGEST_LENGTH, "le": LARGEST_LENGTH}
_RATE = {"gt": 0, "le": LARGEST_RATE}


class Place(_Part):
    """A point of the vehicle's frame."""

    x: float = quantity("How far ahead", "m", example=0.4, **_PLACE)
    y: float = quantity("How far left", "m", example=0.25, **_PLACE)


class WheelDefinition(_Part):
    """One of wheelDefinitions."""

    type: str = quantity("DRIVE, CASTER, FIXED or MECANUM", "", example="DRIVE", max_length=100)
    isActiveDriven: bool = quantity("Whether it is driven", "", example=True)
    isActiveSteered: bool = quantity("Whether it is steered", "", example=False)
    position: Place = quantity("Where it stands")
    diameter: float = quantity("Diameter", "m", example=0.2, **_LENGTH)
    centerDisplacement: float = quantity("How far it trails its pivot", "m", 0.0, example=0.03, **_PLACE)


class Envelope(_Part):
    """One of envelopes2d."""

    name: str = _either("set", "envelope2dId", "Name of the envelope", example="empty", max_length=1000)
    vertices: list[Place] = _either(
        "polygonPoints", "vertices", "Its corners", min_length=3, max_length=MAX_VERTICES
    )


class Geometry(_Part):
    """agvGeometry or mobileRobotGeometry."""

    wheelDefinitions: list[WheelDefinition] = quantity("The wheels", "", (), max_length=MAX_WHEELS)
    envelopes2d: list[Envelope] = quantity("The outlines", "", (), max_length=100)


class PhysicalParameters(_Part):
    """What the vehicle may do, and its size."""

    speed: float = _either("speedMax", "maximumSpeed", "Largest speed", "m/s", example=1.5, **_RATE)
    acceleration: float = _either(
        "accelerationMax", "maximumAcceleration", "Largest acceleration", "m/s^2", example=0.8, **_RATE
    )
    deceleration: float = _either(
        "decelerationMax", "maximumDeceleration", "Largest deceleration", "m/s^2", example=0.6, **_RATE
    )
    yaw_rate: float | None = _either(
        "angularSpeedMax", "maximumAngularSpeed", "Largest yaw rate", "rad/s", None, example=1.0, **_RATE
    )
    width: float = quantity("Width", "m", example=0.8, **_LENGTH)
    length: float = quantity("Length", "m", example=1.2, **_LENGTH)


class Factsheet(_Part):
    """The parts of a factsheet message that describe a robot; others are skipped."""

    physicalParameters: PhysicalParameters = quantity("Limits and size")
    geometry: Geometry = _either("agvGeometry", "mobileRobotGeometry", "Wheels and envelopes")


class Gap(BaseModel):
    """What a request needs and the factsheet does not say."""

    pointer: str = quantity("Where it belongs in the answer", "", example="/robot/limits/steering_rate")
    detail: str = quantity(
        "What is needed, and why",
        "",
        example="rad/s; a factsheet does not say how fast wheels are steered.",
    )


class RobotOfFactsheet(BaseModel):
    """A robot, whole where nothing is missing."""

    robot: dict[str, Any] = quantity(
        "As a request has it, less what is missing", "", example={"limits": {"linear_speed": 1.5}}
    )
    missing: list[Gap] = quantity("What to fill in before it can be planned for")
    notes: list[str] = quantity(
        "What was assumed", "", example=["slip_coefficient is left at 1; measure it by turning on the spot."]
    )


def robot_of(sheet: Factsheet) -> dict[str, Any]:
    """{"robot", "missing", "notes"}: the answer that RobotOfFactsheet describes."""
    missing: list[dict[str, str]] = []
    notes: list[str] = []

    def lacks(at: str, detail: str) -> None:
        missing.append({"pointer": f"/robot/{at}", "detail": detail})

    wheels, can = sheet.geometry.wheelDefinitions, sheet.physicalParameters
    drive, origin, turned = _drive(wheels)
    change = min(can.acceleration, can.deceleration)
    limits = {"linear_speed": can.speed, "linear_acceleration": change}
    if can.yaw_rate is not None:
        limits["angular_speed"] = can.yaw_rate
    if drive is None:
        kinds = ", ".join(_said(wheel) for wheel in wheels) or "none at all"
        lacks("drive", f"No drive of wheelplan has these wheels: {kinds}.")
        for name in ("wheel_speed", "wheel_acceleration"):
            lacks(f"limits/{name}", "Without a drive there is no wheel radius to divide a speed by.")
    else:
        radius = drive["wheel_radius"]
        limits |= {"wheel_speed": can.speed / radius, "wheel_acceleration": change / radius}
        notes.append(
            "wheel_speed and wheel_acceleration are the vehicle's divided by the wheel radius: what driving "
            "straight on needs. Wheels that may turn faster make turns quicker."
        )
        rolling = [w for w in wheels if w.type != "CASTER" or w.isActiveDriven or w.isActiveSteered]
        if max(w.diameter for w in rolling) - min(w.diameter for w in rolling) > _SAME:
            notes.append(f"Wheels have different diameters; {2 * radius:g} m is taken for all.")
        if any(wheel.isActiveSteered for wheel in wheels):
            lacks("limits/steering_rate", "rad/s; a factsheet does not say how fast wheels are steered.")
        if drive["type"] in ("tricycle", "ackermann"):
            lacks("limits/steering_angle", "rad; a factsheet does not say how far wheels are steered.")
        if drive["type"] == "skid_steer":
            notes.append("slip_coefficient is left at 1; measure it by turning on the spot.")
    if np.hypot(*origin) > _SAME:
        notes.append(
            f"Poses are of the point ({origin[0]:g}, {origin[1]:g}) m of the vehicle's frame, the drive's "
            "origin."
        )
    if turned:
        notes.append(
            "The steered wheel is behind: theta is the vehicle's heading + π, forwards its backwards."
        )
    footprint = _footprint(sheet, origin, -1.0 if turned else 1.0, notes)
    robot = {"drive": drive, "footprint": footprint, "limits": limits}
    return {"robot": {k: v for k, v in robot.items() if v is not None}, "missing": missing, "notes": notes}


def _footprint(sheet: Factsheet, origin: Array, sign: float, notes: list[str]) -> dict[str, Any]:
    envelopes, size = sheet.geometry.envelopes2d, sheet.physicalParameters
    if envelopes:
        if len(envelopes) > 1:
            others = ", ".join(repr(envelope.name[:40]) for envelope in envelopes[1:9])
            notes.append(
                f"The footprint is the envelope {envelopes[0].name[:40]!r}; there are also {others}."
            )
        corners = np.array([[p.x, p.y] for p in envelopes[0].vertices])
    else:
        notes.append("There is no envelope: the footprint is length × width about the vehicle's origin.")
        half = np.array([size.length, size.width]) / 2
        corners = half * [[-1, -1], [1, -1], [1, 1], [-1, 1]]
    return {"type": "polygon", "vertices": (sign * (corners - origin)).tolist()}


def _said(wheel: WheelDefinition) -> str:
    how = [word for word, so in (("driven", wheel.isActiveDriven), ("steered", wheel.isActiveSteered)) if so]
    return " ".join([wheel.type[:20], *how])


def _drive(wheels: list[WheelDefinition]) -> tuple[dict[str, Any] | None, Array, bool]:
    """The drive that has these wheels, its origin in the vehicle's frame, and whether it looks backwards."""
    steered = [w for w in wheels if w.isActiveSteered]
    fixed = [w for w in wheels if not w.isActiveSteered and w.type in ("DRIVE", "FIXED")]
    driven = [w for w in fixed if w.isActiveDriven]
    mecanum = [w for w in wheels if w.type == "MECANUM" and w.isActiveDriven]
    nothing = np.zeros(2)
    if mecanum or (len(driven) == 4 and not steered):
        four = mecanum or driven
        middle, spread = _middle(four), np.ptp(_places(four), axis=0)
        corners = np.abs(_places(four) - middle) - spread / 2
        if len(four) != 4 or steered or (mecanum and fixed) or np.abs(corners).max() > _SAME:
            return None, nothing, False
        kind = "mecanum" if mecanum else "skid_steer"
        return _sized(kind, four, track_width=spread[1], wheelbase=spread[0]), middle, False
    if len(driven) == 2 and not steered and _axle(driven):
        return _sized("differential", driven, track_width=_width(driven)), _middle(driven), False
    if len(steered) in (1, 2) and len(fixed) == 2 and _axle(fixed):
        middle = _middle(fixed)
        ahead = _places(steered) - middle
        behind = bool(ahead[0, 0] < 0)
        shape = {"wheelbase": abs(ahead[0, 0]), "track_width": _width(fixed)}
        if len(steered) == 1 and abs(ahead[0, 1]) < _SAME:
            return _sized("tricycle", steered, **shape), middle, behind
        if len(steered) == 2 and _axle(steered) and abs(_middle(steered)[1] - middle[1]) < _SAME:
            return _sized("ackermann", fixed, **shape), middle, behind
    if len(steered) >= 2 and not fixed and all(wheel.isActiveDriven for wheel in steered):
        modules = [
            {"name": f"wheel_{i}", "x": w.position.x, "y": w.position.y} for i, w in enumerate(steered, 1)
        ]
        offset = abs(steered[0].centerDisplacement)
        more = {"caster_offset": offset} if offset else {}
        return (
            _sized("powered_caster" if offset else "swerve", steered, **more, modules=modules),
            nothing,
            False,
        )
    return None, nothing, False


def _sized(kind: str, wheels: list[WheelDefinition], **shape: Any) -> dict[str, Any]:
    shape = {name: value if name == "modules" else float(value) for name, value in shape.items()}
    return {"type": kind, "wheel_radius": wheels[0].diameter / 2, **shape}


def _places(wheels: list[WheelDefinition]) -> Array:
    return np.array([[wheel.position.x, wheel.position.y] for wheel in wheels])


def _middle(wheels: list[WheelDefinition]) -> Array:
    return np.asarray(_places(wheels).mean(axis=0))


def _width(wheels: list[WheelDefinition]) -> float:
    return float(np.ptp(_places(wheels)[:, 1]))


def _axle(wheels: list[WheelDefinition]) -> bool:
    """Whether the wheels stand side by side."""
    return bool(np.ptp(_places(wheels)[:, 0]) < _SAME < _width(wheels))
