"""The certificate's clearance against shapely, in random worlds, for random footprints and motions.

shapely measures the distance at many poses of the motion, which are integrated here from the twists. The
certificate states a lower bound: never more than shapely's smallest distance, and less by what
docs/certificate.md says at most.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from drives.drive import Holonomic, Limits
from drives.se2 import Array, Pose, Twist
from planner.environment import CollisionWorld
from planner.errors import AuditFailed
from planner.problem import (
    Bounds,
    Circle,
    Environment,
    Footprint,
    Goal,
    MapLayer,
    Options,
    Polygon,
    Problem,
    Robot,
)
from planner.schedule import WheelSchedule
from planner.tolerances import CLEARANCE_ACCURACY, CLEARANCE_SHARE
from planner.verify import verify
from tests.planner.schedules import drive_of
from tests.planner.worlds import star

_FINE = 24
"""Poses in every interval, and parts that shapely cuts the way between two of them into if need be."""


def motion(kind: str, rng: np.random.Generator) -> tuple[WheelSchedule, Array]:
    """A random motion of a drive with fixed wheels whose twists are linear between samples; and its poses
    (n, 3) at many instants."""
    drive = drive_of(kind)
    period, n = float(rng.choice([0.005, 0.02, 0.1])), int(rng.integers(8, 25))
    size = np.array([0.8, 0.5 * isinstance(drive.mobility(Limits(*np.ones((3, 1)))), Holonomic), 1.5])
    twist = rng.normal(size=(n, 3)) * size
    twist[[0, -1]] = 0.0
    time = np.arange(n) * period
    fine = (time[:-1, None] + np.linspace(0, period, _FINE, endpoint=False)).ravel()
    fine = np.append(fine, time[-1])
    along = np.stack([np.interp(fine, time, each) for each in twist.T], 1)
    step = fine[1]
    theta = np.append(0.0, np.cumsum(step * (along[1:, 2] + along[:-1, 2]) / 2)) + rng.uniform(-3, 3)
    c, s = np.cos(theta), np.sin(theta)
    velocity = np.stack([c * along[:, 0] - s * along[:, 1], s * along[:, 0] + c * along[:, 1]], 1)
    steps = step * (velocity[1:] + velocity[:-1]) / 2
    position = rng.uniform(-0.3, 0.3, 2) + np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    pose = np.column_stack([position, theta])
    rows = np.array([drive.inverse(Twist(*unit)).rates for unit in np.eye(3) * (size > 0)])
    rise = np.diff(twist, axis=0) / period
    gained = np.vstack([np.zeros(3), np.cumsum(period * (twist[1:] + twist[:-1]) / 2, axis=0)])
    none = np.zeros((n, 0))
    columns = (gained @ rows, twist @ rows, np.vstack([rise, rise[-1:]]) @ rows)
    return WheelSchedule(time, *columns, none, none, pose[::_FINE], twist), pose


def body(rng: np.random.Generator) -> Footprint:
    """A round, rectangular or concave footprint, mostly off-centre."""
    shape = rng.integers(3)
    if shape == 0:
        return Footprint(rng.uniform(-0.1, 0.1, (1, 2)) * (rng.random() < 0.5), rng.uniform(0.05, 0.4))
    if shape == 1:
        x, y = rng.uniform(0.05, 0.4, 2)
        corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) + rng.uniform(-0.2, 0.2, 2)
        return Footprint(corners)
    outline = star(rng, 0.4, *rng.uniform(-0.1, 0.1, 2))
    area = np.sum(outline[:, 0] * np.roll(outline[:, 1], -1) - outline[:, 1] * np.roll(outline[:, 0], -1))
    return Footprint(outline if area > 0 else outline[::-1].copy())


Closed = list[tuple[shapely.Geometry, float]]
"""Closed shapes, each grown by so many metres."""


def surroundings(rng: np.random.Generator, directory: Path) -> tuple[Environment, Closed]:
    """A random environment, and what is closed in it."""
    closed: Closed = []
    obstacles: list[Polygon | Circle] = []
    for _ in range(rng.integers(1, 8)):
        x, y = rng.uniform(-2.5, 2.5, 2)
        if rng.random() < 0.4:
            radius = float(rng.uniform(0.05, 0.5))
            obstacles.append(Circle(float(x), float(y), radius))
            closed.append((shapely.Point(x, y), radius))
        else:
            outline = star(rng, rng.uniform(0.1, 0.8), x, y)
            obstacles.append(Polygon(outline))
            closed.append((shapely.Polygon(outline), 0.0))
    if rng.random() < 0.5:
        box = Bounds(*rng.uniform([-4, -4, 2, 2], [-2, -2, 4, 4]).tolist())
        inside = shapely.box(box.x_min, box.y_min, box.x_max, box.y_max)
        closed.append((shapely.box(-50, -50, 50, 50).difference(inside), 0.0))
        return Environment(box, tuple(obstacles)), closed
    cells = (rng.random((40, 40)) < 0.02).astype(np.int8)
    directory.mkdir()
    np.save(directory / "cells.npy", cells)
    origin = Pose(*rng.uniform([-3, -3, -3], [-2, -2, 3]).tolist())
    c, s = math.cos(origin.theta), math.sin(origin.theta)
    # Turned about its own middle, the map covers the motion.
    origin = Pose(-2.5 * c + 2.5 * s, -2.5 * s - 2.5 * c, origin.theta)
    layer = MapLayer(str(rng.integers(2**60)), directory, 0.125, origin)
    matrix = [c, -s, s, c, origin.x, origin.y]
    row, column = np.nonzero(cells)
    squares = shapely.box(column * 0.125, row * 0.125, column * 0.125 + 0.125, row * 0.125 + 0.125)
    outside = shapely.box(-50, -50, 50, 50).difference(shapely.box(0, 0, 5, 5))
    layer_shape = shapely.union_all([*squares, outside])
    closed.append((shapely.affinity.affine_transform(layer_shape, matrix), 0.0))
    return Environment(None, tuple(obstacles), layer), closed


def distances(closed: Closed, footprint: Footprint, poses: Array) -> Array:
    c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x, y = footprint.vertices.T
    points = np.stack([poses[:, :1] + c * x - s * y, poses[:, 1:2] + s * x + c * y], -1)
    shapes = shapely.points(points[:, 0]) if len(x) == 1 else shapely.polygons(points)
    found: Array = np.min([shapely.distance(shapes, shape) - grown for shape, grown in closed], axis=0)
    return found - footprint.radius


def smallest(closed: Closed, footprint: Footprint, poses: Array) -> tuple[float, float]:
    """The smallest distance along a polyline of poses, and by how much it may be smaller on the way, m."""
    moved = np.append(0.0, np.cumsum(np.abs(np.diff(poses, axis=0)) @ [1.0, 1.0, footprint.reach]))
    at = np.append(np.arange(0.0, len(poses) - 1, _FINE), len(poses) - 1.0)
    index = np.arange(float(len(poses)))
    least, shares = np.inf, np.linspace(0.0, 1.0, _FINE + 1)[None]
    for _ in range(3):
        here = np.stack([np.interp(at, index, each) for each in poses.T], 1)
        found, way = distances(closed, footprint, here), np.interp(at, index, moved)
        least = min(least, float(found.min()))
        near = (found[:-1] + found[1:] - np.diff(way)) / 2 < least
        between = float(np.diff(way)[near & (np.diff(at) < 1.01)].max(initial=0.0))
        if least < -0.01 or not near.any():
            break
        at = np.unique(at[:-1][near, None] + (np.diff(at)[near, None]) * shares)
    return least, between


def certified(problem: Problem, schedule: WheelSchedule, world: CollisionWorld) -> tuple[float, list[str]]:
    """The clearance that the certificate states, and the violations that it finds."""
    try:
        return verify(problem, schedule, world).clearance, []
    except AuditFailed as failure:
        return failure.details["certificate"]["clearance"], failure.details["violations"]


@pytest.mark.parametrize("kind", ["differential", "mecanum", "omni", "swedish"])
@pytest.mark.parametrize("seed", range(2))
def test_the_clearance_is_a_close_lower_bound_of_shapely_s(kind: str, seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng([seed, *kind.encode()])
    compared = 0
    for world in range(40):
        environment, closed = surroundings(rng, tmp_path / str(world))
        footprint, (schedule, poses) = body(rng), motion(kind, rng)
        nearest, more = smallest(closed, footprint, poses)
        m = len(drive_of(kind).wheel_names)
        limits = Limits(np.full(m, 1e6), np.full(m, 1e9), np.full(m, np.inf))
        asked = float(rng.choice([0.0, 0.1]))
        problem = Problem(
            Robot(drive_of(kind), footprint, limits), Pose(*poses[0].tolist()), Goal(*poses[-1].tolist()),
            environment, Options(sample_period=float(schedule.time[1]), min_clearance=asked),
        )  # fmt: skip
        built = CollisionWorld.build(environment, footprint, asked)
        found, faults = certified(problem, schedule, built)
        assert all(each.startswith("the clearance is") for each in faults), faults
        assert nearest < asked + 1e-4 or not faults
        if nearest < 1e-6:  # shapely knows no depth
            assert found < 1e-6
            continue
        low = nearest - more - max(CLEARANCE_ACCURACY, CLEARANCE_SHARE * abs(nearest - asked))
        assert low - 2e-5 <= found <= nearest + 2e-5, (world, low, found, nearest)
        compared += 1
    assert compared > 10
