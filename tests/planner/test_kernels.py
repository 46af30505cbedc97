"""Kernels are compiled once, before the clock of the first plan begins."""

import os
import subprocess
import sys
import time

import pytest

from planner import kernels, stopwatch
from planner.kernels import make_ready
from planner.stopwatch import Stopwatch


@pytest.fixture
def started(monkeypatch, tmp_path):
    """The shares whose compilers were started, in an empty cache; ended[0] is their exit status."""
    started, ended = [], [0]

    def compiler(share):
        started.append(share)
        return subprocess.Popen(
            [sys.executable, "-c", f"raise SystemExit({ended[0]})"], stdin=subprocess.PIPE
        )

    monkeypatch.setattr(kernels, "_ready", False)
    monkeypatch.setattr(kernels, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(kernels, "code_folder", lambda file, module: tmp_path / f"{module}-0")
    monkeypatch.setattr(kernels, "_compiler", compiler)
    monkeypatch.setattr(kernels, "_POLL", 0.01)
    started_and_ended = started, ended
    return started_and_ended


def test_what_the_cache_lacks_is_compiled_once_by_several_processes(started, monkeypatch):
    told = []
    make_ready(lambda done, total: told.append((done, total)))
    assert sorted(started[0]) == [0, 1]
    assert told[0][0] == 0
    assert told[-1][0] == told[-1][1] > 100
    monkeypatch.setattr(kernels, "_ready", False)  # another process
    make_ready(lambda done, total: told.append(None))
    assert len(started[0]) == 2
    assert None not in told


def test_compilers_that_fail_are_told_of_and_tried_again_by_the_next_process(started, monkeypatch):
    started[1][0] = 1
    with pytest.warns(RuntimeWarning, match="could not be compiled"):
        make_ready()
    make_ready()
    assert len(started[0]) == 2
    started[1][0] = 0
    monkeypatch.setattr(kernels, "_ready", False)
    make_ready()
    assert len(started[0]) == 4


def test_code_that_nobody_has_used_for_a_month_is_deleted(started, tmp_path):
    (old := tmp_path / "planner.gone-0").mkdir()
    (new := tmp_path / "planner.here-0").mkdir()
    month = time.time() - 31 * 86400
    os.utime(old, (month, month))
    make_ready()
    assert new.exists()
    assert not old.exists()


def test_new_files_with_kernels_are_found_without_a_list():
    named = {code.name.rpartition("-")[0] for code in kernels._kernels()}
    assert {"drives.steering", "drives.caster", "planner.edges", "planner.interior_point"} <= named


def test_the_clock_of_a_plan_stands_still_while_kernels_are_compiled(monkeypatch):
    waited = [0.0]
    monkeypatch.setattr(stopwatch, "compiling", lambda: waited[0])
    watch = Stopwatch(1.0)
    time.sleep(0.02)
    waited[0] = 0.02  # it was a compilation
    watch.lap("search")
    assert watch.timings()["search"] < 0.015
    assert not watch.is_over(0.95)
