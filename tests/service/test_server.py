"""A real service with real workers: probes, plans, crashes, leaving clients, shutdown, orphans."""

import contextlib
import http.client
import json
import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from tests.service.service import (
    QUICK,
    ROOT,
    alive,
    busiest,
    descendants,
    in_background,
    serving,
    slow,
    stat,
    until,
)  # fmt: skip


def test_a_plan_is_made_and_the_same_seed_makes_it_again(server):
    status, headers, body = server.call("/v1/plans", QUICK)
    assert status == 200, body
    assert headers["x-request-id"]
    again = json.loads(server.call("/v1/plans", QUICK)[2])
    plan = json.loads(body)
    assert plan["schedule"] == again["schedule"]
    assert plan["duration"] > 0


def test_probes_are_answered_at_once_while_every_worker_plans(server):
    joins = [in_background(server.call, "/v1/plans", slow(2.0)) for _ in range(2)]
    time.sleep(0.3)
    times = []
    for _ in range(20):
        began = time.perf_counter()
        assert server.call("/livez")[0] == 200
        times.append(time.perf_counter() - began)
        time.sleep(0.02)
    assert sorted(times)[10] < 0.05
    assert [join()[0] for join in joins] == [200, 200]


def test_a_worker_that_is_killed_fails_its_own_request_alone(server):
    restarts = server.metric("wheelplan_worker_restarts_total")
    victim_of = in_background(server.call, "/v1/plans", slow(5.0))
    time.sleep(0.3)
    os.kill(busiest(server), signal.SIGKILL)
    other = server.call("/v1/plans", QUICK)
    status, _, body = victim_of()
    assert (status, json.loads(body)["code"]) == (500, "worker-crashed")
    assert other[0] == 200
    assert server.call("/v1/plans", QUICK)[0] == 200
    until(lambda: server.metric("wheelplan_worker_restarts_total") == restarts + 1)


def test_a_client_who_leaves_frees_its_worker_within_half_a_second(server):
    until(lambda: server.metric("wheelplan_workers_idle") == 2)
    connections = [server.open(slow(20.0)) for _ in range(2)]
    until(lambda: server.metric("wheelplan_workers_idle") == 0)
    for connection in connections:
        connection.close()
    until(lambda: server.metric("wheelplan_workers_idle") == 2, 0.5)
    assert server.lost("cancelled") >= 2
    assert server.call("/v1/plans", QUICK)[0] == 200


@pytest.mark.parametrize("chunked", [False, True])
def test_a_client_who_sends_too_much_is_told_so(server, chunked):
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as connection:
        head = b"POST /v1/plans HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
        size = 3 << 20
        length = b"Transfer-Encoding: chunked" if chunked else b"Content-Length: %d" % size
        connection.sendall(head + length + b"\r\n\r\n")
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            for _ in range(size >> 14):
                piece = b" " * (1 << 14)
                connection.sendall(b"%x\r\n%s\r\n" % (len(piece), piece) if chunked else piece)
            if chunked:
                connection.sendall(b"0\r\n\r\n")
        for expected in (413, 200):  # and the connection is good for another request
            answer = http.client.HTTPResponse(connection)
            answer.begin()
            assert answer.status == expected
            answer.read()
            connection.sendall(b"GET /livez HTTP/1.1\r\nHost: x\r\n\r\n")


def test_a_full_queue_answers_429_and_a_plan_that_outlasts_the_grace_of_a_shutdown_503(tmp_path):
    with serving(tmp_path, workers=1, queue_length=1, drain_grace=0.5) as server:
        joins = [in_background(server.call, "/v1/plans", slow(20.0)) for _ in range(2)]
        time.sleep(0.5)
        status, headers, body = server.call("/v1/plans", QUICK)
        assert (status, json.loads(body)["code"]) == (429, "overloaded")
        assert int(headers["retry-after"]) >= 1
        assert server.metric("wheelplan_shed_total") == 1
        server.process.terminate()
        for status, _, body in [join() for join in joins]:
            assert (status, json.loads(body)["code"]) == (503, "draining")
        assert server.process.wait(5) == 0


def test_the_first_plan_costs_the_server_no_loading(tmp_path):
    corners = [[2.0, -3.0], [3.0, -3.0], [3.0, -2.0]]
    walled = QUICK["environment"] | {"obstacles": [{"type": "polygon", "vertices": corners}]}
    with serving(tmp_path) as server:
        used = stat(server.process.pid)[2]
        assert server.call("/v1/plans", QUICK | {"environment": walled})[0] == 200
        assert (stat(server.process.pid)[2] - used) / os.sysconf("SC_CLK_TCK") < 0.15


def test_a_shutdown_finishes_the_plans_in_flight_and_leaves_nothing_behind(tmp_path):
    with serving(tmp_path, workers=2) as server:
        family = descendants(server.process.pid)
        in_flight = in_background(server.call, "/v1/plans", slow(2.0))
        time.sleep(0.5)
        server.process.terminate()
        time.sleep(0.2)
        status, _, body = server.call("/readyz")
        assert (status, json.loads(body)["code"]) == (503, "draining")
        status, headers, body = server.call("/v1/plans", QUICK)
        assert (status, json.loads(body)["code"]) == (503, "draining")
        assert headers["retry-after"]
        assert server.call("/livez")[0] == 200
        assert in_flight()[0] == 200
        assert server.process.wait(10) == 0
        until(lambda: not any(map(alive, family)), 10)


def test_a_second_signal_ends_the_service_at_once_and_leaves_nothing_behind(tmp_path):
    with serving(tmp_path, workers=1) as server:
        family = descendants(server.process.pid)
        connection = server.open(slow(20.0))
        time.sleep(0.5)
        server.process.send_signal(signal.SIGINT)
        time.sleep(0.2)
        assert server.process.poll() is None
        server.process.send_signal(signal.SIGINT)
        server.process.wait(10)
        until(lambda: not any(map(alive, family)), 10)
        connection.close()


def test_a_service_that_is_killed_leaves_no_process_behind(tmp_path):
    with serving(tmp_path, workers=2) as server:
        family = descendants(server.process.pid)
        assert len(family) >= 3
        connection = server.open(slow(20.0))  # one worker is busy, one is idle
        time.sleep(0.5)
        server.process.kill()
        server.process.wait()
        until(lambda: not any(map(alive, family)), 10)  # well before the plan would end
        connection.close()


def test_a_port_in_use_ends_the_service_with_a_reason(server, tmp_path):
    env = os.environ | {"WHEELPLAN_DATA_DIR": str(tmp_path)}
    command = [sys.executable, "-m", "api.cli", "serve", "--port", str(server.port)]
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, timeout=30)
    assert done.returncode != 0
    assert b"address already in use" in done.stderr
