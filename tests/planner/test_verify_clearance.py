"""The certificate's clearance is the smallest over the whole motion."""

from __future__ import annotations

import math
import re
from dataclasses import fields

import numpy as np
import pytest

from drives.se2 import Array, Pose, Twist, compose, exp
from planner.tolerances import CLEARANCE_ACCURACY, CLEARANCE_SHARE
from planner.verify import Certificate
from tests.planner.schedules import (
    KINDS,
    PARAMETERS,
    PERIOD,
    RADIUS,
    START,
    Case,
    Discs,
    column,
    drive_of,
    exact,
    moving,
)


@pytest.mark.parametrize("kind", KINDS)
def test_an_obstacle_in_the_way(kind: str) -> None:
    case = moving(drive_of(kind))
    x, y, _ = case.schedule.pose[100]
    error = case.refused(Discs(((x, y, 0.05),)))
    assert [s for s in error.details["violations"] if not s.startswith("the clearance is -0.3")] == []
    assert "at t = 2.0" in error.message
    assert error.details["certificate"]["clearance"] == pytest.approx(-0.35, abs=3e-3)
    assert set(error.details["certificate"]) == {f.name for f in fields(Certificate)}


def passing(beside: float, period: float) -> tuple[Case, Discs]:
    """A straight motion past a disc that the footprint misses by `beside` m, between samples."""
    case = exact("differential", period, tangent=Twist(1.0, 0.0, 0.0))
    x, y, _ = compose(START, Pose(0.7531, beside + RADIUS + 0.1, 0.0))
    return case, Discs(((x, y, 0.1), (x + 30, y, 0.1)))


@pytest.mark.parametrize("period", [0.002, 0.02, 0.1])
@pytest.mark.parametrize("beside", [1e-4, 0.01, 0.2, 1.7, 19.7])
def test_the_clearance_is_a_lower_bound_over_the_whole_motion(period: float, beside: float) -> None:
    case, world = passing(beside, period)
    found = case.verify(world).clearance
    assert beside - max(CLEARANCE_ACCURACY, CLEARANCE_SHARE * beside) <= found <= beside + 1e-9
    assert world.asked < 400


def test_the_least_clearance_asked_for_is_kept() -> None:
    case, world = passing(0.2, PERIOD)
    assert case.options(min_clearance=0.2).verify(world).clearance == pytest.approx(0.2, abs=1e-4)
    found = case.options(min_clearance=0.2003).sentences(world)
    assert len(found) == 1
    assert re.match(
        r"the clearance is 0\.\d+ m at t = 1\.\d+ s, pose \(.*\), allowed at least 0\.2003 m", found[0]
    )


@pytest.mark.parametrize("side", [-0.6, 0.6])
def test_clearance_is_found_on_the_arc_not_on_its_chord(side: float) -> None:
    """Samples are far apart: an arc is up to 9 mm from its chords."""
    case = exact("differential", 0.4, 4.0, tangent=Twist(1.0, 0.0, 1.0))
    before, after = case.schedule.pose[5:7, 2] - START.theta
    assert 1 - math.cos((after - before) / 2) > 9e-3
    turn = (before + after) / 2
    middle = compose(START, exp(Twist(turn, 0.0, turn)))
    x, y, _ = compose(middle, Pose(0.0, side, 0.0))
    found = case.verify(Discs(((x, y, 0.1),))).clearance
    assert found == pytest.approx(0.6 - 0.1 - RADIUS, abs=6e-4)


def test_a_needle_between_two_samples_is_seen() -> None:
    """A stretch of 5 mm whose ends keep 1.4 mm: the needle's point lies on the circle that passes it."""
    case = exact("differential", 0.1, tangent=Twist(1.0, 0.0, 0.0))
    poses = case.schedule.pose
    middle = (poses[20] + poses[21]) / 2
    x, y, _ = compose(Pose(*middle.tolist()), Pose(0.0, RADIUS + 1e-6, 0.0))
    found = case.verify(Discs(((x, y, 0.0),)))
    assert found.clearance == pytest.approx(1e-6, abs=1e-4)
    x, y, _ = compose(Pose(*middle.tolist()), Pose(0.0, RADIUS - 4e-4, 0.0))
    assert case.sentences(Discs(((x, y, 0.0),)))[0].startswith("the clearance is -0.0004")


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
    found = column("wheel_velocity", (70, 0), 1e9)(moving(drive_of("differential"))).sentences(world)
    assert re.fullmatch(r"the footprint moves \S+ m, of which 110000 m can be checked", found[0])
    assert world.asked < 1000
