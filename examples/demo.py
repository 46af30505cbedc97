"""Starts the service, plans for three robots in a warehouse, and shows what came back.

    python examples/demo.py [--out FOLDER]

Needs nothing but the installed package. Writes each plan into the folder (default: out) as JSON, as CSV and
as a picture. Exit status 0 where every plan was made.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).resolve().parent
MAP = EXAMPLES / "warehouse" / "warehouse.yaml"
ROBOTS = ("mecanum", "differential", "ackermann")
COLUMNS = ("robot", "duration", "length", "samples", "worst limit", "closure", "answered in")

# Proxies that the environment names are not for loopback.
HTTP = urllib.request.build_opener(urllib.request.ProxyHandler({}))


class Failure(Exception):
    """Something that ends the demo, said in one line."""


def call(url: str, body: bytes | None = None, **headers: str) -> bytes:
    """The body of the answer. A refusal's own words become the Failure."""
    request = urllib.request.Request(url, body, {k.replace("_", "-"): v for k, v in headers.items()})
    try:
        with HTTP.open(request, timeout=60) as answer:
            content: bytes = answer.read()
            return content
    except urllib.error.HTTPError as refusal:
        raise Failure(f"{url} answered {refusal.code}: {refusal.read().decode(errors='replace')}") from None


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
    """Wait for the service. Its first start compiles the collision kernels; later ones find them cached."""
    deadline = time.monotonic() + 180
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise Failure(f"the service stopped with status {process.returncode}")
        try:
            HTTP.open(f"{url}/readyz", timeout=2).close()
            return
        except OSError:
            time.sleep(0.25)
    raise Failure("the service did not become ready")


def upload(url: str, map_yaml: Path) -> str:
    """Upload a map_server pair; the map's id."""
    boundary = uuid.uuid4().hex
    body = b""
    for field, file in (("yaml", map_yaml), ("image", map_yaml.with_suffix(".pgm"))):
        body += (
            f"--{boundary}\r\n"
            f'Content-Disposition: form-data; name="{field}"; filename="{file.name}"\r\n'
            "Content-Type: application/octet-stream\r\n\r\n"
        ).encode()
        body += file.read_bytes() + b"\r\n"
    body += f"--{boundary}--\r\n".encode()
    answer = call(f"{url}/v1/maps", body, Content_Type=f"multipart/form-data; boundary={boundary}")
    return str(json.loads(answer)["id"])


def plan(url: str, robot: str, map_id: str, out: Path) -> tuple[str, ...]:
    """Plan the robot's drive through the warehouse and save it; its row of the table."""
    from api.picture import draw_plan

    request: dict[str, Any] = json.loads((EXAMPLES / "warehouse" / f"{robot}.json").read_text())
    request["environment"]["map"]["id"] = map_id
    body = json.dumps(request).encode()

    began = time.perf_counter()
    answer = call(f"{url}/v1/plans", body, Content_Type="application/json", Accept="application/json")
    took = time.perf_counter() - began
    # The same request and seed make the same plan, so this is the same one as a table.
    table = call(f"{url}/v1/plans", body, Content_Type="application/json", Accept="text/csv")

    found = json.loads(answer)
    (out / f"{robot}.json").write_bytes(answer)
    (out / f"{robot}.csv").write_bytes(table)
    draw_plan(request, found, out / f"{robot}.png", MAP)

    certificate = found["certificate"]
    worst = max(v for k, v in certificate.items() if k.endswith("_ratio") and v is not None)
    return (
        robot,
        f"{found['duration']:.2f} s",
        f"{found['length']:.2f} m",
        str(len(found["schedule"]["time"])),
        f"{100 * worst:.1f} %",
        f"{1e3 * certificate['closure_position']:.3f} mm",
        f"{1e3 * took:.0f} ms",
    )


def show(rows: list[tuple[str, ...]]) -> None:
    widths = [max(len(row[i]) for row in [COLUMNS, *rows]) for i in range(len(COLUMNS))]
    for name, *figures in [COLUMNS, *rows]:
        aligned = (figure.rjust(width) for figure, width in zip(figures, widths[1:], strict=True))
        print("  ".join([name.ljust(widths[0]), *aligned]))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"), help="where plans and pictures go")
    out: Path = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory() as data, service(Path(data)) as url:
            map_id = upload(url, MAP)
            show([plan(url, robot, map_id, out) for robot in ROBOTS])
    except (Failure, OSError) as reason:
        print(f"demo: {reason}", file=sys.stderr)
        return 1
    print(f"\nEach plan is in {out}/ as .json, .csv and .png.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
