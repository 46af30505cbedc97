"""Clients that send slowly, in part, or what is no HTTP: raw sockets against a real service."""

import json
import socket
import threading
import time

import pytest

from tests.service.service import QUICK, head, serving, until

CLOSED_WITHIN = 10.0
"""What an operator is promised; the default receive_timeout is a little less."""

PROBE = b"GET /livez HTTP/1.1\r\nHost: x\r\n"
CHUNKED = head("Transfer-Encoding: chunked")

SLOW = {
    "nothing is sent": (b"", b"", None),
    "half a request line": (b"POST /v1/pl", b"", None),
    "empty lines, one after the other": (b"", b"\r\n", 400),
    "a head that comes letter by letter": (PROBE + b"X-Slow: ", b"x", None),
    "a head that never ends": (PROBE, b"X-More: x\r\n", None),
    "nothing after an answer": (PROBE + b"\r\n", b"", 200),
    "half a second request after an answer": (PROBE + b"\r\n" + PROBE, b"x", 200),
    "a declared body that never comes": (head("Content-Length: 100"), b"", 408),
    "a declared body that comes letter by letter": (head("Content-Length: 100"), b" ", 408),
    "a chunked body that never comes": (CHUNKED, b"", 408),
    "a chunked body that comes letter by letter": (CHUNKED, b"1\r\n \r\n", 408),
    "a body that waits to be asked for": (head("Content-Length: 9", "Expect: 100-continue"), b"", 100),
    "a body that nobody reads": (PROBE + b"Content-Length: 100\r\n\r\n", b" ", 200),
    "a map that comes letter by letter": (
        b"POST /v1/maps HTTP/1.1\r\nHost: x\r\nContent-Type: multipart/form-data; boundary=b\r\n"
        b"Content-Length: 1000\r\n\r\n--b\r\n", b"x", 408,
    ),
}  # fmt: skip
"""What a client sends at first, then every 0.4 s, and the status of the first answer, if there is one."""


def converse(server, first, then):
    """How long the service keeps the connection (s), and all that it sends."""
    began, received = time.monotonic(), b""
    with server.connect(first) as connection:
        connection.settimeout(0.4)
        while time.monotonic() - began < 2 * CLOSED_WITHIN:
            try:
                data = connection.recv(1 << 16)
                received += data
                if not data:
                    break
            except TimeoutError:
                try:
                    connection.sendall(then)
                except OSError:
                    break
            except OSError:
                break
    return time.monotonic() - began, received


@pytest.fixture(scope="module")
def conversations(server):
    """All of SLOW at once."""
    found = {}

    def hold(name, first, then):
        found[name] = converse(server, first, then)

    threads = [threading.Thread(target=hold, args=(name, *row[:2])) for name, row in SLOW.items()]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


@pytest.mark.parametrize("name", SLOW)
def test_a_connection_is_closed_within_ten_seconds_where_a_client_sends(conversations, name):
    seconds, received = conversations[name]
    assert seconds < CLOSED_WITHIN
    status = SLOW[name][2]
    if status is None:
        assert received == b""
    else:
        assert received.startswith(b"HTTP/1.1 %d " % status)
    if status == 408:
        assert json.loads(received.partition(b"\r\n\r\n")[2])["code"] == "request-timeout"


def test_a_large_body_that_keeps_coming_may_take_longer_than_a_small_one(tmp_path):
    with serving(tmp_path, workers=1, receive_timeout=1.0) as server:
        size, pieces = 400_000, 20
        connection = server.connect(head(f"Content-Length: {size}"))
        began = time.monotonic()
        for _ in range(pieces):
            connection.sendall(b" " * (size // pieces))
            time.sleep(0.1)
        assert time.monotonic() - began > 1.9
        answer = connection.recv(1 << 16)
        assert answer.startswith(b"HTTP/1.1 400 "), answer
        connection.close()


def test_a_client_who_does_not_take_its_answer_is_given_up(tmp_path):
    with serving(tmp_path, workers=1, receive_timeout=0.5) as server:
        until(lambda: server.call("/metrics") and True)
        open_files = server.metric("process_open_fds")
        connection = socket.socket()
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(("127.0.0.1", server.port))
        body = json.dumps(QUICK | {"options": QUICK["options"] | {"sample_period": 0.001}}).encode()
        for _ in range(20):  # each answer has a megabyte
            connection.sendall(head(f"Content-Length: {len(body)}") + body)
        until(lambda: server.metric("process_open_fds") > open_files, 20)
        until(lambda: server.metric("process_open_fds") <= open_files, 30)
        connection.close()


def test_a_client_who_leaves_amid_its_body_is_no_error_of_ours(server):
    gone = 'wheelplan_requests_total{method="POST",route="/v1/plans",status="499"}'
    before, lines = server.metric(gone), len(server.log)
    server.connect(head("Content-Length: 100") + b"half").close()
    until(lambda: server.metric(gone) == before + 1, 10)
    assert not any(b"Traceback" in line for line in server.log[lines:])


@pytest.mark.parametrize(
    "sent",
    [
        b"EHLO example.org\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n",
        b"GET /livez HTTP/1.1\r\nHost: x\r\nno colon\r\n\r\n",
        b"GET /livez HTTP/1.1\r\nHost: x\r\n" + b"X-Long: " + b"x" * 100_000,
        CHUNKED + b"no size\r\n",
        head("Content-Length: ten"), head("Content-Length: 1", "Content-Length: 2"),
    ],
    ids=["smtp", "tls", "no-header", "endless-header", "no-chunk", "no-length", "two-lengths"],
)  # fmt: skip
def test_what_is_no_http_is_told_so_by_a_problem_document(server, sent):
    with server.connect(sent) as connection:
        connection.shutdown(socket.SHUT_WR)
        answer = b""
        while data := connection.recv(1 << 16):
            answer += data
    top, _, body = answer.partition(b"\r\n\r\n")
    assert top.startswith(b"HTTP/1.1 400 ")
    assert b"application/problem+json" in top
    assert json.loads(body)["code"] == "malformed-http"


def test_every_line_of_the_log_is_json_and_names_the_request_that_an_answer_names(server):
    with server.connect(b"no HTTP\r\n\r\n") as connection:
        connection.recv(1 << 16)
    request_id = server.call("/v1/drives")[1]["x-request-id"]
    until(lambda: any(request_id.encode() in line for line in server.log), 10)
    lines = [json.loads(line) for line in server.log]
    assert [line["path"] for line in lines if line.get("request_id") == request_id] == ["/v1/drives"]
    assert all("time" in line for line in lines)


def test_other_origins_are_not_let_in(server):
    headers = server.call("/v1/drives", Origin="https://example.org")[1]
    assert not [name for name in headers if name.lower().startswith("access-control")]


def test_only_this_machine_is_listened_to_unless_told(server):
    assert all(line["host"] == "127.0.0.1" for line in map(json.loads, server.log) if "host" in line)
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", server.port), timeout=5)
