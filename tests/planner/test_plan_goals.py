"""Every goal is reached: of any heading or none, near or far, and however often turned."""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import numpy as np
import pytest

from drives.se2 import Pose, wrap
from planner.plan import plan
from planner.problem import Environment
from tests.planner.plans import (
    JOURNEYS,
    KINDS,
    NONHOLONOMIC,
    PI,
    Ask,
    closes,
    distance,
    every_drive,
    keeps_limits,
)

HOLONOMIC = [kind for kind in KINDS if kind not in NONHOLONOMIC]


@every_drive
def test_goal_without_heading_takes_any(ask: Ask, kind: str) -> None:
    made = plan(ask(kind, (0.0, 0.0, 0.4), (2.0, -1.0, None)))
    assert distance(made.schedule.pose[-1], Pose(2.0, -1.0, 0.0)) < 1e-6
    assert made.certificate.closure_heading == 0.0
    assert keeps_limits(made)


def test_goal_without_heading_is_reached_no_later_than_with_one(ask: Ask) -> None:
    free = plan(ask("differential", (0.0, 0.0, 0.4), (2.0, -1.0, None)))
    fixed = plan(ask("differential", (0.0, 0.0, 0.4), (2.0, -1.0, 2.0)))
    assert free.duration <= fixed.duration


@every_drive
@pytest.mark.parametrize("theta", [0.4, 0.4 - 2 * PI, None])
def test_start_that_is_the_goal_is_one_sample_at_rest(ask: Ask, kind: str, theta: float | None) -> None:
    made = plan(ask(kind, (1.0, 0.5, 0.4), (1.0, 0.5, theta)))
    columns = made.schedule
    assert made.duration == made.length == 0.0
    assert columns.time.tolist() == [0.0]
    assert columns.pose.tolist() == [[1.0, 0.5, 0.4]]
    for rate in (columns.wheel_velocity, columns.wheel_acceleration, columns.steering_rate, columns.twist):
        assert len(rate) == 1
        assert not rate.any()
    assert made.certificate.closure_position == made.certificate.closure_heading == 0.0


@every_drive
@pytest.mark.parametrize("aside", [False, True], ids=["ahead", "aside"])
def test_one_millimetre(ask: Ask, kind: str, aside: bool) -> None:
    theta = 0.3
    course = theta + (PI / 2 if aside else 0.0)
    goal = (1.0 + 1e-3 * math.cos(course), -1.0 + 1e-3 * math.sin(course), theta)
    made = plan(ask(kind, (1.0, -1.0, theta), goal))
    poses = made.schedule.pose
    assert distance(poses[-1], Pose(*goal)) < 1e-6
    assert abs(wrap(poses[-1, 2] - theta)) < 1e-6
    assert made.certificate.closure_position < 1e-5
    assert keeps_limits(made)
    assert made.duration > 0
    if not aside or kind in HOLONOMIC:
        assert made.length == pytest.approx(1e-3, rel=1e-5)


@every_drive
@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["left", "right"])
def test_turn_of_exactly_half_a_turn(ask: Ask, kind: str, sign: float) -> None:
    made = plan(ask(kind, (0.0, 0.0, 0.4), (0.0, 0.0, 0.4 + sign * PI)))
    poses = made.schedule.pose
    assert distance(poses[-1], Pose(0.0, 0.0, 0.0)) < 1e-6
    assert abs(wrap(poses[-1, 2] - 0.4 - PI)) < 1e-6
    assert keeps_limits(made)
    assert closes(made)
    if kind not in ("tricycle", "ackermann"):
        assert abs(poses[-1, 2] - 0.4) == pytest.approx(PI)
        assert made.length < 1e-6


@every_drive
def test_heading_is_continuous_across_the_wrap(ask: Ask, kind: str) -> None:
    made = plan(ask(kind, (0.0, 0.0, 3.1), (-1.0, 0.0, -3.1)))
    heading = made.schedule.pose[:, 2]
    assert heading[0] == 3.1
    assert np.abs(np.diff(heading)).max() < 0.2
    assert abs(wrap(heading[-1] + 3.1)) < 1e-6
    if kind in HOLONOMIC:
        assert heading[-1] == pytest.approx(2 * PI - 3.1)


@every_drive
@pytest.mark.parametrize("turns", [7.0, -20.0])
def test_heading_is_unwrapped_from_the_value_given_at_the_start(ask: Ask, kind: str, turns: float) -> None:
    made = plan(ask(kind, (-1.0, 0.0, turns), (1.0, 0.5, 0.2)))
    heading = made.schedule.pose[:, 2]
    assert heading[0] == turns
    assert np.abs(np.diff(heading)).max() < 0.2
    assert abs(heading[-1] - turns) < 2 * PI
    assert abs(wrap(heading[-1] - 0.2)) < 1e-6
    assert closes(made)


@every_drive
def test_whole_turns_in_a_request_change_nothing_but_theta(ask: Ask, kind: str) -> None:
    near = plan(ask(kind, (-1.0, 0.0, 0.7), (1.0, 0.5, 0.2)))
    wound = plan(ask(kind, (-1.0, 0.0, 0.7 + 6 * PI), (1.0, 0.5, 0.2 - 4 * PI)))
    assert wound.duration == pytest.approx(near.duration, rel=1e-6)
    assert wound.schedule.pose[:, 2] - 6 * PI == pytest.approx(near.schedule.pose[:, 2], abs=1e-6)


@every_drive
def test_far_from_the_origin_is_as_near_it(ask: Ask, floor: Environment, kind: str) -> None:
    assert floor.bounds is not None
    far = 1e5
    moved = replace(
        floor,
        bounds=replace(
            floor.bounds,
            **{name: value + far for name, value in asdict(floor.bounds).items()},
        ),
    )
    (x, y, theta), (gx, gy, turned) = JOURNEYS["floor"]
    here = plan(ask(kind, (x, y, theta), (gx, gy, turned)))
    there = plan(ask(kind, (x + far, y + far, theta), (gx + far, gy + far, turned), moved))
    assert there.duration == pytest.approx(here.duration, rel=1e-6)
    assert closes(there)
    assert there.certificate.clearance == pytest.approx(here.certificate.clearance, abs=1e-6)


def test_a_motion_begun_the_other_way_round_takes_as_long(ask: Ask) -> None:
    (x, y, theta), (gx, gy, turned) = JOURNEYS["floor"]
    left = plan(ask("differential", (x, y, theta), (gx, gy, turned)))
    right = plan(ask("differential", (x, -y, -theta), (gx, -gy, -turned)))
    assert right.duration == pytest.approx(left.duration, rel=1e-9)
