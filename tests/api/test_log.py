"""The log's queue."""

import logging
from queue import Queue

from api.log import _Waiting, dropped


def test_lines_that_find_no_room_are_dropped_and_counted():
    handler, before = _Waiting(Queue(2)), dropped()
    for number in range(5):
        handler.handle(logging.LogRecord("wheelplan", logging.INFO, "", 0, str(number), None, None))
    assert dropped() == before + 3
    assert [handler.queue.get().getMessage() for _ in range(2)] == ["0", "1"]
