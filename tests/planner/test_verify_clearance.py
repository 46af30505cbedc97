"""The certificate's clearance is the smallest over the whole motion."""

from __future__ import annotations

import math
import re
from dataclasses import fields

import numpy as np
import pytest

from drives.se2 import Array, Pose, Twist, compose, exp
from planner.verify import Certificate
from tests.planner.schedules import KINDS, PARAMETERS, RADIUS, START, Discs, column, drive_of, moving


@pytest.mark.parametrize("kind", KINDS)
def test_an_obstacle_in_the_way(kind: str) -> None:
    case = moving(drive_of(kind))
    x, y, _ = case.schedule.pose[100]
    error = case.refused(Discs(((x, y, 0.05),)))
    assert [s for s in error.details["violations"] if not s.startswith("the clearance is -0.3")] == []
    assert "at t = 2.0" in error.message
    assert error.details["certificate"]["clearance"] == pytest.approx(-0.35, abs=3e-3)
    assert set(error.details["certificate"]) == {f.name for f in fields(Certificate)}


@pytest.mark.parametrize("period", [0.002, 0.02, 0.5])
@pytest.mark.parametrize("beside", [0.31, 0.5, 2.0, 20.0])
def test_the_clearance_is_the_smallest_over_the_whole_motion(period: float, beside: float) -> None:
    case = moving(drive_of("differential"), Twist(1.0, 0.0, 0.0), period=period)
    x, y, _ = compose(START, Pose(0.7531, beside + 0.1, 0.0))
    world = Discs(((x, y, 0.1), (x + 30, y, 0.1)))
    assert case.verify(world).clearance == pytest.approx(beside - RADIUS, abs=3e-5)
    assert world.asked < 400


def test_the_least_clearance_asked_for_is_kept() -> None:
    case = moving(drive_of("differential"), Twist(1.0, 0.0, 0.0))
    x, y, _ = compose(START, Pose(0.75, 0.6, 0.0))
    world = Discs(((x, y, 0.1),))
    assert case.options(min_clearance=0.2).verify(world).clearance == pytest.approx(0.2, abs=3e-5)
    found = case.options(min_clearance=0.202).sentences(world)
    assert len(found) == 1
    assert re.match(
        r"the clearance is 0\.2\d* m at t = 1\.\d+ s, pose \(.*\), allowed at least 0\.202 m", found[0]
    )


def test_clearance_is_looked_at_on_the_arc_and_on_the_chord() -> None:
    """With samples far apart, what the robot does and what the samples say differ by the arc's height."""
    case = moving(drive_of("differential"), Twist(1.0, 0.0, 1.0), period=0.4, duration=4.0)
    case = case.limits(wheel_acceleration=np.full(2, 12.0))
    before, after = case.schedule.pose[5:7, 2] - START.theta
    rise = 1 - math.cos((after - before) / 2)  # of the arc, its radius 1 m, over its chord
    assert rise > 0.01
    turn = (before + after) / 2
    middle = compose(START, exp(Twist(turn, 0.0, turn)))
    inside, outside = (compose(middle, Pose(0.0, y, 0.0)) for y in (0.6, -0.6))
    near = 0.6 - 0.1 - RADIUS
    assert case.verify(Discs(((*inside[:2], 0.1),))).clearance == pytest.approx(near - rise, abs=2e-3)
    assert case.verify(Discs(((*outside[:2], 0.1),))).clearance == pytest.approx(near, abs=2e-3)


def test_a_synchro_drive_keeps_the_heading_of_its_body() -> None:
    world = Discs()
    moving(drive_of("synchro")).verify(world)
    assert set(world.headings) == {PARAMETERS["synchro"]["body_heading"]}


@pytest.mark.parametrize("value", [math.nan, -math.inf])
def test_a_clearance_that_is_no_number_fails(value: float) -> None:
    class Broken:
        def clearance(self, poses: Array) -> Array:
            return np.where(np.arange(len(poses)) == 3, value, 1.0)

    error = moving(drive_of("differential")).refused(Broken())
    assert error.details["certificate"]["clearance"] == -1e6
    assert error.details["violations"][0].startswith("the clearance is -1e+06 m at t = ")


def test_a_motion_too_long_to_check_fails_and_says_so() -> None:
    world = Discs()
    found = column("pose", (70, 0), 1e7)(moving(drive_of("differential"))).sentences(world)
    assert re.fullmatch(r"the footprint moves 2e\+07 m, of which 110000 m can be checked", found[0])
    assert world.asked < 1000
