"""A real `wheelplan serve` with real workers, and what tests do to it."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

ROOT = Path(__file__).parents[2]

QUICK = {
    "robot": {
        "drive": {"type": "omni", "wheel_radius": 0.05, "robot_radius": 0.2},
        "footprint": {"type": "circle", "radius": 0.25},
        "limits": {"wheel_speed": 20.0, "wheel_acceleration": 20.0},
    },
    "start": {"x": 0.0, "y": 0.0, "theta": 0.0},
    "goal": {"x": 2.0, "y": 1.0, "theta": 0.5},
    "environment": {"bounds": {"x_min": -5, "y_min": -5, "x_max": 5, "y_max": 5}},
    "options": {"effort": "first", "time_budget": 5.0},
}
OBSTACLES = [{"type": "circle", "center": [x, y], "radius": 0.4} for x in (1, 2.5) for y in (-3, -1, 1, 3)]


def slow(seconds):
    """A request that takes the whole of its time budget."""
    return {
        **QUICK,
        "goal": {"x": 4.0, "y": 0.5, "theta": 1.0},
        "environment": {**QUICK["environment"], "obstacles": OBSTACLES},
        "options": {"effort": "best", "time_budget": seconds},
    }


class Server:
    """Listens on a free port. settings: queue_length=1 sets WHEELPLAN_QUEUE_LENGTH. stalls: nobody reads its
    log."""

    def __init__(self, data_dir, token=None, **settings):
        self.token = token
        self.data_dir = Path(data_dir)
        given = {f"WHEELPLAN_{name.upper()}": str(value) for name, value in settings.items()}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "api.cli", "serve", "--port", "0"],
            cwd=ROOT,
            env=os.environ | {"WHEELPLAN_DATA_DIR": str(data_dir)} | given,
            stderr=subprocess.PIPE,
        )
        self.port = None
        self.log = []
        self.stalls = False
        threading.Thread(target=self._read_log, daemon=True).start()

    def _read_log(self):
        for line in self.process.stderr:
            while self.stalls:
                time.sleep(0.1)
            self.log.append(line)
            if b'"listening"' in line:
                self.port = json.loads(line)["port"]

    def call(self, path, body=None, timeout=60.0, method=None, **headers):
        """(status, headers, body) of one request."""
        data = None if body is None else json.dumps(body).encode()
        headers = {"Content-Type": "application/json", **headers}
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}{path}", data, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=timeout) as answer:
                return answer.status, answer.headers, answer.read()
        except urllib.error.HTTPError as error:
            return error.code, error.headers, error.read()

    def plan(self, body, **headers):
        """(status, problem's code or None) of a plan request."""
        status, _, answer = self.call("/v1/plans", body, **headers)
        return status, json.loads(answer).get("code")

    def ready(self):
        with contextlib.suppress(OSError):
            return self.port is not None and self.call("/readyz")[0] == 200
        return False

    def metric(self, name):
        given = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        for line in self.call("/metrics", **given)[2].decode().splitlines():
            if line.startswith(name + " "):
                return float(line.split()[1])
        return 0.0

    def lost(self, reason):
        return self.metric(f'wheelplan_workers_lost_total{{reason="{reason}"}}')

    def connect(self, data=b"", timeout=60.0):
        """A connection over which this has been sent."""
        connection = socket.create_connection(("127.0.0.1", self.port), timeout=timeout)
        connection.sendall(data)
        return connection

    def open(self, body, *lines):
        """A connection that has sent a plan request. lines: more of its head."""
        data = json.dumps(body).encode()
        return self.connect(head(f"Content-Length: {len(data)}", *lines) + data)

    def workers(self):
        """The processes that plan, which are children of the fork server."""
        found = []
        for pid in descendants(self.process.pid):
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):
                state, parent, _ = stat(pid)
                if state != "Z" and parent != self.process.pid:
                    found.append(pid)
        return found

    def fork_server(self):
        return stat(self.workers()[0])[1]

    def end(self):
        for pid in [self.process.pid, *descendants(self.process.pid)]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()


@contextlib.contextmanager
def serving(data_dir, token=None, **settings):
    """A server that is ready. token: what to show it for its metrics."""
    server = Server(data_dir, token, **settings)
    try:
        until(lambda: server.ready() or server.process.poll() is not None, 600)  # it may have to compile
        assert server.process.poll() is None, b"".join(server.log)
        until(lambda: server.metric("wheelplan_workers_idle") == settings.get("workers", 2))
        yield server
    finally:
        server.end()


def head(*lines, target="POST /v1/plans"):
    """The head of a request."""
    fixed = (f"{target} HTTP/1.1", "Host: x", "Content-Type: application/json")
    return "\r\n".join((*fixed, *lines, "", "")).encode()


def until(condition, within=60.0):
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < within
        time.sleep(0.02)


def in_background(function, *args):
    """Calls it in a thread; what it returns is what the function returned will."""
    results = []
    thread = threading.Thread(target=lambda: results.append(function(*args)))
    thread.start()

    def join():
        thread.join()
        return results[0]

    return join


def stat(pid):
    """(state, parent, CPU time in ticks) of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return fields[0], int(fields[1]), int(fields[11]) + int(fields[12])


def descendants(root):
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):
                parents[int(entry.name)] = stat(entry.name)[1]
    found, grown = {root}, True
    while grown:
        more = {pid for pid, parent in parents.items() if parent in found} - found
        grown = bool(more)
        found |= more
    return found - {root}


def alive(pid):
    try:
        return stat(pid)[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def busiest(server):
    """The process of the service that works hardest right now: a worker that plans."""
    before = {pid: stat(pid)[2] for pid in server.workers()}
    time.sleep(0.3)
    return max(before, key=lambda pid: stat(pid)[2] - before[pid] if alive(pid) else -1)
