"""A schedule begins where the steered wheels stand."""

from __future__ import annotations

import numpy as np
import pytest

from planner.plan import plan
from planner.problem import Environment
from tests.planner.plans import JOURNEYS, PI, Ask, closes, keeps_limits, largest

STEERED = ["tricycle", "ackermann", "synchro", "swerve", "powered_caster"]


@pytest.mark.parametrize(
    ("kind", "angles"),
    [
        ("tricycle", 0.7), ("tricycle", -0.31), ("ackermann", 0.2), ("ackermann", [0.0, 0.0]),
        ("swerve", [1.0, -2.0, 0.3]), ("swerve", [3.0, 9.0, -7.5]), ("powered_caster", [1.0, -2.0, 0.3]),
        ("powered_caster", PI), ("powered_caster", 0.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("place", JOURNEYS)
def test_schedule_begins_where_the_steered_wheels_stand(
    ask: Ask, floor: Environment, clutter: Environment, kind: str, angles: float | list[float], place: str
) -> None:
    problem = ask(kind, *JOURNEYS[place], {"floor": floor, "clutter": clutter}[place], steering=angles)
    made = plan(problem)
    columns, limits = made.schedule, problem.robot.limits
    assert problem.steering is not None
    assert columns.steering_angle[0].tolist() == problem.steering.tolist()
    over = np.diff(columns.time)[:, None]
    assert largest(np.diff(columns.steering_angle, axis=0), limits.steering_rate * over) <= 1.001
    assert keeps_limits(made)
    assert closes(made)


def test_wheels_that_steer_at_rest_do_so_before_the_body_moves(ask: Ask) -> None:
    made = plan(ask("swerve", (0.0, 0.0, 0.0), (2.0, 0.0, 0.0), steering=[1.2, 0.0, -0.6])).schedule
    before = made.time < 1.2 / 3.0 - 1e-9
    assert before.sum() > 10
    assert not made.wheel_velocity[before].any()
    assert (made.pose[before] == made.pose[0]).all()


def test_a_caster_that_is_told_nothing_begins_at_zero(ask: Ask) -> None:
    made = plan(ask("powered_caster", *JOURNEYS["floor"]))
    assert not made.schedule.steering_angle[0].any()


@pytest.mark.parametrize("kind", STEERED)
def test_standing_still_keeps_the_steering_given(ask: Ask, kind: str) -> None:
    angle = -0.4 if kind == "synchro" else 0.5  # a synchro's wheels stand at theta - body_heading
    made = plan(ask(kind, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), steering=angle))
    assert (made.schedule.steering_angle == angle).all()


def test_synchro_wheels_begin_on_the_branch_given(ask: Ask) -> None:
    turned = -0.4 + 2 * PI
    made = plan(ask("synchro", (0.0, 0.0, 0.0), (2.0, 1.0, 0.0), steering=turned))
    assert (made.schedule.steering_angle[0] == turned).all()
    assert made.schedule.steering_angle - made.schedule.pose[:, 2:] == pytest.approx(turned)
