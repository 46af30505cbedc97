import io
import json
import os
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from api.maps import MapStore
from planner.kept import recall

YAML = """
image: map.pgm
resolution: 0.5
origin: [1.0, -2.0, 0.25]
occupied_thresh: 0.65
free_thresh: 0.2
"""
PIXELS = np.array([[0, 255, 128], [255, 255, 0]], dtype=np.uint8)  # row 0 is the top


def pgm(pixels=PIXELS, maxval=255):
    height, width = pixels.shape
    data = pixels.astype(">u2" if maxval > 255 else "u1").tobytes()
    return f"P5\n# a comment\n{width} {height}\n{maxval}\n".encode() + data


def ascii_pgm(pixels=PIXELS):
    height, width = pixels.shape
    return f"P2\n{width} {height}\n255\n{' '.join(map(str, pixels.ravel()))}\n".encode()


def png(image):
    out = io.BytesIO()
    image.save(out, "PNG")
    return out.getvalue()


def upload(client, yaml=YAML, image=None, **more):
    image = pgm() if image is None else image
    files = {"yaml": ("map.yaml", yaml), "image": ("map.pgm", image), **more}
    return client.post("/v1/maps", files=files)


def cells(settings, answer):
    return np.load(settings.data_dir / "maps" / answer.json()["id"] / "cells.npy").tolist()


FREE, OCCUPIED, UNKNOWN = 0, 1, 2
CELLS = [[FREE, FREE, OCCUPIED], [OCCUPIED, FREE, UNKNOWN]]  # row 0 is the bottom


def test_a_new_map_is_created_and_the_same_map_again_is_found(client, settings):
    first, second = upload(client), upload(client)
    assert (first.status_code, second.status_code) == (201, 200)
    map_id = first.json()["id"]
    assert first.headers["location"] == second.headers["location"] == f"/v1/maps/{map_id}"
    assert first.json() == second.json() == {
        "id": map_id, "width": 3, "height": 2, "resolution": 0.5, "origin": [1.0, -2.0, 0.25],
        "occupied": 2, "unknown": 1, "free": 3,
    }  # fmt: skip
    assert cells(settings, first) == CELLS


def grey16():
    return Image.fromarray(PIXELS.astype(np.uint16) * 257)


@pytest.mark.parametrize(
    "image",
    [
        ascii_pgm(), png(Image.fromarray(PIXELS)), png(Image.fromarray(PIXELS).convert("RGB")),
        png(Image.fromarray(PIXELS).convert("P")), png(Image.fromarray(PIXELS).convert("RGBA")),
        png(grey16()), pgm(PIXELS.astype(np.uint16) * 257, 65535),
    ],
    ids=["ascii", "grey", "rgb", "palette", "rgba", "grey16", "pgm16"],
)  # fmt: skip
def test_the_id_is_that_of_the_content_whatever_the_file(client, image):
    assert upload(client, image=image).json()["id"] == upload(client).json()["id"]


@pytest.mark.parametrize(
    "change",
    [("0.5", "0.25"), ("[1.0, -2.0, 0.25]", "[1.0, -2.0, 0.5]"), ("free_thresh: 0.2", "free_thresh: 0.5")],
)
def test_other_content_has_another_id(client, change):
    assert upload(client, YAML.replace(*change)).json()["id"] != upload(client).json()["id"]


@pytest.mark.parametrize(
    ("more", "pixels", "expected"),
    [
        # thresholds count themselves in, as do 0 and 255
        ("", [204, 203, 90, 89], [FREE, UNKNOWN, UNKNOWN, OCCUPIED]),
        ("negate: 1", [0, 51, 52, 165, 166, 255], [FREE, FREE, UNKNOWN, UNKNOWN, OCCUPIED, OCCUPIED]),
        ("negate: true", [0, 255], [FREE, OCCUPIED]),
        ("mode: scale", [204, 150, 89], [FREE, UNKNOWN, OCCUPIED]),
        ("mode: raw", [0, 20, 21, 64, 65, 100, 101, 255], [0, 0, 2, 2, 1, 1, 2, 2]),
        ("mode: raw\nnegate: 1", [255, 155, 154], [FREE, OCCUPIED, UNKNOWN]),
    ],
)
def test_thresholds_negate_and_mode_are_honoured(client, settings, more, pixels, expected):
    answer = upload(client, YAML + more, pgm(np.array([pixels], dtype=np.uint8)))
    assert answer.status_code == 201, answer.text
    assert cells(settings, answer) == [expected]


def test_transparent_pixels_are_unknown_in_scale_mode(client, settings):
    image = Image.new("LA", (2, 1), (255, 255))
    image.putpixel((1, 0), (255, 0))
    assert cells(settings, upload(client, YAML + "mode: scale", png(image))) == [[FREE, UNKNOWN]]
    assert cells(settings, upload(client, YAML, png(image))) == [[FREE, FREE]]


def test_numbers_that_yaml_1_1_takes_for_strings_are_numbers(client):
    assert upload(client, YAML.replace("0.5", "5e-1")).json()["resolution"] == 0.5


def test_maps_are_listed_shown_and_deleted(client):
    assert client.get("/v1/maps").json() == {"maps": []}
    one = upload(client).json()
    two = upload(client, YAML.replace("0.5", "0.25")).json()
    assert client.get("/v1/maps").json()["maps"] == sorted([one, two], key=lambda m: m["id"])
    assert client.get(f"/v1/maps/{one['id']}").json() == one
    assert client.delete(f"/v1/maps/{one['id']}").status_code == 204
    assert client.get("/v1/maps").json() == {"maps": [two]}
    for answer in (client.get(f"/v1/maps/{one['id']}"), client.delete(f"/v1/maps/{one['id']}")):
        assert (answer.status_code, answer.json()["code"]) == (404, "unknown-map")


@pytest.mark.parametrize(
    "map_id", ["..", "%2e%2e", "A" * 64, "0" * 63, "0" * 65, "%00", ".new-x", "0" * 63 + "%0a", "a" * 2000]
)
def test_only_an_id_names_a_map(client, settings, map_id):
    upload(client)
    for answer in (client.get(f"/v1/maps/{map_id}"), client.delete(f"/v1/maps/{map_id}")):
        assert answer.status_code in (404, 405)
    assert len(list(settings.data_dir.glob("maps/*"))) == 1


def test_a_plan_gets_the_map_it_names(client, settings, body, planner_):
    map_id = upload(client).json()["id"]
    body["environment"] = {"map": {"id": map_id, "unknown": "free"}}
    assert client.post("/v1/plans", json=body).status_code == 200
    layer = planner_.problem.environment.map
    assert (layer.id, layer.unknown, layer.resolution, tuple(layer.origin)) == (
        map_id,
        "free",
        0.5,
        (1.0, -2.0, 0.25),
    )
    assert layer.directory == settings.data_dir / "maps" / map_id
    assert planner_.problem.environment.bounds is None


def test_a_map_deleted_while_it_is_planned_on_is_unknown(client, body, planner_):
    map_id = upload(client).json()["id"]
    body["environment"] = {"map": {"id": map_id}}

    def plan(problem):
        client.delete(f"/v1/maps/{map_id}")
        np.load(problem.environment.map.directory / "cells.npy")

    planner_.__class__ = type(
        "Deleting", (planner_.__class__,), {"__call__": lambda _, problem, improved: plan(problem)}
    )
    answer = client.post("/v1/plans", json=body)
    assert (answer.status_code, answer.json()["code"]) == (404, "unknown-map")


BOMB = "a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n" + YAML


@pytest.mark.parametrize(
    ("yaml", "pointer"),
    [
        (YAML.replace("resolution: 0.5", ""), "/yaml/resolution"),
        (YAML.replace("0.5", "-0.5"), "/yaml/resolution"),
        (YAML.replace("0.5", "0"), "/yaml/resolution"),
        (YAML.replace("0.5", ".nan"), "/yaml/resolution"),
        (YAML.replace("0.5", ".inf"), "/yaml/resolution"),
        (YAML.replace("0.5", "true"), "/yaml/resolution"),
        (YAML.replace("0.5", "wide"), "/yaml/resolution"),
        (YAML.replace("0.5", "2020-01-01"), "/yaml/resolution"),
        (YAML.replace("[1.0, -2.0, 0.25]", "[1.0, -2.0]"), "/yaml/origin"),
        (YAML.replace("[1.0, -2.0, 0.25]", "[1.0, .nan, 0.0]"), "/yaml/origin/1"),
        (YAML.replace("[1.0, -2.0, 0.25]", "[1.0, 1e9, 0.0]"), "/yaml/origin/1"),
        (YAML.replace("0.65", "1.5"), "/yaml/occupied_thresh"),
        (YAML.replace("0.65", "0.1"), "/yaml/free_thresh"),
        (YAML + "mode: fancy", "/yaml/mode"),
        (YAML + "negate: 7", "/yaml/negate"),
        ("just a string", "/yaml"), ("[1, 2]", "/yaml"), ("", "/yaml"), ("{", "/yaml"),
        (b"\xff\xfe\xfa", "/yaml"),
        (BOMB, "/yaml"), ("a: !!python/object/apply:os.system [ls]", "/yaml"), ("[" * 10_000, "/yaml"),
        ("a: !!timestamp x", "/yaml"), ("? [a]\n: b", "/yaml"), ("a: " + "9" * 10_000, "/yaml"),
    ],
)  # fmt: skip
def test_a_bad_yaml_is_refused_by_its_field(client, yaml, pointer):
    answer = upload(client, yaml)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid-request")
    assert answer.json()["errors"][0]["pointer"] == pointer


@pytest.mark.parametrize(
    "image",
    [
        b"x", b"P5", b"P5\n3 2\n255\n" + b"\0" * 5, b"P5\n0 2\n255\n", b"P5\n3 2\n0\n" + b"\0" * 6,
        b"P5\n-3 2\n255\n" + b"\0" * 6, b"P2\n3 2\n255\n1 2 3", b"P2\n3 2\n255\n1 2 3 4 5 x",
        b"P6\n1 1\n255\n\0\0\0",
        b"GIF89a", png(Image.fromarray(PIXELS))[:40], b"\x89PNG\r\n\x1a\n" + b"\0" * 30,
    ],
)  # fmt: skip
def test_a_broken_image_is_refused(client, settings, image):
    answer = upload(client, image=image)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid-request")
    assert answer.json()["errors"][0]["pointer"] == "/image"
    assert not list(settings.data_dir.glob("maps/*"))


@pytest.mark.parametrize(
    ("yaml", "image"),
    [
        (YAML, b"P5\n1000 1000\n255\n"),  # refused by its header: there is no data
        (YAML, b"P5\n1000000 1000000\n255\n"),
        (YAML, pgm(np.zeros((100, 101), dtype=np.uint8))),
        (YAML, b"P5\n" + b"\0" * 120_000),
        ("#" * 20_000 + YAML, pgm()),
    ],
    ids=["header", "bomb", "cells", "bytes", "yaml"],
)
def test_a_map_over_the_limits_is_too_large(client, yaml, image):
    answer = upload(client, yaml, image)
    assert (answer.status_code, answer.json()["code"]) == (413, "payload-too-large")


def test_the_store_does_not_grow_beyond_its_limit(client, settings):
    for i in range(settings.max_maps):
        assert upload(client, YAML.replace("0.5", f"{i + 1}")).status_code == 201
    assert upload(client).json()["code"] == "payload-too-large"
    assert upload(client, YAML.replace("0.5", "1")).status_code == 200


@pytest.mark.parametrize(
    ("send", "status", "code"),
    [
        ({"json": {}}, 415, "unsupported-media-type"),
        ({"files": {"yaml": ("m", YAML)}}, 422, "invalid-request"),
        ({"files": {"image": ("m", pgm())}}, 422, "invalid-request"),
        ({"files": [("yaml", ("m", YAML)), ("yaml", ("m", YAML)), ("image", ("m", pgm()))]}, 422,
         "invalid-request"),
        ({"content": b"x", "headers": {"content-type": "multipart/form-data"}}, 422, "invalid-request"),
        ({"content": b"x", "headers": {"content-type": "multipart/form-data; boundary=a"}}, 422,
         "invalid-request"),
        ({"content": b"--a\r\n\r\n", "headers": {"content-type": "multipart/form-data; boundary=a"}}, 422,
         "invalid-request"),
    ],
)  # fmt: skip
def test_a_form_that_is_no_map_is_refused(client, send, status, code):
    answer = client.post("/v1/maps", **send)
    assert (answer.status_code, answer.json()["code"]) == (status, code)


def test_plain_form_fields_will_do(client):
    mark = b"--x\r\nContent-Disposition: form-data; name="
    form = (
        mark
        + b'"yaml"\r\n\r\n'
        + YAML.encode()
        + b"\r\n"
        + mark
        + b'"image"\r\n\r\n'
        + ascii_pgm()
        + b"\r\n--x--\r\n"
    )
    answer = client.post(
        "/v1/maps", content=form, headers={"content-type": "multipart/form-data; boundary=x"}
    )
    assert answer.status_code == 201, answer.text


def test_an_upload_that_fails_on_disk_leaves_nothing(client, settings, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr("api.maps.np.save", full)
        assert upload(client).status_code == 500
    assert not list(settings.data_dir.glob("maps/*"))
    assert upload(client).status_code == 201


def test_what_planning_needs_first_is_kept_at_upload(client, settings, body, planner_):
    body["environment"] = {"map": {"id": upload(client).json()["id"], "unknown": "free"}}
    client.post("/v1/plans", json=body)
    layer = planner_.problem.environment.map
    shape = np.load(layer.directory / "cells.npy").shape
    for unknown in ("occupied", "free"):
        assert recall(replace(layer, unknown=unknown), shape, shape) is not None


def test_what_a_crash_left_is_swept_at_the_next_start(settings):
    left = settings.data_dir / "maps" / ".new-x"
    left.mkdir(parents=True)
    store = MapStore(settings.data_dir / "maps", 10)
    store.sweep()
    assert left.exists()  # perhaps another server's upload
    os.utime(left, (0, 0))
    store.sweep()
    assert not left.exists()


def test_a_stored_map_survives_a_restart(client, settings):
    summary = upload(client).json()
    store = MapStore(settings.data_dir / "maps", 10)
    assert json.loads(json.dumps(store.list())) == [summary]


def test_a_maps_image_has_its_cells_in_greys_and_makes_the_same_map_again(client):
    answer = upload(client).json()
    image = client.get(f"/v1/maps/{answer['id']}/image")
    assert (image.status_code, image.headers["content-type"]) == (200, "image/png")
    pixels = np.asarray(Image.open(io.BytesIO(image.content)))
    assert pixels.tolist() == [[0, 254, 205], [254, 254, 0]]  # row 0 is the top
    again = upload(client, YAML.replace("free_thresh: 0.2", "free_thresh: 0.19"), image.content)
    assert (again.status_code, again.json()) == (200, answer)


@pytest.mark.parametrize("path", ["/v1/maps", "/v1/maps/{id}", "/v1/maps/{id}/image"])
def test_what_a_client_has_already_is_not_sent_again(client, path):
    path = path.format(id=upload(client).json()["id"])
    full = client.get(path)
    tag = full.headers["etag"]
    for named in (tag, f'"x", {tag}', f"W/{tag}", "*"):
        answer = client.get(path, headers={"if-none-match": named})
        assert (answer.status_code, answer.content, answer.headers["etag"]) == (304, b"", tag)
    assert client.get(path, headers={"if-none-match": '"x"'}).content == full.content


def test_the_list_has_another_tag_once_it_has_changed(client):
    tags = [client.get("/v1/maps").headers["etag"]]
    map_id = upload(client).json()["id"]
    tags.append(client.get("/v1/maps").headers["etag"])
    client.delete(f"/v1/maps/{map_id}")
    assert client.get("/v1/maps").headers["etag"] == tags[0] != tags[1]


def test_an_image_is_offered_as_png_only(client):
    path = f"/v1/maps/{upload(client).json()['id']}/image"
    assert client.get(path, headers={"accept": "image/*"}).status_code == 200
    assert client.get(path, headers={"accept": "application/json"}).json()["code"] == "not-acceptable"
    assert client.get(f"/v1/maps/{'0' * 64}/image").json()["code"] == "unknown-map"
