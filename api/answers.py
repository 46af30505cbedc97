"""What clients get: the schemas of the answers, for the OpenAPI document."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from api.drive_schemas import EXAMPLES
from api.fields import LARGEST_LENGTH, Coordinate, Number, WheelName, amount, quantity

__all__ = [
    "CertificateAnswer", "DriveAnswer", "DrivesAnswer", "ForwardAnswer", "HealthAnswer", "InverseAnswer",
    "LimitsAnswer", "MapAnswer", "MapsAnswer", "PlanAnswer", "Problem",
]  # fmt: skip


class WheelSeries(BaseModel):
    """The motion of one wheel, at the schedule's times."""

    angle: list[Number] = quantity("Angle turned since the start", "rad", example=[0.0, 0.0006])
    velocity: list[Number] = quantity(
        "Rate; positive drives the wheel along its own heading", "rad/s", example=[0.0, 0.06]
    )
    acceleration: list[Number] = quantity("Acceleration", "rad/s^2", example=[3.0, 3.0])


class SteeringSeries(BaseModel):
    """The motion of one steered wheel, at the schedule's times."""

    angle: list[Number] = quantity("Steering angle relative to the body", "rad", example=[0.0, 0.0001])
    rate: list[Number] = quantity("Steering rate", "rad/s", example=[0.0, 0.01])


class ScheduleAnswer(BaseModel):
    """What to send to the motors."""

    time: list[Number] = quantity(
        "0, period, 2 period, …, duration; the last step may be shorter", "s", example=[0.0, 0.02]
    )
    wheels: dict[str, WheelSeries] = quantity("By wheel")
    steering: dict[str, SteeringSeries] = quantity("By steered wheel; {} for a drive that does not steer")


class TrajectoryAnswer(BaseModel):
    """The motion of the body on the same time grid: pose in the world frame, twist in the body frame."""

    x: list[Number] = quantity("Position along x", "m", example=[0.0, 0.0001])
    y: list[Number] = quantity("Position along y", "m", example=[0.0, 0.0])
    theta: list[Number] = quantity("Heading, continuous from the start's", "rad", example=[0.0, 0.0])
    vx: list[Number] = quantity("Forward speed", "m/s", example=[0.0, 0.006])
    vy: list[Number] = quantity("Speed to the left", "m/s", example=[0.0, 0.0])
    omega: list[Number] = quantity("Yaw rate", "rad/s", example=[0.0, 0.0])


class CertificateAnswer(BaseModel):
    """What an independent check of this schedule found, worst case over the whole motion."""

    model_config = ConfigDict(extra="allow")

    closure_position: float = amount(
        "|pose reached by rolling the schedule forward - goal|", "m", example=1e-9
    )
    closure_heading: float = amount("The same for the heading", "rad", example=1e-10)
    wheel_speed_ratio: float = amount("Used / allowed", "1", example=0.98)
    wheel_acceleration_ratio: float = amount("Used / allowed", "1", example=0.98)
    wheel_jerk_ratio: float = amount("Used / allowed", "1", example=0.98)
    steering_angle_ratio: float = amount("Used / allowed", "1", example=0.98)
    steering_rate_ratio: float = amount("Used / allowed", "1", example=0.98)
    slip: float = amount(
        "Largest disagreement between the wheels and any one rigid motion", "m/s", example=0.0
    )
    clearance: Number = quantity(
        "Lower bound of the distance from footprint to obstacle, accurate to 0.1 mm near min_clearance",
        "m",
        example=0.25,
    )


class PlanAnswer(BaseModel):
    """A certified plan. It starts and ends at rest."""

    id: str = quantity("The plan's id", pattern="^[0-9a-f]{32}$", example="5a" * 16)
    duration: float = amount("Duration", "s", example=4.2)
    length: float = amount("Distance the body origin travels", "m", example=6.1)
    schedule: ScheduleAnswer = quantity("The wheel schedule")
    trajectory: TrajectoryAnswer = quantity("The motion it makes")
    certificate: CertificateAnswer = quantity("What the check of the schedule found")
    planning: dict[str, Any] = quantity(
        "How it was made: planner, state_space, seed, timings and more",
        example={"planner": "RRTConnect", "state_space": "SE2", "seed": 7, "timings": {"search": 0.02}},
    )


class InverseAnswer(BaseModel):
    """What the wheels do for a twist."""

    wheels: dict[str, Number] = quantity("Rate of each wheel", "rad/s", example={"left": 4.5, "right": 5.5})
    steering: dict[str, Number] = quantity("Angle of each steered wheel", "rad", example={})
    steering_rates: dict[str, Number] | None = quantity(
        "Rate of each steered wheel, where the twist decides it (powered_caster, synchro)",
        "rad/s", None, example={"front": 0.1, "rear": -0.1},
    )  # fmt: skip


class TwistAnswer(BaseModel):
    """A velocity of the body, in its own frame."""

    vx: Number = quantity("Forward speed", "m/s", example=0.5)
    vy: Number = quantity("Speed to the left", "m/s", example=0.0)
    omega: Number = quantity("Yaw rate", "rad/s", example=0.2)


class ForwardAnswer(BaseModel):
    """The least-squares twist of given wheel rates."""

    twist: TwistAnswer = quantity("The body's velocity")
    slip: float = amount("How far the wheels are from agreeing on it", "m/s", example=0.0)


class DriveAnswer(BaseModel):
    """One drive of the catalogue."""

    type: str = quantity("The drive's name in requests", example="differential")
    parameters: dict[str, Any] = quantity("JSON schema of the drive object", example={"type": "object"})
    example: dict[str, Any] = quantity("A drive object", example=EXAMPLES["differential"])
    wheels: list[WheelName] = quantity("Names of the example's wheels, in order", example=["left", "right"])
    steering: list[WheelName] = quantity("Names of the example's steered wheels, in order", example=[])


class DrivesAnswer(BaseModel):
    """The catalogue of drives."""

    drives: list[DriveAnswer] = quantity("Every drive")


class MapAnswer(BaseModel):
    """A stored map."""

    id: str = quantity("SHA-256 of the decoded content", pattern="^[0-9a-f]{64}$", example="0" * 64)
    width: int = amount("Columns", "cells", example=400)
    height: int = amount("Rows", "cells", example=300)
    resolution: float = quantity("Edge of a cell", "m", example=0.05, gt=0, le=LARGEST_LENGTH)
    origin: list[Coordinate] = quantity(
        "Pose [x, y, theta] of the lower left corner", "m and rad",
        example=[-10.0, -7.5, 0.0], min_length=3, max_length=3,
    )  # fmt: skip
    occupied: int = amount("Occupied cells", "cells", example=5000)
    unknown: int = amount("Unknown cells", "cells", example=15000)
    free: int = amount("Free cells", "cells", example=100000)


class MapsAnswer(BaseModel):
    """The stored maps."""

    maps: list[MapAnswer] = quantity("By id")


class HealthAnswer(BaseModel):
    """How the service is."""

    status: Literal["ok", "ready"] = quantity("How it is", example="ready")
    workers: int | None = quantity("Workers that are up", "workers", None, example=4, ge=0, le=2**31)


class LimitsAnswer(BaseModel):
    """The bounds that this server sets."""

    max_time_budget: float = amount("Largest time_budget", "s", example=30.0)
    deadline_grace: float = amount("A worker is stopped time_budget + this after it began", "s", example=5.0)
    max_body_bytes: int = amount("Largest JSON body", "bytes", example=1048576)
    max_map_bytes: int = amount("Largest map upload", "bytes", example=33554432)
    max_map_cells: int = amount("Largest map", "cells", example=16777216)
    max_maps: int = amount("Maps in store", "maps", example=1000)
    max_store_bytes: int = amount("What they may take on disk", "bytes", example=10737418240)
    max_obstacles: int = amount("Obstacles in a request", "obstacles", example=10000)
    max_vertices: int = amount("Vertices of a polygon", "vertices", example=500)
    max_wheels: int = amount("Wheels of a drive", "wheels", example=32)
    max_coordinate: float = amount("Largest |coordinate|", "m", example=1e6)
    max_length: float = amount("Largest length of a robot or obstacle", "m", example=1e3)
    min_length: float = amount("Smallest length of a robot or obstacle", "m", example=1e-6)
    min_rate: float = amount(
        "Smallest limit on a speed, acceleration or jerk", "rad/s, m/s and their derivatives", example=1e-6
    )
    max_rate: float = amount(
        "Largest limit on a speed, acceleration or jerk", "rad/s, m/s and their derivatives", example=1e6
    )
    sample_period: list[Number] = quantity(
        "Smallest and largest sample_period", "s", example=[0.001, 0.1], min_length=2, max_length=2
    )
    max_samples: int = amount("Samples of a plan", "samples", example=200000)
    workers: int = amount("Plans made at once", "plans", example=4)
    queue_length: int = amount("Plans that may wait", "plans", example=256)
    queue_wait: float = amount("Expected wait beyond which plans are refused", "s", example=1.0)
    queue_timeout: float = amount("How long a plan may wait", "s", example=10.0)
    receive_timeout: float = amount(
        "How long a request may take to arrive; large bodies longer", "s", example=8.0
    )
    max_batches: int = amount("Batches that may run at once", "batches", example=8)
    max_batch_requests: int = amount("Plan requests in a batch", "requests", example=1000)
    max_batch_bytes: int = amount("Largest body of a batch", "bytes", example=8388608)
    batch_keep: float = amount("How long the results of a batch are kept", "s", example=86400.0)
    max_connections: int = amount("Connections at once", "connections", example=1000)
    max_upload_bytes: int = amount("Map uploads at once, all together", "bytes", example=134217728)
    max_pending_bytes: int = amount("Request bodies at once, all together", "bytes", example=268435456)
    batch_store_bytes: int = amount("Results kept at most; the oldest go first", "bytes", example=1073741824)


class Problem(BaseModel):
    """RFC 9457: why a request was refused. Further members depend on the code: errors, pose, proof …"""

    model_config = ConfigDict(extra="allow")

    type: str = quantity("URN of the code", "", example="urn:wheelplan:problem:invalid-request")
    title: str = quantity(
        "The code in words", example="A field is missing, of the wrong type or out of range"
    )
    status: int = quantity("HTTP status", "1", example=422, ge=400, le=599)
    detail: str = quantity("What went wrong this time", example="wheel_radius is -0.1; it must be >= 1e-06.")
    code: str = quantity("Stable name of the kind of problem", "", example="invalid-request")
