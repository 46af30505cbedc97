"""Clearance of a moving footprint by shapely."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely

from benchmarks.fuzz.kinematics import Array
from benchmarks.fuzz.robot import reach
from benchmarks.fuzz.scene import footprints

__all__ = ["CLEARANCE", "World", "solid_cells"]

CLEARANCE = 3e-4
"""Tolerance: how much of the clearance asked for may be missing, m."""
_SURE, _FINEST = 0.9, 2e-5
"""Share of the tolerance that is left as it is, and the shortest stretch (m) that is halved no more."""
_MANY = 20_000
"""Footprints whose distances are found at once, so that they fit into memory."""
_OVERLAP = -0.01
"""What stands for the clearance of footprints that overlap something, m."""


class World:
    """Obstacles and bounds of a request. solid: the closed parts of its map, and the map's outline."""

    def __init__(self, request: dict[str, Any], solid: tuple[list[Any], Any] | None = None) -> None:
        self._footprint = request["robot"]["footprint"]
        environment, drive = request["environment"], request["robot"]["drive"]
        shapes = [
            shapely.Polygon(o["vertices"]) if o["type"] == "polygon"
            else shapely.Point(o["center"]).buffer(o["radius"], quad_segs=64)
            for o in environment.get("obstacles", [])
        ]  # fmt: skip
        borders = []
        if solid is not None:
            shapes += solid[0]
            borders.append(solid[1])
        if box := environment.get("bounds"):
            borders.append(shapely.box(box["x_min"], box["y_min"], box["x_max"], box["y_max"]))
        self._borders = borders
        for border in borders:
            shapely.prepare(border)
        self._tree = shapely.STRtree(shapes) if shapes else None
        self._fixed: float | None = None
        if drive["type"] == "synchro":
            self._fixed = drive.get("body_heading", request["start"]["theta"])
        self._reach = 0.0 if self._fixed is not None else reach(self._footprint)
        if self._footprint["type"] == "circle":
            self._reach = 0.0

    def distance(self, poses: Array) -> Array:
        """From the footprint at poses (n, 3) to whatever is nearest, m."""
        if len(poses) > _MANY:
            parts = np.array_split(poses, math.ceil(len(poses) / _MANY))
            return np.concatenate([self.distance(part) for part in parts])
        if self._fixed is not None:
            poses = np.column_stack([poses[:, :2], np.full(len(poses), self._fixed)])
        outlines = footprints(self._footprint, poses)
        found = np.full(len(poses), np.inf)
        if self._tree is not None:
            (which, _), apart = self._tree.query_nearest(outlines, return_distance=True, all_matches=False)
            found[which] = np.where(apart > 0, apart, _OVERLAP)
        for border in self._borders:
            inside = shapely.contains_properly(border, outlines)
            found = np.minimum(found, np.where(inside, shapely.distance(border.exterior, outlines), _OVERLAP))
        return found

    def clearance(self, poses: Array, asked: float) -> float:
        """The smallest distance (m) found along a polyline of poses (n, 3). It is found where it falls below
        what is asked (m) by more than the tolerance."""
        moved = np.concatenate([[0.0], np.cumsum(self._moved(poses[:-1], poses[1:]))])
        # Places along the way, in metres that the footprint has moved.
        at = np.linspace(0.0, moved[-1], 1 + min(200, math.ceil(moved[-1] / 0.02)))
        near = self.distance(self._poses(poses, moved, at))
        least = float(near.min())
        begin, end, first, last = at[:-1], at[1:], near[:-1], near[1:]
        while least >= asked - CLEARANCE:
            # Between two places the distance changes by no more than the footprint moves.
            low = (first + last - (end - begin)) / 2 < asked - _SURE * CLEARANCE
            open_ = low & (end - begin > _FINEST)
            begin, end, first, last = begin[open_], end[open_], first[open_], last[open_]
            if not len(begin):
                break
            middle = (begin + end) / 2
            between = self.distance(self._poses(poses, moved, middle))
            least = min(least, float(between.min()))
            begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
            first, last = np.concatenate([first, between]), np.concatenate([between, last])
        return least

    def _moved(self, a: Array, b: Array) -> Array:
        """How far (n,) m no point of the footprint moves farther between two poses."""
        far: Array = np.hypot(*(a - b)[:, :2].T) + self._reach * np.abs((a - b)[:, 2])
        return far

    def _poses(self, poses: Array, moved: Array, at: Array) -> Array:
        return np.stack([np.interp(at, moved, poses[:, k]) for k in range(3)], 1)


def solid_cells(cells: Any, resolution: float, origin: tuple[float, float, float], unknown: str) -> Any:
    """The closed cells of a map beside open ones, as squares, and the outline of the map.

    cells (rows, columns): 0 free, 1 occupied, 2 unknown, row 0 lowest; origin: the map's pose in the world.
    """
    closed = cells == 1 if unknown == "free" else cells != 0
    padded = np.pad(closed, 1, constant_values=True)
    inner = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    rows, columns = np.nonzero(closed & ~inner)
    x, y, yaw = origin
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    corners = (np.stack([columns, rows], -1)[:, None] + square) * resolution @ turn + [x, y]
    height, width = cells.shape
    outline = square * [width * resolution, height * resolution] @ turn + [x, y]
    return list(shapely.polygons(corners)), shapely.Polygon(outline)
