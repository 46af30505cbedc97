"""Starts the service, and plans for three robots in a warehouse (client.py).

    python examples/demo.py [--out FOLDER]

Needs nothing but the installed package. Exit status 0 where every plan was made.
"""

from __future__ import annotations

import argparse
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import client
import httpx


class Failure(Exception):
    """Something that ends the demo, said in one line."""


@contextmanager
def service(folder: Path) -> Iterator[str]:
    """A running service's address. It listens on a free loopback port and is stopped at the end."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    settings = {"WHEELPLAN_HOST": "127.0.0.1", "WHEELPLAN_PORT": str(port), "WHEELPLAN_DATA_DIR": str(folder)}
    command = [str(Path(sys.executable).with_name("wheelplan")), "serve"]
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            command, env={**os.environ, **settings}, stdin=subprocess.DEVNULL, stdout=log, stderr=log
        )
        try:
            url = f"http://127.0.0.1:{port}"
            wait_until_ready(process, url)
            yield url
        except Failure:
            log.seek(0)
            for line in log.read().decode(errors="replace").splitlines()[-20:]:
                print(line, file=sys.stderr)
            raise
        finally:
            process.terminate()
            try:
                process.wait(timeout=30)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def wait_until_ready(process: subprocess.Popen[bytes], url: str) -> None:
    """Wait for the service. The first start on a machine compiles the kernels; later ones load them."""
    deadline = time.monotonic() + 600
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise Failure(f"the service stopped with status {process.returncode}")
        try:
            if httpx.get(f"{url}/readyz", timeout=2, trust_env=False).is_success:
                return
        except httpx.TransportError:
            pass
        time.sleep(0.25)
    raise Failure("the service did not become ready")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"), help="where plans and pictures go")
    out: Path = parser.parse_args().out
    try:
        with tempfile.TemporaryDirectory() as data, service(Path(data)) as url:
            return client.run(url, out)
    except (Failure, OSError) as reason:
        print(f"demo: {reason}", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
