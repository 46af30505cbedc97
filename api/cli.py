"""The command `wheelplan`: serve, plan one request without a server, list the drives and the settings."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from api.settings import Settings
from api.strict_json import MalformedJson, read_json, write_json

if TYPE_CHECKING:
    from planner.plan import Plan
    from planner.problem import Problem

__all__ = ["main"]


def main(arguments: list[str] | None = None) -> int:
    """Runs the command; its exit status."""
    parser = _parser()
    asked = parser.parse_args(arguments)
    try:
        settings = Settings.from_environment()
        if asked.command == "serve":
            given = {name: value for name in ("host", "port") if (value := getattr(asked, name)) is not None}
            settings = replace(settings, **given)
    except ValueError as error:
        parser.error(str(error))
    if asked.command == "serve":
        from api.server import serve  # every command is quicker without what the others need

        return serve(settings)
    if asked.command == "plan":
        return plan_file(asked, settings)
    if asked.command == "settings":
        _list_settings(settings)
        return 0
    from api.routes_drives import catalogue

    _write(catalogue(), None)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="wheelplan", description="Trajectory planning for wheeled robots.")
    commands = parser.add_subparsers(dest="command", required=True)
    serve_command = commands.add_parser("serve", help="run the HTTP service")
    serve_command.add_argument("--host", help="address to listen on (WHEELPLAN_HOST, 127.0.0.1)")
    serve_command.add_argument("--port", type=int, help="port to listen on (WHEELPLAN_PORT, 8000)")
    plan_command = commands.add_parser("plan", help="plan one request, without a server")
    plan_command.add_argument("request", type=Path, help="what you would post to /v1/plans, as a file")
    plan_command.add_argument("--map", type=Path, help="map_server yaml that becomes environment.map")
    plan_command.add_argument("-o", "--output", type=Path, help="where the plan goes (standard output)")
    plan_command.add_argument("--picture", type=Path, help="draw the plan to this file")
    commands.add_parser("drives", help="list the drives, with a JSON schema and an example each")
    commands.add_parser("settings", help="list the settings: environment variable, value, default, meaning")
    return parser


def plan_file(asked: argparse.Namespace, settings: Settings) -> int:
    """Plans one request in this process; 1, and the problem on standard error, where there is no plan."""
    from api.convert import to_problem
    from api.errors import Refusal, problem_document
    from api.maps import MapStore, read_map
    from api.planning import plan_document
    from api.schemas import PlanRequest
    from api.validation import validated
    from planner.errors import PlanningError

    with tempfile.TemporaryDirectory(prefix="wheelplan-") as scratch:
        try:
            request = read_json(asked.request.read_bytes())
            maps = MapStore(settings.data_dir / "maps", settings.max_maps)
            if asked.map is not None:
                maps = MapStore(Path(scratch), 1)
                map_id = maps.add(read_map(asked.map, settings.max_map_cells))[0]["id"]
                with suppress(AttributeError):  # what is no object, validation names below
                    request.setdefault("environment", {}).setdefault("map", {})["id"] = map_id
            problem = to_problem(validated(PlanRequest, request), maps.layer, settings.max_time_budget)
            plan = read_json(write_json(plan_document(problem, _best_so_far(problem))))
        except MalformedJson as error:
            return _refuse(problem_document(Refusal("malformed-json", str(error))))
        except (Refusal, PlanningError) as error:
            return _refuse(problem_document(error))
        except OSError as error:
            print(f"wheelplan: {error}", file=sys.stderr)
            return 2
        _write(plan, asked.output)
        if asked.picture is not None:
            from api.picture import draw_plan

            draw_plan(request, plan, asked.picture, asked.map)
    return 0


def _list_settings(settings: Settings) -> None:
    rows = [("variable", "value", "default", "meaning"), *settings.table()]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)][:-1]
    for *cells, meaning in rows:
        print(*(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)), meaning, sep="  ")


def _best_so_far(problem: Problem) -> Plan:
    """The plan. At effort best each better one on the way is told of; an interrupt ends the work with it."""
    from api.planning import make_plan

    began = time.perf_counter()
    best: Plan | None = None

    def improved(better: Plan) -> None:
        nonlocal best
        best = better
        elapsed = time.perf_counter() - began
        print(f"after {elapsed:.2f} s: a motion of {better.duration:.3f} s", file=sys.stderr)

    try:
        return make_plan(problem, improved)
    except KeyboardInterrupt:
        if best is None:
            raise
        return best


def _write(document: Any, to: Path | None) -> None:
    if to is None:
        sys.stdout.buffer.write(write_json(document, indent=True) + b"\n")
    else:
        to.write_bytes(write_json(document) + b"\n")


def _refuse(document: dict[str, Any]) -> int:
    sys.stderr.buffer.write(write_json(document, indent=True) + b"\n")
    return 1


if __name__ == "__main__":
    sys.exit(main())
