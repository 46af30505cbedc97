"""Half-planes that part a convex footprint from convex obstacles, exactly."""

from __future__ import annotations

import numpy as np

from drives.se2 import Array
from planner.problem import Circle, Environment, Problem

__all__ = ["half_planes"]


def half_planes(problem: Problem, poses: Array, count: int, spare: float) -> Array:
    """Planes (n, count, 3) nx, ny, d: the obstacle or wall is clear of the footprint by `spare` (m) where
    n·vertex >= d at all of its vertices. Those of the nearest obstacles at each pose (n, 3)."""
    robot = problem.robot
    heading = poses[:, 2] if (fixed := robot.drive.fixed_body_heading) is None else np.full(len(poses), fixed)
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    vx, vy = robot.footprint.vertices.T
    body = np.stack([poses[:, :1] + c * vx - s * vy, poses[:, 1:2] + s * vx + c * vy], -1)
    margin = robot.footprint.radius + spare
    found = [_walls(problem.environment, body, margin)]
    for obstacle in problem.environment.obstacles:
        if isinstance(obstacle, Circle):
            vertices, radius = np.array([[obstacle.x, obstacle.y]]), obstacle.radius
        else:
            vertices, radius = obstacle.vertices, 0.0
        found.append(_parting(body, vertices, radius + margin)[:, None])
    every = np.concatenate(found, 1)
    gap = every[..., 3]
    nearest = np.argsort(gap, axis=1)[:, :count]
    planes: Array = np.take_along_axis(every, nearest[..., None], 1)[..., :3]
    return planes


def _walls(environment: Environment, body: Array, margin: float) -> Array:
    bounds = environment.bounds
    assert bounds is not None
    rows = np.array([[1.0, 0.0, bounds.x_min], [-1.0, 0.0, -bounds.x_max],
                     [0.0, 1.0, bounds.y_min], [0.0, -1.0, -bounds.y_max]])  # fmt: skip
    rows[:, 2] += margin
    gap = (body @ rows[:, :2].T).min(1) - rows[:, 2]
    return np.concatenate([np.broadcast_to(rows, (len(body), 4, 3)), gap[..., None]], -1)


def _parting(body: Array, obstacle: Array, margin: float) -> Array:
    """(n, 4) nx, ny, d and gap of the direction that parts them widest, or overlaps least. body (n, k, 2)."""
    n = len(body)
    between = (body[:, :, None] - obstacle).reshape(n, -1, 2)
    ways = [between, -between]
    if body.shape[1] > 1:
        ways += _normals(body)
    if len(obstacle) > 1:
        ways += [np.broadcast_to(w, (n, *w.shape)) for w in _normals(obstacle)]
    directions = np.concatenate(ways, 1)
    directions = directions / np.maximum(np.hypot(directions[..., 0], directions[..., 1]), 1e-9)[..., None]
    d = (directions @ obstacle.T).max(-1) + margin
    gap = np.einsum("nki,nji->njk", body, directions).min(-1) - d
    best = np.argmax(gap, 1)
    rows = np.arange(n)
    return np.column_stack([directions[rows, best], d[rows, best], gap[rows, best]])


def _normals(polygon: Array) -> list[Array]:
    edge = np.roll(polygon, -1, -2) - polygon
    normal = np.stack([edge[..., 1], -edge[..., 0]], -1)
    return [normal, -normal]
