"""Occupancy maps: a ROS map_server pair decoded to cells, and the store that keeps them."""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import orjson
import yaml
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from api.errors import FieldErrors, Refusal
from api.fields import LARGEST_COORDINATE, LARGEST_LENGTH
from api.validation import validated
from drives.se2 import Pose
from planner.environment import prepare_map
from planner.problem import MapLayer

__all__ = ["DecodedMap", "MapStore", "decode_map", "read_map"]

FREE, OCCUPIED, UNKNOWN = 0, 1, 2
_GREYS = np.array([254, 0, 205], dtype=np.uint8)
"""What map_saver writes for each kind of cell"""

_MAX_YAML = 16 << 10
_LONGEST_UPLOAD = 3600.0
_ID = re.compile(r"[0-9a-f]{64}")


class DecodedMap(NamedTuple):
    """cells (height, width) int8, row 0 at the bottom, with 0 free, 1 occupied, 2 unknown; resolution m per
    cell; origin: pose of the lower left corner in the world."""

    cells: NDArray[np.int8]
    resolution: float
    origin: Pose

    @property
    def id(self) -> str:
        """SHA-256 of the content."""
        head = repr((self.cells.shape, float(self.resolution), tuple(float(v) + 0.0 for v in self.origin)))
        return hashlib.sha256(head.encode() + self.cells.tobytes()).hexdigest()

    def summary(self) -> dict[str, Any]:
        """What clients are told of the map."""
        counts = np.bincount(self.cells.ravel(), minlength=3)
        height, width = self.cells.shape
        return {
            "id": self.id,
            "width": width,
            "height": height,
            "resolution": self.resolution,
            "origin": list(self.origin),
            "occupied": int(counts[OCCUPIED]),
            "unknown": int(counts[UNKNOWN]),
            "free": int(counts[FREE]),
        }


def _number(value: Any) -> Any:
    # YAML 1.1 reads 5e-2 as a string; every map_server reads it as a number.
    if isinstance(value, bool):
        raise ValueError("it must be a number")
    return float(value) if isinstance(value, str) else value


_Number = Annotated[float, BeforeValidator(_number)]
_Place = Annotated[_Number, Field(ge=-LARGEST_COORDINATE, le=LARGEST_COORDINATE)]


class _MapYaml(BaseModel):
    model_config = ConfigDict(allow_inf_nan=False)

    resolution: Annotated[_Number, Field(gt=0, le=LARGEST_LENGTH)]
    origin: Annotated[list[_Place], Field(min_length=3, max_length=3)]
    occupied_thresh: Annotated[_Number, Field(ge=0, le=1)]
    free_thresh: Annotated[_Number, Field(ge=0, le=1)]
    negate: bool = False
    mode: Literal["trinary", "scale", "raw"] = "trinary"
    image: str = ""


def decode_map(description: bytes, image: bytes, max_cells: int) -> DecodedMap:
    """The map of a map_server yaml and its PGM or PNG image.

    A pixel v has the occupancy p = 1 - v/255 (negate: v/255); it is free where p <= free_thresh, occupied
    where p >= occupied_thresh, else unknown. In mode raw, v itself (negate: 255 - v) is the occupancy in per
    cent, and beyond 100 unknown. In mode scale, fully transparent pixels are unknown. Raises FieldErrors and
    Refusal.
    """
    meta = _read_yaml(description)
    if meta.free_thresh >= meta.occupied_thresh:
        detail = (
            f"free_thresh is {meta.free_thresh:g}; it must be < occupied_thresh, {meta.occupied_thresh:g}."
        )
        raise FieldErrors([{"pointer": "/yaml/free_thresh", "detail": detail}])
    values, transparent = _read_image(image, max_cells)
    v = np.arange(256)
    if meta.mode == "raw":
        percent = 255 - v if meta.negate else v
        p = np.where(percent <= 100, percent / 100, np.nan)
    else:
        p = v / 255 if meta.negate else 1 - v / 255
    kinds = np.full(256, UNKNOWN, dtype=np.int8)
    kinds[p <= meta.free_thresh] = FREE
    kinds[p >= meta.occupied_thresh] = OCCUPIED
    cells = kinds[values]
    if meta.mode == "scale" and transparent is not None:
        cells[transparent] = UNKNOWN
    x, y, yaw = meta.origin
    # Images begin at the top, maps at the bottom.
    return DecodedMap(np.ascontiguousarray(cells[::-1]), meta.resolution, Pose(x, y, yaw))


def read_map(file: Path, max_cells: int) -> DecodedMap:
    """The map of a map_server yaml on disk, whose image stands beside it. Raises OSError too."""
    description = file.read_bytes()
    return decode_map(description, (file.parent / _read_yaml(description).image).read_bytes(), max_cells)


class _PlainLoader(yaml.SafeLoader):
    def compose_node(self, parent: Any, index: Any) -> Any:
        # An alias can make a small file mean a huge value.
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("aliases are not allowed")
        return super().compose_node(parent, index)


def _read_yaml(description: bytes) -> _MapYaml:
    if len(description) > _MAX_YAML:
        raise Refusal("payload-too-large", f"The yaml must not exceed {_MAX_YAML} bytes.", limit=_MAX_YAML)
    try:
        value = yaml.load(description, _PlainLoader)
    except Exception:  # hostile tags make it raise more than YAMLError
        value = None
    if not isinstance(value, dict):
        raise FieldErrors([{"pointer": "/yaml", "detail": "yaml is not a map_server file."}])
    return validated(_MapYaml, value, ("yaml",))


def _read_image(data: bytes, max_cells: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None]:
    """Grey values (height, width), row 0 at the top, and which pixels are fully transparent."""
    if data[:2] not in (b"P2", b"P5") and data[:8] != b"\x89PNG\r\n\x1a\n":
        raise FieldErrors([{"pointer": "/image", "detail": "image is neither a PGM (P2, P5) nor a PNG."}])
    too_large = Refusal("payload-too-large", f"The map must not exceed {max_cells} cells.", limit=max_cells)
    try:
        with Image.open(io.BytesIO(data), formats=["PPM", "PNG"]) as image:
            if image.width * image.height > max_cells:
                raise too_large
            transparent = None
            if image.has_transparency_data:
                transparent = np.asarray(image.convert("RGBA").getchannel("A")) == 0
            if image.mode.startswith("I"):
                # 16 bits: Pillow would clip them to 255, not scale them.
                return (np.asarray(image, dtype=np.uint32) // 257).astype(np.uint8), transparent
            return np.asarray(image.convert("L")), transparent
    except Image.DecompressionBombError:
        raise too_large from None
    except Refusal:
        raise
    except Exception:  # decoders raise whatever a broken file leads them to
        raise FieldErrors([{"pointer": "/image", "detail": "image cannot be decoded."}]) from None


class MapStore:
    """Maps by id, in root/<id>/: cells.npy, meta.json and what the planner prepares. A map appears and
    vanishes by one rename."""

    def __init__(self, root: Path, max_maps: int) -> None:
        self.root = root
        self.max_maps = max_maps

    def add(self, decoded: DecodedMap) -> tuple[dict[str, Any], bool]:
        """Stores a map; its summary, and whether it is new. Raises Refusal: payload-too-large."""
        summary = decoded.summary()
        place = self.root / summary["id"]
        if place.exists():
            return summary, False
        if len(self.list()) >= self.max_maps:
            detail = f"The store holds {self.max_maps} maps; delete one first."
            raise Refusal("payload-too-large", detail, limit=self.max_maps)
        self.root.mkdir(parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=".new-", dir=self.root))
        try:
            with open(made / "cells.npy", "wb") as file:
                np.save(file, decoded.cells)
                _sync(file.fileno())
            with open(made / "meta.json", "wb") as file:
                file.write(orjson.dumps(summary))
                _sync(file.fileno())
            prepare_map(MapLayer(summary["id"], made, decoded.resolution, decoded.origin))
            made.chmod(0o755)
            made.rename(place)
        except OSError:
            shutil.rmtree(made, ignore_errors=True)
            if place.exists():  # another request stored the same map first
                return summary, False
            raise
        _sync_directory(self.root)
        return summary, True

    def sweep(self) -> None:
        """Removes what a crash in the middle of an upload or a deletion has left."""
        for left in [*self.root.glob(".new-*"), *self.root.glob(".old-*")]:
            if time.time() - left.stat().st_mtime > _LONGEST_UPLOAD:
                shutil.rmtree(left, ignore_errors=True)

    def list(self) -> list[dict[str, Any]]:
        """The summaries of all maps, by id."""
        found = []
        for place in sorted(self.root.iterdir()) if self.root.exists() else []:
            with suppress(Refusal):  # no map, or deleted this moment
                found.append(self.get(place.name))
        return found

    def get(self, id: str) -> dict[str, Any]:
        """The summary of one map. Raises Refusal: unknown-map."""
        try:
            summary: dict[str, Any] = orjson.loads((self._place(id) / "meta.json").read_bytes())
        except FileNotFoundError:
            raise _unknown(id) from None
        return summary

    def layer(self, id: str) -> MapLayer:
        """The map as the planner knows it. Raises Refusal: unknown-map."""
        summary = self.get(id)
        return MapLayer(id, self._place(id).absolute(), summary["resolution"], Pose(*summary["origin"]))

    def image(self, id: str) -> bytes:
        """The map as a PNG in the greys of map_saver, row 0 at the top. Raises Refusal: unknown-map."""
        try:
            cells = np.load(self._place(id) / "cells.npy")
        except FileNotFoundError:
            raise _unknown(id) from None
        out = io.BytesIO()
        Image.fromarray(_GREYS[cells[::-1]]).save(out, "PNG", compress_level=1)
        return out.getvalue()

    def delete(self, id: str) -> None:
        """Raises Refusal: unknown-map."""
        place = self._place(id)
        doomed = Path(tempfile.mkdtemp(prefix=".old-", dir=self.root)) if place.exists() else None
        if doomed is None:
            raise _unknown(id)
        try:
            place.rename(doomed / id)
        except FileNotFoundError:
            raise _unknown(id) from None
        finally:
            shutil.rmtree(doomed, ignore_errors=True)

    def _place(self, id: str) -> Path:
        # Nothing but an id ever becomes part of a path.
        if not _ID.fullmatch(id):
            raise _unknown(id)
        return self.root / id


def _unknown(id: str) -> Refusal:
    return Refusal("unknown-map", "There is no map of this id.", map=id[:64])


def _sync(descriptor: int) -> None:
    os.fsync(descriptor)


def _sync_directory(directory: Path) -> None:
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
