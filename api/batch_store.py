"""Where the results of batches are kept: a folder each, with the lines and a record of how far they go."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import shutil
import threading
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import orjson

from api.errors import Refusal

__all__ = ["BatchStore", "Record", "Results"]

_ID = re.compile(r"[0-9a-f]{32}")
_RECORD, _RESULTS = "record.json", "results.ndjson"


@dataclass(slots=True)
class Record:
    """What is known of a batch: its requests by outcome, the bytes of its results, and when (s since 1970) it
    was created and finished."""

    id: str
    total: int
    created: float
    done: int = 0
    failed: int = 0
    cancelled: int = 0
    size: int = 0
    finished: float | None = None


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

    def close(self) -> None:
        """Closes the file, which also unlocks it."""
        os.close(self._file)


class BatchStore:
    """Batches by id, in root/<id>/. Those that have ended are kept for `keep` s, and while all results
    together do not exceed `limit` bytes; then the oldest go.

    A batch whose server died is ended by whoever looks at it next: what was not done counts as cancelled.
    """

    def __init__(self, root: Path, keep: float, limit: int) -> None:
        self.root = root
        self.keep = keep
        self.limit = limit
        self._used = 0
        self._lock = threading.Lock()

    def create(self, record: Record) -> Results:
        """Begins to keep a batch. Raises OSError."""
        with self._lock:
            self._make_room(0)
        place = self.root / record.id
        place.mkdir(parents=True)
        try:
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
        """Writes the record. Raises OSError."""
        place = self.root / record.id
        made = place / ".record"
        made.write_bytes(orjson.dumps(asdict(record)))
        made.rename(place / _RECORD)

    def load(self, id: str) -> Record:
        """The record of a batch that has ended. Raises Refusal: unknown-batch."""
        # Nothing but an id ever becomes part of a path.
        record = self._read(id) if _ID.fullmatch(id) else None
        if record is None or record.finished is None or record.finished + self.keep < time.time():
            raise Refusal("unknown-batch", "There is no batch of this id.", batch=id[:32])
        return record

    def read(self, id: str, offset: int, size: int) -> bytes:
        """Bytes of the results. Raises FileNotFoundError where they have expired."""
        with open(self.root / id / _RESULTS, "rb") as file:
            return os.pread(file.fileno(), size, offset)

    def _read(self, id: str) -> Record | None:
        try:
            record = Record(**orjson.loads((self.root / id / _RECORD).read_bytes()))
            if record.finished is None:
                results = Results(self.root / id / _RESULTS)
                results.cut(record.size)
                record.cancelled = record.total - record.done - record.failed
                record.finished = time.time()
                with suppress(OSError):  # a full disk is no reason not to read it
                    self.save(record)
                results.close()
        except OSError:  # no such batch, deleted this moment, or still written by its server
            return None
        return record

    def _make_room(self, size: int) -> None:
        """Forgets what has expired, and the oldest results where `size` bytes more would be too many."""
        places = [place.name for place in self.root.iterdir()] if self.root.exists() else []
        sizes = {id: self._size(id) for id in places}
        self._used = sum(sizes.values())
        ended = [r for r in map(self._read, places) if r is not None and r.finished is not None]
        for record in sorted(ended, key=lambda record: record.finished or 0.0):
            expired = (record.finished or 0.0) + self.keep < time.time()
            if expired or self._used + size > self.limit:
                shutil.rmtree(self.root / record.id, ignore_errors=True)
                self._used -= sizes[record.id]

    def _size(self, id: str) -> int:
        try:
            return (self.root / id / _RESULTS).stat().st_size
        except OSError:
            return 0
