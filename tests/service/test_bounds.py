"""What clients together may hold of a real service: memory, connections, bytes, and the log."""

import contextlib
import copy
import http.client
import io
import json
import os
import signal
import socket
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.service.service import QUICK, head, in_background, serving, until

MIB = 1 << 20
YAML = b"resolution: 0.05\norigin: [0, 0, 0]\noccupied_thresh: 0.65\nfree_thresh: 0.196\nimage: hall.pgm\n"


def lasting(samples):
    """A request whose plan has about so many samples: 2 m along, mostly at full speed."""
    body = copy.deepcopy(QUICK)
    body["goal"] = {"x": 2.0, "y": 0.0, "theta": 0.0}
    seconds = samples * 1e-3
    body["robot"]["limits"] |= {"linear_speed": 2.0 / seconds}
    body["options"] |= {"time_budget": 30.0, "sample_period": 1e-3}
    return body


def form(image):
    """The body of a map's upload, its boundary is b."""
    lines = b'--b\r\nContent-Disposition: form-data; name="%b"; filename="%b"\r\n\r\n%b\r\n'
    return lines % (b"yaml", b"y", YAML) + lines % (b"image", b"i", image) + b"--b--\r\n"


def pgm(side):
    """The image of a hall of side x side cells, with a pillar."""
    cells = np.full((side, side), 254, dtype=np.uint8)
    cells[side // 2 : side // 2 + 4, side // 2 : side // 2 + 4] = 0
    return b"P5 %d %d 255\n" % cells.shape + cells.tobytes()


def upload_head(size):
    start = "POST /v1/maps HTTP/1.1", "Host: x", "Content-Type: multipart/form-data; boundary=b"
    return "\r\n".join([*start, f"Content-Length: {size}", "", ""]).encode()


def answer(connection):
    """(status, headers, problem or document) of the answer that comes next."""
    found = http.client.HTTPResponse(connection)
    found.begin()
    return found.status, found.headers, json.loads(found.read())


def upload(server, image):
    body = form(image)
    with server.connect(upload_head(len(body)) + body) as connection:
        return answer(connection)


def forget_peak(server):
    Path(f"/proc/{server.process.pid}/clear_refs").write_text("5")
    return peak(server)


def peak(server):
    """The most memory that the server process has had, bytes."""
    status = Path(f"/proc/{server.process.pid}/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) * 1024


@pytest.fixture(scope="module")
def bounded(tmp_path_factory):
    """A service that holds little at once."""
    settings = {"max_connections": 10, "max_pending_bytes": 600_000, "max_upload_bytes": 300_000}
    with serving(tmp_path_factory.mktemp("data"), workers=1, max_samples=60_000, **settings) as server:
        yield server


# ---------------------------------------------------------------- answers


def test_a_plan_of_more_samples_than_the_limit_is_refused_and_told_the_limit(bounded):
    status, _, body = bounded.call("/v1/plans", lasting(70_000))
    problem = json.loads(body)
    assert (status, problem["code"], problem["max_samples"]) == (422, "too-many-samples", 60_000)
    assert problem["max_samples"] == json.loads(bounded.call("/v1/limits")[2])["max_samples"]
    assert problem["duration"] > 60
    assert problem["sample_period"] == 1e-3
    assert bounded.plan(lasting(50_000)) == (200, None)


@pytest.mark.parametrize("effort", ["first", "best"])
def test_a_large_answer_is_not_held_in_the_server_however_slowly_it_is_read(server, effort):
    body = lasting(60_000)
    body["options"] |= {"effort": effort, "time_budget": 3.0}
    accept = {"Accept": "text/event-stream"} if effort == "best" else {}
    assert server.plan(QUICK) == (200, None)
    before = forget_peak(server)
    data = json.dumps(body).encode()
    accepts = [f"{name}: {value}" for name, value in accept.items()]
    stalled = [server.connect(head(f"Content-Length: {len(data)}", *accepts) + data) for _ in range(2)]
    for connection in stalled:
        assert connection.recv(15) == b"HTTP/1.1 200 OK"
    status, headers, answered = server.call("/v1/plans", body, **accept)
    assert status == 200
    assert len(answered) > 10 * MIB
    if effort == "first":
        assert int(headers["content-length"]) == len(answered)
        assert len(json.loads(answered)["schedule"]["time"]) > 59_000
    assert peak(server) - before < 5 * MIB
    for connection in stalled:
        connection.close()


# ---------------------------------------------------------------- maps


def test_a_map_is_decoded_outside_the_server(server):
    before = forget_peak(server)
    status, _, summary = upload(server, pgm(4096))
    assert (status, summary["occupied"]) == (201, 16)
    assert peak(server) - before < 8 * MIB


def test_a_process_that_dies_over_a_map_costs_that_upload_alone(server):
    workers, losses = set(server.workers()), server.lost("crashed")
    victim = in_background(upload, server, pgm(4000))
    until(lambda: set(server.workers()) - workers)
    for pid in set(server.workers()) - workers:
        os.kill(pid, signal.SIGKILL)
    status, _, problem = victim()
    assert (status, problem["code"]) == (500, "worker-crashed")
    assert set(server.workers()) == workers
    assert server.lost("crashed") == losses
    assert server.plan(QUICK) == (200, None)
    assert upload(server, pgm(400))[0] == 201


def test_the_image_of_a_map_is_encoded_once_and_sent_from_its_file(server):
    id = upload(server, pgm(2048))[2]["id"]
    stored = (server.data_dir / "maps" / id / "image.png").read_bytes()
    assert Image.open(io.BytesIO(stored)).size == (2048, 2048)
    status, headers, image = server.call(f"/v1/maps/{id}/image")
    assert (status, headers["content-type"]) == (200, "image/png")
    assert image == stored


# ---------------------------------------------------------------- bytes of bodies


@pytest.mark.parametrize(
    ("start", "limit"),
    [(upload_head, 300_000), (lambda size: head(f"Content-Length: {size}"), 600_000)],
    ids=["of maps", "of all requests"],
)
def test_bodies_of_more_bytes_than_the_limit_are_refused_until_others_have_gone(bounded, start, limit):
    first = b'--b\r\nContent-Disposition: form-data; name="image"; filename="i"\r\n\r\n'
    half = first + b" " * (2 * limit // 3 - len(first))
    with bounded.connect(start(limit) + half):
        until(lambda: bounded.metric("wheelplan_body_bytes") >= len(half) - 1, 5)
        with bounded.connect(start(len(half)) + half, timeout=10) as second:
            status, headers, problem = answer(second)
        assert (status, problem["code"], problem["limit"]) == (503, "busy", limit)
        assert int(headers["retry-after"]) == problem["retry_after"] >= 1
    until(lambda: bounded.metric("wheelplan_body_bytes") == 0, 5)
    with bounded.connect(start(len(half)) + half, timeout=10) as third:
        assert answer(third)[0] in (400, 422)  # no more than wrong


# ---------------------------------------------------------------- connections


def test_idle_connections_beyond_the_limit_make_room_for_new_ones(bounded):
    idle = [bounded.connect(b"GET /livez HTTP/1.1\r\nHo") for _ in range(30)]
    assert bounded.plan(QUICK) == (200, None)
    assert 20 <= sum(map(closed, idle)) < 30
    for connection in idle:
        connection.close()


def test_beyond_the_limit_of_connections_in_use_probes_are_answered_and_others_refused(bounded):
    used = [bounded.connect(head("Content-Length: 9")) for _ in range(10)]
    time.sleep(0.2)
    status, headers, body = bounded.call("/v1/drives")
    problem = json.loads(body)
    assert (status, problem["code"], problem["limit"]) == (503, "busy", 10)
    assert int(headers["retry-after"]) >= 1
    assert headers["x-request-id"]
    assert headers["connection"] == "close"
    for path in ("/livez", "/readyz", "/metrics"):
        assert bounded.call(path)[0] == 200
    more = [bounded.connect(head("Content-Length: 9")) for _ in range(100)]
    until(lambda: sum(map(closed, more)) >= 30, 5)
    for connection in used + more:
        connection.close()
    until(lambda: bounded.call("/v1/drives")[0] == 200, 10)


def closed(connection):
    """Whether the service has closed it without an answer."""
    connection.settimeout(0.02)
    try:
        return connection.recv(1, socket.MSG_PEEK) == b""
    except TimeoutError:
        return False
    except OSError:
        return True


# ---------------------------------------------------------------- clients without a token


def test_a_client_without_a_token_has_its_401_before_it_has_sent_its_body(tmp_path):
    (tmp_path / "tokens").write_text("the-token\n")
    with serving(tmp_path, "the-token", workers=1, tokens_file=tmp_path / "tokens") as server:
        for target in ("POST /v1/plans", "POST /v1/maps", "POST /v1/batches"):
            began = time.monotonic()
            with server.connect(head("Content-Length: 9000000000", target=target), timeout=10) as connection:
                status, headers, problem = answer(connection)
                assert (status, problem["code"]) == (401, "unauthorized")
                assert headers["connection"] == "close"
                assert time.monotonic() - began < 0.5
                assert connection.recv(1) == b""
            assert time.monotonic() - began < 3.0
        with server.connect(head("Content-Length: 9000000000"), timeout=10) as connection:
            sent = 0
            with contextlib.suppress(OSError):
                while sent < 1 << 30:
                    sent += connection.send(b" " * MIB)
        assert sent < 64 * MIB  # what the kernel holds
        with server.connect(head("Content-Length: 9"), timeout=10) as connection:
            connection.sendall(b" " * 9)
            assert answer(connection)[0] == 401


# ---------------------------------------------------------------- the log


def test_a_reader_of_the_log_that_stalls_does_not_stop_the_service(tmp_path):
    with serving(tmp_path, workers=1) as server:
        server.stalls = True
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
        for _ in range(1000):  # more than a pipe holds
            connection.request("GET", "/" + "x" * 200)
            assert connection.getresponse().read()
        connection.close()
        assert server.call("/livez", timeout=5)[0] == 200
        assert server.plan(QUICK) == (200, None)
        server.process.send_signal(signal.SIGTERM)
        assert server.process.wait(10) == 0
