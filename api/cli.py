"""The command `wheelplan`: serve, plan or draw without a server, list the drives and the settings."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from api.places import keep_to
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
        keep_to(settings.data_dir)
        from api.server import serve  # every command is quicker without what the others need

        return serve(settings)
    files = {"plan": plan_file, "picture": draw_file, "robot": robot_file}
    if asked.command in files:
        return _status(lambda: files[asked.command](asked, settings))
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
    plan_command.add_argument("--format", default="json", help="as ?format= (json)")
    plan_command.add_argument("--picture", type=Path, help="draw the plan to this .svg or .png too")
    picture_command = commands.add_parser("picture", help="draw a plan: floor plan and wheel charts")
    picture_command.add_argument("plan", type=Path, help="a plan, as a file")
    picture_command.add_argument("-o", "--output", type=Path, required=True, help="the .svg or .png")
    picture_command.add_argument("--request", type=Path, help="what was asked, where PLAN does not hold it")
    picture_command.add_argument("--map", type=Path, help="map_server yaml of environment.map")
    robot_command = commands.add_parser("robot", help="the robot of a VDA 5050 factsheet, and what it lacks")
    robot_command.add_argument("factsheet", type=Path, help="a factsheet message, as a file")
    commands.add_parser("drives", help="list the drives, with a JSON schema and an example each")
    commands.add_parser("settings", help="list the settings: environment variable, value, default, meaning")
    return parser


def plan_file(asked: argparse.Namespace, settings: Settings) -> None:
    """Plans one request in this process."""
    from api.formats import find_format, refuse_drive
    from api.planning import plan_document

    wanted = find_format(asked.format)
    request = read_json(asked.request.read_bytes())
    _compile_kernels()
    with _problem(request, asked.map, settings) as problem:
        if not wanted.suits(problem.robot.drive.kind):
            raise refuse_drive(wanted, problem.robot.drive.kind)
        plan = plan_document(problem, _best_so_far(problem))
        if wanted.name == "json":
            _write({**plan, "request": request}, asked.output)
        elif asked.output is None:
            sys.stdout.buffer.write(wanted.write(plan, problem))
        else:
            asked.output.write_bytes(wanted.write(plan, problem))
        if asked.picture is not None:
            _draw(plan, problem, asked.picture)


def draw_file(asked: argparse.Namespace, settings: Settings) -> None:
    """Draws a plan that a file holds, in the world of the request that it answers."""
    from api.answers import PlanAnswer
    from api.validation import validated

    plan = read_json(asked.plan.read_bytes())
    validated(PlanAnswer, plan)
    request = plan.get("request") if asked.request is None else read_json(asked.request.read_bytes())
    if request is None:
        raise OSError(f"{asked.plan} does not hold its request; name it with --request")
    with _problem(request, asked.map, settings) as problem:
        if list(plan["schedule"]["wheels"]) != list(problem.robot.drive.wheel_names):
            raise OSError(f"{asked.plan} is the plan of another robot than the request's")
        _draw(plan, problem, asked.output)


def robot_file(asked: argparse.Namespace, settings: Settings) -> None:
    """Writes the robot that a factsheet describes to standard output."""
    from api.factsheet import Factsheet, robot_of
    from api.validation import validated

    _write(robot_of(validated(Factsheet, read_json(asked.factsheet.read_bytes()))), None)


def _status(work: Callable[[], None]) -> int:
    """Does the work; 1 and the problem on standard error where it is refused, 2 where a file is at fault."""
    from api.errors import Refusal, problem_document
    from planner.errors import PlanningError

    try:
        work()
    except MalformedJson as error:
        return _refuse(problem_document(Refusal("malformed-json", str(error))))
    except (Refusal, PlanningError) as error:
        return _refuse(problem_document(error))
    except OSError as error:
        print(f"wheelplan: {error}", file=sys.stderr)
        return 2
    return 0


@contextmanager
def _problem(request: Any, map_yaml: Path | None, settings: Settings) -> Iterator[Problem]:
    """The problem that a request states, its map from this yaml or from the store of the service."""
    from api.convert import to_problem
    from api.maps import MapStore
    from api.occupancy import read_map
    from api.schemas import PlanRequest
    from api.validation import validated

    with tempfile.TemporaryDirectory(prefix="wheelplan-") as scratch:
        maps = MapStore(settings.data_dir / "maps", settings.max_maps)
        if map_yaml is not None:
            maps = MapStore(Path(scratch), 1)
            map_id = maps.add(read_map(map_yaml, settings.max_map_cells))[0]["id"]
            with suppress(AttributeError):  # what is no object, validation names below
                request.setdefault("environment", {}).setdefault("map", {})["id"] = map_id
        asked = validated(PlanRequest, request)
        yield to_problem(asked, maps.layer, settings.max_time_budget, settings.max_samples)


def _draw(plan: Any, problem: Problem, to: Path) -> None:
    from api.formats import FORMATS

    if to.suffix not in (".svg", ".png"):
        raise OSError(f"{to} is neither an .svg nor a .png")
    to.write_bytes(FORMATS[to.suffix[1:]].write(plan, problem))


def _compile_kernels() -> None:
    """Compiles the kernels at the first start on this machine, and says so on standard error."""
    from planner.kernels import make_ready

    began: float | None = None

    def progress(done: int, total: int) -> None:
        nonlocal began
        if began is None:
            began = time.perf_counter()
            print("compiling kernels, once per machine: ", end="", file=sys.stderr, flush=True)

    make_ready(progress)
    if began is not None:
        print(f"{time.perf_counter() - began:.0f} s", file=sys.stderr)


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
