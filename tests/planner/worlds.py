"""A room, shapes to put into it, and whether what may be driven there is free, by a search's kernels."""

from __future__ import annotations

import math

import numpy as np

from drives.se2 import Array, Pose, Twist
from planner.environment import CollisionWorld
from planner.path import LinePiece, Path
from planner.polygon import check_simple_polygon
from planner.problem import Bounds, Footprint, Polygon
from planner.sweep import linear_free, twist_free

ROOM = Bounds(-5.0, -4.0, 5.0, 4.0)


def rectangle(length: float, width: float, offset: float = 0.0, radius: float = 0.0) -> Footprint:
    x, y = length / 2, width / 2
    return Footprint(np.array([[offset - x, -y], [offset + x, -y], [offset + x, y], [offset - x, y]]), radius)


def box(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    return Polygon(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=np.float64))


def star(rng: np.random.Generator, size: float, x: float = 0.0, y: float = 0.0) -> Array:
    """A simple polygon, mostly concave, of either winding."""
    while True:
        angle = np.sort(rng.uniform(0, 2 * math.pi, rng.integers(3, 10)))
        reach = size * rng.uniform(0.2, 1, len(angle))
        points = np.column_stack([x + reach * np.cos(angle), y + reach * np.sin(angle)])
        if check_simple_polygon(points) is None:
            return points[:: rng.choice([-1, 1])].copy()


def is_line_free(world: CollisionWorld, a: Pose, b: Pose) -> bool:
    return bool(linear_free(world.kernel, *map(float, (*a, *b))))


def is_twist_free(world: CollisionWorld, a: Pose, twist: Twist) -> bool:
    return bool(twist_free(world.kernel, *map(float, (*a, *twist))))


def is_path_free(world: CollisionWorld, path: Path) -> bool:
    return all(
        is_line_free(world, piece.start, piece.end)
        if isinstance(piece, LinePiece)
        else is_twist_free(world, piece.start, piece.twist)
        for piece in path
    )
