"""Pieces of a path: poses and tangents are one motion, and cutting and joining change nothing."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drives.se2 import Array, Pose, Twist, compose, exp
from planner.path import LinePiece, Path, Piece, TwistPiece, as_path, as_steps, merge

number = st.floats(-5.0, 5.0)
POSES = st.builds(Pose, number, number, st.floats(-10.0, 10.0))
TWISTS = st.builds(
    Twist, number, number, st.one_of(st.just(0.0), st.floats(-7.0, 7.0), st.floats(-1e-6, 1e-6))
)
PIECES: st.SearchStrategy[Piece] = st.one_of(
    st.builds(TwistPiece, POSES, TWISTS), st.builds(LinePiece, POSES, POSES)
)
SHARES = st.floats(0.01, 0.99)
fast = settings(max_examples=80, deadline=None)
FINE = np.linspace(0.0, 1.0, 41)


def at(piece: Piece, *s: float) -> Array:
    return piece.poses(np.array(s))


# ---------------------------------------------------------------- one motion


@given(piece=PIECES)
@fast
def test_a_piece_begins_and_ends_where_it_says(piece: Piece) -> None:
    assert at(piece, 0.0)[0] == pytest.approx(piece.start, abs=1e-12)
    assert at(piece, 1.0)[0] == pytest.approx(piece.end, abs=1e-9)
    assert piece.end.theta - piece.start.theta == pytest.approx(piece.turn, abs=1e-12)


@given(piece=PIECES)
@fast
def test_poses_move_along_the_tangent(piece: Piece) -> None:
    h = 1e-5
    s = FINE[1:-1]
    slope = (piece.poses(s + h) - piece.poses(s - h)) / (2 * h)
    path = piece.body_path(s)
    c, d = np.cos(path.heading), np.sin(path.heading)
    vx, vy, omega = path.tangent.T
    assert np.column_stack([c * vx - d * vy, d * vx + c * vy, omega]) == pytest.approx(slope, abs=1e-6)


@given(piece=PIECES)
@fast
def test_tangents_change_by_their_derivative(piece: Piece) -> None:
    h = 1e-5
    s = FINE[1:-1]
    slope = (piece.body_path(s + h).tangent - piece.body_path(s - h).tangent) / (2 * h)
    assert piece.body_path(s).tangent_derivative == pytest.approx(slope, abs=1e-6)


@given(piece=PIECES)
@fast
def test_heading_of_the_body_path_is_that_of_the_poses(piece: Piece) -> None:
    path = piece.body_path(FINE)
    assert path.s == pytest.approx(FINE)
    assert path.heading == pytest.approx(piece.poses(FINE)[:, 2], abs=1e-12)


@given(piece=PIECES)
@fast
def test_length_is_the_way_of_the_body_origin(piece: Piece) -> None:
    steps = np.diff(piece.poses(np.linspace(0.0, 1.0, 2001))[:, :2], axis=0)
    assert piece.length == pytest.approx(np.hypot(*steps.T).sum(), rel=1e-5, abs=1e-9)


def test_a_quarter_turn_to_the_left_ends_a_radius_ahead_and_a_radius_to_the_left() -> None:
    piece = TwistPiece(Pose(1.0, 2.0, math.pi / 2), Twist(math.pi, 0.0, math.pi / 2))
    assert piece.end == pytest.approx((-1.0, 4.0, math.pi))
    assert at(piece, 0.5)[0] == pytest.approx((1.0 - 2 + math.sqrt(2), 2 + math.sqrt(2), 0.75 * math.pi))


def test_a_line_does_not_shorten_its_turn() -> None:
    piece = LinePiece(Pose(0.0, 0.0, 0.0), Pose(1.0, 0.0, 9.0))
    assert piece.turn == 9.0
    assert at(piece, 0.5)[0] == pytest.approx((0.5, 0.0, 4.5))


# ---------------------------------------------------------------- cutting and joining


def part(piece: Piece, a: float, b: float) -> Piece:
    """The piece between s = a and s = b, in closed form."""
    if isinstance(piece, LinePiece):
        p, q = np.array(piece.start), np.array(piece.end)
        return LinePiece(*(Pose(*(p + s * (q - p)).tolist()) for s in (a, b)))
    start = compose(piece.start, exp(Twist(*(a * v for v in piece.twist))))
    return TwistPiece(start, Twist(*((b - a) * v for v in piece.twist)))


@given(piece=PIECES, cuts=st.lists(SHARES, min_size=1, max_size=4, unique=True))
@fast
def test_parts_merge_to_the_whole(piece: Piece, cuts: list[float]) -> None:
    if piece.length + abs(piece.turn) < 0.1:
        return
    ends = [0.0, *sorted(cuts), 1.0]
    if min(np.diff(ends)) < 1e-3:
        return
    whole = merge(part(piece, a, b) for a, b in pairwise(ends))
    assert len(whole) == 1
    assert whole[0].poses(FINE) == pytest.approx(piece.poses(FINE), abs=1e-8)


@given(start=POSES, twists=st.lists(TWISTS, min_size=1, max_size=6))
@fast
def test_merging_keeps_where_the_path_goes(start: Pose, twists: list[Twist]) -> None:
    pieces: list[Piece] = []
    for twist in twists:
        pieces.append(TwistPiece(start, twist))
        start = pieces[-1].end
    merged = merge(pieces)
    assert len(merged) <= len(pieces)
    assert sum(p.length for p in merged) == pytest.approx(sum(p.length for p in pieces), abs=1e-6)
    assert sum(p.turn for p in merged) == pytest.approx(sum(p.turn for p in pieces), abs=1e-6)
    if merged:
        assert merged[0].start == pytest.approx(pieces[0].start, abs=1e-6)
        assert merged[-1].end == pytest.approx(pieces[-1].end, abs=1e-6)


def test_merging_drops_what_does_not_move() -> None:
    here, there = Pose(0.0, 0.0, 0.5), Pose(1.0, 0.0, 0.5)
    still = (TwistPiece(here, Twist(0.0, 0.0, 0.0)), LinePiece(here, here))
    assert merge(still) == ()
    move = LinePiece(here, there)
    assert merge((*still, move, LinePiece(there, there))) == (move,)


def test_a_cusp_and_a_kink_are_not_merged_away() -> None:
    here = Pose(0.0, 0.0, 0.5)
    ahead = TwistPiece(here, Twist(1.0, 0.0, 0.3))
    back = TwistPiece(ahead.end, Twist(-1.0, 0.0, -0.3))
    on = TwistPiece(ahead.end, Twist(1.0, 0.0, -0.3))
    line = LinePiece(here, Pose(1.0, 0.0, 0.5))
    corner = LinePiece(line.end, Pose(1.0, 1.0, 0.5))
    pivot = TwistPiece(ahead.end, Twist(0.0, 0.0, 1.0))
    paths: list[Path] = [(ahead, back), (ahead, on), (line, corner), (ahead, pivot)]
    for path in paths:
        assert merge(path) == path


def test_turns_on_the_spot_are_what_they_come_to() -> None:
    here = Pose(1.0, 2.0, 0.5)
    there = TwistPiece(here, Twist(0.0, 0.0, 0.4))
    back = TwistPiece(there.end, Twist(0.0, 0.0, -0.3))
    (one,) = merge((there, back))
    assert one.turn == pytest.approx(0.1)
    assert merge((there, TwistPiece(there.end, Twist(0.0, 0.0, -0.4)))) == ()


@given(start=POSES, twists=st.lists(TWISTS, min_size=1, max_size=6), straight=st.booleans())
@fast
def test_steps_say_all_of_a_path(start: Pose, twists: list[Twist], straight: bool) -> None:
    path = as_path(np.array(start), np.array(twists), straight)
    begin, steps, kind = as_steps(path)
    assert len(begin) == len(steps) == len(path)
    if path:
        assert kind is straight
        again = as_path(begin[0], steps, straight)
        assert as_steps(again)[0] == pytest.approx(begin, abs=1e-9)
        assert again[-1].end == pytest.approx(path[-1].end, abs=1e-9)
