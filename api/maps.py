"""The store of maps: a folder of files by the digest of their content, and an index over them.

root/<id>/ holds meta.json, cells.npy and what the planner prepares. The folder is the truth: a map exists
while its meta.json does, and its id proves the rest. root/index.db (SQLite) knows the same maps for listing
them and for keeping the quota; every change is made while its write lock is held, and what a crash has left
is put right at the next start. See docs/decisions/0016.
"""

from __future__ import annotations

import errno
import fcntl
import io
import os
import re
import shutil
import sqlite3
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import orjson
from numpy.typing import NDArray
from PIL import Image

from api.errors import Refusal
from api.log import log
from api.occupancy import DecodedMap, decode_map
from api.spool import Spool, whole
from drives.se2 import Pose
from planner.environment import prepare_map
from planner.problem import MapLayer

__all__ = ["MapStore", "room_or_refusal", "take_upload"]

_GREYS = np.array([254, 0, 205], dtype=np.uint8)
"""What map_saver writes for each kind of cell"""

_ID = re.compile(r"[0-9a-f]{64}")
_META, _CELLS, _IMAGE = "meta.json", "cells.npy", "image.png"
_TABLE = (
    "CREATE TABLE IF NOT EXISTS maps (id TEXT PRIMARY KEY, bytes INTEGER NOT NULL, summary TEXT NOT NULL)"
)
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, "SQLITE_FULL", "SQLITE_IOERR_SHMSIZE", "SQLITE_IOERR_WRITE"}
_PATIENCE = 30.0
"""How long a change waits for another process's, s"""

_Seal = tuple[int, ...]


class MapStore:
    """Maps by id, at most `max_maps` of them in at most `max_bytes`. Any number of processes may share one on
    a local file system; to read maps, its files are enough."""

    def __init__(self, root: Path, max_maps: int, max_bytes: int = sys.maxsize) -> None:
        self.root = root
        self.max_maps = max_maps
        self.max_bytes = max_bytes
        self._sound: dict[str, tuple[_Seal, dict[str, Any]]] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return MapStore, (self.root, self.max_maps, self.max_bytes)

    def add(self, decoded: DecodedMap) -> tuple[dict[str, Any], bool]:
        """Stores a map, afresh where it is damaged; its summary, and whether it is new.

        Raises Refusal: quota-exceeded, insufficient-storage.
        """
        summary = decoded.summary()
        with suppress(Refusal):
            return self.get(summary["id"]), False
        with room_or_refusal(), ExitStack() as held:
            with self._index() as index:
                self._check_quota(index, summary["id"], decoded.cells.nbytes)
                made = Path(tempfile.mkdtemp(prefix=".new-", dir=self.root))
                held.callback(shutil.rmtree, made, ignore_errors=True)
                unswept = held.enter_context(ExitStack())
                unswept.enter_context(_locked(made, fcntl.LOCK_SH))
            _write(made / _CELLS, lambda file: np.save(file, decoded.cells))
            prepare_map(MapLayer(summary["id"], made, decoded.resolution, decoded.origin))
            _write(made / _IMAGE, lambda file: file.write(_png(decoded.cells)))
            _write(made / _META, lambda file: file.write(orjson.dumps(summary)))
            made.chmod(0o755)
            size = _size(made)
            with _opened(made) as descriptor:
                os.fsync(descriptor)
            place, new = self.root / summary["id"], False
            try:
                with self._index() as index:
                    unswept.close()  # nobody sweeps meanwhile
                    self._check_quota(index, summary["id"], size)
                    _insert(index, summary, size)
                    new = not (place / _META).exists()
                    self._publish(made, place)
            except (OSError, sqlite3.Error):  # it may have appeared, and could not be made to last
                if new:
                    with suppress(OSError):
                        self._vanish(place)
                raise
        return summary, new

    def list(self) -> list[dict[str, Any]]:
        """The summaries of all maps, by id."""
        if not self.root.exists():
            return []
        try:
            with self._index() as index:
                rows = index.execute("SELECT id, summary FROM maps ORDER BY id").fetchall()
        except sqlite3.Error:  # the disk is full, or the index damaged
            return [summary for _, summary in sorted(self._found().items())]
        return [orjson.loads(summary) for id, summary in rows if (self.root / id / _META).exists()]

    def get(self, id: str) -> dict[str, Any]:
        """The summary of one map, whose digest is right. Raises Refusal: unknown-map, map-corrupt."""
        place = self._place(id)
        try:
            seal = _seal(place / _META)
        except (FileNotFoundError, NotADirectoryError):
            raise _unknown(id) from None
        try:
            seal += _seal(place / _CELLS)
            known = self._sound.get(id)
            if known is None or known[0] != seal:  # read again only when a file has changed
                summary = orjson.loads((place / _META).read_bytes())
                origin = Pose(*summary["origin"])
                found = DecodedMap(np.load(place / _CELLS), summary["resolution"], origin).summary()
                if found != summary or found["id"] != id:
                    raise ValueError("another content")
                known = self._sound[id] = seal, summary
        except Exception as error:  # whatever readers raise on damaged files
            if not (place / _META).exists():
                raise _unknown(id) from None
            detail = "The stored map is damaged. Upload it again, or delete it."
            raise Refusal("map-corrupt", detail, map=id) from error
        return known[1]

    def layer(self, id: str) -> MapLayer:
        """The map as the planner knows it. Raises Refusal: unknown-map, map-corrupt."""
        summary = self.get(id)
        return MapLayer(id, self._place(id).absolute(), summary["resolution"], Pose(*summary["origin"]))

    @contextmanager
    def leased(self) -> Iterator[Callable[[str], MapLayer]]:
        """`layer`, but the files of the maps it finds stay until the end, even if these are deleted."""
        with ExitStack() as leases:

            def find(id: str) -> MapLayer:
                place = self._place(id)
                try:
                    leases.callback(self._discard, place)
                    leases.enter_context(_locked(place, fcntl.LOCK_SH))
                except OSError:
                    raise _unknown(id) from None
                return self.layer(id)

            yield find

    def image(self, id: str) -> Spool | None:
        """The map as a PNG in the greys of map_saver, row 0 at the top. Raises as layer does. None: the map
        was stored before images were, see draw."""
        with self.leased() as find, suppress(FileNotFoundError):
            return Spool(open(find(id).directory / _IMAGE, "rb"))
        return None

    def draw(self, id: str) -> None:
        """Stores the image of a map that has none. Raises as layer does, and insufficient-storage."""
        with self.leased() as find, room_or_refusal(), tempfile.TemporaryDirectory(dir=self.root) as made:
            place = find(id).directory
            _write(Path(made, _IMAGE), lambda file: file.write(_png(np.load(place / _CELLS))))
            Path(made, _IMAGE).replace(place / _IMAGE)

    def delete(self, id: str) -> None:
        """Raises Refusal: unknown-map."""
        place = self._place(id)
        try:
            self._vanish(place)  # before the index is written: on a full disk, it makes room
        except (FileNotFoundError, NotADirectoryError):
            raise _unknown(id) from None
        with suppress(sqlite3.Error), self._index() as index:
            if not (place / _META).exists():
                index.execute("DELETE FROM maps WHERE id = ?", (id,))

    def sweep(self) -> None:
        """Puts right what a crash has left, and an index that is lost or damaged."""
        self.root.mkdir(parents=True, exist_ok=True)
        try:
            self._reconcile()
        except sqlite3.OperationalError as error:  # a full disk, say: maps can still be read
            log(event="the index of maps cannot be written", error=repr(error))
        except sqlite3.DatabaseError as error:
            log(event="the index of maps is made again", error=repr(error))
            for file in self.root.glob("index.db*"):
                file.unlink()
            self._reconcile()
        for left in self.root.glob(".old-*"):
            shutil.rmtree(left, ignore_errors=True)

    def _reconcile(self) -> None:
        with self._index() as index:
            found = self._found()
            rows = {id for (id,) in index.execute("SELECT id FROM maps")}
            for id in rows - found.keys():
                index.execute("DELETE FROM maps WHERE id = ?", (id,))
            for id in found.keys() - rows:
                _insert(index, found[id], _size(self.root / id))
            for place in self.root.iterdir():
                if _ID.fullmatch(place.name) or place.name.startswith(".new-"):
                    self._discard(place)

    def _found(self) -> dict[str, dict[str, Any]]:
        """The summaries of all maps by id, from their folders."""
        found = {}
        for file in self.root.glob(f"*/{_META}"):
            with suppress(OSError, ValueError):
                if _ID.fullmatch(file.parent.name):
                    found[file.parent.name] = orjson.loads(file.read_bytes())
        return found

    def _publish(self, made: Path, place: Path) -> None:
        """Makes the map appear. Its files replace those of one that is damaged, or deleted but in use."""
        with suppress(FileNotFoundError), _locked(place, fcntl.LOCK_SH) as descriptor:
            if _is(place, descriptor):  # else it is being discarded
                for file in sorted(made.iterdir(), key=lambda file: file.name == _META):
                    file.replace(place / file.name)
                os.fsync(descriptor)
                return
        made.rename(place)
        with _opened(self.root) as descriptor:
            os.fsync(descriptor)

    def _vanish(self, place: Path) -> None:
        (place / _META).unlink()
        self._sound.pop(place.name, None)
        self._discard(place)

    def _discard(self, place: Path) -> None:
        """Removes a folder that is no map, unless somebody still uses its files: they do it then."""
        with suppress(OSError), _locked(place, fcntl.LOCK_EX | fcntl.LOCK_NB) as descriptor:
            if _is(place, descriptor) and (place.name.startswith(".") or not (place / _META).exists()):
                doomed = self.root / f".old-{uuid4().hex}"
                place.rename(doomed)
                shutil.rmtree(doomed, ignore_errors=True)

    def _check_quota(self, index: sqlite3.Connection, id: str, size: int) -> None:
        count, used = index.execute(
            "SELECT count(*), coalesce(sum(bytes), 0) FROM maps WHERE id <> ?", (id,)
        ).fetchone()
        if count >= self.max_maps:
            detail = f"The store holds {count} maps of at most {self.max_maps}; delete one first."
            raise Refusal("quota-exceeded", detail, limit=self.max_maps)
        if used + size > self.max_bytes:
            detail = f"The store holds {used} bytes of at most {self.max_bytes}; this map needs {size}."
            raise Refusal("quota-exceeded", detail, limit=self.max_bytes)

    @contextmanager
    def _index(self) -> Iterator[sqlite3.Connection]:
        """The index, with its write lock held."""
        self.root.mkdir(parents=True, exist_ok=True)
        with closing(sqlite3.connect(self.root / "index.db", _PATIENCE, isolation_level=None)) as index:
            index.execute("PRAGMA journal_mode = WAL")
            index.execute("BEGIN IMMEDIATE")
            index.execute(_TABLE)
            yield index
            index.execute("COMMIT")

    def _place(self, id: str) -> Path:
        # Nothing but an id ever becomes part of a path.
        if not _ID.fullmatch(id):
            raise _unknown(id)
        return self.root / id


def take_upload(
    store: MapStore, description: bytes | Spool, image: bytes | Spool, max_cells: int
) -> tuple[dict[str, Any], bool]:
    """Decodes a map and stores it: its summary, and whether it is new. Raises as decode_map and add do."""
    return store.add(decode_map(whole(description), whole(image), max_cells))


def _png(cells: NDArray[np.int8]) -> bytes:
    out = io.BytesIO()
    Image.fromarray(_GREYS[cells[::-1]]).save(out, "PNG", compress_level=1)
    return out.getvalue()


def _unknown(id: str) -> Refusal:
    return Refusal("unknown-map", "There is no map of this id.", map=id[:64])


def _insert(index: sqlite3.Connection, summary: dict[str, Any], size: int) -> None:
    row = summary["id"], size, orjson.dumps(summary).decode()
    index.execute("INSERT OR REPLACE INTO maps VALUES (?, ?, ?)", row)


def _size(place: Path) -> int:
    """Bytes of a map's files."""
    return sum(file.stat().st_size for file in place.iterdir())


def _seal(file: Path) -> _Seal:
    """What changes when a file does."""
    about = file.stat()
    return about.st_ino, about.st_size, about.st_mtime_ns


def _write(file: Path, write: Callable[[Any], Any]) -> None:
    with open(file, "wb") as opened:
        write(opened)
        opened.flush()
        os.fsync(opened.fileno())


@contextmanager
def _opened(directory: Path) -> Iterator[int]:
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


@contextmanager
def _locked(directory: Path, how: int) -> Iterator[int]:
    """A directory with a lock on it, which ends with the process at the latest. Raises OSError."""
    with _opened(directory) as descriptor:
        fcntl.flock(descriptor, how)
        yield descriptor


def _is(directory: Path, descriptor: int) -> bool:
    try:
        return os.path.samestat(directory.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


@contextmanager
def room_or_refusal() -> Iterator[None]:
    """Turns a full disk into a Refusal: insufficient-storage."""
    try:
        yield
    except (OSError, sqlite3.OperationalError) as error:
        if getattr(error, "errno", None) in _FULL or getattr(error, "sqlite_errorname", None) in _FULL:
            detail = "The disk is full. Nothing has been stored."
            raise Refusal("insufficient-storage", detail) from error
        raise
