"""The service's log: one JSON object a line on standard error.

A thread writes the lines, so that a reader of standard error that stalls does not stop the service. While
`_MOST` lines wait for it, further ones are dropped and counted.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from logging.handlers import QueueHandler, QueueListener
from queue import Full, Queue
from typing import Any

import orjson

__all__ = ["adopt", "dropped", "log", "logging_to_stderr"]

_MOST = 10_000
_LAST_WORDS = 1.0
"""How long lines that still wait at the end may take to be written, s."""

_STDERR = 2

_logger = logging.getLogger("wheelplan")
_dropped = 0


def log(**fields: Any) -> None:
    """Writes one line."""
    _logger.info(orjson.dumps({"time": _now(), **fields}).decode())


def dropped() -> int:
    """Lines dropped so far."""
    return _dropped


def _drop() -> None:
    global _dropped
    _dropped += 1


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


@contextmanager
def logging_to_stderr() -> Iterator[None]:
    """Sends our lines, and warnings of the libraries, to standard error."""
    lines: Queue[Any] = Queue(_MOST)
    handler = _Waiting(lines)
    handler.setFormatter(_Lines())
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    _logger.setLevel(logging.INFO)
    QueueListener(lines, _Descriptor()).start()
    try:
        yield
    finally:
        until = time.monotonic() + _LAST_WORDS
        while lines.unfinished_tasks and time.monotonic() < until:
            time.sleep(0.01)


def adopt(library: str) -> None:
    """Sends what a library logs the way of all lines, and not through handlers of its own."""
    for name in [name for name in logging.root.manager.loggerDict if name.split(".")[0] == library]:
        logger = logging.getLogger(name)
        logger.handlers.clear()
        logger.propagate = True
        logger.setLevel(logging.NOTSET if "." in name else logging.WARNING)


class _Lines(logging.Formatter):
    """Our own lines as they are, and those of the libraries as JSON too."""

    def format(self, record: logging.LogRecord) -> str:
        text = super().format(record)
        if record.name == _logger.name:
            return text
        line = {"time": _now(), "event": "message", "level": record.levelname.lower(), "text": text}
        return orjson.dumps(line).decode()


class _Waiting(QueueHandler):
    """Formats lines and hands them to the thread."""

    def enqueue(self, record: logging.LogRecord) -> None:
        try:
            self.queue.put_nowait(record)
        except Full:
            _drop()


class _Descriptor(logging.Handler):
    """Writes lines to the descriptor itself: Python's own stream could not be closed amid a write."""

    def createLock(self) -> None:
        """None: one thread writes, and an exit amid a write must not wait for it."""
        self.lock = None

    def emit(self, record: logging.LogRecord) -> None:
        line = f"{record.getMessage()}\n".encode()
        try:
            while line:
                line = line[os.write(_STDERR, line) :]
        except OSError:  # nobody reads
            _drop()
