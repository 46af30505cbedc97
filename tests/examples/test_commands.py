"""What examples/README.md shows works as it stands, against a live service."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from drives import DRIVES

EXAMPLES = Path(__file__).parents[2] / "examples"
TEXT = (EXAMPLES / "README.md").read_text(encoding="utf-8")
HERE = "http://127.0.0.1:8000"
SECTIONS = {part.partition("\n")[0]: part for part in TEXT.split("\n## ")[1:]}
PREFACE = re.findall(r"```python\n(.*?)```", TEXT.partition("\n## ")[0], re.DOTALL)
LEAVES = {
    "ackermann": "ackermann.svg", "differential": "differential.traj", "mecanum": "mecanum.json",
    "omni": "omni.csv", "powered_caster": "powered_caster.json", "skid_steer": "skid_steer.events",
    "swedish": "swedish.msgpack", "swerve": "swerve.wpilib.json", "synchro": "synchro.json",
    "tracked": "tracked.order.json", "tricycle": "tricycle.order.json",
}  # fmt: skip


@pytest.fixture(scope="module")
def demo() -> Any:
    sys.path.insert(0, str(EXAMPLES))
    try:
        import demo

        yield demo
    finally:
        sys.path.remove(str(EXAMPLES))


@pytest.fixture(scope="module")
def url(demo: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with demo.service(tmp_path_factory.mktemp("data")) as url:
        yield url


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder from which the examples are seen as from the project's."""
    (tmp_path / "examples").symlink_to(EXAMPLES)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def blocks(section: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", SECTIONS[section], re.DOTALL)


def shell(script: str, url: str) -> None:
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script.replace(HERE, url)],
        env={**os.environ, "no_proxy": "127.0.0.1"}, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


def test_every_drive_has_a_section() -> None:
    assert {name.removesuffix(".json") for name in SECTIONS} - {"A warehouse"} == set(DRIVES) == set(LEAVES)


@pytest.mark.parametrize("drive", DRIVES)
def test_the_curl_of_each_drive_is_answered(drive: str, url: str, elsewhere: Path) -> None:
    (script,) = blocks(f"{drive}.json", "sh")
    shell(script, url)
    left = (elsewhere / LEAVES[drive]).read_bytes()
    if LEAVES[drive].endswith(("json", "traj")):
        assert json.loads(left)
    else:
        start = {
            "svg": b"<?xml",
            "csv": b"time,x,y,theta",
            "events": b"event: plan",
            "msgpack": b"\x87\xa2id",
        }
        assert left.startswith(start[LEAVES[drive].rpartition(".")[2]])


@pytest.mark.parametrize("drive", DRIVES)
def test_the_python_of_each_drive_runs(drive: str, url: str, elsewhere: Path) -> None:
    (code,) = blocks(f"{drive}.json", "python")
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec("\n".join([*PREFACE, code]).replace(HERE, url), {})
    if drive == "tricycle":
        assert "invalid-request ['/robot/limits/steering_rate']" in printed.getvalue()
    elif "print" in code:
        assert printed.getvalue()


def test_the_warehouse_is_uploaded_and_planned_in(url: str, elsewhere: Path) -> None:
    (script,) = blocks("A warehouse", "sh")
    shell(script, url)
    assert json.loads((elsewhere / "plan.json").read_bytes())["duration"] > 0


def test_the_script_plans_for_three_robots_and_draws_them(demo: Any, url: str, tmp_path: Path) -> None:
    assert demo.client.run(url, tmp_path) == 0
    made = {path.name for path in tmp_path.iterdir()}
    assert made == {f"{robot}.{form}" for robot in demo.client.ROBOTS for form in ("json", "csv", "png")}


def test_the_script_says_why_it_cannot(demo: Any, tmp_path: Path, capsys: Any) -> None:
    assert demo.client.run("http://127.0.0.1:9", tmp_path) == 1
    assert "http://127.0.0.1:9: " in capsys.readouterr().err
