"""From a request to the planner's Problem, with the checks that one field alone cannot decide."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from api.drive_schemas import build_drive
from api.errors import FieldErrors
from api.schemas import (
    CircleFootprint,
    CircleObstacle,
    EnvironmentSchema,
    LimitsSchema,
    OptionsSchema,
    PlanRequest,
    PolygonFootprint,
    PolygonObstacle,
    RectangleFootprint,
)
from api.validation import pointer
from drives.drive import Car, Drive, Limits
from drives.se2 import Array, Pose
from planner.environment import check_simple_polygon
from planner.problem import (
    MAX_SAMPLES,
    Bounds,
    Circle,
    Environment,
    Footprint,
    Goal,
    MapLayer,
    Options,
    Polygon,
    Problem,
    Robot,
)

__all__ = ["FindMap", "by_name", "to_problem"]

FindMap = Callable[[str], MapLayer]


def to_problem(
    request: PlanRequest, find_map: FindMap, max_time_budget: float, max_samples: int = MAX_SAMPLES
) -> Problem:
    """The problem that a request states. find_map(id) gives the stored map, or raises.

    Raises FieldErrors: invalid-geometry for degenerate shapes first, then invalid-request for fields that
    contradict each other.
    """
    drive = build_drive(request.robot.drive, ("robot", "drive"), request.start.theta)
    footprint = _footprint(request)
    obstacles = tuple(_obstacle(shape, i) for i, shape in enumerate(request.environment.obstacles))

    errors = Errors()
    limits = _limits(request.robot.limits, drive, errors)
    steering = _steering(request, drive, limits, errors)
    bounds = _bounds(request.environment, errors)
    options = replace(_options(request.options, max_time_budget, errors), max_samples=max_samples)
    errors.check()

    reference = request.environment.map
    layer = None
    if reference is not None:
        found = find_map(reference.id)
        layer = MapLayer(found.id, found.directory, found.resolution, found.origin, reference.unknown)
    return Problem(
        robot=Robot(drive, footprint, limits),
        start=Pose(request.start.x, request.start.y, request.start.theta),
        goal=Goal(request.goal.x, request.goal.y, request.goal.theta),
        environment=Environment(bounds, obstacles, layer),
        options=options,
        steering=steering,
    )


class Errors(list[dict[str, Any]]):
    """Fields at fault, gathered so that a client hears of all of them at once."""

    def add(self, at: tuple[str | int, ...], detail: str, **more: Any) -> None:
        self.append({"pointer": pointer(*at), "detail": detail, **more})

    def check(self) -> None:
        """Raises FieldErrors where there are any."""
        if self:
            raise FieldErrors(self)


def by_name(
    given: Mapping[str, float], names: tuple[str, ...], at: tuple[str | int, ...], what: str, errors: Errors
) -> Array:
    """The values in the order of the names. A name too many or too few is an error."""
    for name in given:
        if name not in names:
            errors.add(
                (*at, name), f"{name} is no {what} of this drive; it has {', '.join(names) or 'none'}."
            )
    for name in names:
        if name not in given:
            errors.add((*at, name), f"{name} is missing: {at[-1]} must name every {what} of the drive.")
    return np.array([given.get(name, 0.0) for name in names], dtype=float)


def _footprint(request: PlanRequest) -> Footprint:
    shape = request.robot.footprint
    if isinstance(shape, CircleFootprint):
        return Footprint(np.zeros((1, 2)), shape.radius)
    if isinstance(shape, RectangleFootprint):
        half, side, ahead = shape.length / 2, shape.width / 2, shape.offset
        corners = [(ahead - half, -side), (ahead + half, -side), (ahead + half, side), (ahead - half, side)]
        return Footprint(np.array(corners))
    assert isinstance(shape, PolygonFootprint)
    vertices = _simple(shape.vertices, ("robot", "footprint", "vertices"))
    x, y = vertices.T
    area = np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))
    return Footprint(vertices if area > 0 else vertices[::-1].copy())


def _obstacle(shape: PolygonObstacle | CircleObstacle, index: int) -> Polygon | Circle:
    if isinstance(shape, CircleObstacle):
        return Circle(shape.center[0], shape.center[1], shape.radius)
    return Polygon(_simple(shape.vertices, ("environment", "obstacles", index, "vertices")))


def _simple(points: list[list[float]], at: tuple[str | int, ...]) -> Array:
    vertices = np.array(points, dtype=float)
    if fault := check_simple_polygon(vertices):
        raise FieldErrors([{"pointer": pointer(*at), "detail": fault}], "invalid-geometry")
    return vertices


def _limits(limits: LimitsSchema, drive: Drive, errors: Errors) -> Limits:
    at = ("robot", "limits")

    def per_wheel(name: str) -> Array:
        value = getattr(limits, name)
        if isinstance(value, dict):
            return by_name(value, drive.wheel_names, (*at, name), "wheel", errors)
        return np.full(len(drive.wheel_names), np.inf if value is None else value)

    if drive.steered_names and limits.steering_rate is None:
        errors.add((*at, "steering_rate"), "steering_rate is missing: this drive steers.")
    scalars = {
        name: float(value)
        for name in (
            "steering_angle", "steering_rate", "linear_speed", "angular_speed", "linear_acceleration",
            "lateral_acceleration",
        )
        if (value := getattr(limits, name)) is not None
    }  # fmt: skip
    made = Limits(
        per_wheel("wheel_speed"), per_wheel("wheel_acceleration"), per_wheel("wheel_jerk"), **scalars
    )
    if isinstance(drive.mobility(made), Car) and limits.steering_angle is None:
        errors.add((*at, "steering_angle"), "steering_angle is missing: this drive is car-like.")
    return made


def _steering(request: PlanRequest, drive: Drive, limits: Limits, errors: Errors) -> Array | None:
    given, at = request.start.steering, ("start", "steering")
    if given is None:
        return None
    angles = by_name(given, drive.steered_names, at, "steered wheel", errors)
    if drive.fixed_body_heading is not None:
        turned = request.start.theta - drive.fixed_body_heading
        for name, value in zip(drive.steered_names, angles, strict=True):
            if name in given and abs(math.remainder(value - turned, 2 * math.pi)) > 1e-6:
                detail = f"{name} is {value:g}; it must be theta - body_heading = {turned:g} (mod 2π)."
                errors.add((*at, name), detail, value=value)
    for name, value in zip(drive.steered_names, angles, strict=True):
        if abs(value) > limits.steering_angle:
            detail = f"{name} is {value:g}; steering_angle allows |angle| <= {limits.steering_angle:g}."
            errors.add((*at, name), detail, value=value, bound=f"<= {limits.steering_angle:g}")
    return angles if len(angles) else None


def _bounds(environment: EnvironmentSchema, errors: Errors) -> Bounds | None:
    box, at = environment.bounds, ("environment", "bounds")
    if box is None:
        if environment.map is None:
            errors.add(at, "bounds is missing: it is required where there is no map.")
        return None
    for low, high in (("x_min", "x_max"), ("y_min", "y_max")):
        least, most = getattr(box, low), getattr(box, high)
        if not least < most:
            detail = f"{high} is {most:g}; it must be > {low}, which is {least:g}."
            errors.add((*at, high), detail, value=most, bound=f"> {least:g}")
    return Bounds(box.x_min, box.y_min, box.x_max, box.y_max)


def _options(options: OptionsSchema, max_time_budget: float, errors: Errors) -> Options:
    time_budget = options.time_budget
    if "time_budget" not in options.model_fields_set:
        time_budget = min(time_budget, max_time_budget)
    if time_budget > max_time_budget:
        detail = f"time_budget is {time_budget:g}; it must be <= {max_time_budget:g}."
        bound = f"<= {max_time_budget:g}"
        errors.add(("options", "time_budget"), detail, value=time_budget, bound=bound)
    own = {"time_budget": time_budget, "turning_radius": options.turning_radius or 0.0}
    return Options(**dict(options) | own)
