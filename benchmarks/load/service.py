"""The service under load: a real one, and what its processes weigh."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib import request

__all__ = ["Service", "running"]

_HTTP = request.build_opener(request.ProxyHandler({}))


class Service:
    """A service that is ready."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.process = process
        assert process.stderr is not None
        line: dict[str, object] = {}
        port: object = None
        while line.get("event") != "ready":
            line = json.loads(process.stderr.readline())
            port = line.get("port", port)
        self.port = int(str(port))
        with _HTTP.open(f"http://127.0.0.1:{self.port}/v1/limits") as answer:
            limits = json.load(answer)
        self.workers, self.queue_length = int(limits["workers"]), int(limits["queue_length"])

    def cpu(self) -> float:
        """CPU time that the server has used, its workers not counted, s."""
        ticks = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
        return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")

    def resident(self) -> dict[str, float]:
        """Resident memory (MB) of the server and of each worker, oldest first."""
        parents = {}
        for place in Path("/proc").glob("[0-9]*/stat"):
            try:
                parents[int(place.parent.name)] = int(place.read_text().rpartition(")")[2].split()[1])
            except OSError:  # it has ended meanwhile
                continue
        server = self.process.pid
        workers = sorted(pid for pid, parent in parents.items() if parents.get(parent) == server)
        named = {"server": server} | {f"worker {i + 1}": pid for i, pid in enumerate(workers)}
        return {name: _resident(pid) for name, pid in named.items()}


@contextmanager
def running(workers: int | None) -> Iterator[Service]:
    """Starts a service, and stops it in the end."""
    given = {} if workers is None else {"WHEELPLAN_WORKERS": str(workers)}
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as rest:
        command = [sys.executable, "-m", "api.cli", "serve", "--host", "127.0.0.1", "--port", "0"]
        environment = {**os.environ, "WHEELPLAN_DATA_DIR": folder, **given}
        process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE)
        assert process.stderr is not None
        drain = None
        try:
            service = Service(process)
            # Nobody reads its log from here on, and it must not wait for somebody to.
            drain = subprocess.Popen(["cat"], stdin=process.stderr, stdout=rest)
            yield service
        finally:
            process.terminate()
            process.wait(60)
            if drain is not None:
                drain.wait()


def _resident(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return 0.0
