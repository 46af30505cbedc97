"""A planning problem, stated: who moves, from where to where, among what, and how hard to try."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from drives.drive import Drive, Limits
from drives.se2 import Array, Pose

__all__ = [
    "MAX_SAMPLES",
    "Bounds",
    "Circle",
    "Environment",
    "Footprint",
    "Goal",
    "MapLayer",
    "Options",
    "Polygon",
    "Problem",
    "Robot",
]

MAX_SAMPLES = 200_000
"""The default of Options.max_samples."""


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """A simple polygon in the body frame, grown by a disc: vertices (n, 2) m, counter-clockwise, n = 1 or
    >= 3; radius m >= 0. A circular robot is the single vertex (0, 0) and its radius."""

    vertices: Array
    radius: float = 0.0

    @property
    def reach(self) -> float:
        """Distance (m) of its farthest point from the body origin."""
        return float(np.hypot(self.vertices[:, 0], self.vertices[:, 1]).max()) + self.radius


@dataclass(frozen=True, slots=True)
class Bounds:
    """A box in the world frame that the footprint must stay inside, m."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float


@dataclass(frozen=True, slots=True, eq=False)
class Polygon:
    """A solid simple polygon in the world frame: vertices (n >= 3, 2) m, either winding."""

    vertices: Array


@dataclass(frozen=True, slots=True)
class Circle:
    """A solid disc in the world frame, m."""

    x: float
    y: float
    radius: float


@dataclass(frozen=True, slots=True)
class MapLayer:
    """An occupancy grid in storage. `directory` holds cells.npy, int8 (height, width), row 0 at the map's own
    y = 0, with 0 free, 1 occupied, 2 unknown; cell (row, column) covers the square from
    (column, row)·resolution, in the map frame, whose pose in the world is `origin`. Everything outside the
    grid is closed. `id` names the content."""

    id: str
    directory: Path
    resolution: float
    origin: Pose
    unknown: Literal["occupied", "free"] = "occupied"


@dataclass(frozen=True, slots=True)
class Environment:
    """Where the robot may be. Bounds or a map, or both (then the footprint stays inside both)."""

    bounds: Bounds | None = None
    obstacles: tuple[Polygon | Circle, ...] = ()
    map: MapLayer | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    drive: Drive
    footprint: Footprint
    limits: Limits


@dataclass(frozen=True, slots=True)
class Goal:
    """Position m and heading rad in the world frame; theta None: any heading."""

    x: float
    y: float
    theta: float | None


@dataclass(frozen=True, slots=True)
class Options:
    """time_budget s; sample_period s; min_clearance m; turning_radius m (0: no floor); max_samples: a motion
    of more is refused."""

    time_budget: float = 1.0
    effort: Literal["first", "good", "best"] = "good"
    seed: int = 0
    sample_period: float = 0.02
    min_clearance: float = 0.0
    reverse: bool = True
    turning_radius: float = 0.0
    max_samples: int = MAX_SAMPLES


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """steering (k,) rad: where the steered wheels stand at the start, None: as the first motion needs."""

    robot: Robot
    start: Pose
    goal: Goal
    environment: Environment
    options: Options = field(default_factory=Options)
    steering: Array | None = None
