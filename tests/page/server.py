"""A real `wheelplan serve` for a browser to open."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

ROOT = Path(__file__).parents[2]

CHROMIUM_ARGUMENTS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip


class Server:
    """Serves on a free port of this machine while the context lasts; ready when it begins."""

    def __init__(self, data_dir: Path, **settings: object) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{port}"
        self._port = str(port)
        given = {f"WHEELPLAN_{name.upper()}": str(value) for name, value in settings.items()}
        self._environment = os.environ | {"WHEELPLAN_DATA_DIR": str(data_dir)} | given

    def __enter__(self) -> Server:
        command = [sys.executable, "-m", "api.cli", "serve", "--port", self._port]
        self._process = subprocess.Popen(
            command, cwd=ROOT, env=self._environment, stderr=subprocess.DEVNULL
        )
        for _ in range(2400):
            if self._ready():
                return self
            time.sleep(0.05)
        self.__exit__()
        raise RuntimeError("the service did not become ready")

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait(30)

    def _ready(self) -> bool:
        try:
            with urllib.request.urlopen(f"{self.url}/readyz", timeout=2) as answer:
                return bool(answer.status == 200)
        except (OSError, urllib.error.URLError):
            return False
