"""A trajectory as ChoreoLib reads it: a .traj file, schema version 3, of differential or swerve samples.

It holds what a robot follows, not the waypoints that the Choreo application edits.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from api.formats.format import PlanDocument, held_rate, world_velocity
from api.strict_json import write_json
from drives import Differential
from drives.se2 import Array
from planner.problem import Problem

__all__ = ["write_choreo"]

_VERSION = 3


def write_choreo(plan: PlanDocument, problem: Problem) -> bytes:
    """Samples in the world frame. Held until the next sample, their accelerations lead to it, as ChoreoLib
    interpolates. Forces are 0: a plan knows no masses."""
    drive = problem.robot.drive
    time = np.asarray(plan["schedule"]["time"], float)
    body = {name: np.asarray(values, float) for name, values in plan["trajectory"].items()}
    omega = body["omega"]
    columns: dict[str, Array] = {"t": time, "x": body["x"], "y": body["y"], "heading": body["theta"]}
    forces: dict[str, Any]
    if isinstance(drive, Differential):
        wheels = plan["schedule"]["wheels"]
        left, right = (
            drive.wheel_radius * np.asarray(wheels[name]["velocity"]) for name in drive.wheel_names
        )
        columns |= {"vl": left, "vr": right, "omega": omega}
        columns |= {"al": held_rate(time, left), "ar": held_rate(time, right)}
        forces = {"fl": 0.0, "fr": 0.0}
    else:
        vx, vy = world_velocity(plan).T
        columns |= {"vx": vx, "vy": vy, "omega": omega}
        columns |= {"ax": held_rate(time, vx), "ay": held_rate(time, vy)}
        still = [0.0] * len(drive.wheel_names)
        forces = {"fx": still, "fy": still}
    columns["alpha"] = held_rate(time, omega)
    rows = zip(*columns.values(), strict=True)
    trajectory = {
        "sampleType": "Differential" if isinstance(drive, Differential) else "Swerve",
        "waypoints": [0.0, time[-1]],
        "samples": [dict(zip(columns, row, strict=True)) | forces for row in rows],
        "splits": [0],
    }
    return write_json({"name": plan["id"], "version": _VERSION, "trajectory": trajectory, "events": []})
