"""A line that bows out is a smooth curve, and a quicker way where trailing wheels have to swing round."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drives.se2 import Pose
from planner.bow import BowedPiece, bowed
from planner.environment import CollisionWorld
from planner.path import LinePiece
from planner.problem import Problem
from planner.time_law import time_path
from planner.trajectory import Phases

Ask = Callable[..., Problem]
NUMBER = st.floats(-2.0, 2.0)


@given(NUMBER, NUMBER, NUMBER, NUMBER, st.floats(0.01, 0.99))
def test_the_body_path_is_the_derivative_of_the_poses(
    x: float, y: float, turn: float, bow: float, s: float
) -> None:
    piece = BowedPiece(Pose(0.3, -0.2, 0.4), Pose(x, y, turn), (bow, 0.3 - bow, 0.5 * bow))
    h = 1e-5
    at = np.array([s - h, s, s + h])
    poses, path = piece.poses(at), piece.body_path(at)
    rate = (poses[2] - poses[0]) / (2 * h)
    c, d = math.cos(poses[1, 2]), math.sin(poses[1, 2])
    expected = [c * rate[0] + d * rate[1], c * rate[1] - d * rate[0], rate[2]]
    assert path.tangent[1] == pytest.approx(expected, abs=1e-8)
    change = (path.tangent[2] - path.tangent[0]) / (2 * h)
    assert path.tangent_derivative[1] == pytest.approx(change, abs=1e-6)
    assert path.heading == pytest.approx(poses[:, 2])


def _asked(ask: Ask) -> tuple[Problem, CollisionWorld, LinePiece, Phases]:
    problem = ask("powered_caster", (-1.5, 0.0, 0.0), (1.5, 1.0, 2.5))
    world = CollisionWorld.build(problem.environment, problem.robot.footprint)
    line = LinePiece(problem.start, Pose(1.5, 1.0, 2.5))
    known = time_path((line,), problem.robot.drive, problem.robot.limits)
    return problem, world, line, known


def test_a_bowed_way_is_quicker_and_has_the_same_ends(ask: Ask) -> None:
    problem, world, line, known = _asked(ask)
    found = bowed(line, known, problem, world, lambda: False)
    assert found is not None
    assert found.duration < known.duration
    ends = found.sample(np.array([0.0, found.duration])).pose
    assert ends == pytest.approx(np.array([line.start, line.end]), abs=1e-9)


def test_no_time_no_bow(ask: Ask) -> None:
    problem, world, line, known = _asked(ask)
    assert bowed(line, known, problem, world, lambda: True) is None
