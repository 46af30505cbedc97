"""Occupancy maps: a ROS map_server pair, yaml and image, decoded to cells."""

from __future__ import annotations

import hashlib
import io
import re
import struct
import zlib
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from api.errors import FieldErrors, Refusal
from api.fields import LARGEST_COORDINATE, LARGEST_LENGTH, SMALLEST_LENGTH
from api.validation import validated
from drives.se2 import Pose

__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "DecodedMap", "decode_map", "read_map"]

FREE, OCCUPIED, UNKNOWN = 0, 1, 2
_MAX_YAML = 16 << 10
_PNG = b"\x89PNG\r\n\x1a\n"
_MOST_CHUNKS = 1 << 16
_GAP = rb"(?:\s|#[^\r\n]*[\r\n])+"
_PGM = re.compile(rb"P([25])" + 3 * (_GAP + rb"(\d{1,10})") + rb"\s")
_SPACE = re.compile(rb"\s")
_LONGEST_HEADER = 4096
_PIECE = 1 << 18

Image.MAX_IMAGE_PIXELS = None  # sizes are checked here, before Pillow sees them


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
        digest = hashlib.sha256(head.encode())
        digest.update(np.ascontiguousarray(self.cells).data)
        return digest.hexdigest()

    def summary(self) -> dict[str, Any]:
        """What clients are told of the map."""
        height, width = self.cells.shape
        return {
            "id": self.id,
            "width": width,
            "height": height,
            "resolution": self.resolution,
            "origin": list(self.origin),
            "occupied": int(np.count_nonzero(self.cells == OCCUPIED)),
            "unknown": int(np.count_nonzero(self.cells == UNKNOWN)),
            "free": int(np.count_nonzero(self.cells == FREE)),
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

    resolution: Annotated[_Number, Field(ge=SMALLEST_LENGTH, le=LARGEST_LENGTH)]
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
    if data[:8] == _PNG:
        return _read_png(data, max_cells)
    if data[:2] in (b"P2", b"P5"):
        return _read_pgm(data, max_cells), None
    raise _unreadable("is neither a PGM (P2, P5) nor a PNG")


def _read_png(data: bytes, max_cells: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None]:
    """Only the chunks that make pixels reach the decoder, and none before the header has been checked: the
    others can be many, or compressed and huge."""
    kept, at, kind = [_PNG], len(_PNG), b""
    for count in range(_MOST_CHUNKS):
        if kind == b"IEND":
            break
        length, kind = struct.unpack_from(">I4s", data, at) if at + 12 <= len(data) else (len(data), b"")
        chunk = data[at : at + 12 + length]
        if len(chunk) < 12 + length:
            raise _unreadable("is cut short")
        if (count == 0) != (kind == b"IHDR") or (count == 0 and length != 13):
            raise _unreadable("does not begin with one PNG header")
        if count == 0:
            width, height = struct.unpack_from(">II", chunk, 8)
            _check_size(width, height, max_cells)
        if kind in (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND"):
            if zlib.crc32(chunk[4:-4]) != int.from_bytes(chunk[-4:], "big"):
                raise _unreadable("has a chunk with a wrong checksum")
            kept.append(chunk)
        at += len(chunk)
    else:
        raise _unreadable(f"has more than {_MOST_CHUNKS} chunks")
    try:
        with Image.open(io.BytesIO(b"".join(kept)), formats=["PNG"]) as image:
            transparent = None
            if image.has_transparency_data:
                transparent = np.asarray(image.convert("RGBA").getchannel("A")) == 0
            if image.mode.startswith("I"):  # 16 bits: Pillow would clip them to 255, not scale them
                return _scaled(np.asarray(image, dtype=np.uint16), 65535), transparent
            return np.asarray(image.convert("L")), transparent
    except Exception:  # decoders raise whatever a broken file leads them to
        raise _unreadable("cannot be decoded") from None


def _read_pgm(data: bytes, max_cells: int) -> NDArray[np.uint8]:
    # Not Pillow's: it reads comments byte by byte, and its time on plain rasters grows with their square.
    header = _PGM.match(data, 0, _LONGEST_HEADER)
    if header is None:
        raise _unreadable("has no PGM header")
    width, height, largest = (int(number) for number in header.groups()[1:])
    _check_size(width, height, max_cells)
    if not 0 < largest < 1 << 16:
        raise _unreadable(f"has the largest value {largest}; it must lie between 1 and 65535")
    count, at = width * height, header.end()
    if header[1] == b"2":
        values = _plain(data, at, count)
    else:
        depth = np.dtype(np.uint8 if largest < 256 else ">u2")
        values = np.frombuffer(data, depth, min(count, (len(data) - at) // depth.itemsize), at)
    if len(values) < count:
        raise _unreadable(f"ends after {len(values)} of {count} pixels")
    if values.max() > largest:
        raise _unreadable(f"has a pixel of more than {largest}")
    return _scaled(values.reshape(height, width), largest)


def _plain(data: bytes, at: int, count: int) -> NDArray[np.uint16]:
    """At most `count` decimal numbers, those above 65535 as 65535. In pieces: numpy holds the interpreter's
    lock meanwhile."""
    found, left = [np.empty(0, dtype=np.uint16)], count
    while left > 0 and at < len(data):
        end = min(at + _PIECE, len(data))
        if end < len(data):
            space = _SPACE.search(data, end, end + _LONGEST_HEADER)
            if space is None:
                raise _unreadable("has a pixel that is no number")
            end = space.start()
        piece = data[at:end]
        if piece.translate(None, b"0123456789 \t\n\v\f\r"):
            raise _unreadable("has a pixel that is no number")
        if not piece.isspace():
            numbers = np.fromstring(piece, dtype=np.int64, sep=" ")[:left]
            found.append(np.clip(numbers, 0, 65535).astype(np.uint16))
            left -= len(numbers)
        at = end + 1
    return np.concatenate(found)


def _scaled(values: NDArray[np.unsignedinteger[Any]], largest: int) -> NDArray[np.uint8]:
    """0 … largest as the nearest of 0 … 255."""
    scale = np.rint(np.arange(largest + 1) * (255 / largest)).astype(np.uint8)
    return np.take(scale, values)


def _check_size(width: int, height: int, max_cells: int) -> None:
    if width < 1 or height < 1:
        raise _unreadable(f"is {width} x {height} pixels")
    if width * height > max_cells:
        detail = f"The map has {width} x {height} cells; it must not exceed {max_cells}."
        raise Refusal("payload-too-large", detail, limit=max_cells)


def _unreadable(why: str) -> FieldErrors:
    return FieldErrors([{"pointer": "/image", "detail": f"image {why}."}])
