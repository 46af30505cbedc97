"""The store of results: what a crash or a full disk leaves of it."""

import errno
import os
import time

import pytest

from api.batch_store import BatchStore, Record, Results
from api.errors import Refusal


def test_a_line_that_does_not_fit_leaves_no_half(tmp_path, monkeypatch):
    results, real = Results(tmp_path / "lines"), os.write
    results.append(b"whole\n", 0)

    def small(file, data):
        if len(data) < 10:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(file, data[:10])

    monkeypatch.setattr(os, "write", small)
    with pytest.raises(OSError, match="No space"):
        results.append(b"x" * 25, 6)
    monkeypatch.undo()
    results.close()
    assert (tmp_path / "lines").read_bytes() == b"whole\n"


def test_a_batch_whose_server_was_killed_is_cancelled_and_half_a_line_is_dropped(tmp_path):
    record, store = Record("a" * 32, 5, time.time()), BatchStore(tmp_path, 60, 10**6)
    results = store.create(record)
    store.append(record, results, b'{"index":0}\n')
    record.failed = 1
    store.save(record)
    with pytest.raises(Refusal, match="no batch"):
        store.load(record.id)  # its server lives, and it is another
    os.write(results._file, b'{"index":1,"na')
    results.close()
    found = store.load(record.id)
    assert (found.done, found.failed, found.cancelled) == (0, 1, 4)
    assert found.finished is not None
    assert (tmp_path / record.id / "results.ndjson").read_bytes() == b'{"index":0}\n'
