"""Imported by the fork server before it forks the first worker: the planner, loaded and compiled."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from api import planning  # noqa: F401
from drives.se2 import Pose
from planner import warm_up
from planner.environment import prepare_map
from planner.problem import MapLayer

warm_up.warm_up()
with TemporaryDirectory() as _folder:
    np.save(Path(_folder) / "cells.npy", np.eye(3, dtype=np.int8))
    prepare_map(MapLayer("", Path(_folder), 1.0, Pose(0.0, 0.0, 0.0), "occupied"))
