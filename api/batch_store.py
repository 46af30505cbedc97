"""Where the results of batches are kept: a folder each, with the lines and a record of how far they go."""

from __future__ import annotations

import errno
import fcntl
import math
import os
import re
import shutil
import threading
import time
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated

import orjson
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, with_config

from api.errors import Refusal
from api.log import log

__all__ = ["BatchStore", "Record", "Results"]

_ID = re.compile(r"[0-9a-f]{32}")
_RECORD, _RESULTS = "record.json", "results.ndjson"


_BAD = ".bad"
"""The folder of a batch that cannot be read gets this suffix."""

_Count = Annotated[int, Field(ge=0)]
_Time = Annotated[float, Field(ge=0.0, le=1e11, allow_inf_nan=False)]


@with_config(ConfigDict(extra="ignore"))
@dataclass(slots=True)
class Record:
    """What is known of a batch: its requests by outcome, the bytes of its results, and when (s since 1970) it
    was created and finished. Fields that a newer version has written besides these are ignored."""

    id: str
    total: _Count
    created: _Time
    done: _Count = 0
    failed: _Count = 0
    cancelled: _Count = 0
    size: _Count = 0
    finished: _Time | None = None

    def become(self, other: Record) -> None:
        """Takes over what another record of the same batch says."""
        for each in fields(other):
            setattr(self, each.name, getattr(other, each.name))


_RECORDS = TypeAdapter(Record)


class _Unusable(Exception):
    """A record that this version cannot use."""


class Results:
    """The lines of one batch, open for writing. The lock on the file says that somebody still writes."""

    def __init__(self, path: Path) -> None:
        """Raises OSError where somebody else holds the lock."""
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(self._file)
            raise

    def append(self, line: bytes, size: int) -> None:
        """Adds a line to a file of `size` bytes, or leaves it as it is. Raises OSError."""
        try:
            left = memoryview(line)
            while left:
                left = left[os.write(self._file, left) :]
        except OSError:
            self.cut(size)
            raise

    def cut(self, size: int) -> None:
        """Shortens the file to `size` bytes."""
        os.ftruncate(self._file, size)

    def sync(self) -> None:
        """Waits until the disk has what was added."""
        os.fsync(self._file)

    def close(self) -> None:
        """Closes the file, which also unlocks it."""
        os.close(self._file)


class BatchStore:
    """Batches by id, in root/<id>/. Those that have ended are kept for `keep` s, and while all results
    together do not exceed `limit` bytes; then the oldest go.

    A batch whose server died is ended by whoever looks at it next: what was not done counts as cancelled. One
    whose record cannot be used is moved to root/<id>.bad; these go first if room is needed.

    Time is counted by the monotonic clock from the moment in which this store first sees that a batch has
    ended. Only the time before, when another process ran, is told by the wall clock.

    set_aside  batches moved so far because their record could not be used
    """

    def __init__(self, root: Path, keep: float, limit: int) -> None:
        self.root = root
        self.keep = keep
        self.limit = limit
        self.set_aside = 0
        self._used = 0
        self._ends: dict[str, float] = {}
        self._lock = threading.Lock()

    def create(self, record: Record) -> Results:
        """Begins to keep a batch. Raises OSError."""
        with self._lock:
            self._make_room(0)
        place = self.root / record.id
        place.mkdir(parents=True)
        try:
            _sync(self.root)
            results = Results(place / _RESULTS)
            self.save(record)
        except OSError:
            shutil.rmtree(place, ignore_errors=True)
            raise
        return results

    def append(self, record: Record, results: Results, line: bytes) -> None:
        """Adds a line of a batch; the record is not saved yet. Raises OSError where there is no room."""
        with self._lock:
            if self._used + len(line) > self.limit:
                self._make_room(len(line))
            if self._used + len(line) > self.limit:
                raise OSError(errno.ENOSPC, "The results of running batches fill the store.")
            results.append(line, record.size)
            self._used += len(line)
        record.size += len(line)

    def save(self, record: Record) -> None:
        """Writes the record, and waits until the disk has it. Raises OSError."""
        if record.finished is not None:
            self._ends.setdefault(record.id, time.monotonic() + self.keep)
        place = self.root / record.id
        made = place / ".record"
        with made.open("wb") as file:
            file.write(orjson.dumps(asdict(record)))
            file.flush()
            os.fsync(file.fileno())
        made.rename(place / _RECORD)
        _sync(place)

    def load(self, id: str) -> Record:
        """The record of a batch that has ended. Raises Refusal: unknown-batch."""
        # Nothing but an id ever becomes part of a path.
        record = self._read(id) if _ID.fullmatch(id) else None
        if record is None or self._left(record) <= 0:
            raise Refusal("unknown-batch", "There is no batch of this id.", batch=id[:32])
        return record

    def read(self, id: str, offset: int, size: int) -> bytes:
        """Bytes of the results. Raises FileNotFoundError where they have expired."""
        with open(self.root / id / _RESULTS, "rb") as file:
            return os.pread(file.fileno(), size, offset)

    def _left(self, record: Record) -> float:
        """How long the results of a batch that has ended are still kept, s."""
        if record.id not in self._ends:
            age = min(max(0.0, time.time() - (record.finished or 0.0)), self.keep)
            self._ends[record.id] = time.monotonic() - age + self.keep
        return self._ends[record.id] - time.monotonic()

    def _read(self, id: str) -> Record | None:
        """The record of a batch that has ended. None: it is not there, or its server still writes it."""
        try:
            return self._ended(id, self._record(id))
        except OSError as error:
            if not isinstance(error, PermissionError | IsADirectoryError | NotADirectoryError):
                return None  # deleted this moment, still written by its server, or no descriptor is left
            self._put_aside(id, repr(error))
        except _Unusable as error:
            self._put_aside(id, str(error))
        return None

    def _record(self, id: str) -> Record:
        try:
            record = _RECORDS.validate_json((self.root / id / _RECORD).read_bytes())
        except ValidationError as error:
            faults = [f"{fault['loc']}: {fault['msg']}" for fault in error.errors(include_input=False)]
            raise _Unusable("; ".join(faults)) from None
        if record.id != id:
            raise _Unusable("it is another batch's")
        if record.done + record.failed + record.cancelled > record.total:
            raise _Unusable("its counts exceed its total")
        if record.size > self._size(id):
            raise _Unusable("results are missing")
        return record

    def _ended(self, id: str, record: Record) -> Record:
        """The record; its batch is ended if its server died. Raises OSError if that still runs."""
        if record.finished is None:
            results = Results(self.root / id / _RESULTS)
            try:
                results.cut(record.size)
                record.cancelled = record.total - record.done - record.failed
                record.finished = time.time()
                with suppress(OSError):  # a full disk is no reason not to read it
                    self.save(record)
            finally:
                results.close()
        return record

    def _put_aside(self, id: str, reason: str) -> None:
        """Moves a batch that cannot be read, unless its server still writes it: that replaces the record."""
        place = self.root / id
        try:
            with suppress(FileNotFoundError, PermissionError, NotADirectoryError):
                Results(place / _RESULTS).close()
            place.rename(place.with_suffix(_BAD))
            _sync(self.root)
        except OSError:
            return
        self.set_aside += 1
        log(event="a batch cannot be read", batch=id, moved_to=id + _BAD, reason=reason[:500])

    def _make_room(self, size: int) -> None:
        """Forgets what has expired, and the oldest results where `size` bytes more would be too many."""
        names = [place.name for place in self.root.iterdir()] if self.root.exists() else []
        sizes = {name: self._size(name) for name in names}
        self._used = sum(sizes.values())
        ended = [r for r in map(self._read, filter(_ID.fullmatch, names)) if r is not None]
        left = {record.id: self._left(record) for record in ended}
        bad = [name for name in names if name.endswith(_BAD)]
        for name in bad + sorted(left, key=lambda id: left[id]):
            if left.get(name, math.inf) <= 0 or self._used + size > self.limit:
                shutil.rmtree(self.root / name, ignore_errors=True)
                self._used -= sizes[name]
                self._ends.pop(name, None)

    def _size(self, name: str) -> int:
        try:
            return (self.root / name / _RESULTS).stat().st_size
        except OSError:
            return 0


def _sync(folder: Path) -> None:
    """Waits until the disk has the names in a folder."""
    file = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(file)
    finally:
        os.close(file)
