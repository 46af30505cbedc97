"""Large bodies between processes: a temporary file, whose descriptor is passed instead of its content."""

from __future__ import annotations

import io
import os
import pickle
import tempfile
from collections.abc import AsyncIterator, Sequence
from contextlib import closing
from multiprocessing import reduction
from multiprocessing.connection import Connection
from typing import IO, Any

import anyio

__all__ = ["LARGE", "Spool", "dumps", "loads", "pieces", "send", "spooled", "whole"]

LARGE = 1 << 20
"""Bytes; smaller bodies are cheaper to copy than to write to a file."""


_PIECE = 1 << 18


class Spool:
    """Bytes in a temporary file that has no name. They are read once, from the beginning."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        file.seek(0)
        self.size = os.fstat(file.fileno()).st_size

    @classmethod
    def holding(cls, data: bytes) -> Spool:
        """A new file with this content. Raises OSError if the disk is full."""
        file = tempfile.TemporaryFile()  # noqa: SIM115 - the spool closes it
        file.write(data)
        return cls(file)

    def read(self, size: int = -1) -> bytes:
        """The next `size` bytes, or all that are left."""
        return self._file.read(size)

    def fileno(self) -> int:
        return self._file.fileno()

    def close(self) -> None:
        self._file.close()

    def __reduce__(self) -> tuple[Any, ...]:
        # To another machine, the content itself.
        self._file.seek(0)
        return Spool.holding, (self.read(),)


def spooled(body: bytes) -> bytes | Spool:
    """The body, in a file if it is large. If the disk is full it stays in memory."""
    if len(body) < LARGE:
        return body
    try:
        return Spool.holding(body)
    except OSError:
        return body


def whole(body: bytes | Spool) -> bytes:
    """The body in memory."""
    if isinstance(body, bytes):
        return body
    with closing(body):
        return body.read()


async def pieces(body: bytes | Spool) -> AsyncIterator[bytes]:
    """The body piece by piece, without all of it in memory."""
    if isinstance(body, bytes):
        yield body
        return
    with closing(body):
        while piece := await anyio.to_thread.run_sync(body.read, _PIECE):
            yield piece


class _Pickler(pickle.Pickler):
    def __init__(self, file: IO[bytes]) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self.spools: list[Spool] = []

    def persistent_id(self, value: Any) -> int | None:
        if not isinstance(value, Spool):
            return None
        self.spools.append(value)
        return len(self.spools)


class _Unpickler(pickle.Unpickler):
    def __init__(self, data: bytes, pipe: Connection) -> None:
        super().__init__(io.BytesIO(data))
        self._pipe = pipe

    def persistent_load(self, _: Any) -> Spool:
        # Descriptors follow the message, in the order in which it names them.
        return Spool(os.fdopen(reduction.recv_handle(self._pipe), "rb"))


def dumps(value: Any) -> tuple[bytes, list[Spool]]:
    """What `send` takes: a value, pickled, and the spools in it."""
    pickler = _Pickler(buffer := io.BytesIO())
    pickler.dump(value)
    return buffer.getvalue(), pickler.spools


def send(pipe: Connection, data: bytes, spools: Sequence[Spool] = ()) -> None:
    """Sends what `dumps` made to another process of this machine, and closes the spools here."""
    pipe.send_bytes(data)
    for spool in spools:
        reduction.send_handle(pipe, spool.fileno(), None)
        spool.close()


def loads(data: bytes, pipe: Connection) -> Any:
    """The value that `recv_bytes` of this pipe brought, with its spools."""
    return _Unpickler(data, pipe).load()
