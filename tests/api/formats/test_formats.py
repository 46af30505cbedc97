"""Which format a client gets, by name and by media type, and what is refused."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import fields

import msgpack
import numpy as np
import pytest

from api import cli
from api.formats import FORMATS, formats_for
from drives import DRIVES
from planner.plan import Plan
from planner.schedule import standstill
from planner.verify import Certificate

SWERVE = {
    "type": "swerve", "wheel_radius": 0.1,
    "modules": [{"name": "front", "x": 0.2, "y": 0.0}, {"name": "rear", "x": -0.2, "y": 0.0}],
}  # fmt: skip
MECANUM = {"type": "mecanum", "wheel_radius": 0.1, "track_width": 0.4, "wheelbase": 0.4}


def swerve(body):
    body["robot"]["drive"] = SWERVE
    body["robot"]["limits"]["steering_rate"] = 2.0
    return body


def standing(problem):
    """The plan of a robot that is where it should be: in every format there is something of it to tell."""
    still = standstill(np.array(problem.start), 2, np.zeros(2))
    certificate = Certificate(**dict.fromkeys((f.name for f in fields(Certificate)), 0.0))
    return Plan(0.0, 0.0, still, certificate, {"planner": "none", "seed": 7, "refused": 0})


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("by", ["query", "header"])
def test_every_format_is_had_by_name_and_by_media_type(client, body, planner_, monkeypatch, name, by):
    monkeypatch.setattr(planner_, "made", lambda _: standing(planner_.problem))
    wanted = FORMATS[name].media_type
    query, accept = (f"?format={name}", "*/*") if by == "query" else ("", wanted)
    answer = client.post(f"/v1/plans{query}", json=swerve(body), headers={"accept": accept})
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"].split(";")[0] == wanted
    assert answer.content


def test_media_types_are_all_different():
    assert len({each.media_type for each in FORMATS.values()}) == len(FORMATS)


def test_a_format_for_other_drives_is_refused_before_planning(client, body, planner_):
    body["robot"]["drive"] = MECANUM
    answer = client.post("/v1/plans?format=choreo", json=body)
    assert (answer.status_code, answer.json()["code"]) == (406, "not-acceptable")
    assert "choreo is for differential and swerve drives; for mecanum there are json, csv" in answer.text
    assert planner_.problem is None


@pytest.mark.parametrize("drive", DRIVES)
def test_choreo_is_offered_to_differential_and_swerve_alone(drive):
    offered = [each.name for each in formats_for(drive)]
    assert ("choreo" in offered) == (drive in ("differential", "swerve"))
    assert {"json", "csv", "wpilib", "vda5050-3.0"} <= set(offered)


def test_a_drive_that_a_media_type_is_not_for_gets_the_next_one(client, body, planner_):
    body["robot"]["drive"] = MECANUM
    choreo = FORMATS["choreo"].media_type
    answer = client.post("/v1/plans", json=body, headers={"accept": f"{choreo}, text/csv;q=0.5"})
    assert answer.headers["content-type"].startswith("text/csv")
    answer = client.post("/v1/plans", json=body, headers={"accept": choreo})
    assert (answer.status_code, answer.json()["code"]) == (406, "not-acceptable")


def test_an_unknown_format_is_told_which_there_are(client, body):
    (error,) = client.post("/v1/plans?format=xml", json=body).json()["errors"]
    assert error["parameter"] == "format"
    assert all(name in error["detail"] for name in FORMATS)


def test_the_openapi_document_names_every_format(client):
    operation = client.get("/openapi.json").json()["paths"]["/v1/plans"]["post"]
    assert {each.media_type for each in FORMATS.values()} <= set(operation["responses"]["200"]["content"])
    (query,) = [p for p in operation["parameters"] if p["name"] == "format"]
    assert all(name in query["description"] for name in FORMATS)


@pytest.mark.parametrize("drive", ["tricycle", "powered_caster"])
def test_messagepack_says_what_json_says(planned, drive):
    plan, problem = planned(drive)
    packed = msgpack.unpackb(FORMATS["msgpack"].write(plan, problem))
    assert packed == json.loads(FORMATS["json"].write(plan, problem))


def test_an_svg_is_well_formed_and_the_same_every_time(planned):
    plan, problem = planned("swerve")
    drawn = FORMATS["svg"].write(plan, problem)
    assert ET.fromstring(drawn).tag == "{http://www.w3.org/2000/svg}svg"
    assert drawn == FORMATS["svg"].write(plan, problem)


def test_a_plan_is_written_in_a_format_from_the_command_line(tmp_path, body, planner_, capsysbinary):
    (tmp_path / "request.json").write_text(json.dumps(swerve(body)))
    command = ["plan", str(tmp_path / "request.json"), "--format"]
    assert cli.main([*command, "choreo", "-o", str(tmp_path / "plan.traj")]) == 0
    assert json.loads((tmp_path / "plan.traj").read_bytes())["version"] == 3
    assert cli.main([*command, "csv"]) == 0
    assert capsysbinary.readouterr().out.startswith(b"time,x,y,theta,front.velocity")
    assert cli.main([*command, "xml"]) == 1
    assert json.loads(capsysbinary.readouterr().err)["errors"][0]["parameter"] == "format"


def test_a_format_for_other_drives_is_refused_on_the_command_line(tmp_path, body, planner_, capsysbinary):
    body["robot"]["drive"] = MECANUM
    (tmp_path / "request.json").write_text(json.dumps(body))
    assert cli.main(["plan", str(tmp_path / "request.json"), "--format", "choreo"]) == 1
    assert json.loads(capsysbinary.readouterr().err)["code"] == "not-acceptable"
    assert planner_.problem is None
