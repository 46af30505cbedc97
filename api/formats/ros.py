"""The JSON form of two ROS 2 messages, as rosbridge and `ros2 topic pub` take them.

nav_msgs/Trajectory (common_interfaces, since Lyrical) and trajectory_msgs/JointTrajectory. A plan does not
know when it will be driven: stamps are seconds since its start.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from api.formats.format import PlanDocument, held_rate
from api.strict_json import write_json
from planner.problem import Problem

__all__ = ["write_joint_trajectory", "write_trajectory"]

_FRAME = "map"


def write_trajectory(plan: PlanDocument, _: Problem) -> bytes:
    """nav_msgs/Trajectory: poses in the frame `map`; velocities and accelerations in the body frame, like the
    twist of nav_msgs/Odometry.

    An acceleration is the mean rate of change of the twist's components until the next point. `effort` is
    left out: the message says NaN for unknown, which JSON cannot.
    """
    body = {name: np.asarray(values, float) for name, values in plan["trajectory"].items()}
    twist = np.column_stack([body["vx"], body["vy"], body["omega"]])
    rows = zip(
        plan["schedule"]["time"], body["x"], body["y"], body["theta"],
        twist, held_rate(np.asarray(plan["schedule"]["time"], float), twist),
        strict=True,
    )  # fmt: skip
    points = [
        {
            "header": _header(t),
            "pose": {
                "position": _vector(x, y),
                "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(theta / 2), "w": math.cos(theta / 2)},
            },
            "velocity": _planar(v),
            "acceleration": _planar(a),
        }
        for t, x, y, theta, v, a in rows
    ]
    return write_json({"header": _header(0.0), "points": points})


def write_joint_trajectory(plan: PlanDocument, _: Problem) -> bytes:
    """trajectory_msgs/JointTrajectory: joints <wheel>_wheel, rolling, then <wheel>_steering."""
    schedule = plan["schedule"]
    time = np.asarray(schedule["time"], float)
    joints = {
        f"{name}_wheel": (series["angle"], series["velocity"], series["acceleration"])
        for name, series in schedule["wheels"].items()
    } | {
        f"{name}_steering": (series["angle"], series["rate"], held_rate(time, np.asarray(series["rate"])))
        for name, series in schedule["steering"].items()
    }
    positions, velocities, accelerations = (
        np.column_stack(part) for part in zip(*joints.values(), strict=True)
    )
    points = [
        {"positions": q, "velocities": v, "accelerations": a, "effort": [], "time_from_start": _time(t)}
        for t, q, v, a in zip(time, positions, velocities, accelerations, strict=True)
    ]
    return write_json({"header": _header(0.0), "joint_names": list(joints), "points": points})


def _header(seconds: float) -> dict[str, Any]:
    return {"stamp": _time(seconds), "frame_id": _FRAME}


def _time(seconds: float) -> dict[str, int]:
    whole, nanoseconds = divmod(round(seconds * 1e9), 10**9)
    return {"sec": whole, "nanosec": nanoseconds}


def _vector(x: float, y: float, z: float = 0.0) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def _planar(twist: Any) -> dict[str, Any]:
    return {"linear": _vector(twist[0], twist[1]), "angular": _vector(0.0, 0.0, twist[2])}
