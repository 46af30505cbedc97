"""Plans for three robots in a warehouse, over HTTP, and keeps what comes back.

    python examples/client.py [--url http://127.0.0.1:8000] [--out FOLDER]

Needs a running service (`make serve`). Writes each plan into the folder (default: out) as JSON, as CSV and as
a picture. Exit status 0 where every plan was made.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import httpx

from api.client import Client, Problem

WAREHOUSE = Path(__file__).resolve().parent / "warehouse"
ROBOTS = ("mecanum", "differential", "ackermann")
COLUMNS = ("robot", "duration", "length", "samples", "worst limit", "closure", "answered in")


def plan(wheelplan: Client, robot: str, map_id: str, out: Path) -> tuple[str, ...]:
    """Plan the robot's drive through the warehouse and save it; its row of the table."""
    request = json.loads((WAREHOUSE / f"{robot}.json").read_text())
    request["environment"]["map"]["id"] = map_id

    began = time.perf_counter()
    found = wheelplan.plan(request)
    took = time.perf_counter() - began
    (out / f"{robot}.json").write_text(found.model_dump_json())
    # The same request and seed make the same plan, so these are of the same one.
    for form in ("csv", "png"):
        (out / f"{robot}.{form}").write_bytes(wheelplan.plan_as(request, form))

    certificate = found.certificate
    worst = max(
        ratio
        for name, ratio in certificate.model_dump().items()
        if name.endswith("_ratio") and ratio is not None
    )
    return (
        robot,
        f"{found.duration:.2f} s",
        f"{found.length:.2f} m",
        str(len(found.schedule.time)),
        f"{100 * worst:.1f} %",
        f"{1e3 * certificate.closure_position:.3f} mm",
        f"{1e3 * took:.0f} ms",
    )


def show(rows: list[tuple[str, ...]]) -> None:
    widths = [max(len(row[i]) for row in [COLUMNS, *rows]) for i in range(len(COLUMNS))]
    for name, *figures in [COLUMNS, *rows]:
        aligned = (figure.rjust(width) for figure, width in zip(figures, widths[1:], strict=True))
        print("  ".join([name.ljust(widths[0]), *aligned]))


def run(url: str, out: Path) -> int:
    """Plan for every robot at this service; the exit status."""
    out.mkdir(parents=True, exist_ok=True)
    try:
        with Client(url) as wheelplan:
            stored = wheelplan.upload_map(WAREHOUSE / "warehouse.yaml", WAREHOUSE / "warehouse.pgm")
            show([plan(wheelplan, robot, stored.id, out) for robot in ROBOTS])
    except (Problem, httpx.TransportError, OSError) as reason:
        print(f"{url}: {reason}", file=sys.stderr)
        return 1
    print(f"\nEach plan is in {out}/ as .json, .csv and .png.")
    return 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--url", default="http://127.0.0.1:8000", help="where the service is")
    parser.add_argument("--out", type=Path, default=Path("out"), help="where plans and pictures go")
    asked = parser.parse_args()
    sys.exit(run(asked.url, asked.out))
