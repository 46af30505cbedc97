"""WPILib's and Choreo's trajectories, read by their own libraries and sampled between the plan's samples."""

from __future__ import annotations

import math

import choreo
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from wpimath.trajectory import TrajectoryUtil

from api.errors import Refusal
from api.formats import FORMATS
from api.formats.format import world_velocity

PIVOT = (("start", (1.0, 1.0, 0.0)), ("goal", (1.0, 1.0, 2.0)))
POINTING = ("tricycle", "synchro")
FREE = ("mecanum", "omni", "swedish", "swerve")


def between(plan):
    """Times half-way between the samples, and the places there."""
    time = plan["schedule"]["time"]
    place = np.column_stack([plan["trajectory"]["x"], plan["trajectory"]["y"]])
    at = (time[1:] + time[:-1]) / 2
    return at, CubicHermiteSpline(time, place, world_velocity(plan))(at)


@pytest.mark.parametrize("drive", POINTING + FREE)
def test_wpilib_samples_lie_on_the_plan(planned, drive):
    plan, problem = planned(drive, "good")
    read = TrajectoryUtil.deserializeTrajectory(FORMATS["wpilib"].write(plan, problem).decode())
    assert read.totalTime() == pytest.approx(plan["duration"])
    speeds = np.hypot(plan["trajectory"]["vx"], plan["trajectory"]["vy"])
    for t, (x, y) in zip(*between(plan), strict=True):
        got = read.sample(t)
        assert math.hypot(got.pose.X() - x, got.pose.Y() - y) < 2e-3
        assert abs(got.velocity) == pytest.approx(np.interp(t, plan["schedule"]["time"], speeds), abs=0.05)


@pytest.mark.parametrize("drive", POINTING)
def test_wpilib_curvature_is_what_the_heading_does(planned, drive):
    plan, problem = planned(drive, "good")
    read = TrajectoryUtil.deserializeTrajectory(FORMATS["wpilib"].write(plan, problem).decode())
    for i, state in enumerate(read.states()):
        assert state.pose.rotation().cos() == pytest.approx(
            math.cos(plan["trajectory"]["theta"][i]), abs=1e-9
        )
        assert state.velocity * state.curvature == pytest.approx(
            plan["trajectory"]["omega"][i], abs=1e-9 + (abs(state.velocity) < 1e-6)
        )


@pytest.mark.parametrize("drive", FREE)
def test_wpilib_poses_of_holonomic_drives_point_where_they_go(planned, drive):
    plan, problem = planned(drive, "good")
    read = TrajectoryUtil.deserializeTrajectory(FORMATS["wpilib"].write(plan, problem).decode())
    for state, velocity in zip(read.states(), world_velocity(plan), strict=True):
        assert state.velocity >= 0
        along = state.velocity * state.pose.rotation().cos(), state.velocity * state.pose.rotation().sin()
        assert along == pytest.approx(velocity, abs=1e-6)


def test_wpilib_is_refused_for_a_turn_on_the_spot_which_it_would_sample_as_nan(planned):
    with pytest.raises(Refusal, match=r"0.00 s after the start.*csv and ros-trajectory can") as refused:
        FORMATS["wpilib"].write(*planned("differential", "first", PIVOT))
    assert refused.value.code == "not-acceptable"


@pytest.mark.parametrize(
    ("drive", "load"),
    [
        ("differential", choreo.load_differential_trajectory_string),
        ("swerve", choreo.load_swerve_trajectory_string),
    ],
)
@pytest.mark.parametrize("effort", ["first", "good"])
def test_choreo_samples_lie_on_the_plan(planned, drive, load, effort):
    plan, problem = planned(drive, effort)
    read = load(FORMATS["choreo"].write(plan, problem).decode())
    assert read.get_total_time() == pytest.approx(plan["duration"])
    assert len(read.get_samples()) == len(plan["schedule"]["time"])
    for t, (x, y) in zip(*between(plan), strict=True):
        got = read.sample_at(t)
        assert math.hypot(got.x - x, got.y - y) < 1e-3
        assert got.heading == pytest.approx(
            np.interp(t, plan["schedule"]["time"], plan["trajectory"]["theta"]), abs=5e-3
        )


def test_choreo_wheel_speeds_are_the_schedules(planned):
    plan, problem = planned("differential")
    read = choreo.load_differential_trajectory_string(FORMATS["choreo"].write(plan, problem).decode())
    radius = problem.robot.drive.wheel_radius
    wheels = plan["schedule"]["wheels"]
    assert [s.vl for s in read.get_samples()] == pytest.approx(radius * wheels["left"]["velocity"])
    assert [s.vr for s in read.get_samples()] == pytest.approx(radius * wheels["right"]["velocity"])


def test_choreo_turns_on_the_spot(planned):
    plan, problem = planned("differential", "first", PIVOT)
    read = choreo.load_differential_trajectory_string(FORMATS["choreo"].write(plan, problem).decode())
    assert read.get_final_pose().rotation().radians() == pytest.approx(2.0, abs=1e-6)
