"""The store of results: what a crash or a full disk leaves of it."""

import errno
import json
import os
import time
from dataclasses import asdict

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


def kept(root, name, total=2, **changes):
    """The folder of a batch that has ended, with one line of results."""
    results = b'{"index":0}\n'
    record = Record(name, total, time.time(), done=1, cancelled=total - 1, size=len(results))
    place = root / name
    place.mkdir(parents=True)
    (place / "results.ndjson").write_bytes(results)
    document = asdict(record) | {"finished": time.time()} | changes
    (place / "record.json").write_text(json.dumps(document))
    return place


@pytest.mark.parametrize(
    "content",
    [
        b"", b"{", b"null", b"[]", b"{}", b"\xff\xfe",
        b'{"id":"' + b"b" * 32 + b'","total":"many","created":0}',
        b'{"id":"' + b"c" * 32 + b'","total":1,"created":0}', b"[" * 100_000,
    ],
)  # fmt: skip
def test_a_record_that_cannot_be_used_is_moved_away_once(tmp_path, content, monkeypatch):
    lines, store = [], BatchStore(tmp_path, 60, 10**6)
    monkeypatch.setattr("api.batch_store.log", lambda **line: lines.append(line))
    place = kept(tmp_path, "b" * 32)
    (place / "record.json").write_bytes(content)
    good = kept(tmp_path, "d" * 32)
    for id in ("e" * 32, "f" * 32):
        store.create(Record(id, 1, time.time())).close()
    assert store.load(good.name).done == 1
    with pytest.raises(Refusal, match="no batch"):
        store.load(place.name)
    assert (store.set_aside, len(lines)) == (1, 1)
    assert lines[0]["batch"] == place.name
    assert (tmp_path / lines[0]["moved_to"] / "record.json").read_bytes() == content


@pytest.mark.parametrize(
    "changes",
    [
        {"total": 1.5}, {"size": -1}, {"size": 10**6}, {"finished": "yesterday"}, {"finished": 1e300},
        {"done": 3}, {"id": "a" * 32}, {"created": None},
    ],
)  # fmt: skip
def test_a_record_with_an_impossible_value_is_moved_away(tmp_path, changes):
    store, place = BatchStore(tmp_path, 60, 10**6), kept(tmp_path, "b" * 32, **changes)
    store.create(Record("e" * 32, 1, time.time())).close()
    assert store.set_aside == 1
    assert not place.exists()


def test_a_folder_in_place_of_a_record_is_moved_away_and_other_files_are_left_alone(tmp_path):
    store, place = BatchStore(tmp_path, 60, 10**6), tmp_path / ("b" * 32)
    (place / "record.json").mkdir(parents=True)
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / ("c" * 32)).write_text("a file")
    store.create(Record("e" * 32, 1, time.time())).close()
    assert not place.exists()
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_fields_of_a_newer_version_are_ignored(tmp_path):
    place = kept(tmp_path, "b" * 32, priority=9, owner={"name": "x"})
    store = BatchStore(tmp_path, 60, 10**6)
    assert store.load(place.name).done == 1
    assert store.set_aside == 0


def test_a_batch_that_still_runs_is_not_moved_away_whatever_its_record_says(tmp_path):
    store, record = BatchStore(tmp_path, 60, 10**6), Record("a" * 32, 5, time.time())
    results = store.create(record)
    (tmp_path / record.id / "record.json").write_text("{")
    BatchStore(tmp_path, 60, 10**6).create(Record("b" * 32, 1, time.time())).close()
    record.finished = time.time()
    store.save(record)
    results.close()
    assert store.load(record.id).total == 5


def test_what_was_moved_away_goes_first_if_room_is_needed(tmp_path):
    store = BatchStore(tmp_path, 60, 30)
    kept(tmp_path, "b" * 32, id="x")
    good = kept(tmp_path, "c" * 32)
    store.create(Record("d" * 32, 1, time.time())).close()
    record = Record("e" * 32, 1, time.time())
    results = store.create(record)
    store.append(record, results, b"1234567890\n")
    results.close()
    assert {place.name[:1] for place in tmp_path.iterdir()} == {"c", "d", "e"}
    assert store.load(good.name)


@pytest.mark.parametrize("step", [-1e6, -100.0, 100.0, 1e6])
def test_a_step_of_the_clock_neither_deletes_nor_keeps_results(tmp_path, monkeypatch, step):
    clocks = {"time": 1e9, "monotonic": 500.0}
    for name in clocks:
        monkeypatch.setattr(time, name, lambda name=name: clocks[name])
    store, record = BatchStore(tmp_path, 60.0, 10**6), Record("a" * 32, 1, time.time())
    store.create(record).close()
    record.finished = time.time()
    store.save(record)
    clocks["time"] += step
    clocks["monotonic"] += 59.0
    assert store.load(record.id)
    clocks["monotonic"] += 2.0
    with pytest.raises(Refusal, match="no batch"):
        store.load(record.id)
    store.create(Record("b" * 32, 1, time.time())).close()
    assert not (tmp_path / record.id).exists()


@pytest.mark.parametrize(("passed", "left"), [(-1e6, 60.0), (0.0, 60.0), (20.0, 40.0), (1e6, 0.0)])
def test_after_a_restart_the_wall_clock_tells_how_old_results_are(tmp_path, monkeypatch, passed, left):
    clocks = {"time": 1e9, "monotonic": 500.0}
    for name in clocks:
        monkeypatch.setattr(time, name, lambda name=name: clocks[name])
    place = kept(tmp_path, "b" * 32, created=1e9, finished=1e9)
    clocks["time"] += passed
    store = BatchStore(tmp_path, 60.0, 10**6)
    if left:
        store.load(place.name)
    clocks["monotonic"] += left - 0.5
    if left:
        store.load(place.name)
    clocks["monotonic"] += 1.0
    with pytest.raises(Refusal, match="no batch"):
        store.load(place.name)


def test_records_and_folders_are_on_disk_before_they_count(tmp_path, monkeypatch):
    synced, real = [], os.fsync

    def fsync(file):
        synced.append(os.path.basename(os.readlink(f"/proc/self/fd/{file}")))
        real(file)

    monkeypatch.setattr(os, "fsync", fsync)
    store, record = BatchStore(tmp_path, 60, 10**6), Record("a" * 32, 1, time.time())
    results = store.create(record)
    assert synced == [tmp_path.name, ".record", record.id]
    store.append(record, results, b"line\n")
    results.sync()
    store.save(record)
    results.close()
    assert synced[3:] == ["results.ndjson", ".record", record.id]
