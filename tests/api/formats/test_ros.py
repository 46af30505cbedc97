"""The ROS 2 messages, read into the message types of rosbags and through CDR and back."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from api.formats import FORMATS
from drives import DRIVES

ROS = get_typestore(Stores.ROS2_LYRICAL)
ARRAYS, BASE, NAME, SEQUENCE = (3, 4), 1, 2, 4


def message(kind: str, value: dict[str, Any], unknown: set[str]) -> Any:
    """The message of this type that a JSON object describes, field by field. Unknown fields are NaN."""
    fields = dict(ROS.fielddefs[kind][1])
    assert set(value) == set(fields) - unknown, kind
    made = {}
    for name, (shape, about) in fields.items():
        if name in unknown:
            vector = message("geometry_msgs/msg/Vector3", dict.fromkeys("xyz", math.nan), set())
            made[name] = ROS.types[about](force=vector, torque=vector)
        elif shape == BASE:
            made[name] = value[name]
        elif shape == NAME:
            made[name] = message(about, value[name], unknown)
        else:
            assert shape == SEQUENCE
            (inner, what), _ = about
            if inner == NAME:
                made[name] = [message(what, item, unknown) for item in value[name]]
            else:
                made[name] = value[name] if what[0] == "string" else np.array(value[name], what[0])
    return ROS.types[kind](**made)


def read(kind: str, format: str, plan: dict[str, Any], problem: Any, unknown: set[str]) -> Any:
    told = json.loads(FORMATS[format].write(plan, problem))
    sent = ROS.serialize_cdr(message(kind, told, unknown), kind)
    return ROS.deserialize_cdr(sent, kind)


def seconds(stamp: Any) -> float:
    return stamp.sec + stamp.nanosec / 1e9


@pytest.mark.parametrize("drive", DRIVES)
def test_a_trajectory_is_read_as_nav_msgs_trajectory(planned, drive):
    plan, problem = planned(drive)
    got = read("nav_msgs/msg/Trajectory", "ros-trajectory", plan, problem, {"effort"})
    body = plan["trajectory"]
    assert got.header.frame_id == "map"
    assert [seconds(p.header.stamp) for p in got.points] == pytest.approx(plan["schedule"]["time"], abs=1e-9)
    assert [p.pose.position.x for p in got.points] == list(body["x"])
    for name, of in (("vx", "linear.x"), ("vy", "linear.y"), ("omega", "angular.z")):
        part, axis = of.split(".")
        assert [getattr(getattr(p.velocity, part), axis) for p in got.points] == list(body[name])
    for point, theta in zip(got.points, body["theta"], strict=True):
        q = point.pose.orientation
        assert math.remainder(2 * math.atan2(q.z, q.w) - theta, 2 * math.pi) == pytest.approx(0, abs=1e-9)
    times = np.array([seconds(p.header.stamp) for p in got.points])
    change = np.array([p.acceleration.linear.x for p in got.points])
    assert np.cumsum(change[:-1] * np.diff(times)) == pytest.approx(body["vx"][1:], abs=1e-6)


@pytest.mark.parametrize("drive", DRIVES)
def test_the_joints_are_read_as_trajectory_msgs_joint_trajectory(planned, drive):
    plan, problem = planned(drive)
    got = read("trajectory_msgs/msg/JointTrajectory", "ros-joint-trajectory", plan, problem, set())
    wheels, steering = plan["schedule"]["wheels"], plan["schedule"]["steering"]
    assert got.joint_names == [f"{w}_wheel" for w in wheels] + [f"{s}_steering" for s in steering]
    assert [seconds(p.time_from_start) for p in got.points] == pytest.approx(
        plan["schedule"]["time"], abs=1e-9
    )
    for part, rolling, turning in (
        ("positions", "angle", "angle"), ("velocities", "velocity", "rate"),
    ):  # fmt: skip
        columns = [w[rolling] for w in wheels.values()] + [s[turning] for s in steering.values()]
        assert np.array([getattr(p, part) for p in got.points]) == pytest.approx(np.column_stack(columns))
    accelerations = np.array([p.accelerations for p in got.points])
    own = np.column_stack([w["acceleration"] for w in wheels.values()])
    assert np.array_equal(accelerations[:, : len(wheels)], own)


def test_a_whole_second_is_no_nanosecond_short(planned):
    plan, problem = planned("omni")
    told = json.loads(FORMATS["ros-joint-trajectory"].write(plan, problem))
    assert {"sec": 1, "nanosec": 0} in [point["time_from_start"] for point in told["points"]]
