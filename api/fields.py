"""What the schemas are made of: strict models, and numbers with a unit, bounds and an example."""

from __future__ import annotations

import math
import sys
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

__all__ = [
    "LARGEST_COORDINATE", "LARGEST_LENGTH", "LARGEST_RATE", "SMALLEST_LENGTH", "SMALLEST_RATE", "Angle",
    "Coordinate", "Number", "Strict", "WheelName", "amount", "angle", "coordinate", "extent", "quantity",
    "rate",
]  # fmt: skip

LARGEST_COORDINATE = 1e6
LARGEST_LENGTH = 1e3
LARGEST_RATE = 1e6
SMALLEST_LENGTH = 1e-6
SMALLEST_RATE = 1e-6
_LARGEST_NUMBER = sys.float_info.max


class Strict(BaseModel):
    """Refuses fields that it does not know, and strings or booleans in a number's place."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def quantity(
    description: str, unit: str = "", default: Any = ..., *, example: Any = None, **bounds: Any
) -> Any:
    """A field that documents itself: description, unit ("1": none), bounds (gt, ge, lt, le …), example."""
    text = f"{description}, {unit}." if unit not in ("", "1") else f"{description}."
    extra: Any = {"x-unit": unit} if unit else None
    examples = [example] if example is not None else None
    return Field(default, description=text, examples=examples, json_schema_extra=extra, **bounds)


def extent(description: str, default: Any = ..., *, example: float | None = None, **bounds: Any) -> Any:
    """A positive length, unless bounds say otherwise."""
    return quantity(
        description, "m", default, example=example, **{"ge": SMALLEST_LENGTH, "le": LARGEST_LENGTH} | bounds
    )


def rate(description: str, unit: str, default: Any = ..., *, example: float | None = None) -> Any:
    """A positive limit on a speed, an acceleration or a jerk."""
    return quantity(description, unit, default, example=example, ge=SMALLEST_RATE, le=LARGEST_RATE)


def coordinate(description: str, default: Any = ..., *, example: float | None = None) -> Any:
    return quantity(description, "m", default, example=example, ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE)


def angle(description: str, default: Any = ..., *, example: float | None = None) -> Any:
    """Any finite number of radians; its type is Angle."""
    return quantity(description, "rad", default, example=example)


def amount(description: str, unit: str, *, example: float) -> Any:
    """A number of an answer that is never negative."""
    largest = 2**63 - 1 if isinstance(example, int) else _LARGEST_NUMBER
    return quantity(description, unit, example=example, ge=0, le=largest)


def _reduced(value: float) -> float:
    # Beyond this a double no longer resolves the small turns that a plan adds to it. Not math.remainder: its
    # 2π is the nearest double's, and a large angle holds many of them.
    return value if abs(value) <= 1e6 else math.atan2(math.sin(value), math.cos(value))


Number = Annotated[float, Field(ge=-_LARGEST_NUMBER, le=_LARGEST_NUMBER)]
Angle = Annotated[Number, AfterValidator(_reduced)]
Coordinate = Annotated[float, Field(ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE)]
WheelName = Annotated[
    str,
    Field(
        pattern=r"^[A-Za-z0-9_][A-Za-z0-9_ .\-]{0,63}$",
        description="1 to 64 letters, digits, underscores, dots, hyphens or spaces.",
        examples=["front_left"],
    ),
]
