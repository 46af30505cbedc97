"""Shortest curves of bounded curvature between two poses: Dubins and Reeds–Shepp words, as segments.

A word is a sequence of at most five segments (curvature, signed length): an arc to the left (L, curvature
1/radius), to the right (R, -1/radius) or a straight (S, 0), driven forwards (+) or backwards (-).

The kernels measure lengths in turning radii and take the goal as (x, y, phi) in the frame of the start: x
forward, y left, phi counter-clockwise in rad. First and last arcs go up to 2π; inner arcs take the smaller of
their two values.

Derivation, in the complex plane. An arc of curvature k through z, heading h, turns about z + i·k·e^{ih}. So
at a joint of heading h a change of curvature to k' moves the centre by i·(k' - k)·e^{ih}, and a straight of
signed length d moves it by d·e^{ih}. Together they carry the first centre, i·k1, to the last, x + i·y +
i·kn·e^{i·phi}. The modulus of this difference D gives the length u in the word's middle, its argument the
heading h of the first joint, hence the first arc t, and phi the last arc v.

Nine base words, starting L+, are solved so; swapping left and right, forwards and backwards, or the order of
travel makes the others of Reeds and Shepp (1990, §8). Dubins (1957) keeps the words without a minus and adds
one more, whose middle arc exceeds π.
"""

from __future__ import annotations

import math

import numpy as np

from planner.kernels import kernel

__all__ = [
    "DUBINS",
    "DUBINS_END",
    "REEDS_SHEPP",
    "REEDS_SHEPP_END",
    "SEGMENTS",
    "shortest",
    "solve_word",
    "word_reaches",
    "word_segment",
]

_TWO_PI = 2 * math.pi
# Rounding turns an arc of zero into one of nearly 2π: arcs (rad) and straights (radii) below _SNAP are zero.
# What this moves the end by, 3·_SNAP of the distance at most, is within what a word may miss its goal by.
_SNAP = 1e-10
_MISS = 1e-9
# On the edge of a word's region u would be the root of a rounding error: squares, cosines so near are on it.
_EDGE = 1e-13
# Equal lengths differ by rounding, and so do positions: by less than this they are equal.
_TIE = 1e-12

_LSL, _LSR, _LRL, _LRBL, _LRLR, _LRLR_INNER, _LRSL, _LRSR, _LRSLR, _LRL_LONG = range(10)
# Every segment's turn, direction and length: t, u, v are solved for, q is π/2.
_BASE = (
    "L+t S+u L+v",  # 8.1
    "L+t S+u R+v",  # 8.2
    "L+t R-u L+v",  # 8.3
    "L+t R-u L-v",  # 8.4
    "L+t R+u L-u R-v",  # 8.7
    "L+t R-u L-u R+v",  # 8.8
    "L+t R-q S-u L-v",  # 8.9
    "L+t R-q S-u R-v",  # 8.10
    "L+t R-q S-u L-q R+v",  # 8.11
    "L+t R+u L+v",  # Dubins
)
_SWAPS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
# One row a word: its base, then -1 if direction, side, order of travel are swapped. Dubins' six come first,
# and the 48 start among them. Swapping the order makes new words of 8.4, 8.9, 8.10 only.
_ROWS = np.array(
    [(base, 1, side, 1) for base in (_LRL_LONG, _LSL, _LSR) for side in (1, -1)]
    + [(base, -1, side, 1) for base in (_LSL, _LSR) for side in (1, -1)]
    + [(base, *swap, 1) for base in range(_LRL, _LRL_LONG) for swap in _SWAPS]
    + [(base, *swap, -1) for base in (_LRBL, _LRSL, _LRSR) for swap in _SWAPS]
)
DUBINS, DUBINS_END, REEDS_SHEPP, REEDS_SHEPP_END, SEGMENTS = 0, 6, 2, len(_ROWS), 5

# Of every row's segments the curvature, (50, 5), and the length's coefficients of t, u, v, π/2, (50, 5, 4).
_CURVATURE, _COEFFICIENT = np.zeros((len(_ROWS), 5)), np.zeros((len(_ROWS), 5, 4))
# Of every base, (10, 6): the last curvature; the sense of the last arc, left or right; then the coefficients
# of u and π/2 in the distance, and in the turn, from the first joint to the last.
_SHAPE = np.zeros((len(_BASE), 6))


def _fill_tables() -> None:
    words = [
        [("RSL".index(k) - 1, 1 if d == "+" else -1, "tuvq".index(n)) for k, d, n in map(tuple, word.split())]
        for word in _BASE
    ]
    for row, (base, direction, side, order) in enumerate(_ROWS.tolist()):
        for i, (turn, sign, part) in enumerate(words[base][::order]):
            _CURVATURE[row, i] = side * turn
            _COEFFICIENT[row, i, part] = direction * sign
    for base, (_, *inner, (turn_last, sign_last, _)) in enumerate(words):
        _SHAPE[base, :2] = turn_last, turn_last * sign_last
        for turn, sign, part in inner:
            _SHAPE[base, [2, 4] if part == 1 else [3, 5]] += 1, turn * sign


_fill_tables()


@kernel
def _arc(angle: float) -> float:
    """The angle in [0, 2π), zero where it is zero but for rounding."""
    angle -= _TWO_PI * math.floor(angle / _TWO_PI)
    return 0.0 if angle < _SNAP or angle > _TWO_PI - _SNAP else angle


@kernel
def _root(square: float) -> float:
    """The square root, zero where the square is zero but for rounding, NaN where it is negative."""
    return 0.0 if abs(square) < 4 * _EDGE else float(np.sqrt(square))


@kernel
def _acos(cosine: float) -> float:
    """The arc cosine, zero where the cosine is one but for rounding, NaN where it is above."""
    return 0.0 if abs(1 - cosine) < _EDGE else float(np.arccos(cosine))


@kernel
def solve_word(
    row: int, x: float, y: float, phi: float, s: float, c: float, bound: float
) -> tuple[float, float, float, float]:
    """(length, t, u, v) of a word, s and c being sin and cos of phi; length inf where none is below bound."""
    base, direction, side = _ROWS[row, 0], _ROWS[row, 1], _ROWS[row, 2]
    if _ROWS[row, 3] < 0:
        x, y = x * c + y * s, x * s - y * c
    x, y = direction * x, side * y
    phi, s = direction * side * phi, direction * side * s
    k_last, sense, distance_u, distance_q, turn_u, turn_q = _SHAPE[base]
    d_x, d_y = x - k_last * s, y + k_last * c - 1
    square = d_x * d_x + d_y * d_y
    rho = math.sqrt(square)

    # The modulus of D gives u; angle is h less the argument of D.
    if base == _LSL:  # D = u·e^{ih}
        u, angle = rho, 0.0
    elif base == _LSR:  # D = (u - 2i)·e^{ih}
        u = _root(square - 4)
        angle = math.atan2(2.0, u)
    elif base in (_LRL, _LRBL):  # D = -4·sin(u/2)·e^{i(h + u/2)}
        u = math.pi - 2 * _acos(rho / 4)
        angle = math.pi - u / 2
    elif base == _LRL_LONG:  # D = 4·sin(u/2)·e^{i(h - u/2)}
        u = math.pi + 2 * _acos(rho / 4)
        angle = u / 2
    elif base == _LRLR:  # D = 2i·(1 - 2·cos u)·e^{i(h - u)}; of the two u the shorter
        u = _acos((2 + rho) / 4)
        angle = math.pi / 2 + u
    elif base == _LRLR_INNER:  # D = 2i·(e^{iu} - 2)·e^{ih}
        u = _acos((20 - square) / 16)
        angle = -math.pi / 2 - math.atan2(math.sin(u), math.cos(u) - 2)
    elif base == _LRSR:  # D = -(u + 2)·e^{i(h + π/2)}
        u = rho - 2
        angle = math.pi / 2
    else:  # D = (2i - u - 2)·e^{i(h + π/2)}, and 2 more beside u where there is another quarter turn
        leg = _root(square - 4)
        u = leg - 2 * distance_q
        angle = -math.atan2(2.0, -leg) - math.pi / 2
    distance = distance_u * u + distance_q * (math.pi / 2)
    if not (u > -_SNAP and distance < bound):  # u is NaN where there is no word
        return math.inf, 0.0, 0.0, 0.0
    if u < _SNAP:
        u = 0.0

    h = math.atan2(d_y, d_x) + angle
    if base == _LSL:
        # The argument of a short D is rounding. If the position cannot tell h from the start's or the goal's
        # heading, it is that one.
        if rho * abs(h) < _TIE:
            h = 0.0
        elif rho * abs(math.sin((h - phi) / 2)) < _TIE and math.cos(h - phi) > 0:
            h = phi
    t = _arc(h)
    v = _arc(sense * (phi - h - turn_u * u - turn_q * (math.pi / 2)))
    length = t + distance + v
    return (length if length < bound else math.inf), t, u, v


@kernel
def word_segment(row: int, i: int, word: tuple[float, float, float, float]) -> tuple[float, float]:
    """Curvature and signed length of the i-th of its SEGMENTS."""
    of = _COEFFICIENT[row, i]
    _, t, u, v = word
    return _CURVATURE[row, i], of[0] * t + of[1] * u + of[2] * v + of[3] * (math.pi / 2)


@kernel
def word_reaches(
    row: int, word: tuple[float, float, float, float], x: float, y: float, s: float, c: float
) -> bool:
    """Whether the word, rolled out segment by segment, ends at the goal."""
    x_end, y_end, heading, s_end, c_end = 0.0, 0.0, 0.0, 0.0, 1.0
    for i in range(SEGMENTS):
        curvature, length = word_segment(row, i, word)
        if curvature == 0:
            x_end, y_end = x_end + length * c_end, y_end + length * s_end
        else:
            heading += curvature * length
            s_next, c_next = math.sin(heading), math.cos(heading)
            x_end, y_end = x_end + curvature * (s_next - s_end), y_end - curvature * (c_next - c_end)
            s_end, c_end = s_next, c_next
    error = abs(x_end - x) + abs(y_end - y) + abs(s_end - s) + abs(c_end - c)
    return error <= _MISS * (1 + abs(x) + abs(y))


@kernel
def shortest(x: float, y: float, phi: float, reverse: bool) -> tuple[int, tuple[float, float, float, float]]:
    """Row and word of the shortest; inf and NaN where there is none."""
    row, best = 0, (math.inf, math.nan, math.nan, math.nan)
    s, c = math.sin(phi), math.cos(phi)
    for k in range(REEDS_SHEPP if reverse else DUBINS, REEDS_SHEPP_END if reverse else DUBINS_END):
        word = solve_word(k, x, y, phi, s, c, best[0] - _TIE)
        if word[0] < math.inf and word_reaches(k, word, x, y, s, c):
            row, best = k, word
    return row, best
