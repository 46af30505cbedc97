"""Words against OMPL's distances, closed forms, and the laws every word obeys."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from ompl import base as ob

from drives.se2 import Pose, Twist, between, compose, exp, wrap
from planner.curves import (
    DUBINS,
    DUBINS_END,
    REEDS_SHEPP,
    REEDS_SHEPP_END,
    SEGMENTS,
    shortest,
    solve_word,
    word_reaches,
    word_segment,
)

Word = list[tuple[float, float]]
"""Segments that are not empty: curvature (positive: left), length (negative: backwards)."""

PI = math.pi
ORIGIN = Pose(0.0, 0.0, 0.0)
TURN_ROUND = (2 * PI / 3, -2 * PI / 3, 2 * PI / 3)


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    length(shortest_word(ORIGIN, Pose(1.0, 0.5, 0.25), 1.0, True))
    words(ORIGIN, Pose(1.0, 0.5, 0.25), 1.0, True)


def ompl_distance(radius: float, reverse: bool) -> Callable[[Pose, Pose], float]:
    space = (ob.ReedsSheppStateSpace if reverse else ob.DubinsStateSpace)(radius)
    bounds = ob.RealVectorBounds(2)
    bounds.setLow(-1e6)
    bounds.setHigh(1e6)
    space.setBounds(bounds)
    a, b = space.allocState(), space.allocState()

    def distance(start: Pose, goal: Pose) -> float:
        for state, pose in ((a, start), (b, goal)):
            state.setX(pose.x)
            state.setY(pose.y)
            state.setYaw(pose.theta)
        return float(space.distance(a, b))

    return distance


def in_radii(start: Pose, goal: Pose, radius: float) -> tuple[float, float, float]:
    """The goal as kernels take it."""
    x, y, phi = between(start, goal)
    return x / radius, y / radius, wrap(phi)


def segments(row: int, word: tuple[float, float, float, float], radius: float) -> Word:
    parts = [word_segment(row, i, word) for i in range(SEGMENTS)]
    return [(bent / radius, ell * radius) for bent, ell in parts if ell != 0.0]


def words_to(x: float, y: float, phi: float, radius: float, reverse: bool) -> dict[int, Word]:
    """By their rows the words that reach a goal given in radii."""
    s, c = math.sin(phi), math.cos(phi)
    found = {}
    for row in range(REEDS_SHEPP, REEDS_SHEPP_END) if reverse else range(DUBINS, DUBINS_END):
        word = solve_word(row, x, y, phi, s, c, math.inf)
        if word[0] < math.inf and word_reaches(row, word, x, y, s, c):
            found[row] = segments(row, word, radius)
    return found


def words(start: Pose, goal: Pose, radius: float, reverse: bool) -> list[Word]:
    return list(words_to(*in_radii(start, goal, radius), radius, reverse).values())


def shortest_word(start: Pose, goal: Pose, radius: float, reverse: bool) -> Word:
    return segments(*shortest(*in_radii(start, goal, radius), reverse), radius)


def shortest_length(start: Pose, goal: Pose, radius: float, reverse: bool) -> float:
    return float(radius * shortest(*in_radii(start, goal, radius), reverse)[1][0])


def length(word: Word) -> float:
    return math.fsum(abs(ell) for _, ell in word)


def end(word: Word, start: Pose) -> Pose:
    for bent, ell in word:
        start = compose(start, exp(Twist(ell, 0.0, bent * ell)))
    return start


def random_poses(seed: int, n: int, reach: float) -> list[Pose]:
    rng = np.random.default_rng(seed)
    return [Pose(*row) for row in (rng.uniform(-1, 1, (n, 3)) * (reach, reach, PI)).tolist()]


def miss(word: Word, start: Pose, goal: Pose) -> float:
    x, y, theta = end(word, start)
    return max(abs(x - goal.x), abs(y - goal.y), abs(wrap(theta - goal.theta)))


# Coordinates and headings on which words begin, end or coincide, and neighbours of them. Dubins' length jumps
# there; OMPL rounds its goals to 1e-6 of a jump, we do not, so for Dubins the neighbours lie beyond that.
EDGES = (0.0, 1.0, -1.0, 2.0, -2.0, 4.0, -4.0, math.sqrt(2), 2 * math.sqrt(3))
ANGLES = (0.0, PI / 2, -PI / 2, PI, -PI, PI / 3, 2 * PI / 3, 1.0, -2.0)
NEAR_RS = (1e-3, -1e-3, 1e-6, 1e-9, -1e-9)
NEAR_DUBINS = (1e-2, -1e-2, 1e-3, -1e-3)


@pytest.mark.parametrize("reverse", [True, False])
@pytest.mark.parametrize("radius", [0.3, 1.0, 7.5])
@pytest.mark.parametrize("reach", [0.1, 1.0, 3.0, 10.0, 100.0])
def test_shortest_length_equals_ompl(reach: float, radius: float, reverse: bool) -> None:
    distance = ompl_distance(radius, reverse)
    starts, goals = random_poses(1, 2000, reach * radius), random_poses(2, 2000, reach * radius)
    for start, goal in zip(starts, goals, strict=True):
        ours = shortest_length(start, goal, radius, reverse)
        assert ours == pytest.approx(distance(start, goal), rel=1e-6), (start, goal)


@pytest.mark.parametrize(("reverse", "near"), [(True, NEAR_RS), (False, NEAR_DUBINS)])
def test_shortest_length_equals_ompl_on_edges(reverse: bool, near: tuple[float, ...]) -> None:
    distance = ompl_distance(1.0, reverse)
    for x, y, phi in itertools.product(EDGES + near, EDGES + near, ANGLES + near):
        ours = shortest(x, y, phi, reverse)[1][0]
        # Sideways offsets below 1e-12 count as none; abs is the length of a manoeuvre for one.
        assert ours == pytest.approx(distance(ORIGIN, Pose(x, y, phi)), rel=1e-6, abs=2e-6), (x, y, phi)


@pytest.mark.parametrize("reverse", [True, False])
@pytest.mark.parametrize("reach", [1e-6, 1e-3, 0.1, 1.0, 10.0, 1e4])
def test_every_word_reaches_its_goal_within_its_curvature(reach: float, reverse: bool) -> None:
    for radius, start, goal in zip(
        itertools.cycle((0.2, 1.0, 30.0)),
        random_poses(3, 120, 5.0),
        random_poses(4, 120, reach),
        strict=False,
    ):
        goal = compose(start, goal)
        found = words(start, goal, radius, reverse)
        least = shortest_length(start, goal, radius, reverse)
        assert min(map(length, found)) == pytest.approx(least, rel=1e-9)
        for word in found:
            distance = math.hypot(goal.x - start.x, goal.y - start.y)
            assert miss(word, start, goal) <= 1e-9 * (1 + radius + distance)
            assert all(abs(bent) <= 1 / radius for bent, _ in word)
            assert reverse or all(ell > 0 for _, ell in word)


def test_edge_goals_are_reached() -> None:
    near = (1e-3, 1e-6, 1e-9, -1e-9, 1e-11, 1e-13)
    for x, y, phi in itertools.product(EDGES[:5] + near, EDGES[:5] + near, ANGLES[:5] + near):
        for reverse in (True, False):
            found = words(ORIGIN, Pose(x, y, phi), 1.0, reverse)
            assert found
            for word in found:
                assert miss(word, ORIGIN, Pose(x, y, phi)) <= 1e-9 * (1 + abs(x) + abs(y))


def test_random_words_are_found_again() -> None:
    """No word is missing: roll out any word of the 48 and it is among the words to where it ends."""
    rng = np.random.default_rng(5)
    seen = set()
    for _ in range(300):
        x, y, phi = rng.uniform(-3, 3, 3)
        for row, word in words_to(x, y, phi, 1.0, True).items():
            seen.add(tuple((bent, math.copysign(1.0, ell)) for bent, ell in word))
            again = words_to(*end(word, ORIGIN), 1.0, True)
            assert np.allclose(again[row], word, rtol=0.0, atol=1e-6), (x, y, phi, word)
    assert len(seen) == 48


def test_dubins_has_six_words() -> None:
    seen = set()
    for x, y, phi in random_poses(6, 300, 4.0):
        for word in words_to(x, y, phi, 1.0, False).values():
            assert all(ell > 0 for _, ell in word)
            seen.add(tuple(bent for bent, _ in word))
    assert seen == {(1, 0, 1), (-1, 0, -1), (1, 0, -1), (-1, 0, 1), (1, -1, 1), (-1, 1, -1)}


@pytest.mark.parametrize(
    ("goal", "reverse", "expected"),
    [
        pytest.param((0, 0, 0), True, [], id="identical"),
        pytest.param((0, 0, 0), False, [], id="identical, forwards"),
        pytest.param((0, 0, 2 * PI), False, [], id="identical but for a whole turn"),
        pytest.param((5, 0, 0), True, [(0, 5)], id="straight"),
        pytest.param((5, 0, 0), False, [(0, 5)], id="straight, forwards"),
        pytest.param((-5, 0, 0), True, [(0, -5)], id="straight back"),
        pytest.param((2, 2, PI / 2), True, [(0.5, PI)], id="quarter turn left"),
        pytest.param((2, -2, -PI / 2), False, [(-0.5, PI)], id="quarter turn right"),
        pytest.param((-2, 2, -PI / 2), True, [(0.5, -PI)], id="quarter turn backwards"),
        pytest.param((0, 4, PI), False, [(0.5, 2 * PI)], id="U-turn"),
        pytest.param((0, 4, -PI), False, [(0.5, 2 * PI)], id="U-turn, heading -π"),
        pytest.param((0, 10, PI), False, [(0.5, PI), (0, 6), (0.5, PI)], id="wide U-turn"),
        pytest.param((4, 4, 0), False, [(0.5, PI), (-0.5, PI)], id="S-turn"),
        pytest.param((0, 0, PI), True, list(zip((0.5, -0.5, 0.5), TURN_ROUND, strict=True)), id="turn round"),
    ],
)
def test_closed_forms(goal: tuple[float, ...], reverse: bool, expected: Word) -> None:
    word = shortest_word(ORIGIN, Pose(*map(float, goal)), 2.0, reverse)
    assert len(word) == len(expected)
    for got, wanted in zip(word, expected, strict=True):
        assert got == pytest.approx(wanted, abs=1e-9)


def test_parallel_shift_sideways() -> None:
    """Left t, back on the right u, back on the left u, right t: no way ahead where sin(t + u) = 2·sin t."""
    t = 0.2
    turn = math.asin(2 * math.sin(t))
    goal = Pose(0.0, 2 - 4 * math.cos(t) + 2 * math.cos(turn), 0.0)
    assert shortest_length(ORIGIN, goal, 1.0, True) == pytest.approx(2 * turn, rel=1e-9)
    expected = [(1, t), (-1, t - turn), (1, t - turn), (-1, t)]
    assert any(np.allclose(w, expected, atol=1e-9) for w in words(ORIGIN, goal, 1.0, True) if len(w) == 4)


def test_dubins_loops_round_where_reeds_shepp_backs_up() -> None:
    back = Pose(-1.0, 0.0, 0.0)
    assert shortest_word(ORIGIN, back, 1.0, True) == [(0.0, -1.0)]
    assert shortest_word(ORIGIN, back, 1.0, False) == [(1.0, PI), (0.0, 1.0), (1.0, PI)]


@pytest.mark.parametrize("reverse", [True, False])
def test_rounding_of_poses_in_the_world_makes_no_loop(reverse: bool) -> None:
    for start in random_poses(7, 300, 100.0):
        for distance in (1e-9, 1e-6, 1e-3, 1.0, 50.0):
            goal = compose(start, Pose(distance, 0.0, 0.0))
            assert shortest_length(start, goal, 1.0, reverse) == pytest.approx(distance, rel=1e-6, abs=1e-10)


def test_equal_lengths_are_decided_alike() -> None:
    word = shortest_word(ORIGIN, Pose(0.0, 0.0, PI), 1.0, True)
    assert [bent for bent, _ in word] == [1, -1, 1]
    assert word[0][1] > 0
    assert word == shortest_word(ORIGIN, Pose(0.0, 0.0, PI), 1.0, True)


@pytest.mark.parametrize("reverse", [True, False])
def test_shortest_word_is_the_shortest(reverse: bool) -> None:
    for goal in random_poses(8, 500, 5.0):
        word = shortest_word(ORIGIN, goal, 1.0, reverse)
        total = length(word)
        assert total == pytest.approx(min(map(length, words(ORIGIN, goal, 1.0, reverse))), abs=1e-9)
        assert total == pytest.approx(shortest_length(ORIGIN, goal, 1.0, reverse), abs=1e-12)
        assert {bent for bent, _ in word} <= {-1.0, 0.0, 1.0}


def test_kernels_compose_in_compiled_code() -> None:
    @njit
    def total(n: int) -> float:
        result = 0.0
        for i in range(n):
            row, word = shortest(1.0 * i, 2.0, 0.5, True)
            for k in range(SEGMENTS):
                result += abs(word_segment(row, k, word)[1])
        return result

    assert total(5) == pytest.approx(sum(shortest(1.0 * i, 2.0, 0.5, True)[1][0] for i in range(5)))


def test_kernels_find_nothing_for_goals_that_are_not_finite() -> None:
    for bad in (math.nan, math.inf):
        for goal in ((bad, 0.0, 0.0), (0.0, bad, 0.0)):
            assert not words_to(*goal, 1.0, True)
        for goal in ((bad, 0.0, 0.0), (0.0, bad, 0.0), (0.0, 0.0, bad)):
            for reverse in (True, False):
                length, *parts = shortest(*goal, reverse)[1]
                assert length == math.inf
                assert np.isnan(parts).all()


coordinate = st.floats(-20, 20, allow_subnormal=False)
angle = st.floats(-PI, PI, allow_subnormal=False)
pose = st.builds(Pose, coordinate, coordinate, angle)


# Reeds–Shepp lengths are continuous, but only as a root of the offset: rounding of 1e-15 may show as 1e-7.
@given(goal=pose)
def test_the_way_back_is_as_long(goal: Pose) -> None:
    there, back = (shortest_length(a, b, 1.0, True) for a, b in ((ORIGIN, goal), (goal, ORIGIN)))
    assert there == pytest.approx(back, rel=1e-6, abs=3e-6)


@given(goal=pose, scale=st.floats(0.01, 100))
def test_lengths_scale_with_the_radius(goal: Pose, scale: float) -> None:
    scaled = Pose(scale * goal.x, scale * goal.y, goal.theta)
    expected = scale * shortest_length(ORIGIN, goal, 1.0, True)
    assert shortest_length(ORIGIN, scaled, scale, True) == pytest.approx(expected, rel=1e-6, abs=3e-6 * scale)


@given(goal=pose, frame=pose)
def test_lengths_do_not_depend_on_the_frame(goal: Pose, frame: Pose) -> None:
    expected = shortest_length(ORIGIN, goal, 1.0, True)
    assert shortest_length(frame, compose(frame, goal), 1.0, True) == pytest.approx(
        expected, rel=1e-6, abs=3e-6
    )


@given(goal=pose)
def test_dubins_is_never_shorter_than_reeds_shepp(goal: Pose) -> None:
    with_reverse, without = (shortest_length(ORIGIN, goal, 1.0, reverse) for reverse in (True, False))
    assert with_reverse <= without + 1e-9
    assert with_reverse >= math.hypot(goal.x, goal.y) - 1e-9
