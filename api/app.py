"""The application: routes, error documents and the pool of workers behind them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import ExitStack, asynccontextmanager
from importlib.metadata import version
from typing import Any

from fastapi import FastAPI, Request, Response
from fastapi.openapi.utils import get_openapi
from fastapi.routing import APIRoute
from fastapi_offline import FastAPIOffline
from pydantic.json_schema import models_json_schema
from starlette.exceptions import HTTPException

from api import (
    routes_batches,
    routes_drives,
    routes_kinematics,
    routes_maps,
    routes_operations,
    routes_page,
    routes_plans,
    routes_robots,
)
from api.answers import Problem
from api.batch_schemas import BatchItem, BatchLine, BatchRequest
from api.batch_store import BatchStore
from api.batches import Batches
from api.bounds import PROBES, Allowance, Crowd
from api.convert import to_problem
from api.errors import Refusal, problem_response
from api.factsheet import Factsheet
from api.fair_queue import Ticket
from api.maps import MapStore
from api.metrics import Metrics
from api.middleware import Envelope, Gate
from api.planning import answer_plan
from api.scheduler import Scheduler
from api.schemas import ForwardRequest, InverseRequest, PlanRequest
from api.settings import Settings
from api.spool import whole
from api.tokens import OPEN, Guard, Tokens
from api.validation import validated
from api.workers import local_pool
from planner.errors import PlanningError
from planner.problem import Problem as PlanProblem

__all__ = ["create_app", "scheduler_of"]

_ROUTES = (
    routes_plans,
    routes_batches,
    routes_kinematics,
    routes_drives,
    routes_robots,
    routes_maps,
    routes_operations,
    routes_page,
)


def create_app(settings: Settings, pool: Scheduler[Any] | None = None) -> FastAPI:
    """The service as an ASGI application. The pool is started and closed with it."""
    workers = pool or scheduler_of(settings)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        app.state.maps.sweep()
        workers.start()
        app.state.batches.start()
        yield
        await app.state.batches.close()
        await workers.close()

    app = FastAPIOffline(
        title="wheelplan",
        version=version("wheelplan"),
        description="A start, a goal, a robot and a map in; a certified schedule of wheel speeds out.",
        lifespan=lifespan,
        redoc_url=None,
        swagger_ui_parameters={"validatorUrl": None},  # else the page asks a service on the internet
        telemetry={
            "auto_configure": True,  # by the standard's OTEL_… variables; without them, nothing
            "metrics": False,
            "logs": False,
            "operation_spans": False,
            "exclude": lambda scope: scope.get("path") in PROBES,
        },
    )
    app.state.settings = settings
    app.state.pool = workers
    app.state.maps = MapStore(settings.data_dir / "maps", settings.max_maps, settings.max_store_bytes)
    app.state.batches = _batches(app, workers)
    bodies = Allowance(settings.max_pending_bytes, "request bodies")
    app.state.uploads = Allowance(settings.max_upload_bytes, "map uploads")
    app.state.metrics = Metrics(workers, app.state.batches, bodies)
    app.state.decoding = asyncio.Lock()
    for routes in _ROUTES:
        app.include_router(routes.router)
    (plans,) = (route for route in routes_plans.router.routes if isinstance(route, APIRoute))
    app.add_middleware(Gate, route=plans, scheduler=workers, metrics=app.state.metrics)
    if settings.tokens_file is not None:
        app.add_middleware(Guard, tokens=Tokens(settings.tokens_file))
    app.add_middleware(Crowd, max_connections=settings.max_connections)
    app.add_middleware(
        Envelope, metrics=app.state.metrics, receive_timeout=settings.receive_timeout, bodies=bodies
    )
    for refused in (Refusal, PlanningError):
        app.add_exception_handler(refused, _refused)
    app.add_exception_handler(HTTPException, _http_error)
    app.openapi = lambda: _openapi(app, settings)  # type: ignore[method-assign]
    return app


def scheduler_of(settings: Settings) -> Scheduler[Any]:
    """The scheduler that the settings ask for. Raises ValueError."""
    address = settings.scheduler
    if not address:
        return local_pool(settings, settings.workers)
    if "://" not in address:
        raise ValueError(f"WHEELPLAN_SCHEDULER must be an address like tcp://host:8786, not {address!r}")
    try:
        from api.cluster import Cluster  # takes long to import
    except ImportError as error:
        raise ValueError(f"WHEELPLAN_SCHEDULER needs the extra wheelplan[cluster]: {error}") from None
    return Cluster(
        address, settings.queue_length, settings.queue_wait, settings.queue_timeout, settings.worker_memory
    )


def _batches(app: FastAPI, scheduler: Scheduler[Any]) -> Batches:
    settings: Settings = app.state.settings

    def read(request: Any, held: ExitStack) -> PlanProblem:
        asked = validated(BatchItem, request)
        find_map = held.enter_context(app.state.maps.leased())
        return to_problem(asked, find_map, settings.max_time_budget, settings.max_samples)

    async def plan(problem: PlanProblem, ticket: Ticket) -> bytes:
        with app.state.maps.leased() as find_map:
            if problem.environment.map is not None:
                find_map(problem.environment.map.id)
            made = await routes_plans.answered(
                app.state, problem, ticket, answer_plan, "application/json", False
            )
            return whole(made.body)

    store = BatchStore(settings.data_dir / "batches", settings.batch_keep, settings.batch_store_bytes)
    return Batches(scheduler, store, read, routes_plans.ticket_for, plan, settings.max_batches)


async def _refused(_: Request, error: Exception) -> Response:
    assert isinstance(error, Refusal | PlanningError)
    return problem_response(error)


async def _http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    code = {404: "not-found", 405: "method-not-allowed"}.get(error.status_code, "internal-error")
    headers = dict(error.headers or {})
    route = getattr(request.scope.get("route"), "path", None)
    if route in (paths := request.app.openapi()["paths"]):  # the header names one of the path's methods only
        headers["Allow"] = ", ".join(method.upper() for method in sorted(paths[route]))
    detail = {
        "not-found": "There is nothing at this path.",
        "method-not-allowed": f"{request.method[:20]} is not offered here.",
    }.get(code, str(error.detail))
    return problem_response(Refusal(code, detail), headers)


def _openapi(app: FastAPI, settings: Settings) -> dict[str, Any]:
    """FastAPI's document, with the schemas of the bodies that we read ourselves."""
    if app.openapi_schema is None:
        document = get_openapi(
            title=app.title, version=app.version, description=app.description, routes=app.routes
        )
        bodies = [
            (model, "validation")
            for model in (PlanRequest, BatchRequest, InverseRequest, ForwardRequest, Factsheet)
        ]
        answers = [(Problem, "serialization"), (BatchLine, "serialization")]
        template = "#/components/schemas/{model}"
        _, extra = models_json_schema([*bodies, *answers], ref_template=template)  # type: ignore[list-item]
        schemas = document.setdefault("components", {}).setdefault("schemas", {})
        schemas.update(extra["$defs"])
        for operation in (o for methods in document["paths"].values() for o in methods.values()):
            if "application/json" in operation["responses"].get("422", {}).get("content", {}):
                del operation["responses"]["422"]  # FastAPI's own, which cannot happen
        for unused in ("HTTPValidationError", "ValidationError"):
            schemas.pop(unused, None)
        if settings.tokens_file is not None:
            _ask_for_tokens(document)
        budget = schemas["OptionsSchema"]["properties"]["time_budget"]
        budget["maximum"] = settings.max_time_budget
        budget["default"] = min(budget["default"], settings.max_time_budget)
        app.openapi_schema = document
    return app.openapi_schema


def _ask_for_tokens(document: dict[str, Any]) -> None:
    """Tells of the bearer tokens that all routes ask for but the open ones."""
    about = "One of the tokens that the operator of this service gives out."
    scheme = {"type": "http", "scheme": "bearer", "description": about}
    document["components"]["securitySchemes"] = {"token": scheme}
    for path, methods in document["paths"].items():
        for operation in methods.values() if path not in OPEN else ():
            operation["security"] = [{"token": []}]
