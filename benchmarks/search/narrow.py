"""Generated narrow passages and parking slots: rectangles between walls, sized by the robot."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.search.mobilities import Mobility
from drives.se2 import Array, Pose
from planner.problem import Bounds, Environment, Polygon

__all__ = ["Made", "passage", "slot"]

Made = tuple[Environment, Pose, Pose, tuple[Pose, ...]]
"""Where, the start, the goal, and poses on a way between them: with these in hand it is easily found."""

_TIGHT, _WIDE = 0.04, 0.12
"""What a passage is wider than the footprint (m), in all."""


def passage(mobility: Mobility, random: np.random.Generator) -> Made:
    """A corridor between two rooms, one with a right angle in it, or a dead end to be left backwards."""
    kinds = (_corridor, _corner, _dead_end) if mobility.options.reverse else (_corridor, _corner)
    return kinds[int(random.integers(len(kinds)))](mobility, random)


def slot(mobility: Mobility, random: np.random.Generator) -> Made:
    """A goal in a row of parked robots: along the kerb, or at a right angle to it."""
    return (_parallel, _perpendicular)[int(random.integers(2))](mobility, random)


def _box(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    return Polygon(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))


def _middle(mobility: Mobility) -> float:
    """Where the footprint's middle is, ahead of the origin."""
    x = mobility.outline[:, 0]
    return float(x.min() + x.max()) / 2


def _behind(mobility: Mobility, x: float, y: float) -> Pose:
    """About to enter a corridor along x that begins at (x, y)."""
    return Pose(x - float(mobility.outline[:, 0].max()) - 0.02, y, 0.0)


def _past(mobility: Mobility, x: float, y: float) -> Pose:
    """Just out of a corridor along x that ends at (x, y)."""
    return Pose(x - float(mobility.outline[:, 0].min()) + 0.02, y, 0.0)


def _heading(random: np.random.Generator) -> float:
    return float(random.uniform(-math.pi, math.pi))


def _corridor(mobility: Mobility, random: np.random.Generator) -> Made:
    """Two rooms, and a corridor along x somewhere in the wall between them."""
    gap = mobility.width + float(random.uniform(_TIGHT, _WIDE))
    room, long = 2 * mobility.room_to_turn() + 1.0, float(random.uniform(0.3, 2.5))
    high = float(random.uniform(0.25, 0.75)) * room
    walls = (
        _box(room, 0.0, room + long, high - gap / 2),
        _box(room, high + gap / 2, room + long, room),
    )
    starts, goals = (float(v) for v in random.uniform(0.3, 0.7, 2) * room)
    return (
        Environment(Bounds(0.0, 0.0, 2 * room + long, room), walls),
        Pose(room / 2, starts, _heading(random)),
        Pose(1.5 * room + long, goals, _heading(random)),
        (_behind(mobility, room, high), _past(mobility, room + long, high)),
    )


def _corner(mobility: Mobility, random: np.random.Generator) -> Made:
    """A corridor along x into a small room, and one along y out of it; open rooms at both ends."""
    gap = mobility.width + float(random.uniform(_TIGHT, _WIDE))
    turn, room = mobility.room_to_turn(), 2 * mobility.room_to_turn() + 1.0
    long = float(random.uniform(0.5, 1.5))
    x0, x1 = room + long, room + long + turn  # of the small room, y from 0 to turn
    y0, y1 = turn + long, turn + long + room  # of the room that its corridor leads up to
    # Who pivots does so in the room's middle; a curve needs the room inside the turn.
    share = 1 / 2 if mobility.pivots else 1 / 4
    low, right = share * turn, x1 - share * turn
    side = max(room, y1)
    walls = (
        _box(room, low + gap / 2, x0, side),
        _box(room, 0.0, x0, low - gap / 2),
        _box(x0, turn, right - gap / 2, y0),
        _box(right + gap / 2, turn, x1 + room, y0),
        _box(x1, 0.0, x1 + room, turn),
    )
    tail = float(mobility.outline[:, 0].min()) - 0.02
    start, end = Pose(right - mobility.radius, low, 0.0), Pose(right, low + mobility.radius, math.pi / 2)
    turning = (Pose(right, low, 0.0), Pose(right, low, math.pi / 2)) if mobility.pivots else (start, end)
    return (
        Environment(Bounds(0.0, 0.0, x1 + room, side), walls),
        Pose(room / 2, room / 2, _heading(random)),
        Pose(x0 + room / 2, y0 + room / 2, _heading(random)),
        (_behind(mobility, room, low), *turning, Pose(right, y0 - tail, math.pi / 2)),
    )


def _dead_end(mobility: Mobility, random: np.random.Generator) -> Made:
    """A corridor with one end, in which the start is, nose in; the goal faces away from it."""
    gap = mobility.width + float(random.uniform(_TIGHT, _WIDE))
    room, long = 2 * mobility.room_to_turn() + 1.0, float(random.uniform(1.0, 3.0)) + mobility.length
    high = float(random.uniform(0.3, 0.7)) * room
    walls = (
        _box(room, 0.0, room + long, high - gap / 2),
        _box(room, high + gap / 2, room + long, room),
    )
    nose = float(mobility.outline[:, 0].max())
    return (
        Environment(Bounds(0.0, 0.0, room + long, room), walls),
        Pose(room + long - nose - 0.05, high, 0.0),
        Pose(room / 2, float(random.uniform(0.3, 0.7)) * room, math.pi),
        (_behind(mobility, room, high),),
    )


def _parallel(mobility: Mobility, random: np.random.Generator) -> Made:
    """Parked robots in a line along the kerb, one missing."""
    deep, length = mobility.width + 0.1, mobility.length
    spare = float(random.uniform(0.45, 0.8)) * length if mobility.options.reverse else 2.5 * mobility.radius
    return _parked(mobility, random, length + spare, deep, 0.0)


def _perpendicular(mobility: Mobility, random: np.random.Generator) -> Made:
    """Parked robots side by side, one missing, to be entered forwards or backwards."""
    wide, deep = mobility.width + float(random.uniform(0.1, 0.3)), mobility.length + 0.1
    backwards = mobility.options.reverse and random.random() < 0.5
    return _parked(mobility, random, wide, deep, math.pi / 2 if backwards else -math.pi / 2)


def _parked(
    mobility: Mobility, random: np.random.Generator, wide: float, deep: float, heading: float
) -> Made:
    """A slot (wide, deep) below a street, its neighbours full; the goal in its middle at a heading."""
    street = float(random.uniform(1.0, 1.4)) * mobility.room_to_turn() + mobility.width
    side = 3.0 + 2 * mobility.length
    neighbours = (_box(0.0, 0.0, side, deep), _box(side + wide, 0.0, 2 * side + wide, deep))
    middle: Array = np.array([side + wide / 2, deep / 2])
    x, y = middle - _middle(mobility) * np.array([math.cos(heading), math.sin(heading)])
    first = float(random.uniform(0.3, 0.6)) * side
    return (
        Environment(Bounds(0.0, 0.0, 2 * side + wide, deep + street), neighbours),
        Pose(first, deep + street / 2, float(random.uniform(-0.3, 0.3))),
        Pose(float(x), float(y), heading),
        () if heading == 0.0 else (Pose(float(x), float(y) + mobility.length + 0.1, heading),),
    )
