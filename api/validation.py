"""A JSON value against a schema: the model, or every field at fault by its JSON pointer."""

from __future__ import annotations

import math
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from api.errors import FieldErrors

__all__ = ["pointer", "validated"]

Model = TypeVar("Model", bound=BaseModel)

# Fields that hold one of several shapes. pydantic puts the name of the shape it chose after them.
_UNIONS = {"drive", "footprint", "wheel_speed", "wheel_acceleration", "wheel_jerk"}

_BOUNDS = {
    "greater_than": ("gt", ">"), "greater_than_equal": ("ge", ">="),
    "less_than": ("lt", "<"), "less_than_equal": ("le", "<="),
}  # fmt: skip

_WANTED = {
    "float_type": "a number", "int_type": "an integer", "int_from_float": "an integer",
    "bool_type": "true or false",
    "string_type": "a string", "list_type": "an array", "dict_type": "an object", "model_type": "an object",
    "model_attributes_type": "an object",
}  # fmt: skip


def validated(model: type[Model], value: Any, at: tuple[str, ...] = ()) -> Model:
    """The value as a model. Raises FieldErrors with pointers below `at`."""
    try:
        return model.model_validate(value)
    except ValidationError as failure:
        errors = failure.errors(include_url=False)
        raise FieldErrors([_field_error(error, at) for error in errors]) from None


def pointer(*parts: str | int) -> str:
    """The JSON pointer (RFC 6901) of a path of names and indices."""
    return "".join("/" + str(part).replace("~", "~0").replace("/", "~1") for part in parts)


def _field_error(error: ErrorDetails, at: tuple[str, ...]) -> dict[str, Any]:
    parts = _short((*at, *_without_tags(error["loc"])))
    kind, given, limits = error["type"], error["input"], error.get("ctx", {})
    found: dict[str, Any] = {}
    bound = None
    if kind.startswith("union_tag") and "type" in str(limits.get("discriminator")):
        parts = (*parts, "type")
        given = given.get("type") if isinstance(given, dict) else None
        kind = "missing" if kind == "union_tag_not_found" else kind
    name = _name(parts)
    if kind == "string_pattern_mismatch" and parts[-1] == "[key]":
        parts, name = parts[:-1], f"A name in {_name(parts[:-2])}"
    if isinstance(given, bool | int | str) or (isinstance(given, float) and math.isfinite(given)):
        short = given if not isinstance(given, str) else given[:40]
        found = {"value": short}
    shown = _shown(given)

    if kind == "missing":
        detail, found = f"{name} is missing.", {}
    elif kind == "extra_forbidden":
        detail, found = f"{name} is not a known field.", {}
    elif kind == "finite_number":
        detail = f"{name} is not finite; it must be a finite number."
    elif kind in _BOUNDS:
        key, sign = _BOUNDS[kind]
        bound = f"{sign} {limits[key]:.12g}"
        detail = f"{name} is {shown}; it must be {bound}."
    elif kind in ("too_short", "too_long"):
        least = kind == "too_short"
        bound = f"{'>=' if least else '<='} {limits['min_length' if least else 'max_length']}"
        # Of an object too long pydantic does not say how long it is.
        detail = f"{name} has {limits['actual_length'] or len(given)} items; it must have {bound}."
    elif kind == "string_pattern_mismatch":
        bound = f"match {limits['pattern']}"
        detail = f"{name} is {shown}; it must {bound}."
    elif kind == "string_too_long":
        bound = f"<= {limits['max_length']} characters"
        detail = f"{name} has {len(given)} characters; it must have {bound}."
    elif kind == "literal_error" or kind == "union_tag_invalid":
        bound = f"one of {limits.get('expected') or limits['expected_tags']}"
        detail = f"{name} is {shown}; it must be {bound}."
    elif kind == "union_tag_not_found":
        detail = f"{name} is {shown}; it must be a number, or an object of numbers by wheel."
    elif kind in _WANTED:
        detail = f"{name} is {shown}; it must be {_WANTED[kind]}."
    else:
        detail = f"{name}: {error['msg']}."
    return {"pointer": pointer(*parts), "detail": detail, **found, **({"bound": bound} if bound else {})}


def _without_tags(loc: tuple[str | int, ...]) -> list[str | int]:
    kept: list[str | int] = []
    tag_next = False
    for part in loc:
        if not tag_next:
            kept.append(part)
            tag_next = part in _UNIONS or (isinstance(part, int) and kept[-2:-1] == ["obstacles"])
        else:
            tag_next = False
    return kept


def _short(parts: tuple[str | int, ...]) -> tuple[str | int, ...]:
    # A name of a megabyte is not sent back: the pointer ends at the object that holds it.
    for i, part in enumerate(parts):
        if isinstance(part, str) and len(part) > 100:
            return parts[:i]
    return parts


def _name(parts: tuple[str | int, ...]) -> str:
    """The field's name as a sentence says it: "vertices[2][0]"."""
    indices = ""
    for part in reversed(parts):
        if isinstance(part, str):
            return (part if part.strip() and part.isprintable() else ascii(part))[:60] + indices
        indices = f"[{part}]" + indices
    return f"The body{indices}"


def _shown(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return str(value) if isinstance(value, int) else f"{value:.12g}"
    if isinstance(value, str):
        return f'"{value[:40]}"' if value.isprintable() else ascii(value[:40])
    return "an array" if isinstance(value, list) else "an object"
