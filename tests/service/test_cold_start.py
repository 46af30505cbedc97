"""Real processes with an empty home folder: the first plan waits for the kernels, then is as later ones."""

import json
import re
import subprocess
import sys

import pytest

from tests.service.service import ROOT, serving

REQUEST = ROOT / "examples" / "tricycle.json"


@pytest.fixture
def home(tmp_path, monkeypatch):
    """An empty home folder for all processes that the test starts."""
    for variable in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()
    return tmp_path / "home"


def start_planning():
    command = [sys.executable, "-m", "api.cli", "plan", str(REQUEST)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def planned(process):
    """The schedule that a command has written, and what it said on standard error."""
    out, told = process.communicate(timeout=900)
    assert process.returncode == 0, told.decode()
    return json.loads(out)["schedule"], told.decode()


def test_a_command_and_a_service_that_start_at_once_in_an_empty_home_plan_as_later_ones_do(home, tmp_path):
    first = start_planning()
    with serving(tmp_path / "data", workers=1) as server:
        cold, told = planned(first)
        answered = json.loads(server.call("/v1/plans", json.loads(REQUEST.read_bytes()))[2])["schedule"]
        events = [json.loads(line) for line in server.log]
    assert re.fullmatch(r"compiling kernels, once per machine: \d+ s\n", told)
    assert 9.7 < cold["time"][-1] < 9.9
    names = [event.get("event") for event in events]
    begun, *_, ended = [i for i, name in enumerate(names) if name == "compiling kernels"]
    assert names.index("listening") < begun < names.index("ready")
    assert events[ended]["done"] == events[ended]["total"] > 100
    warm, told = planned(start_planning())
    assert told == ""
    assert cold == answered == warm
    assert not list(home.rglob("*.tmp.*"))
