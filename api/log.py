"""The service's log: one JSON object a line on standard error."""

from __future__ import annotations

import logging
import sys
from datetime import UTC, datetime
from typing import Any

import orjson

__all__ = ["log", "log_to_stderr"]

_logger = logging.getLogger("wheelplan")


def log(**fields: Any) -> None:
    """Writes one line."""
    _logger.info(orjson.dumps({"time": _now(), **fields}).decode())


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def log_to_stderr() -> None:
    """Sends our lines, and warnings of the libraries, to standard error."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Lines())
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    _logger.setLevel(logging.INFO)


class _Lines(logging.Formatter):
    """Our own lines as they are, and those of the libraries as JSON too."""

    def format(self, record: logging.LogRecord) -> str:
        text = super().format(record)
        if record.name == _logger.name:
            return text
        line = {"time": _now(), "event": "message", "level": record.levelname.lower(), "text": text}
        return orjson.dumps(line).decode()
