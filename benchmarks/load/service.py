"""The service under load: a real one, and what its processes weigh."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib import request

__all__ = ["Service", "running"]

_HTTP = request.build_opener(request.ProxyHandler({}))


class Service:
    """A service that is ready."""

    def __init__(self, process: subprocess.Popen[bytes], log: Path) -> None:
        self.process = process
        events: dict[str, Any] = {}
        while "ready" not in events:
            time.sleep(0.1)
            assert process.poll() is None, log.read_text()
            whole = log.read_bytes().rpartition(b"\n")[0].splitlines()
            events = {line["event"]: line for line in map(json.loads, whole) if "event" in line}
        self.port = int(events["listening"]["port"])
        with _HTTP.open(f"http://127.0.0.1:{self.port}/v1/limits") as answer:
            limits = json.load(answer)
        self.workers: int = limits["workers"]
        self.queue_length: int = limits["queue_length"]
        self.queue_wait: float = limits["queue_wait"]

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
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        command = [sys.executable, "-m", "api.cli", "serve", "--host", "127.0.0.1", "--port", "0"]
        environment = {**os.environ, "WHEELPLAN_DATA_DIR": folder, **given}
        with log.open("wb") as lines:  # not a pipe: whoever reads it takes of the processors
            process = subprocess.Popen(command, env=environment, stderr=lines)
        try:
            yield Service(process, log)
        finally:
            process.terminate()
            process.wait(60)


def _resident(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    return 0.0
