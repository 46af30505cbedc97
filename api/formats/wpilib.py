"""A trajectory as WPILib's TrajectoryUtil reads it: a JSON array of states.

A state is a point on a path with the speed along it, so a heading that is not the direction of travel and a
turn on the spot have no place in it; two states at one place make WPILib's interpolation divide by zero.
"""

from __future__ import annotations

import numpy as np

from api.errors import Refusal
from api.formats.format import PlanDocument, held_rate, world_velocity
from api.strict_json import write_json
from drives.drive import Holonomic
from drives.se2 import Array
from planner.problem import Problem

__all__ = ["write_wpilib"]

_STILL = 1e-9


def write_wpilib(plan: PlanDocument, problem: Problem) -> bytes:
    """States of time, velocity, acceleration, pose and curvature.

    Of a drive that goes where it points, the pose is the body's, and a velocity below 0 is backwards. Of a
    holonomic one the pose points in the direction of travel, as HolonomicDriveController wants it, and the
    body's own heading is a member `heading`, which WPILib skips. Raises Refusal: not-acceptable where the
    robot stands still on the way.
    """
    time = np.asarray(plan["schedule"]["time"], float)
    body = {name: np.asarray(values, float) for name, values in plan["trajectory"].items()}
    moved = np.hypot(np.diff(body["x"]), np.diff(body["y"]))
    if (at := np.flatnonzero(moved < _STILL)).size:
        raise Refusal(
            "not-acceptable",
            f"The robot moves only its heading or its steering {time[at[0]]:.2f} s after the start, which a "
            "WPILib trajectory cannot tell; csv and ros-trajectory can.",
        )
    if isinstance(problem.robot.drive.mobility(problem.robot.limits), Holonomic):
        velocity = world_velocity(plan)
        speed = np.hypot(*velocity.T)
        direction = _travel(velocity, np.column_stack([body["x"], body["y"]]))
        turned = np.append(np.diff(direction), 0.0)
        curvature = turned / np.append(moved, 1.0)
    else:
        speed, direction = body["vx"], body["theta"]
        slow = np.abs(speed) < 1e-6
        curvature = np.where(slow, 0.0, body["omega"] / np.where(slow, 1.0, speed))
    states = [
        {
            "time": t,
            "velocity": v,
            "acceleration": a,
            "pose": {"translation": {"x": x, "y": y}, "rotation": {"radians": d}},
            "curvature": k,
            "heading": theta,
        }
        for t, v, a, x, y, d, k, theta in zip(
            time, speed, held_rate(time, speed), body["x"], body["y"], direction, curvature, body["theta"],
            strict=True,
        )
    ]  # fmt: skip
    return write_json(states)


def _travel(velocity: Array, place: Array) -> Array:
    """The direction (n,) of travel, rad, continuous. At rest: to the next place, or from the last."""
    if len(place) == 1:
        return np.zeros(1)
    chord = np.diff(place, axis=0)
    along = np.where(np.hypot(*velocity.T)[:, None] > 1e-6, velocity, np.append(chord, chord[-1:], axis=0))
    return np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
