"""Folders that libraries write to, if the only writable one is our own."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

__all__ = ["keep_to"]

_FOLDERS = {"TMPDIR": "tmp", "MPLCONFIGDIR": "matplotlib"}
"""By the environment variable that says where they are."""


def keep_to(data_dir: Path) -> None:
    """Moves those folders that are named but read-only, as in a container whose only volume is data_dir, to
    data_dir/cache. The kernel cache finds a place by itself."""
    for variable, name in _FOLDERS.items():
        given = os.environ.get(variable)
        if given and not _is_writable(Path(given)):
            place = data_dir.absolute() / "cache" / name
            place.mkdir(parents=True, exist_ok=True)
            os.environ[variable] = str(place)
    tempfile.tempdir = None  # it looks only once


def _is_writable(folder: Path) -> bool:
    while not folder.exists():
        folder = folder.parent
    return os.access(folder, os.W_OK)
