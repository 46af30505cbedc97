import math

import pytest

from api.drive_schemas import EXAMPLES, SCHEMAS, build_drive

KINDS = list(EXAMPLES)
FREE = {"omni", "mecanum", "swedish", "swerve", "powered_caster"}


def drive_of(kind):
    return build_drive(SCHEMAS[kind].model_validate(EXAMPLES[kind]), ())


@pytest.mark.parametrize("kind", KINDS)
def test_forward_undoes_inverse(client, kind):
    twist = {"vx": 0.5, "vy": 0.2 if kind in FREE else 0.0, "omega": 0.3}
    asked = {"drive": EXAMPLES[kind], "twist": twist}
    if kind == "powered_caster":
        asked["steering"] = dict.fromkeys(drive_of(kind).steered_names, 0.4)
    state = client.post("/v1/kinematics/inverse", json=asked)
    assert state.status_code == 200, state.text
    back = client.post("/v1/kinematics/forward", json={"drive": EXAMPLES[kind], **state.json()})
    assert back.status_code == 200, back.text
    assert back.json()["twist"] == pytest.approx(twist, abs=1e-9)
    assert back.json()["slip"] == pytest.approx(0, abs=1e-9)


def test_slip_is_how_far_the_wheels_disagree(client):
    drive = {"type": "mecanum", "wheel_radius": 0.1, "track_width": 0.4, "wheelbase": 0.5}
    wheels = {"front_left": 1.0, "front_right": 1.0, "rear_left": 1.0, "rear_right": 2.0}
    answer = client.post("/v1/kinematics/forward", json={"drive": drive, "wheels": wheels})
    assert answer.json()["slip"] > 0.01


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in FREE])
def test_sideways_is_inadmissible_where_the_drive_cannot(client, kind):
    asked = {"drive": EXAMPLES[kind], "twist": {"vx": 0.1, "vy": 0.5, "omega": 0.0}}
    answer = client.post("/v1/kinematics/inverse", json=asked)
    assert (answer.status_code, answer.json()["code"]) == (422, "inadmissible-twist")


@pytest.mark.parametrize(
    ("asked", "pointer"),
    [
        ({"drive": EXAMPLES["powered_caster"], "twist": {"vx": 1, "vy": 0, "omega": 0}}, "/steering"),
        ({"drive": EXAMPLES["swerve"], "twist": {"vx": 1, "vy": 0, "omega": 0}, "steering": {"front": 0.0}},
         "/steering/rear"),
        ({"drive": EXAMPLES["omni"], "twist": {"vx": 1, "vy": 0, "omega": "1"}}, "/twist/omega"),
        ({"drive": {"type": "omni"}, "twist": {"vx": 1, "vy": 0, "omega": 1}}, "/drive/wheel_radius"),
    ],
)  # fmt: skip
def test_inverse_names_the_field_at_fault(client, asked, pointer):
    answer = client.post("/v1/kinematics/inverse", json=asked)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid-request")
    assert answer.json()["errors"][0]["pointer"] == pointer


@pytest.mark.parametrize(
    ("change", "pointer"),
    [
        ({"wheels": {"left": 1.0}}, "/wheels/right"),
        ({"wheels": {"left": 1.0, "right": 1.0, "x": 1.0}}, "/wheels/x"),
        ({"wheels": {"left": 1.0, "right": 1e9}}, "/wheels/right"),
        ({"steering": {"left": 0.0}}, "/steering/left"),
    ],
)
def test_forward_names_the_field_at_fault(client, change, pointer):
    asked = {"drive": EXAMPLES["differential"], "wheels": {"left": 1.0, "right": 1.0}} | change
    answer = client.post("/v1/kinematics/forward", json=asked)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid-request")
    assert answer.json()["errors"][0]["pointer"] == pointer


def test_a_degenerate_drive_is_invalid_geometry(client):
    drive = {"type": "swerve", "wheel_radius": 0.1, "modules": [{"name": "a", "x": 0, "y": 0}]}
    asked = {"drive": drive, "twist": {"vx": 1, "vy": 0, "omega": 0}}
    answer = client.post("/v1/kinematics/inverse", json=asked)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid-geometry")
    assert answer.json()["errors"][0]["pointer"] == "/drive/modules"


def test_a_powered_caster_returns_its_steering_rates(client):
    asked = {
        "drive": EXAMPLES["powered_caster"],
        "twist": {"vx": 0.0, "vy": 0.2, "omega": 0.0},
        "steering": {"front": 0.0, "rear": math.pi / 2},
    }
    state = client.post("/v1/kinematics/inverse", json=asked).json()
    assert state["steering_rates"] == pytest.approx({"front": 5.0, "rear": 0.0})
    assert state["wheels"] == pytest.approx({"front": 0.0, "rear": 2.0})


def test_the_catalogue_lists_every_drive_with_an_example_that_works(client):
    answer = client.get("/v1/drives")
    drives = {drive["type"]: drive for drive in answer.json()["drives"]}
    assert list(drives) == [
        "differential", "tracked", "skid_steer", "omni", "mecanum", "swedish", "tricycle", "ackermann",
        "synchro", "swerve", "powered_caster",
    ]  # fmt: skip
    assert drives["ackermann"]["wheels"] == ["front_left", "front_right", "rear_left", "rear_right"]
    assert drives["ackermann"]["steering"] == ["front_left", "front_right"]
    for drive in drives.values():
        wheels = dict.fromkeys(drive["wheels"], 0.0)
        steering = dict.fromkeys(drive["steering"], 0.0)
        asked = {"drive": drive["example"], "wheels": wheels, "steering": steering}
        assert client.post("/v1/kinematics/forward", json=asked).status_code == 200
        assert set(drive["parameters"]["required"]) <= set(drive["example"])
