"""What clients send: the schemas of the requests, with units and bounds."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Discriminator, Field, JsonValue, Tag

from api.drive_schemas import EXAMPLES, DriveSchema
from api.fields import (
    LARGEST_LENGTH,
    LARGEST_RATE,
    SMALLEST_RATE,
    Angle,
    Coordinate,
    Strict,
    WheelName,
    angle,
    coordinate,
    extent,
    quantity,
    rate,
)

__all__ = [
    "BoundsSchema", "CircleFootprint", "CircleObstacle", "EnvironmentSchema", "ForwardRequest", "GoalSchema",
    "InverseRequest", "LimitsSchema", "MapReference", "OptionsSchema", "PlanRequest", "PolygonFootprint",
    "PolygonObstacle", "PoseSchema", "RectangleFootprint", "RobotSchema", "StartSchema", "TwistSchema",
]  # fmt: skip

MAX_VERTICES = 500
MAX_OBSTACLES = 10_000
MAX_WHEELS = 32
SAMPLE_PERIODS = (0.001, 0.1)

Vertices = Annotated[
    list[Annotated[list[Coordinate], Field(min_length=2, max_length=2)]],
    Field(min_length=3, max_length=MAX_VERTICES),
]


class PolygonFootprint(Strict):
    """A simple polygon in the body frame, either winding; it need not be convex."""

    type: Literal["polygon"] = quantity("Kind of footprint")
    vertices: Vertices = quantity(
        "Corners [x, y] in order, body frame",
        "m",
        example=[[0.5, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.5, -0.3]],
    )


class RectangleFootprint(Strict):
    """A rectangle along the body's axes."""

    type: Literal["rectangle"] = quantity("Kind of footprint")
    length: float = extent("Extent along the body's x axis", example=0.8)
    width: float = extent("Extent along the body's y axis", example=0.6)
    offset: float = extent(
        "How far ahead of the body origin its centre lies", 0.0, ge=-LARGEST_LENGTH, example=0.1
    )


class CircleFootprint(Strict):
    """A disc about the body origin."""

    type: Literal["circle"] = quantity("Kind of footprint")
    radius: float = extent("Radius", example=0.3)


def _per_wheel_kind(value: Any) -> str | None:
    if isinstance(value, dict):
        return "by wheel"
    return "every wheel" if not isinstance(value, str | list | None) else None


_Rate = Annotated[float, Field(ge=SMALLEST_RATE, le=LARGEST_RATE)]
PerWheel = Annotated[
    Annotated[_Rate, Tag("every wheel")] | Annotated[dict[WheelName, _Rate], Tag("by wheel")],
    Discriminator(_per_wheel_kind),
]


class LimitsSchema(Strict):
    """What the actuators and the body may do. Per wheel: one number for all, or an object by wheel."""

    wheel_speed: PerWheel = quantity("Largest rate of each wheel", "rad/s", example=15.0)
    wheel_acceleration: PerWheel = quantity("Largest acceleration of each wheel", "rad/s^2", example=20.0)
    wheel_jerk: PerWheel | None = quantity(
        "Largest jerk of each wheel; absent: unlimited", "rad/s^3", None, example=200.0
    )
    steering_angle: float | None = quantity(
        "Largest |angle| of any steered wheel; required where the drive is car-like",
        "rad", None, example=1.1, ge=1e-6, le=100.0,
    )  # fmt: skip
    steering_rate: float | None = rate(
        "Largest rate of any steered wheel; required where the drive steers", "rad/s", None, example=2.0
    )
    linear_speed: float | None = rate("Largest speed of the body origin", "m/s", None, example=1.0)
    angular_speed: float | None = rate("Largest yaw rate", "rad/s", None, example=1.5)
    linear_acceleration: float | None = rate(
        "Largest rate of change of the speed of the body origin", "m/s^2", None, example=0.8
    )
    lateral_acceleration: float | None = rate(
        "Largest |speed × turn rate of the direction of travel|", "m/s^2", None, example=0.5
    )


class RobotSchema(Strict):
    """The robot: its drive, its outline and its limits."""

    drive: DriveSchema = quantity("The wheels, by type")
    footprint: PolygonFootprint | RectangleFootprint | CircleFootprint = quantity(
        "The outline, in the body frame", discriminator="type"
    )
    limits: LimitsSchema = quantity("What actuators and body may do")


class PoseSchema(Strict):
    """A pose in the world frame."""

    x: float = coordinate("Position along x", example=1.0)
    y: float = coordinate("Position along y", example=2.0)
    theta: Angle = angle("Heading, counter-clockwise from +x", example=0.5)


class StartSchema(PoseSchema):
    """Where the motion begins, at rest."""

    steering: dict[WheelName, Angle] | None = quantity(
        "Where each steered wheel stands. Absent: as the first motion needs (powered_caster: 0)",
        "rad", None, example={}, max_length=MAX_WHEELS,
    )  # fmt: skip


class GoalSchema(Strict):
    """Where the motion ends, at rest."""

    x: float = coordinate("Position along x", example=3.0)
    y: float = coordinate("Position along y", example=0.0)
    theta: Angle | None = angle("Heading, counter-clockwise from +x; null: any heading", example=0.0)


class BoundsSchema(Strict):
    """A box in the world frame that the footprint stays inside."""

    x_min: float = coordinate("Left edge", example=-5.0)
    y_min: float = coordinate("Lower edge", example=-5.0)
    x_max: float = coordinate("Right edge, above x_min", example=5.0)
    y_max: float = coordinate("Upper edge, above y_min", example=5.0)


class PolygonObstacle(Strict):
    """A solid simple polygon in the world frame, either winding."""

    type: Literal["polygon"] = quantity("Kind of obstacle")
    vertices: Vertices = quantity(
        "Corners [x, y] in order, world frame",
        "m",
        example=[[-0.1, 1.0], [0.1, 1.0], [0.1, 5.0], [-0.1, 5.0]],
    )


class CircleObstacle(Strict):
    """A solid disc in the world frame."""

    type: Literal["circle"] = quantity("Kind of obstacle")
    center: list[Coordinate] = quantity("Centre [x, y]", "m", example=[1.0, -3.0], min_length=2, max_length=2)
    radius: float = extent("Radius", example=0.4)


class MapReference(Strict):
    """An uploaded map."""

    id: str = quantity("The map's id, 64 hexadecimal digits", example="0" * 64, max_length=256)
    unknown: Literal["occupied", "free"] = quantity(
        "What unknown cells count as", "", "occupied", example="occupied"
    )


class EnvironmentSchema(Strict):
    """Where the robot may be. With bounds and a map, the footprint stays inside both."""

    bounds: BoundsSchema | None = quantity("Required where there is no map", "", None)
    obstacles: list[Annotated[PolygonObstacle | CircleObstacle, Field(discriminator="type")]] = quantity(
        "Solid obstacles", "", (), max_length=MAX_OBSTACLES
    )
    map: MapReference | None = quantity("An uploaded map", "", None)


class OptionsSchema(Strict):
    """How hard to try, and what the answer looks like."""

    time_budget: float = quantity(
        "Planning time the client grants, queueing excluded", "s", 1.0, gt=0, example=1.0
    )
    effort: Literal["first", "good", "best"] = quantity(
        'When to stop improving: "first", at the first certified plan; "good", when it no longer pays; '
        '"best", when time_budget ends', "", "good", example="good",
    )  # fmt: skip
    seed: int = quantity(
        'Same request and seed, same plan (effort "best" excepted)', "1", 0, ge=0, lt=2**31, example=7
    )
    sample_period: float = quantity(
        "Spacing of the schedule's samples",
        "s",
        0.02,
        ge=SAMPLE_PERIODS[0],
        le=SAMPLE_PERIODS[1],
        example=0.02,
    )
    min_clearance: float = extent(
        "The footprint keeps at least this far from obstacles", 0.0, example=0.05, ge=0
    )
    reverse: bool = quantity("Whether the robot may drive backwards", "", True, example=True)
    turning_radius: float | None = extent(
        "Floor on the turning radius of a nonholonomic drive", None, example=1.0, ge=0
    )


_EXAMPLES: list[JsonValue] = [
    {
        "robot": {
            "drive": {"type": "differential", "wheel_radius": 0.1, "track_width": 0.5},
            "footprint": {"type": "rectangle", "length": 0.8, "width": 0.6},
            "limits": {"wheel_speed": 15.0, "wheel_acceleration": 15.0},
        },
        "start": {"x": -3.0, "y": 0.0, "theta": 0.0},
        "goal": {"x": 3.0, "y": 0.0, "theta": 0.0},
        "environment": {
            "bounds": {"x_min": -5.0, "y_min": -5.0, "x_max": 5.0, "y_max": 5.0},
            "obstacles": [{"type": "circle", "center": [0.0, 0.5], "radius": 0.6}],
        },
        "options": {"time_budget": 2.0, "seed": 7},
    },
    {
        "robot": {
            "drive": {"type": "tricycle", "wheel_radius": 0.15, "wheelbase": 1.2, "track_width": 0.8},
            "footprint": {"type": "rectangle", "length": 1.8, "width": 1.0, "offset": 0.5},
            "limits": {
                "wheel_speed": {"front": 12.0, "rear_left": 10.0, "rear_right": 10.0},
                "wheel_acceleration": 8.0,
                "steering_angle": 1.2,
                "steering_rate": 1.0,
            },
        },
        "start": {"x": 0.0, "y": 0.0, "theta": 0.0, "steering": {"front": -0.9}},
        "goal": {"x": 5.0, "y": 2.0, "theta": 1.0},
        "environment": {"bounds": {"x_min": -10.0, "y_min": -10.0, "x_max": 10.0, "y_max": 10.0}},
    },
]


class PlanRequest(Strict):
    """A motion to plan: who moves, from where to where, among what."""

    model_config = ConfigDict(json_schema_extra={"examples": _EXAMPLES})

    robot: RobotSchema = quantity("Who moves")
    start: StartSchema = quantity("From where")
    goal: GoalSchema = quantity("To where. Equal to the start: a single sample of duration 0")
    environment: EnvironmentSchema = quantity("Among what")
    options: OptionsSchema = quantity("How", "", OptionsSchema())


class TwistSchema(Strict):
    """A velocity of the body, in its own frame."""

    vx: float = quantity("Forward speed", "m/s", ge=-LARGEST_RATE, le=LARGEST_RATE, example=0.5)
    vy: float = quantity("Speed to the left", "m/s", ge=-LARGEST_RATE, le=LARGEST_RATE, example=0.0)
    omega: float = quantity("Yaw rate", "rad/s", ge=-LARGEST_RATE, le=LARGEST_RATE, example=0.2)


_Rates = dict[WheelName, Annotated[float, Field(ge=-LARGEST_RATE, le=LARGEST_RATE)]]


class InverseRequest(Strict):
    """A twist, asked for as wheel rates."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"drive": EXAMPLES["differential"], "twist": {"vx": 0.5, "vy": 0.0, "omega": 0.2}}]
        }
    )

    drive: DriveSchema = quantity("The wheels, by type")
    twist: TwistSchema = quantity("The body's velocity")
    steering: dict[WheelName, Angle] | None = quantity(
        "Present angle of each steered wheel; a powered_caster needs it",
        "rad", None, example={"front": 0.3, "rear": 0.3}, max_length=MAX_WHEELS,
    )  # fmt: skip


class ForwardRequest(Strict):
    """Wheel rates, asked for as a twist."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"drive": EXAMPLES["differential"], "wheels": {"left": 4.5, "right": 5.5}, "steering": {}}
            ]
        }
    )

    drive: DriveSchema = quantity("The wheels, by type")
    wheels: _Rates = quantity(
        "Rate of each wheel", "rad/s", example={"left": 4.5, "right": 5.5}, max_length=MAX_WHEELS
    )
    steering: dict[WheelName, Angle] = quantity(
        "Angle of each steered wheel", "rad", {}, example={}, max_length=MAX_WHEELS
    )
    steering_rates: _Rates | None = quantity(
        "Rate of each steered wheel; 0 where absent. It matters to powered_caster and synchro",
        "rad/s", None, example={"front": 0.0}, max_length=MAX_WHEELS,
    )  # fmt: skip
