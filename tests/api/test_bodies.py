"""What is wrong with a body, and how the client hears of it."""

import json
import math
from dataclasses import replace

import pytest

GEOMETRY = "invalid-geometry"
INVALID = "invalid-request"


def put(body, pointer, value):
    *parents, last = pointer.strip("/").split("/")
    for part in parents:
        body = body[int(part) if isinstance(body, list) else part]
    if value is ...:
        del body[last]
    elif isinstance(body, list):
        body.insert(int(last), value)
    else:
        body[last] = value


def swedish(*names):
    return {
        "type": "swedish",
        "wheels": [
            {"name": n, "x": 0.3, "y": 0.1 * i, "heading": 1.5 * i, "roller_angle": 0.0, "radius": 0.05}
            for i, n in enumerate(names)
        ],
    }


TRICYCLE = {"type": "tricycle", "wheel_radius": 0.1, "wheelbase": 1.0, "track_width": 0.6}
SYNCHRO = {"type": "synchro", "wheel_radius": 0.1, "body_heading": 0.5}
BOW_TIE = [[0, 0], [1, 1], [1, 0], [0, 1]]
LIMITS, DRIVE, FOOTPRINT = "/robot/limits", "/robot/drive", "/robot/footprint"

# What is put into a good body, the code, and the pointer that must come back (None: the one that was put).
BAD = [
    # the wrong type in a number's place
    ({"/start/x": "1.5"}, INVALID, None),
    ({"/start/x": True}, INVALID, None),
    ({"/start/x": None}, INVALID, None),
    ({"/start/x": [1]}, INVALID, None),
    ({"/start/x": {}}, INVALID, None),
    ({"/options/seed": 1.5}, INVALID, None),
    ({"/options/seed": "7"}, INVALID, None),
    ({"/options/reverse": 1}, INVALID, None),
    ({"/options/reverse": "false"}, INVALID, None),
    ({"/options/effort": "fast"}, INVALID, None),
    ({"/options/effort": 3}, INVALID, None),
    # out of range
    ({"/start/x": 1e7}, INVALID, None),
    ({"/goal/y": -1e7}, INVALID, None),
    ({f"{LIMITS}/wheel_speed": 0}, INVALID, None),
    ({f"{LIMITS}/wheel_speed": -1}, INVALID, None),
    ({f"{LIMITS}/wheel_acceleration": 1e9}, INVALID, None),
    ({f"{LIMITS}/wheel_jerk": 0}, INVALID, None),
    ({f"{LIMITS}/linear_speed": 0}, INVALID, None),
    ({f"{DRIVE}/wheel_radius": 0}, INVALID, None),
    ({f"{DRIVE}/wheel_radius": -0.1}, INVALID, None),
    ({f"{DRIVE}/track_width": 1e5}, INVALID, None),
    ({f"{FOOTPRINT}/length": 0}, INVALID, None),
    ({f"{FOOTPRINT}/offset": 1e5}, INVALID, None),
    ({"/options/time_budget": 0}, INVALID, None),
    ({"/options/time_budget": 31}, INVALID, None),
    ({"/options/seed": -1}, INVALID, None),
    ({"/options/seed": 2**31}, INVALID, None),
    ({"/options/sample_period": 0.0009}, INVALID, None),
    ({"/options/sample_period": 0.21}, INVALID, None),
    ({"/options/min_clearance": -0.1}, INVALID, None),
    ({"/options/turning_radius": -0.1}, INVALID, None),
    ({"/environment/bounds/x_min": 5}, INVALID, "/environment/bounds/x_max"),
    ({"/environment/bounds/y_max": -7}, INVALID, None),
    # too small or too large for arithmetic
    ({f"{LIMITS}/wheel_speed": 1e-300}, INVALID, None),
    ({f"{LIMITS}/wheel_speed": 1e300}, INVALID, None),
    ({f"{LIMITS}/wheel_jerk": {"left": 5e-324, "right": 1}}, INVALID, f"{LIMITS}/wheel_jerk/left"),
    ({f"{LIMITS}/angular_speed": 1e-300}, INVALID, None),
    ({f"{LIMITS}/steering_angle": 1e-300}, INVALID, None),
    ({f"{DRIVE}/track_width": 1e-300}, INVALID, None),
    ({f"{FOOTPRINT}/length": 1e-300}, INVALID, None),
    ({"/environment/obstacles/0": {"type": "circle", "center": [0, 0], "radius": 1e-300}}, INVALID,
     "/environment/obstacles/0/radius"),
    ({"/start/x": 1e300}, INVALID, None),
    ({"/goal/y": -1e300}, INVALID, None),
    ({"/environment/bounds/x_max": 1e300}, INVALID, None),
    ({"/environment/obstacles/0": {"type": "circle", "center": [0, 1e300], "radius": 1}}, INVALID,
     "/environment/obstacles/0/center/1"),
    ({FOOTPRINT: {"type": "polygon", "vertices": [[i, i * i] for i in range(10_000)]}}, INVALID,
     f"{FOOTPRINT}/vertices"),
    # missing
    ({"/robot": ...}, INVALID, None),
    ({"/start": ...}, INVALID, None),
    ({"/goal": ...}, INVALID, None),
    ({"/goal/theta": ...}, INVALID, None),
    ({"/environment": ...}, INVALID, None),
    ({"/environment/bounds": ...}, INVALID, None),
    ({"/environment/bounds/x_max": ...}, INVALID, None),
    ({f"{LIMITS}/wheel_speed": ...}, INVALID, None),
    ({f"{DRIVE}/type": ...}, INVALID, None),
    ({f"{DRIVE}/track_width": ...}, INVALID, None),
    ({f"{FOOTPRINT}/type": ...}, INVALID, None),
    ({f"{FOOTPRINT}/width": ...}, INVALID, None),
    # unknown
    ({"/colour": "red"}, INVALID, None),
    ({"/start/steer": {}}, INVALID, None),
    ({f"{DRIVE}/wheelbase": 1.0}, INVALID, None),
    ({f"{DRIVE}/type": "hovercraft"}, INVALID, None),
    ({f"{DRIVE}/type": 3}, INVALID, None),
    ({f"{DRIVE}": "differential"}, INVALID, None),
    ({f"{DRIVE}/differential": 1}, INVALID, None),
    ({f"{FOOTPRINT}/type": "square"}, INVALID, None),
    ({f"{FOOTPRINT}/a~b": 1}, INVALID, f"{FOOTPRINT}/a~0b"),
    # per wheel
    ({f"{LIMITS}/wheel_speed": {"left": 1.0}}, INVALID, f"{LIMITS}/wheel_speed/right"),
    ({f"{LIMITS}/wheel_speed": {"left": 1.0, "right": 2.0, "x": 3.0}}, INVALID, f"{LIMITS}/wheel_speed/x"),
    ({f"{LIMITS}/wheel_speed": {"left": 1.0, "right": -2.0}}, INVALID, f"{LIMITS}/wheel_speed/right"),
    ({f"{LIMITS}/wheel_speed": {"left": 1.0, "right": "2"}}, INVALID, f"{LIMITS}/wheel_speed/right"),
    ({f"{LIMITS}/wheel_speed": "fast"}, INVALID, None),
    ({f"{LIMITS}/wheel_speed": None}, INVALID, None),
    ({f"{LIMITS}/wheel_speed": True}, INVALID, None),
    ({f"{LIMITS}/wheel_speed": [1, 2]}, INVALID, None),
    # steering
    ({DRIVE: TRICYCLE, f"{LIMITS}/steering_rate": 1.0}, INVALID, f"{LIMITS}/steering_angle"),
    ({DRIVE: TRICYCLE, f"{LIMITS}/steering_angle": 1.0}, INVALID, f"{LIMITS}/steering_rate"),
    ({DRIVE: SYNCHRO}, INVALID, f"{LIMITS}/steering_rate"),
    ({"/start/steering": {"left": 0.0}}, INVALID, "/start/steering/left"),
    (
        {
            DRIVE: TRICYCLE, f"{LIMITS}/steering_angle": 1.0, f"{LIMITS}/steering_rate": 1.0,
            "/start/steering": {},
        },
        INVALID, "/start/steering/front",
    ),
    (
        {
            DRIVE: TRICYCLE, f"{LIMITS}/steering_angle": 1.0, f"{LIMITS}/steering_rate": 1.0,
            "/start/steering": {"front": 1.1},
        },
        INVALID, "/start/steering/front",
    ),
    (
        {
            DRIVE: SYNCHRO, f"{LIMITS}/steering_rate": 1.0,
            "/start/steering": {"wheel_1": -0.5, "wheel_2": 2 * math.pi - 0.5, "wheel_3": 0.0},
        },
        INVALID, "/start/steering/wheel_3",
    ),
    # degenerate shapes, before anything that depends on them
    ({DRIVE: swedish("a", "b"), f"{LIMITS}/wheel_speed": {"a": 1, "b": 1, "c": 1}}, GEOMETRY,
     f"{DRIVE}/wheels"),
    ({DRIVE: swedish("a", "a", "b")}, GEOMETRY, f"{DRIVE}/wheels"),
    ({DRIVE: {"type": "omni", "wheel_radius": 0.1, "robot_radius": 0.2, "wheel_count": 2}}, GEOMETRY,
     f"{DRIVE}/wheel_count"),
    ({DRIVE: {"type": "swerve", "wheel_radius": 0.1, "modules": [{"name": "a", "x": 0, "y": 0}]}}, GEOMETRY,
     f"{DRIVE}/modules"),
    ({DRIVE: {"type": "swerve", "wheel_radius": 0.1, "modules": []}}, INVALID, f"{DRIVE}/modules"),
    ({DRIVE: {"type": "swerve", "wheel_radius": 0.1, "modules": [{"name": "a,b", "x": 0, "y": 0}]}}, INVALID,
     f"{DRIVE}/modules/0/name"),
    ({FOOTPRINT: {"type": "polygon", "vertices": BOW_TIE}}, GEOMETRY, f"{FOOTPRINT}/vertices"),
    ({FOOTPRINT: {"type": "polygon", "vertices": [[0, 0], [1, 0], [2, 0]]}}, GEOMETRY,
     f"{FOOTPRINT}/vertices"),
    ({FOOTPRINT: {"type": "polygon", "vertices": [[0, 0], [1, 0]]}}, INVALID, f"{FOOTPRINT}/vertices"),
    ({FOOTPRINT: {"type": "polygon", "vertices": [[0, 0], [1, 0], [0, 1, 2]]}}, INVALID,
     f"{FOOTPRINT}/vertices/2"),
    ({FOOTPRINT: {"type": "polygon", "vertices": [[0, 0], [1, 0], [0, "1"]]}}, INVALID,
     f"{FOOTPRINT}/vertices/2/1"),
    ({"/environment/obstacles/0": {"type": "polygon", "vertices": BOW_TIE}}, GEOMETRY,
     "/environment/obstacles/0/vertices"),
    ({"/environment/obstacles/0": {"type": "circle", "center": [0], "radius": 1}}, INVALID,
     "/environment/obstacles/0/center"),
    ({"/environment/obstacles/0": {"type": "circle", "center": [0, 0], "radius": 0}}, INVALID,
     "/environment/obstacles/0/radius"),
    ({"/environment/obstacles/0": {"type": "square"}}, INVALID, "/environment/obstacles/0/type"),
    ({"/environment/obstacles/0": 7}, INVALID, None),
    ({"/environment/obstacles": {}}, INVALID, None),
    ({"/environment/map": {}}, INVALID, "/environment/map/id"),
    ({"/environment/map": {"id": "0" * 64, "unknown": "maybe"}}, INVALID, "/environment/map/unknown"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "code", "pointer"), BAD, ids=[str(i) for i in range(len(BAD))])
def test_a_bad_field_is_refused_by_its_pointer(client, body, changes, code, pointer):
    for where, value in changes.items():
        put(body, where, value)
    answer = client.post("/v1/plans", json=body)
    problem = answer.json()
    assert (answer.status_code, problem["code"]) == (422, code), problem
    wanted = pointer or next(iter(changes))
    assert [error["pointer"] for error in problem["errors"]] == [wanted]
    name = wanted.rsplit("/", 1)[1].replace("~0", "~")
    if not name.isdecimal() and code == INVALID:
        assert name in problem["errors"][0]["detail"]


@pytest.mark.parametrize("text", ["[]", '"x"', "3", "null", "true", "{}"])
def test_a_body_that_is_no_plan_request_is_refused(client, text):
    answer = client.post("/v1/plans", content=text, headers={"content-type": "application/json"})
    assert (answer.status_code, answer.json()["code"]) == (422, INVALID)


def test_the_sentence_names_field_value_and_bound(client, body):
    body["robot"]["drive"]["wheel_radius"] = -0.1
    (error,) = client.post("/v1/plans", json=body).json()["errors"]
    assert error == {
        "pointer": "/robot/drive/wheel_radius",
        "detail": "wheel_radius is -0.1; it must be >= 1e-06.",
        "value": -0.1,
        "bound": ">= 1e-06",
    }


@pytest.mark.parametrize(("name", "escaped"), [("", ""), ("a/b", "a~1b"), ("é", "é")])
def test_a_bad_name_of_a_wheel_is_itself_what_is_wrong(client, body, name, escaped):
    body["robot"]["limits"]["wheel_speed"] = {name: 1.0}
    (error,) = client.post("/v1/plans", json=body).json()["errors"]
    assert error["pointer"] == f"/robot/limits/wheel_speed/{escaped}"
    assert error["detail"] == f'A name in wheel_speed is "{name}"; it must {error["bound"]}.'
    assert error["value"] == name


def test_too_many_steering_angles_are_counted(client, body):
    body["start"]["steering"] = {f"wheel_{i}": 0.0 for i in range(33)}
    (error,) = client.post("/v1/plans", json=body).json()["errors"]
    assert error["detail"] == "steering has 33 items; it must have <= 32."


def test_a_time_budget_that_nobody_gave_is_never_too_long(client, settings, planner_, body):
    client.app.state.settings = replace(settings, max_time_budget=0.25)
    del body["options"]
    assert client.post("/v1/plans", json=body).status_code == 200
    assert planner_.problem.options.time_budget == 0.25
    body["options"] = {"time_budget": 0.3}
    assert client.post("/v1/plans", json=body).json()["errors"][0]["bound"] == "<= 0.25"


def test_all_bad_fields_are_named_at_once(client, body):
    body["start"]["x"] = "a"
    body["options"]["seed"] = -1
    del body["robot"]["limits"]["wheel_speed"]
    problem = client.post("/v1/plans", json=body).json()
    pointers = {error["pointer"] for error in problem["errors"]}
    assert pointers == {"/start/x", "/options/seed", "/robot/limits/wheel_speed"}


@pytest.mark.parametrize("number", ["1e999", "-1e999", "9" * 5000])
def test_a_number_that_is_not_finite_is_refused_by_its_pointer(client, body, number):
    text = json.dumps(body).replace('"x": -3.0', f'"x": {number}')
    answer = client.post("/v1/plans", content=text, headers={"content-type": "application/json"})
    assert answer.status_code == 422
    assert answer.json()["errors"] == [
        {"pointer": "/start/x", "detail": "x is not finite; it must be a finite number."}
    ]


@pytest.mark.parametrize(
    "text",
    [
        "", "{", "not json", '{"robot": NaN}', '{"robot": Infinity}', '{"start": {}, "start": {}}',
        '"\\ud800"',
        "[" * 200_000, "[" * 90_000 + "]" * 90_000, b"\xff\xfe",
    ],
)  # fmt: skip
def test_what_is_not_json_is_malformed(client, text):
    answer = client.post("/v1/plans", content=text, headers={"content-type": "application/json"})
    assert (answer.status_code, answer.json()["code"]) == (400, "malformed-json")


def test_the_body_is_never_echoed(client, body):
    secret = "s" * 5000
    body[secret] = secret
    body["start"]["x"] = secret
    body["robot"]["drive"]["type"] = secret
    answer = client.post("/v1/plans", json=body)
    assert answer.status_code == 422
    assert secret[:200] not in answer.text


@pytest.mark.parametrize(
    "headers",
    [
        {"content-type": "text/plain"},
        {"content-type": "application/x-www-form-urlencoded"},
        {"content-type": "application/json; charset=utf-16"},
        {"content-type": "application/json", "content-encoding": "gzip"},
        {},
    ],
)
def test_a_body_of_another_type_is_unsupported(client, headers):
    answer = client.post("/v1/plans", content=b"{}", headers=headers)
    assert (answer.status_code, answer.json()["code"]) == (415, "unsupported-media-type")


def test_a_charset_of_utf_8_is_welcome(client, body):
    headers = {"content-type": 'application/json; charset="UTF-8"'}
    assert client.post("/v1/plans", content=json.dumps(body), headers=headers).status_code == 200


def chunks(size):
    for _ in range(size // 1000):
        yield b" " * 1000


@pytest.mark.parametrize("content", [b" " * 200_001, chunks(300_000)], ids=["length", "chunked"])
def test_a_body_over_the_limit_is_too_large(client, content):
    answer = client.post("/v1/plans", content=content, headers={"content-type": "application/json"})
    assert (answer.status_code, answer.json()["code"]) == (413, "payload-too-large")


def test_angles_may_be_any_finite_number(client, body, planner_):
    body["start"]["theta"] = 1e300
    body["goal"]["theta"] = -123456789.0
    assert client.post("/v1/plans", json=body).status_code == 200
    assert math.cos(planner_.problem.start.theta) == pytest.approx(math.cos(1e300))
    assert math.sin(planner_.problem.goal.theta) == pytest.approx(math.sin(-123456789.0))
