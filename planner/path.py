"""A path of the body: pieces q(s), s in [0, 1], cut where the robot must stop."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import add, sub
from typing import Protocol

import numpy as np

from drives.drive import BodyPath
from drives.se2 import Array, Pose, Twist, compose, exp
from planner.kernels import kernel

__all__ = [
    "Curve",
    "LinePiece",
    "Path",
    "Piece",
    "TwistPiece",
    "as_path",
    "as_steps",
    "merge",
]

_SAME_DIRECTION = 1e-9
_NOTHING = 1e-12


@dataclass(frozen=True, slots=True)
class TwistPiece:
    """A constant body twist held for s in [0, 1]: an arc, a straight line, or a turn on the spot."""

    start: Pose
    twist: Twist

    @property
    def end(self) -> Pose:
        return compose(self.start, exp(self.twist))

    @property
    def length(self) -> float:
        """Way of the body origin, m."""
        return math.hypot(self.twist.vx, self.twist.vy)

    @property
    def turn(self) -> float:
        """Change of heading, rad."""
        return self.twist.omega

    def poses(self, s: Array) -> Array:
        """Poses (n, 3) in the world frame at s (n,)."""
        made: Array = _twist_poses(*self.start, *self.twist, s)
        return made

    def body_path(self, s: Array) -> BodyPath:
        tangent = np.empty((len(s), 3))
        tangent[:] = self.twist
        return BodyPath(s, self.start.theta + self.twist.omega * s, tangent, np.zeros((len(s), 3)))


@dataclass(frozen=True, slots=True)
class LinePiece:
    """A straight line of the body origin in the world, the heading changing in proportion (OMPL's SE(2)
    edge).

    start.theta and end.theta are unwrapped: the turn is their difference.
    """

    start: Pose
    end: Pose

    @property
    def length(self) -> float:
        return math.hypot(self.end.x - self.start.x, self.end.y - self.start.y)

    @property
    def turn(self) -> float:
        return self.end.theta - self.start.theta

    def poses(self, s: Array) -> Array:
        a, b = np.array(self.start), np.array(self.end)
        poses: Array = a + np.multiply.outer(s, b - a)
        return poses

    def body_path(self, s: Array) -> BodyPath:
        dx, dy = self.end.x - self.start.x, self.end.y - self.start.y
        return BodyPath(s, *_line_path(self.start.theta, dx, dy, self.turn, s))


@kernel
def _twist_poses(x: float, y: float, theta: float, vx: float, vy: float, omega: float, s: Array) -> Array:
    """Poses (n, 3) after holding a twist for s (n,)."""
    found = np.empty((len(s), 3))
    for i in range(len(s)):
        half = omega * s[i] / 2
        chord = s[i] * (math.sin(half) / half if half != 0.0 else 1.0)
        c, d = math.cos(theta + half), math.sin(theta + half)
        found[i, 0], found[i, 1] = x + chord * (c * vx - d * vy), y + chord * (d * vx + c * vy)
        found[i, 2] = theta + omega * s[i]
    return found


@kernel
def _line_path(theta: float, dx: float, dy: float, turn: float, s: Array) -> tuple[Array, Array, Array]:
    """Headings (n,), tangents and their derivatives (n, 3) along a line in the world, the heading from theta
    on gaining turn."""
    heading, tangent, change = np.empty(len(s)), np.empty((len(s), 3)), np.empty((len(s), 3))
    for i in range(len(s)):
        heading[i] = theta + turn * s[i]
        c, d = math.cos(heading[i]), math.sin(heading[i])
        vx, vy = c * dx + d * dy, c * dy - d * dx
        tangent[i, 0], tangent[i, 1], tangent[i, 2] = vx, vy, turn
        change[i, 0], change[i, 1], change[i, 2] = turn * vy, -turn * vx, 0.0
    return heading, tangent, change


Piece = TwistPiece | LinePiece
Path = tuple[Piece, ...]


class Curve(Protocol):
    """What is driven without a stop: any curve q(s), s in [0, 1]."""

    @property
    def start(self) -> Pose:
        """Where it begins, world frame."""

    def poses(self, s: Array) -> Array:
        """Poses (n, 3) in the world frame at s (n,)."""

    def body_path(self, s: Array) -> BodyPath:
        """Tangents in the body frame and their derivatives at s (n,)."""


def merge(pieces: Iterable[Piece]) -> Path:
    """The same path without empty pieces, and with neighbours joined where the motion simply goes on; turns
    on the spot, one after the other, are what they come to."""
    out: list[Piece] = []
    for piece in pieces:
        joined = _join(out[-1], piece) if out else None
        if joined is not None:
            out.pop()
        piece = joined or piece
        if piece.length >= _NOTHING or abs(piece.turn) >= _NOTHING:
            out.append(piece)
    return tuple(out)


def _join(a: Piece, b: Piece) -> Piece | None:
    """One piece for both, if the direction of the tangent in the body frame does not change between them."""
    if (
        isinstance(a, TwistPiece)
        and isinstance(b, TwistPiece)
        and ((a.length == b.length == 0.0) or _is_same(a.twist, b.twist))
    ):
        return TwistPiece(a.start, Twist(*map(add, a.twist, b.twist)))
    if isinstance(a, LinePiece) and isinstance(b, LinePiece) and _is_same(_step(a), _step(b)):
        return LinePiece(a.start, b.end)
    return None


def _is_same(u: Sequence[float], v: Sequence[float]) -> bool:
    """Whether two vectors point in the same direction."""
    p, q = math.hypot(*u), math.hypot(*v)
    if min(p, q) < _NOTHING:
        return False
    return math.dist([x / p for x in u], [x / q for x in v]) < _SAME_DIRECTION


def _step(piece: LinePiece) -> Pose:
    return Pose(*map(sub, piece.end, piece.start))


def as_steps(path: Path) -> tuple[Array, Array, bool]:
    """Where the pieces of a path begin (n, 3), what they do (n, 3), twists held for unit time or else
    displacements in the world, and whether it is these. All pieces are of the same kind."""
    straight = any(isinstance(piece, LinePiece) for piece in path)
    steps = [_step(piece) if isinstance(piece, LinePiece) else piece.twist for piece in path]
    start = [piece.start for piece in path]
    return np.array(start).reshape(-1, 3), np.array(steps).reshape(-1, 3), straight


def as_path(start: Array, steps: Array, straight: bool) -> Path:
    """The path of steps (n, 3), see as_steps, from a pose (3,)."""
    pieces: list[Piece] = []
    pose = Pose(*start.tolist())
    for step in steps.tolist():
        if straight:
            pieces.append(LinePiece(pose, Pose(*map(add, pose, step))))
        else:
            pieces.append(TwistPiece(pose, Twist(*step)))
        pose = pieces[-1].end
    return merge(pieces)
