"""The store of maps through crashes, damage, full disks and concurrent use."""

import errno
import io
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import planner.environment
from api.errors import Refusal
from api.maps import MapStore
from api.occupancy import DecodedMap
from drives.se2 import Pose
from planner.kept import recall

ROOM = DecodedMap(np.array([[0, 1, 2], [1, 1, 0]], dtype=np.int8), 0.5, Pose(1.0, -2.0, 0.25))
HALL = DecodedMap(np.zeros((60, 80), dtype=np.int8), 0.1, Pose(0.0, 0.0, 0.0))


@pytest.fixture
def store(tmp_path):
    return MapStore(tmp_path / "maps", 10)


def files(store):
    return {file.name for file in store.root.iterdir() if not file.name.startswith("index.db")}


def code(call, *args):
    with pytest.raises(Refusal) as refused:
        call(*args)
    return refused.value.code


# ---------------------------------------------------------------- crashes

CHANGES = ["os.mkdir", "os.fsync", "os.rename", "os.replace", "os.unlink", "os.rmdir", "os.chmod"]


def killed_at(store, step, work):
    """Whether a process that does the work is killed -9 just before its step-th change to the disk."""

    def child():
        left = [step]

        def dying(change):
            def counted(*args, **more):
                left[0] -= 1
                if left[0] < 0:
                    os.kill(os.getpid(), signal.SIGKILL)
                return change(*args, **more)

            return counted

        for name in CHANGES:
            setattr(os, name.removeprefix("os."), dying(getattr(os, name.removeprefix("os."))))
        work(MapStore(store.root, 10))
        os._exit(0)

    process = get_context("fork").Process(target=child)
    process.start()
    process.join(60)
    assert process.exitcode in (0, -signal.SIGKILL)
    return process.exitcode != 0


def test_a_kill_at_any_step_of_an_upload_or_deletion_leaves_all_or_nothing(store):
    hall = store.add(HALL)[0]
    works = {
        "add": (lambda: None, lambda other: other.add(ROOM)),
        "delete": (lambda: store.add(ROOM), lambda other: other.delete(ROOM.id)),
    }
    steps = {}
    for name, (before, work) in works.items():
        before()
        step = 0
        while killed_at(store, step, work):
            store.sweep()
            there = [summary["id"] for summary in store.list()]
            assert there in ([hall["id"]], sorted([hall["id"], ROOM.id])), (name, step)
            assert files(store) == set(there), (name, step)
            for summary in store.list():
                assert store.get(summary["id"]) == summary
            before()
            if name == "add" and ROOM.id in there:
                store.delete(ROOM.id)
            step += 1
        steps[name] = step
    assert steps["add"] >= 8
    assert steps["delete"] >= 3


def test_an_index_that_is_lost_or_damaged_is_made_again_from_the_folders(store):
    summaries = sorted((store.add(decoded)[0] for decoded in (ROOM, HALL)), key=lambda s: s["id"])
    for damage in (lambda file: file.unlink(), lambda file: file.write_bytes(b"x" * file.stat().st_size)):
        damage(store.root / "index.db")
        assert [s for s in store.list() if s not in summaries] == []
        store.sweep()
        assert store.list() == summaries
        with sqlite3.connect(store.root / "index.db") as index:
            assert index.execute("SELECT count(*) FROM maps").fetchone() == (2,)


def test_an_upload_under_way_is_not_swept(store, monkeypatch):
    def interrupted(layer):
        MapStore(store.root, 10).sweep()  # another server starts
        assert layer.directory.exists()

    monkeypatch.setattr("api.maps.prepare_map", interrupted)
    assert store.add(ROOM)[1]
    assert files(store) == {ROOM.id}


# ---------------------------------------------------------------- damage


@pytest.mark.parametrize("byte", [0, 8, -1])
def test_a_flipped_byte_in_the_cells_is_found_and_a_new_upload_mends_it(store, byte):
    store.add(ROOM)
    store.layer(ROOM.id)
    file = store.root / ROOM.id / "cells.npy"
    content = bytearray(file.read_bytes())
    content[byte] ^= 1
    file.write_bytes(content)
    for call in (store.get, store.layer, store.image):
        assert code(call, ROOM.id) == "map-corrupt"
    assert store.add(ROOM) == (ROOM.summary(), False)
    assert store.get(ROOM.id) == ROOM.summary()


@pytest.mark.parametrize(
    "change",
    [
        lambda place: (place / "cells.npy").unlink(),
        lambda place: (place / "cells.npy").write_bytes(b""),
        lambda place: (place / "meta.json").write_bytes(b"{"),
        lambda place: (place / "meta.json").write_bytes(b"[]"),
        lambda place: (place / "meta.json").write_text(json.dumps(ROOM.summary() | {"resolution": 0.25})),
        lambda place: (place / "meta.json").write_text(json.dumps(HALL.summary())),
        lambda place: np.save(place / "cells.npy", np.array([None, 1], dtype=object)),
    ],
)
def test_a_damaged_map_is_reported_and_can_be_deleted(store, change):
    store.add(ROOM)
    change(store.root / ROOM.id)
    assert code(store.layer, ROOM.id) == "map-corrupt"
    store.delete(ROOM.id)
    assert code(store.layer, ROOM.id) == "unknown-map"
    assert not files(store)


def test_damaged_derived_data_is_not_planned_with_and_is_made_again(store):
    store.add(ROOM)
    layer = replace(store.layer(ROOM.id), unknown="free")
    file = layer.directory / "ground-free.npy"
    content = bytearray(file.read_bytes())
    file.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    shape = ROOM.cells.shape
    assert recall(layer, shape, shape) is None
    ground = planner.environment._map_ground.__wrapped__(layer)
    kept = recall(layer, shape, shape)
    assert kept is not None
    assert np.array_equal(kept[1], ground.field)
    assert file.read_bytes() == bytes(content)


# ---------------------------------------------------------------- quota and full disks


def test_a_quota_in_bytes_refuses_what_would_not_fit(tmp_path):
    used = sum(f.stat().st_size for f in place_of(MapStore(tmp_path / "one", 10), HALL).iterdir())
    store = MapStore(tmp_path / "maps", 10, used + 100)
    store.add(HALL)
    assert code(store.add, ROOM) == "quota-exceeded"
    assert store.add(HALL) == (HALL.summary(), False)
    assert files(store) == {HALL.id}
    store.delete(HALL.id)
    assert store.add(ROOM)[1]


def place_of(store, decoded):
    store.add(decoded)
    return store.root / decoded.id


@pytest.mark.parametrize("call", ["fsync", "rename"])
@pytest.mark.parametrize("after", range(4))
def test_no_room_at_any_step_is_told_and_leaves_nothing(store, monkeypatch, call, after):
    store.add(HALL)
    count, real = [0], getattr(os, call)

    def full(*args, **more):
        count[0] += 1
        if count[0] > after:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(*args, **more)

    with monkeypatch.context() as patched:
        patched.setattr(f"os.{call}", full)
        try:
            assert code(store.add, ROOM) == "insufficient-storage"
        except pytest.fail.Exception:
            assert count[0] <= after  # it does not call it so often
    if count[0] <= after:
        store.delete(ROOM.id)
    assert files(store) == {HALL.id}
    assert store.add(ROOM)[1]


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 1 MiB of its own."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = shutil.which("mount") and subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(place)], capture_output=True
    )
    if not mounted or mounted.returncode:
        pytest.skip("no file system can be mounted here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_on_a_full_disk_uploads_are_refused_and_everything_else_works(small_disk):
    store = MapStore(small_disk / "maps", 10)
    store.add(ROOM)
    filler = small_disk / "filler"
    with open(filler, "wb", buffering=0) as file, suppress(OSError):
        while file.write(b"x" * 4096):
            pass
    assert code(store.add, HALL) == "insufficient-storage"
    store = MapStore(store.root, 10)
    store.sweep()
    assert store.list() == [ROOM.summary()]
    assert store.layer(ROOM.id).id == ROOM.id
    store.delete(ROOM.id)
    assert store.list() == []
    assert not files(store)
    filler.unlink()
    store.sweep()
    assert store.add(HALL)[1]
    assert store.list() == [HALL.summary()]


# ---------------------------------------------------------------- concurrent use


def test_a_deleted_map_keeps_its_files_until_the_last_who_uses_it_is_done(store):
    store.add(ROOM)
    other = MapStore(store.root, 10)
    with store.leased() as find:
        layer = find(ROOM.id)
        with other.leased() as find_too:
            find_too(ROOM.id)
            other.delete(ROOM.id)
            assert code(store.layer, ROOM.id) == "unknown-map"
        other.sweep()
        assert np.load(layer.directory / "cells.npy").shape == ROOM.cells.shape
    assert not files(store)


def test_a_map_uploaded_again_while_the_deleted_one_is_in_use_is_there(store):
    store.add(ROOM)
    with store.leased() as find:
        find(ROOM.id)
        store.delete(ROOM.id)
        assert store.add(ROOM)[1]
    assert store.get(ROOM.id) == ROOM.summary()
    assert store.list() == [ROOM.summary()]


CHURN = """
import random, sys
from pathlib import Path
import numpy as np
from api.errors import Refusal
from api.maps import MapStore
from api.occupancy import DecodedMap
from drives.se2 import Pose

store, draw = MapStore(Path(sys.argv[1]), 2), random.Random(int(sys.argv[2]))
for _ in range(60):
    decoded = DecodedMap(np.full((4, 4), draw.randrange(2), dtype=np.int8), 0.5, Pose(0.0, 0.0, 0.0))
    try:
        if draw.random() < 0.5:
            store.add(decoded)
        elif draw.random() < 0.5:
            store.delete(decoded.id)
        else:
            with store.leased() as find:
                assert np.load(find(decoded.id).directory / "cells.npy").shape == (4, 4)
    except Refusal as refused:
        assert refused.code in ("unknown-map", "quota-exceeded"), refused
"""


def test_processes_that_share_a_store_agree(store):
    root = Path(__file__).parents[2]
    command = [sys.executable, "-c", CHURN, str(store.root)]
    others = [subprocess.Popen([*command, str(seed)], cwd=root, stderr=subprocess.PIPE) for seed in range(3)]
    for other in others:
        assert other.communicate(timeout=120)[1] == b""
    listed = {summary["id"] for summary in store.list()}
    assert files(store) == listed
    for id in listed:
        store.get(id)


# ---------------------------------------------------------------- images


def pixels(store):
    return np.asarray(Image.open(io.BytesIO(store.image(ROOM.id).read()))).tolist()


def test_an_image_is_encoded_when_its_map_is_stored_and_never_again(store, monkeypatch):
    store.add(ROOM)
    monkeypatch.setattr("api.maps.Image", None)
    assert pixels(store) == [[0, 0, 254], [254, 0, 205]]


def test_a_map_stored_before_images_were_gets_one_that_lasts(store):
    store.add(ROOM)
    stored = pixels(store)
    (store.root / ROOM.id / "image.png").unlink()
    assert store.image(ROOM.id) is None
    store.draw(ROOM.id)
    assert pixels(store) == stored
    assert files(store) == {ROOM.id}
    assert code(store.draw, HALL.id) == "unknown-map"
