"""What stands around a known motion without touching it: tubes, fences, clutter, crowds and maps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
import yaml

from benchmarks.fuzz.kinematics import Array
from benchmarks.fuzz.motion import Motion, Piece
from benchmarks.fuzz.robot import log_uniform, outline, reach

__all__ = ["SCENES", "MapFiles", "Scene", "draw_scene", "footprints"]

_MOST_POSES = 1500
_MOST_VERTICES = 400


@dataclass(frozen=True)
class MapFiles:
    """A map as a client uploads it: the bytes of a map_server yaml and of its PGM image."""

    description: bytes
    image: bytes


@dataclass(frozen=True)
class Scene:
    """environment: as in a request, but for the id of the map, which an upload gives."""

    environment: dict[str, Any]
    map: MapFiles | None = None


@dataclass(frozen=True)
class _Way:
    """What the footprint sweeps; the gap (m) that obstacles keep from it, of which `margin` m are to spare;
    and the size (m) of the robot."""

    swept: Any
    gap: float
    margin: float
    size: float


def footprints(footprint: dict[str, Any], poses: Array) -> Any:
    """The outlines (n,) of a footprint at poses (n, 3), as polygons. Circles are polygons of 128 corners, a
    hair (3e-4 of the radius) inside."""
    if footprint["type"] == "circle":
        at = np.linspace(0, math.tau, 128, endpoint=False)
        corners = footprint["radius"] * np.stack([np.cos(at), np.sin(at)], 1)
    else:
        corners = np.array(outline(footprint), dtype=float)
    c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    x = poses[:, :1] + c * corners[:, 0] - s * corners[:, 1]
    y = poses[:, 1:2] + s * corners[:, 0] + c * corners[:, 1]
    return shapely.polygons(np.stack([x, y], -1))


def draw_scene(
    rng: np.random.Generator, kind: str, robot: dict[str, Any], motion: Motion, clearance: float
) -> Scene:
    """A scene of one of the SCENES in which the motion keeps more than `clearance` (m)."""
    size = reach(robot["footprint"])
    tight = kind in ("tube", "fence")
    margin = size * (log_uniform(rng, 0.02, 0.3) if tight else log_uniform(rng, 0.03, 1.0))
    return SCENES[kind](rng, _way(robot, motion, clearance, margin, size))


def _way(robot: dict[str, Any], motion: Motion, clearance: float, margin: float, size: float) -> _Way:
    fixed = None
    if robot["drive"]["type"] == "synchro":
        fixed = robot["drive"].get("body_heading", float(motion.start[2]))
    step = margin / 2

    def steps(piece: Piece) -> int:
        moved = math.hypot(piece.vx, piece.vy) + (0.0 if fixed is not None else size * abs(piece.omega))
        return min(math.ceil(moved / step), _MOST_POSES)

    poses = motion.poses(steps)
    if fixed is not None:
        poses = np.column_stack([poses[:, :2], np.full(len(poses), fixed)])
    moved = np.hypot(*np.diff(poses[:, :2], axis=0).T) + size * np.abs(np.diff(poses[:, 2]))
    # Between two poses no point of the footprint is further than half a step from one of them.
    gap = clearance + margin + float(moved.max(initial=0.0)) / 2 + 4e-4 * size + 2e-5
    return _Way(shapely.union_all(footprints(robot["footprint"], poses)), gap, margin, size)


def _open(rng: np.random.Generator, way: _Way) -> Scene:
    """Bounds, and nothing in them."""
    return Scene({"bounds": _bounds(rng, way)})


def _tube(rng: np.random.Generator, way: _Way) -> Scene:
    """Walls on all sides of the way, in two halves, and islands in its loops."""
    tube = _simple(way.swept.buffer(way.gap, quad_segs=6), way.margin)
    x0, y0, x1, y1 = tube.bounds
    grown = way.size * log_uniform(rng, 0.02, 0.5)
    box = (x0 - grown, y0 - grown, x1 + grown, y1 + grown)
    middle = float(rng.uniform(x0 + 0.3 * (x1 - x0), x0 + 0.7 * (x1 - x0)))
    filled = shapely.Polygon(tube.exterior)
    halves = [shapely.box(box[0], box[1], middle, box[3]), shapely.box(middle, box[1], box[2], box[3])]
    solids = [part for half in halves for part in _parts(half.difference(filled))]
    solids += [shapely.Polygon(ring) for ring in tube.interiors]
    return Scene({"bounds": _box(box), "obstacles": _polygons(solids)})


def _fence(rng: np.random.Generator, way: _Way) -> Scene:
    """Posts along both sides of the way, too close to pass between."""
    radius = way.size * log_uniform(rng, 0.03, 0.3)
    around = way.swept.buffer(way.gap + radius, quad_segs=6)
    lines = [around.exterior, *around.interiors]
    apart = max(radius * rng.uniform(1.5, 3.0), sum(line.length for line in lines) / 900)
    posts = []
    for line in lines:
        at = np.arange(0.0, line.length, apart)
        posts += shapely.get_coordinates(shapely.line_interpolate_point(line, at)).tolist()
    obstacles = [{"type": "circle", "center": post, "radius": radius} for post in posts]
    return Scene({"bounds": _bounds(rng, way), "obstacles": obstacles})


def _clutter(rng: np.random.Generator, way: _Way) -> Scene:
    return _scattered(rng, way, int(rng.integers(1, 30)), (0.05, 2.0))


def _crowd(rng: np.random.Generator, way: _Way) -> Scene:
    return _scattered(rng, way, int(log_uniform(rng, 100, 1000)), (0.02, 0.3))


def _scattered(rng: np.random.Generator, way: _Way, count: int, sizes: tuple[float, float]) -> Scene:
    """Polygons and discs anywhere in the bounds, but for those too near to the way."""
    bounds = _bounds(rng, way)
    kept = way.swept.buffer(way.gap)
    shapely.prepare(kept)
    obstacles: list[dict[str, Any]] = []
    for _ in range(4 * count):
        if len(obstacles) == count:
            break
        x = rng.uniform(bounds["x_min"], bounds["x_max"])
        y = rng.uniform(bounds["y_min"], bounds["y_max"])
        radius = way.size * log_uniform(rng, *sizes)
        if rng.random() < 0.4:
            if not kept.intersects(shapely.Point(x, y).buffer(radius * 1.02)):
                obstacles.append({"type": "circle", "center": [x, y], "radius": radius})
            continue
        corners = int(rng.integers(3, 9))
        at = np.sort(rng.uniform(0, math.tau, corners)) + rng.uniform(0, math.tau)
        far = radius * rng.uniform(0.3, 1.0, corners)
        shape = shapely.Polygon(np.stack([x + far * np.cos(at), y + far * np.sin(at)], 1))
        if shape.is_valid and shape.area > 1e-3 * radius**2 and not kept.intersects(shape):
            obstacles += _polygons([shape])
    return Scene({"bounds": bounds, "obstacles": obstacles})


def _map(rng: np.random.Generator, way: _Way) -> Scene:
    """An occupancy grid at a random pose, its cells free on the way, and sometimes bounds."""
    resolution, yaw = way.size * log_uniform(rng, 0.05, 0.3), float(rng.choice([0.0, rng.uniform(-4, 4)]))
    own = shapely.affinity.rotate(way.swept, -yaw, origin=(0, 0), use_radians=True)
    x0, y0, x1, y1 = own.bounds
    grown = way.gap + way.size * log_uniform(rng, 0.3, 4.0)
    columns, rows = (min(400, math.ceil((d + 2 * grown) / resolution)) for d in (x1 - x0, y1 - y0))
    resolution = max((x1 - x0 + 2 * grown) / columns, (y1 - y0 + 2 * grown) / rows)
    left, low = x0 - grown, y0 - grown
    cells = np.zeros((rows, columns), dtype=np.uint8)
    for _ in range(int(rng.integers(0, 60))):
        r, c = int(rng.integers(rows)), int(rng.integers(columns))
        h, w = rng.integers(1, max(2, rows // 6)), rng.integers(1, max(2, columns // 6))
        cells[r : r + h, c : c + w] = 1 if rng.random() < 0.8 else 2
    cells[rng.random(cells.shape) < rng.choice([0.0, 0.02])] = 1
    near = own.buffer(way.gap + resolution * 0.71)
    shapely.prepare(near)
    x, y = np.meshgrid(
        left + (np.arange(columns) + 0.5) * resolution, low + (np.arange(rows) + 0.5) * resolution
    )
    cells[shapely.contains_xy(near, x, y)] = 0
    cos, sin = math.cos(yaw), math.sin(yaw)
    meta = {
        "image": "map.pgm", "resolution": resolution,
        "negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.196,
        "origin": [cos * left - sin * low, sin * left + cos * low, yaw],
    }  # fmt: skip
    grey = np.array([254, 0, 205], dtype=np.uint8)[cells[::-1]]
    image = b"P5\n%d %d\n255\n" % (columns, rows) + grey.tobytes()
    environment: dict[str, Any] = {"map": {"unknown": str(rng.choice(["occupied", "free"]))}}
    if rng.random() < 0.3:
        environment["bounds"] = _bounds(rng, way)
    return Scene(environment, MapFiles(yaml.safe_dump(meta).encode(), image))


SCENES: dict[str, Callable[[np.random.Generator, _Way], Scene]] = {
    "tube": _tube, "fence": _fence, "clutter": _clutter, "crowd": _crowd, "map": _map, "open": _open,
}  # fmt: skip
"""How each scene is drawn."""


def _bounds(rng: np.random.Generator, way: _Way) -> dict[str, float]:
    x0, y0, x1, y1 = way.swept.bounds
    out = way.gap + way.size * np.exp(rng.uniform(math.log(0.01), math.log(4.0), 4))
    return _box((x0 - out[0], y0 - out[1], x1 + out[2], y1 + out[3]))


def _box(box: tuple[float, float, float, float]) -> dict[str, float]:
    return dict(zip(("x_min", "y_min", "x_max", "y_max"), map(float, box), strict=True))


def _simple(shape: Any, margin: float) -> Any:
    """The shape with fewer corners, its sides moved by a share of the margin at most."""
    for share in (0.02, 0.05, 0.1, 0.2, 0.4):
        made = shape.simplify(share * margin)
        if len(made.exterior.coords) <= _MOST_VERTICES:
            break
    return made


def _parts(shape: Any) -> list[Any]:
    return [part for part in getattr(shape, "geoms", [shape]) if part.geom_type == "Polygon"]


def _polygons(shapes: list[Any]) -> list[dict[str, Any]]:
    made = []
    for shape in shapes:
        corners = np.array(shape.exterior.coords)[:-1]
        if shape.area > 0 and len(corners) <= 500:
            made.append({"type": "polygon", "vertices": corners.tolist()})
    return made
