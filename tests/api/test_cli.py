import json
import math
from dataclasses import fields

import numpy as np
import pytest

from api import cli
from api.settings import Settings
from planner.errors import NoPathExists


@pytest.fixture
def request_file(tmp_path, body):
    path = tmp_path / "request.json"
    path.write_text(json.dumps(body))
    return path


def test_a_plan_goes_to_standard_output(request_file, planner_, capsysbinary):
    assert cli.main(["plan", str(request_file)]) == 0
    out, err = capsysbinary.readouterr()
    assert json.loads(out)["schedule"]["time"] == [0.0, 0.02, 0.04]
    assert err == b""


def test_a_plan_goes_to_the_file_named(request_file, planner_, tmp_path, capsysbinary):
    out = tmp_path / "plan.json"
    assert cli.main(["plan", str(request_file), "-o", str(out)]) == 0
    assert json.loads(out.read_bytes())["duration"] == 0.04
    assert capsysbinary.readouterr().out == b""


def test_where_there_is_no_plan_the_problem_goes_to_standard_error(request_file, planner_, capsysbinary):
    planner_.raises = NoPathExists("a wall", {"radius": np.float64(0.3)})
    assert cli.main(["plan", str(request_file)]) == 1
    out, err = capsysbinary.readouterr()
    assert out == b""
    assert json.loads(err)["code"] == "no-path-exists"
    assert json.loads(err)["proof"] == {"radius": 0.3}


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("{", "malformed-json"),
        ("{}", "invalid-request"),
        ("[]", "invalid-request"),
        ('{"a": 1e999}', "invalid-request"),
    ],
)
def test_a_bad_request_file_is_a_problem_too(request_file, planner_, capsysbinary, text, code):
    request_file.write_text(text)
    assert cli.main(["plan", str(request_file)]) == 1
    assert json.loads(capsysbinary.readouterr().err)["code"] == code


def test_a_map_file_becomes_the_requests_map(request_file, planner_, tmp_path, capsysbinary):
    (tmp_path / "m.pgm").write_bytes(b"P5\n2 1\n255\n\0\xff")
    described = "image: m.pgm\nresolution: 0.5\norigin: [0, 0, 0]\noccupied_thresh: 0.6\nfree_thresh: 0.2\n"
    (tmp_path / "m.yaml").write_text(described)
    assert cli.main(["plan", str(request_file), "--map", str(tmp_path / "m.yaml")]) == 0
    assert planner_.problem.environment.map.resolution == 0.5
    assert math.isclose(planner_.problem.environment.bounds.x_max, 5)


@pytest.mark.parametrize(
    "arguments", [["plan", "/nowhere.json"], ["plan", "{request}", "--map", "/nowhere.yaml"]]
)
def test_a_file_that_cannot_be_read_is_named(request_file, planner_, capsys, arguments):
    assert cli.main([a.format(request=request_file) for a in arguments]) == 2
    assert "/nowhere" in capsys.readouterr().err


def test_a_broken_map_file_is_a_problem(request_file, planner_, tmp_path, capsysbinary):
    (tmp_path / "m.yaml").write_text("image: m.pgm")
    assert cli.main(["plan", str(request_file), "--map", str(tmp_path / "m.yaml")]) == 1
    assert json.loads(capsysbinary.readouterr().err)["errors"][0]["pointer"] == "/yaml/resolution"


def test_the_drives_are_listed(capsysbinary):
    assert cli.main(["drives"]) == 0
    assert len(json.loads(capsysbinary.readouterr().out)["drives"]) == 11


def test_the_settings_are_listed_with_what_is_set_now(monkeypatch, capsys):
    monkeypatch.setenv("WHEELPLAN_MAX_MAPS", "7")
    assert cli.main(["settings"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (line,) = [line for line in lines if line.startswith("WHEELPLAN_MAX_MAPS")]
    assert line.split()[1:3] == ["7", "1000"]
    assert len(lines) == 1 + len(fields(Settings))
    assert all(len(line.split("  ")[-1]) > 9 for line in lines[1:]), "each has a meaning"


def test_a_flag_wins_over_the_environment_and_is_checked_like_it(monkeypatch, capsys):
    monkeypatch.setenv("WHEELPLAN_PORT", "80")
    served = []
    monkeypatch.setattr("api.server.serve", lambda settings: served.append(settings) or 0)
    assert cli.main(["serve", "--port", "81"]) == 0
    assert cli.main(["serve"]) == 0
    assert [settings.port for settings in served] == [81, 80]
    with pytest.raises(SystemExit):
        cli.main(["serve", "--port", "65536"])
    assert "65536" in capsys.readouterr().err


def test_a_bad_setting_ends_the_command_with_a_sentence(monkeypatch, capsys):
    monkeypatch.setenv("WHEELPLAN_PORT", "http")
    with pytest.raises(SystemExit):
        cli.main(["drives"])
    assert "WHEELPLAN_PORT must be a whole number" in capsys.readouterr().err
