"""What clients get: the schemas of the answers, for the OpenAPI document."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict

from api.fields import quantity

__all__ = [
    "CertificateAnswer", "DriveAnswer", "DrivesAnswer", "ForwardAnswer", "HealthAnswer", "InverseAnswer",
    "LimitsAnswer", "MapAnswer", "MapsAnswer", "PlanAnswer", "Problem",
]  # fmt: skip


class WheelSeries(BaseModel):
    """The motion of one wheel, at the schedule's times."""

    angle: list[float] = quantity("Angle turned since the start", "rad")
    velocity: list[float] = quantity("Rate; positive drives the wheel along its own heading", "rad/s")
    acceleration: list[float] = quantity("Acceleration", "rad/s^2")


class SteeringSeries(BaseModel):
    """The motion of one steered wheel, at the schedule's times."""

    angle: list[float] = quantity("Steering angle relative to the body", "rad")
    rate: list[float] = quantity("Steering rate", "rad/s")


class ScheduleAnswer(BaseModel):
    """What to send to the motors."""

    time: list[float] = quantity("0, period, 2 period, …, duration; the last step may be shorter", "s")
    wheels: dict[str, WheelSeries] = quantity("By wheel")
    steering: dict[str, SteeringSeries] = quantity("By steered wheel; {} for a drive that does not steer")


class TrajectoryAnswer(BaseModel):
    """The motion of the body on the same time grid: pose in the world frame, twist in the body frame."""

    x: list[float] = quantity("Position along x", "m")
    y: list[float] = quantity("Position along y", "m")
    theta: list[float] = quantity("Heading, continuous from the start's", "rad")
    vx: list[float] = quantity("Forward speed", "m/s")
    vy: list[float] = quantity("Speed to the left", "m/s")
    omega: list[float] = quantity("Yaw rate", "rad/s")


class CertificateAnswer(BaseModel):
    """What an independent check of this schedule found, worst case over the whole motion."""

    model_config = ConfigDict(extra="allow")

    closure_position: float = quantity("|pose reached by rolling the schedule forward - goal|", "m")
    closure_heading: float = quantity("The same for the heading", "rad")
    wheel_speed_ratio: float = quantity("Used / allowed")
    wheel_acceleration_ratio: float = quantity("Used / allowed")
    wheel_jerk_ratio: float = quantity("Used / allowed")
    steering_angle_ratio: float = quantity("Used / allowed")
    steering_rate_ratio: float = quantity("Used / allowed")
    slip: float = quantity("Largest disagreement between the wheels and any one rigid motion", "m/s")
    clearance: float = quantity("Smallest distance from footprint to obstacle", "m")


class PlanAnswer(BaseModel):
    """A certified plan. It starts and ends at rest."""

    id: str = quantity("The plan's id")
    duration: float = quantity("Duration", "s")
    length: float = quantity("Distance the body origin travels", "m")
    schedule: ScheduleAnswer = quantity("The wheel schedule")
    trajectory: TrajectoryAnswer = quantity("The motion it makes")
    certificate: CertificateAnswer = quantity("What the check of the schedule found")
    planning: dict[str, Any] = quantity("How it was made: planner, state_space, seed, timings and more")


class InverseAnswer(BaseModel):
    """What the wheels do for a twist."""

    wheels: dict[str, float] = quantity("Rate of each wheel", "rad/s")
    steering: dict[str, float] = quantity("Angle of each steered wheel", "rad")
    steering_rates: dict[str, float] | None = quantity(
        "Rate of each steered wheel, where the twist decides it (powered_caster, synchro)", "rad/s", None
    )


class TwistAnswer(BaseModel):
    """A velocity of the body, in its own frame."""

    vx: float = quantity("Forward speed", "m/s")
    vy: float = quantity("Speed to the left", "m/s")
    omega: float = quantity("Yaw rate", "rad/s")


class ForwardAnswer(BaseModel):
    """The least-squares twist of given wheel rates."""

    twist: TwistAnswer = quantity("The body's velocity")
    slip: float = quantity("How far the wheels are from agreeing on it", "m/s")


class DriveAnswer(BaseModel):
    """One drive of the catalogue."""

    type: str = quantity("The drive's name in requests")
    parameters: dict[str, Any] = quantity("JSON schema of the drive object")
    example: dict[str, Any] = quantity("A drive object")
    wheels: list[str] = quantity("Names of the example's wheels, in order")
    steering: list[str] = quantity("Names of the example's steered wheels, in order")


class DrivesAnswer(BaseModel):
    """The catalogue of drives."""

    drives: list[DriveAnswer] = quantity("Every drive")


class MapAnswer(BaseModel):
    """A stored map."""

    id: str = quantity("SHA-256 of the decoded content")
    width: int = quantity("Columns")
    height: int = quantity("Rows")
    resolution: float = quantity("Edge of a cell", "m")
    origin: list[float] = quantity("Pose [x, y, theta] of the lower left corner, m and rad")
    occupied: int = quantity("Occupied cells")
    unknown: int = quantity("Unknown cells")
    free: int = quantity("Free cells")


class MapsAnswer(BaseModel):
    """The stored maps."""

    maps: list[MapAnswer] = quantity("By id")


class HealthAnswer(BaseModel):
    """How the service is."""

    status: str = quantity("ok or ready")
    workers: int | None = quantity("Workers that are up", "", None)


class LimitsAnswer(BaseModel):
    """The bounds that this server sets."""

    max_time_budget: float = quantity("Largest time_budget", "s")
    deadline_grace: float = quantity("A worker is stopped time_budget + this after it began", "s")
    max_body_bytes: int = quantity("Largest JSON body, bytes")
    max_map_bytes: int = quantity("Largest map upload, bytes")
    max_map_cells: int = quantity("Largest map, cells")
    max_maps: int = quantity("Maps in store")
    max_obstacles: int = quantity("Obstacles in a request")
    max_vertices: int = quantity("Vertices of a polygon")
    max_wheels: int = quantity("Wheels of a drive")
    max_coordinate: float = quantity("Largest |coordinate|", "m")
    max_length: float = quantity("Largest length of a robot or obstacle", "m")
    max_rate: float = quantity("Largest limit on a speed, acceleration or jerk")
    sample_period: list[float] = quantity("Smallest and largest sample_period", "s")
    workers: int = quantity("Plans made at once")
    queue_length: int = quantity("Plans that may wait")
    queue_timeout: float = quantity("How long a plan may wait", "s")
    receive_timeout: float = quantity("How long a request may take to arrive; large bodies longer", "s")
    max_batches: int = quantity("Batches that may run at once")
    max_batch_requests: int = quantity("Plan requests in a batch")
    max_batch_bytes: int = quantity("Largest body of a batch, bytes")
    batch_keep: float = quantity("How long the results of a batch are kept", "s")
    batch_store_bytes: int = quantity("Results kept at most, bytes; the oldest go first")


class Problem(BaseModel):
    """RFC 9457: why a request was refused. Further members depend on the code: errors, pose, proof …"""

    model_config = ConfigDict(extra="allow")

    type: str = quantity("URN of the code", "", example="urn:wheelplan:problem:invalid-request")
    title: str = quantity("The code in words")
    status: int = quantity("HTTP status")
    detail: str = quantity("What went wrong this time")
    code: str = quantity("Stable name of the kind of problem", "", example="invalid-request")
