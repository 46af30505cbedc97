"""A VDA 5050 factsheet as a robot: of 2.1, valid to the published schema, and of 3.0."""

from __future__ import annotations

import copy
import json

import pytest
from vda5050.validation.schema_validator import SchemaValidator

from api import cli
from api.schemas import RobotSchema


def wheel(kind, x, y, *, driven=False, steered=False, diameter=0.2, **more):
    return {
        "type": kind, "isActiveDriven": driven, "isActiveSteered": steered,
        "position": {"x": x, "y": y}, "diameter": diameter, "width": 0.05, **more,
    }  # fmt: skip


CASTERS = [wheel("CASTER", x, 0.2, diameter=0.08, centerDisplacement=0.03) for x in (-0.4, 0.4)]
DRIVEN = {"driven": True}
BOTH = {"driven": True, "steered": True}
CORNERS = [(0.4, 0.3), (0.4, -0.3), (-0.4, 0.3), (-0.4, -0.3)]
WHEELS = {
    "differential": [wheel("DRIVE", 0.0, y, **DRIVEN) for y in (0.25, -0.25)] + CASTERS,
    "skid_steer": [wheel("DRIVE", x, y, **DRIVEN) for x, y in CORNERS],
    "mecanum": [wheel("MECANUM", x, y, **DRIVEN) for x, y in CORNERS],
    "tricycle": [wheel("DRIVE", 1.2, 0.0, **BOTH), wheel("FIXED", 0.0, 0.4), wheel("FIXED", 0.0, -0.4)],
    "ackermann": [wheel("DRIVE", 1.2, y, steered=True) for y in (0.4, -0.4)]
    + [wheel("DRIVE", 0.0, y, **DRIVEN) for y in (0.4, -0.4)],
    "swerve": [wheel("DRIVE", x, y, **BOTH) for x, y in CORNERS],
    "powered_caster": [wheel("CASTER", x, y, **BOTH, centerDisplacement=0.04) for x, y in CORNERS],
}
SHAPES = {
    "differential": {"track_width": 0.5},
    "skid_steer": {"track_width": 0.6, "wheelbase": 0.8},
    "mecanum": {"track_width": 0.6, "wheelbase": 0.8},
    "tricycle": {"track_width": 0.8, "wheelbase": 1.2},
    "ackermann": {"track_width": 0.8, "wheelbase": 1.2},
    "swerve": {},
    "powered_caster": {"caster_offset": 0.04},
}
OUTLINE = [{"x": x, "y": y} for x, y in ((-0.5, -0.4), (1.5, -0.4), (1.5, 0.4), (-0.5, 0.4))]


def sheet(wheels):
    """A factsheet of 2.1."""
    return {
        "headerId": 1, "timestamp": "2026-01-01T00:00:00.00Z", "version": "2.1.0",
        "manufacturer": "Someone", "serialNumber": "1",
        "typeSpecification": {
            "seriesName": "S", "agvKinematic": "DIFF", "agvClass": "CARRIER", "maxLoadMass": 100.0,
            "localizationTypes": ["NATURAL"], "navigationTypes": ["AUTONOMOUS"],
        },
        "physicalParameters": {
            "speedMin": 0.01, "speedMax": 1.5, "accelerationMax": 0.8, "decelerationMax": 0.6,
            "heightMin": 0.3, "heightMax": 0.3, "width": 0.8, "length": 2.0,
        },
        "protocolLimits": {
            "maxStringLens": {}, "maxArrayLens": {},
            "timing": {"minOrderInterval": 1.0, "minStateInterval": 1.0},
        },
        "protocolFeatures": {"optionalParameters": [], "agvActions": []},
        "agvGeometry": {
            "wheelDefinitions": copy.deepcopy(wheels),
            "envelopes2d": [{"set": "empty", "polygonPoints": OUTLINE}],
        },
        "loadSpecification": {},
    }  # fmt: skip


def newer(old):
    """The same in the names of 3.0."""
    physical, geometry = old["physicalParameters"], old["agvGeometry"]
    return {
        "physicalParameters": {
            "minimumSpeed": 0.01, "maximumSpeed": physical["speedMax"], "maximumAngularSpeed": 1.0,
            "maximumAcceleration": 0.8, "maximumDeceleration": 0.6, "width": 0.8, "length": 2.0,
        },
        "mobileRobotGeometry": {
            "wheelDefinitions": geometry["wheelDefinitions"],
            "envelopes2d": [{"envelope2dId": "empty", "vertices": OUTLINE}],
        },
    }  # fmt: skip


def filled(answer):
    """The robot with what is missing filled in, as its pointers say."""
    robot = copy.deepcopy(answer["robot"])
    for gap in answer["missing"]:
        assert gap["detail"]
        _, top, part, name = gap["pointer"].split("/")
        assert top == "robot"
        assert name not in robot[part]
        robot[part][name] = 1.0
    return robot


@pytest.mark.parametrize("version", ["2.1", "3.0"])
@pytest.mark.parametrize("kind", WHEELS)
def test_the_wheels_make_the_drive_and_what_is_missing_makes_it_whole(client, kind, version):
    given = sheet(WHEELS[kind])
    assert SchemaValidator().errors("factsheet", given) == []
    answer = client.post("/v1/robots/from-factsheet", json=given if version == "2.1" else newer(given))
    assert answer.status_code == 200, answer.text
    robot = filled(answer.json())
    RobotSchema.model_validate(robot)
    drive = robot["drive"]
    assert (drive["type"], drive["wheel_radius"]) == (kind, 0.1)
    assert {name: drive[name] for name in SHAPES[kind]} == pytest.approx(SHAPES[kind])
    assert robot["limits"]["linear_speed"] == 1.5
    assert robot["limits"]["wheel_speed"] == pytest.approx(15.0)
    assert robot["limits"]["linear_acceleration"] == 0.6
    assert robot["limits"].get("angular_speed") == (None if version == "2.1" else 1.0)


@pytest.mark.parametrize("kind", WHEELS)
def test_what_steers_lacks_its_steering_limits_and_nothing_else(client, kind):
    answer = client.post("/v1/robots/from-factsheet", json=sheet(WHEELS[kind])).json()
    lacking = {gap["pointer"].rsplit("/", 1)[1] for gap in answer["missing"]}
    expected = {
        "tricycle": {"steering_rate", "steering_angle"}, "ackermann": {"steering_rate", "steering_angle"},
        "swerve": {"steering_rate"}, "powered_caster": {"steering_rate"},
    }  # fmt: skip
    assert lacking == expected.get(kind, set())


def test_a_whole_robot_is_planned_for(client, body):
    answer = client.post("/v1/robots/from-factsheet", json=sheet(WHEELS["differential"])).json()
    assert answer["missing"] == []
    body["robot"] = answer["robot"]
    assert client.post("/v1/plans", json=body).status_code == 200


def test_poses_are_of_the_axle_and_the_outline_follows(client):
    ahead = [wheel("DRIVE", 0.3, y, **DRIVEN) for y in (0.25, -0.25)]
    answer = client.post("/v1/robots/from-factsheet", json=sheet(ahead)).json()
    assert answer["robot"]["footprint"]["vertices"][0] == pytest.approx([-0.8, -0.4])
    assert any("(0.3, 0)" in note for note in answer["notes"])


def test_a_fork_lift_steered_behind_looks_backwards(client):
    behind = [wheel("DRIVE", -1.2, 0.0, **BOTH), wheel("FIXED", 0.0, 0.4), wheel("FIXED", 0.0, -0.4)]
    answer = client.post("/v1/robots/from-factsheet", json=sheet(behind)).json()
    assert answer["robot"]["drive"]["wheelbase"] == pytest.approx(1.2)
    assert answer["robot"]["footprint"]["vertices"][0] == pytest.approx([0.5, 0.4])
    assert any("heading + π" in note for note in answer["notes"])


def test_wheels_of_no_drive_are_told_and_the_rest_is_kept(client):
    odd = [wheel("DRIVE", 0.0, 0.0, **DRIVEN), *CASTERS]
    answer = client.post("/v1/robots/from-factsheet", json=sheet(odd)).json()
    assert "drive" not in answer["robot"]
    assert answer["missing"][0]["pointer"] == "/robot/drive"
    assert "DRIVE driven, CASTER, CASTER" in answer["missing"][0]["detail"]
    assert answer["robot"]["limits"] == {"linear_speed": 1.5, "linear_acceleration": 0.6}


def test_without_an_envelope_the_footprint_is_the_vehicles_size(client):
    given = sheet(WHEELS["differential"])
    del given["agvGeometry"]["envelopes2d"]
    answer = client.post("/v1/robots/from-factsheet", json=given).json()
    assert answer["robot"]["footprint"]["vertices"] == [[-1, -0.4], [1, -0.4], [1, 0.4], [-1, 0.4]]
    assert any("no envelope" in note for note in answer["notes"])


def test_a_broken_factsheet_names_its_fields(client):
    given = sheet(WHEELS["differential"])
    given["physicalParameters"]["speedMax"] = "fast"
    given["agvGeometry"]["wheelDefinitions"][1]["diameter"] = 0
    answer = client.post("/v1/robots/from-factsheet", json=given)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid-request")
    assert {error["pointer"] for error in answer.json()["errors"]} == {
        "/physicalParameters/speedMax",
        "/agvGeometry/wheelDefinitions/1/diameter",
    }


def test_the_command_writes_the_robot(tmp_path, capsysbinary):
    (tmp_path / "sheet.json").write_text(json.dumps(sheet(WHEELS["swerve"])))
    assert cli.main(["robot", str(tmp_path / "sheet.json")]) == 0
    assert len(json.loads(capsysbinary.readouterr().out)["robot"]["drive"]["modules"]) == 4
