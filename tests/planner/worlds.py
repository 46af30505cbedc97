"""Whether what may be driven is free, asked one by one of the kernels that a search asks."""

from __future__ import annotations

from drives.se2 import Pose, Twist
from planner.environment import CollisionWorld
from planner.path import LinePiece, Path
from planner.sweep import linear_free, twist_free


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
