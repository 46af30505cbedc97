"""The service's log: one JSON object a line on standard error."""

from __future__ import annotations

import logging
import sys
from typing import Any

import orjson

__all__ = ["log", "log_to_stderr"]

_logger = logging.getLogger("wheelplan")


def log(**fields: Any) -> None:
    """Writes one line."""
    _logger.info(orjson.dumps(fields).decode())


def log_to_stderr() -> None:
    """Sends our lines, and warnings of the libraries, to standard error."""
    logging.basicConfig(level=logging.WARNING, format="%(message)s", stream=sys.stderr)
    _logger.setLevel(logging.INFO)
