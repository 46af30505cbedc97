"""Ways between two poses on arcs whose radii fit: no arc of a given radius leads through a passage that is
bent otherwise. Compiled.

Every way is a few twists, held in turn: one arc and a straight, in either order (if the straight is empty, a
single arc); two arcs of one radius that bend opposite ways; for robots that turn on the spot, an arc with
such a turn before or after it; for holonomic robots, one twist (a screw motion).
"""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array
from planner.edges import CURVE, LINE, PIVOT, Law, duration, ways_between
from planner.kernels import kernel

__all__ = ["FITS", "all_ways", "fit", "fitted"]

FITS, _STEPS = 16, 2
"""Ways at most, and twists of each."""
_TINY = 1e-9
"""Sines, and shares of a way, that are zero but for rounding."""


@kernel
def fitted(law: Law, a: Array, b: Array) -> tuple[Array, Array]:
    """Times (n, FITS) s, inf if there is no such way, and steps (n, FITS, 2, 3) of ways from poses a (n, 3)
    to b whose radii fit: see Motions. Radii are at least the law's."""
    times, steps = np.empty((len(a), FITS)), np.zeros((len(a), FITS, _STEPS, 3))
    for i in range(len(a)):
        fit(law, a[i], b[i], times[i], steps[i])
    return times, steps


@kernel
def fit(law: Law, a: Array, b: Array, times: Array, steps: Array) -> None:
    """The ways from one pose (3,) to another, into times (FITS,) and steps (FITS, 2 or more, 3), all zero."""
    times[:] = np.inf
    timed = law
    if law.kind == LINE:  # its steps are displacements, these are twists
        timed = Law(
            PIVOT, law.reverse, law.flows, law.radius, law.pace, law.speed, law.push, law.lean, law.slowness,
            law.reversal,
        )  # fmt: skip
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[0] - a[0], b[1] - a[1]
    turn = math.pi - (math.pi - (b[2] - a[2])) % math.tau
    count = _ways(law.kind, c * dx + s * dy, c * dy - s * dx, turn, steps)
    for way in range(count):
        if _is_allowed(steps[way], law.radius, law.kind == CURVE, law.reverse):
            first, last = steps[way, 0].any(), steps[way, 1].any()
            time = duration(timed, a[2], steps[way, int(not first) : 1 + int(last)])
            # A single arc is each of the other kinds, too.
            times[way] = np.inf if np.abs(times - time).min() <= _TINY * time else time


@kernel
def all_ways(law: Law, a: Array, b: Array, few: int, times: Array, steps: Array) -> None:
    """The `few` quickest ways from a pose (3,) to another, see planner.edges, and if there is room for FITS
    more, those whose radii fit, into times (ways,) and steps (ways, SEGMENTS, 3)."""
    ways_between(law, a, b, times[:few], steps[:few])
    if len(times) > few:
        times[few:], steps[few:] = np.inf, 0.0
        if law.kind != LINE:
            fit(law, a, b, times[few:], steps[few:])


@kernel
def _is_allowed(steps: Array, radius: float, drives: bool, reverse: bool) -> bool:
    """Whether twists keep to a turning radius, turn on the spot only if they need not drive, and go forwards
    if they must."""
    moves = False
    for k in range(len(steps)):
        vx, _, turn = steps[k]
        if not (abs(turn) < 2 * math.tau and abs(vx) < np.inf):
            return False
        if (not reverse and vx < 0.0) or (drives and abs(turn) * radius > abs(vx) * (1 + _TINY)):
            return False
        moves |= vx != 0.0 or turn != 0.0
    return moves


@kernel
def _ways(kind: int, x: float, y: float, turn: float, steps: Array) -> int:
    """All ways to a pose (x, y, turn) in the frame of the start into steps (FITS, 2, 3), and how many."""
    n = 0
    distance = math.sqrt(x * x + y * y)
    if distance == 0.0:
        return n
    c, s = math.cos(turn), math.sin(turn)
    other = turn - math.copysign(math.tau, turn)
    # The lines of both headings meet `before` m after the start and `after` m before the goal.
    if abs(s) > _TINY:
        before, after = x - y * c / s, y / s
        if abs(before - after) < _TINY * distance:
            before = after = (before + after) / 2
        bend = math.tan(turn / 2)
        for angle in (turn, other):
            steps[n, 0, 0], steps[n, 0, 2], steps[n, 1, 0] = before * angle / bend, angle, after - before
            n += 1
            steps[n, 0, 0], steps[n, 1, 0], steps[n, 1, 2] = before - after, after * angle / bend, angle
            n += 1
    n = _two_arcs(x, y, turn, c, s, steps, n)
    if kind == LINE:
        for angle in (turn, other):
            _screw(x, y, angle, steps[n])
            n += 1
    if kind == PIVOT:
        course = math.atan2(y, x)
        for backwards in (0.0, math.pi):
            chord = course + backwards
            sign = 1.0 - 2.0 * (backwards > 0.0)
            # An arc from heading h to h + 2·half has its chord at h + half.
            for half in (_wrapped(chord), _wrapped(turn - chord)):
                if abs(half) > (1 - 1e-3) * math.pi:
                    continue
                length = sign * distance / _sinc(half)
                last = _wrapped(turn - 2 * half) if half == _wrapped(chord) else 0.0
                first = 0.0 if half == _wrapped(chord) else _wrapped(chord - half)
                k = int(first != 0.0)
                steps[n, 0, 2] = first
                steps[n, k, 0], steps[n, k, 2] = length, 2 * half
                if k == 0:
                    steps[n, 1, 2] = last
                n += 1
    return n


@kernel
def _two_arcs(x: float, y: float, turn: float, c: float, s: float, steps: Array, n: int) -> int:
    """Two arcs of one radius that bend opposite ways, each the short way round, or one of them the long."""
    # With m the sum of both left normals, the centres are d - side·r·m apart: 2r.
    mx, my, square = -s, 1.0 + c, x * x + y * y
    for side in (1.0, -1.0):
        p, q = 4.0 - mx * mx - my * my, side * (x * mx + y * my)
        root = math.sqrt(q * q + p * square)
        if not q + root > 0.0:
            continue
        r = square / (q + root)
        # The second centre, seen from the first, and the headings at the start, the joint and the goal.
        joint = math.atan2(y - side * r * my, x - side * r * mx) + side * math.pi / 2
        first = _wrapped(joint)
        last = _wrapped(turn - joint)
        for k in range(3):
            one = first - math.copysign(math.tau, first) if k == 1 else first
            two = last - math.copysign(math.tau, last) if k == 2 else last
            steps[n, 0, 0], steps[n, 0, 2] = side * r * one, one
            steps[n, 1, 0], steps[n, 1, 2] = -side * r * two, two
            n += 1
    return n


@kernel
def _screw(x: float, y: float, turn: float, steps: Array) -> None:
    """The twist that leads there when it is held, into steps (2, 3)."""
    half = turn / 2
    c, s, scale = math.cos(half), math.sin(half), 1 / _sinc(half)
    steps[0, 0], steps[0, 1], steps[0, 2] = scale * (c * x + s * y), scale * (c * y - s * x), turn


@kernel
def _sinc(angle: float) -> float:
    return math.sin(angle) / angle if abs(angle) > 1e-9 else 1.0


@kernel
def _wrapped(angle: float) -> float:
    """The same angle in (-π, π], zero if it is only rounding."""
    inside = math.pi - (math.pi - angle) % math.tau
    return 0.0 if abs(inside) < _TINY else inside
