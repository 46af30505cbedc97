"""Schemas of the drives, made from their classes: a drive in the registry is in the interface at once."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, get_args, get_type_hints

from pydantic import BaseModel, Field, create_model

from api.errors import FieldErrors
from api.fields import LARGEST_LENGTH, SMALLEST_LENGTH, Angle, Strict, WheelName, quantity
from api.validation import pointer
from drives import DRIVES
from drives.drive import Drive, InvalidDrive

__all__ = ["EXAMPLES", "SCHEMAS", "DriveSchema", "build_drive"]


class _Parameter(NamedTuple):
    description: str
    unit: str
    bounds: Mapping[str, float]
    example: Any


_LENGTH = {"ge": SMALLEST_LENGTH, "le": LARGEST_LENGTH}
_ARM = {"ge": -LARGEST_LENGTH, "le": LARGEST_LENGTH}
_MANY = {"min_length": 1, "max_length": 32}
_45 = math.pi / 4

_PARAMETERS = {
    "wheel_radius": _Parameter("Radius of every wheel (tracked: of the sprocket)", "m", _LENGTH, 0.1),
    "radius": _Parameter("Radius of this wheel", "m", _LENGTH, 0.05),
    "track_width": _Parameter("Distance between left and right wheels", "m", _LENGTH, 0.5),
    "wheelbase": _Parameter("Distance between front and rear wheels", "m", _LENGTH, 0.8),
    "robot_radius": _Parameter("Distance of every wheel from the body origin", "m", _LENGTH, 0.2),
    "caster_offset": _Parameter("How far the contact trails its pivot", "m", _LENGTH, 0.04),
    "slip_coefficient": _Parameter("Effective track width / track width", "1", {"ge": 1, "le": 100}, 1.2),
    "wheel_count": _Parameter("Number of wheels", "1", {"ge": 1, "le": 32}, 3),
    "wheel_offset": _Parameter("Angle at which wheel_1 stands, body frame", "rad", {}, 0.0),
    "body_heading": _Parameter("Heading that the body keeps (default: the start's theta)", "rad", {}, 0.0),
    "name": _Parameter("Name of the wheel", "", {}, "front_left"),
    "x": _Parameter("How far ahead of the body origin it stands", "m", _ARM, 0.3),
    "y": _Parameter("How far left of the body origin it stands", "m", _ARM, 0.2),
    "heading": _Parameter("Rolling direction, body frame", "rad", {}, 0.0),
    "roller_angle": _Parameter("0: rollers across it (Swedish 90°); ±π/4: Swedish 45°", "rad", {}, _45),
    "modules": _Parameter(
        "The steered wheels, two or more", "", _MANY,
        [{"name": "front", "x": 0.3, "y": 0.1}, {"name": "rear", "x": -0.3, "y": -0.1}],
    ),
    "wheels": _Parameter(
        "The wheels, three or more that together reach every twist", "", _MANY,
        [
            {"name": "nose", "x": 0.3, "y": 0.0, "heading": 2 * _45, "roller_angle": 0.0, "radius": 0.05},
            {"name": "left", "x": -0.2, "y": 0.25, "heading": 0.0, "roller_angle": _45, "radius": 0.06},
            {"name": "right", "x": -0.2, "y": -0.25, "heading": 0.0, "roller_angle": -_45, "radius": 0.06},
        ],
    ),
}  # fmt: skip


_OWN_HEADING = "body_heading"
"""A parameter whose default the contract takes from the start."""


def _parameter(name: str) -> _Parameter:
    return _PARAMETERS.get(name) or _Parameter(name.replace("_", " ").capitalize(), "", {}, None)


def _model(title: str, cls: type, **fixed: Any) -> type[BaseModel]:
    """The strict model of a dataclass's fields."""
    hints = get_type_hints(cls)
    made: dict[str, Any] = dict(fixed)
    for field in dataclasses.fields(cls):
        if not field.init:
            continue
        about = _parameter(field.name)
        default = ... if field.default is dataclasses.MISSING else field.default
        if field.name == _OWN_HEADING:
            default = None
        made[field.name] = (
            _type(field.name, hints[field.name]),
            quantity(about.description, about.unit, default, example=about.example, **about.bounds),
        )
    return create_model(title, __base__=Strict, __doc__=" ".join((cls.__doc__ or title).split()), **made)


def _type(name: str, hint: Any) -> Any:
    if name == "name":
        return WheelName
    parts: tuple[type, ...] = get_args(hint) or (hint,)
    if dataclasses.is_dataclass(parts[0]):
        return list[_model(parts[0].__name__, parts[0])]  # type: ignore[misc]
    kind = Angle if _parameter(name).unit == "rad" else parts[0]
    return kind | None if name == _OWN_HEADING else kind


def _title(kind: str) -> str:
    return "".join(word.capitalize() for word in kind.split("_")) + "Drive"


SCHEMAS: dict[str, type[BaseModel]] = {
    kind: _model(_title(kind), cls, type=(Literal[kind], Field(description="Which drive.")))
    for kind, cls in DRIVES.items()
}

EXAMPLES: dict[str, dict[str, Any]] = {
    kind: {"type": kind}
    | {
        name: field.examples[0]
        for name, field in schema.model_fields.items()
        if field.examples and field.is_required()
    }
    for kind, schema in SCHEMAS.items()
}

if TYPE_CHECKING:
    DriveSchema = BaseModel
else:
    DriveSchema = Annotated[reduce(or_, SCHEMAS.values()), Field(discriminator="type")]


def build_drive(schema: BaseModel, at: tuple[str, ...], start_heading: float = 0.0) -> Drive:
    """The drive that a client describes. Raises FieldErrors, pointing below `at`, where it is degenerate."""
    values = {name: getattr(schema, name) for name in type(schema).model_fields}
    cls = DRIVES[values.pop("type")]
    hints = get_type_hints(cls)
    for name, value in values.items():
        if isinstance(value, list):
            part = get_args(hints[name])[0]
            values[name] = tuple(part(**dict(item)) for item in value)
        elif name == _OWN_HEADING and value is None:
            values[name] = start_heading
    try:
        return cls(**values)
    except InvalidDrive as error:
        where = pointer(*at, *([error.parameter] if error.parameter else []))
        raise FieldErrors([{"pointer": where, "detail": f"{error}."}], "invalid-geometry") from None
