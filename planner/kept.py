"""What follows from a map alone, kept beside its cells: computed once, memory-mapped by all who plan on it.

One file for each reading of unknown cells, ground-<unknown>.npy: a digest, the distance field, the tree of
the outlines. The digest covers all that these depend on and themselves. A file that is missing, stale, cut
short or changed is as good as none.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np

from drives.se2 import Array
from planner.problem import MapLayer

__all__ = ["keep", "recall"]

_VERSION = 1
"""To be raised whenever outlines, the order of a tree or the field of a map change."""

_DIGEST = 32 // 8
"""Numbers that the digest takes the place of."""

Shape = tuple[int, ...]


def recall(layer: MapLayer, cells: Shape, field: Shape) -> tuple[Array, Array] | None:
    """The tree (n,) and the field of this shape, read-only, of a map of `cells`; None where they are not
    kept."""
    try:
        kept = np.asarray(np.load(_file(layer), mmap_mode="r"))
    except (OSError, ValueError, EOFError):
        return None
    end = _DIGEST + field[0] * field[1]
    if kept.dtype != np.float64 or kept.ndim != 1 or len(kept) < end:
        return None
    if kept[:_DIGEST].tobytes() != _digest(layer, cells, field, kept[_DIGEST:]):
        return None
    return kept[end:], kept[_DIGEST:end].reshape(field)


def keep(layer: MapLayer, cells: Shape, tree: Array, field: Array) -> None:
    """Keep them, all at once. Raises OSError."""
    body = np.concatenate([field.ravel(), tree])
    digest = np.frombuffer(_digest(layer, cells, field.shape, body))
    descriptor, name = tempfile.mkstemp(prefix=".ground-", dir=layer.directory)
    try:
        with open(descriptor, "wb") as file:
            np.save(file, np.concatenate([digest, body]))
            os.fchmod(descriptor, 0o644)
        os.replace(name, _file(layer))
    except OSError:
        with suppress(OSError):
            os.unlink(name)
        raise


def _file(layer: MapLayer) -> Path:
    return layer.directory / f"ground-{layer.unknown}.npy"


def _digest(layer: MapLayer, cells: Shape, field: Shape, body: Array) -> bytes:
    key = (_VERSION, layer.id, layer.unknown, float(layer.resolution), tuple(cells), tuple(field), len(body))
    return hashlib.sha256(repr(key).encode() + np.ascontiguousarray(body).tobytes()).digest()
