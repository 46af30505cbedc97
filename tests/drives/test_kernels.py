"""The cache of compiled functions finds no stale code, and needs no folder to write to."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numba
import pytest

from drives import kernels
from drives.kernels import cache_folder, code_folder, compiling, exclusive, kernel

CACHES = cache_folder, code_folder, kernels._source, kernels._imports, kernels._lock


@pytest.fixture(autouse=True)
def _forgotten(monkeypatch):
    """Paths and hashes are found anew in each test."""
    for cached in CACHES:
        cached.cache_clear()
    yield
    for cached in CACHES:
        cached.cache_clear()


def fails(*_, **__):
    raise OSError


def test_a_kernel_is_compiled_anew_when_a_file_changes_that_its_file_imports(tmp_path):
    (tmp_path / "room").mkdir()
    for name, text in {
        "a": "from room.b import x",
        "b": "from room.c import y",
        "c": "y = 1",
        "d": "z = 1",
    }.items():
        (tmp_path / "room" / f"{name}.py").write_text(text)

    def folder():
        code_folder.cache_clear()
        kernels._source.cache_clear()
        return code_folder(tmp_path / "room" / "a.py", "room.a")

    before = folder()
    (tmp_path / "room" / "d.py").write_text("z = 2")
    assert folder() == before
    (tmp_path / "room" / "c.py").write_text("y = 2")
    assert folder() != before


def test_the_cache_does_not_depend_on_where_the_sources_lie(tmp_path):
    for place in ("here", "there"):
        (tmp_path / place / "room").mkdir(parents=True)
        (tmp_path / place / "room" / "a.py").write_text("x = 1")
    here, there = (code_folder(tmp_path / place / "room" / "a.py", "room.a") for place in ("here", "there"))
    assert here == there


def test_the_cache_lies_in_the_user_s_cache_folder_or_where_numba_is_told(monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder().parent == tmp_path / "xdg" / "wheelplan" / "kernels"
    cache_folder.cache_clear()
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder().parent == tmp_path / "home" / ".cache" / "wheelplan" / "kernels"
    cache_folder.cache_clear()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "told"))
    assert cache_folder().parent == tmp_path / "told" / "wheelplan"


def test_without_a_home_the_cache_lies_in_a_private_folder_of_temporary_files(monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", "/proc/nonexistent")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    found = cache_folder()
    private = tmp_path / f"wheelplan-{os.getuid()}"
    assert found.parent == private / "kernels"
    assert private.stat().st_mode & 0o777 == 0o700


def test_code_that_others_may_have_written_is_not_used(monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", "/proc/nonexistent")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    (private := tmp_path / f"wheelplan-{os.getuid()}").mkdir()
    private.chmod(0o777)
    assert cache_folder() is None


def test_a_complete_cache_that_is_read_only_is_used_and_an_empty_one_is_not(monkeypatch, tmp_path):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "built"))
    built = cache_folder()
    cache_folder.cache_clear()
    monkeypatch.setattr(kernels.tempfile, "TemporaryFile", fails)
    assert cache_folder() is None
    cache_folder.cache_clear()
    (built / "ready-0").touch()
    assert cache_folder() == built


def test_kernels_work_without_any_cache(monkeypatch):
    monkeypatch.setattr(kernels, "_places", list)
    assert kernel(_twice)(4.0) == 8.0


def test_a_thread_knows_how_long_it_has_waited_for_kernels():
    began, before = time.perf_counter(), compiling()
    made = kernel(_twice)
    made(3.0)
    after = compiling()
    assert 0.0 < after - before <= time.perf_counter() - began
    made(4.0)
    assert compiling() == after


def test_a_name_is_held_by_one_process_at_a_time():
    ask = "from drives.kernels import exclusive\nwith exclusive({!r}, wait=False) as held: print(held)"

    def other_holds(name):
        command = [sys.executable, "-c", ask.format(name)]
        return subprocess.run(command, capture_output=True, cwd=Path(__file__).parents[2]).stdout == b"True\n"

    with exclusive("a"):
        assert not other_holds("a")
        assert other_holds("b")
    assert other_holds("a")


def _twice(x):
    return 2.0 * x
