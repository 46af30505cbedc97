"""The log's queue."""

import logging
from queue import Queue

import pytest

from api.log import _Waiting, dropped


def test_lines_that_find_no_room_are_dropped_and_counted():
    handler, before = _Waiting(Queue(2)), dropped()
    for number in range(5):
        handler.handle(logging.LogRecord("wheelplan", logging.INFO, "", 0, str(number), None, None))
    assert dropped() == before + 3
    assert [handler.queue.get().getMessage() for _ in range(2)] == ["0", "1"]


def test_what_dask_logs_goes_the_same_way(caplog):
    pytest.importorskip("distributed")
    import api.cluster  # noqa: F401

    loggers = [logging.getLogger(name) for name in logging.root.manager.loggerDict if "distributed" in name]
    assert len(loggers) > 3
    assert [logger for logger in loggers if logger.handlers or not logger.propagate] == []
    logging.getLogger("distributed.client").warning("lost")
    assert "lost" in caplog.text
