"""What operators and monitoring ask."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from api import fields, schemas
from api.answers import HealthAnswer, LimitsAnswer
from api.batch_schemas import MAX_REQUESTS
from api.errors import Refusal
from api.http import json_response, problems, settings_of
from api.scheduler import Scheduler

__all__ = ["router"]

router = APIRouter(tags=["operations"])


@router.get("/livez", summary="Is the process alive?", response_model=HealthAnswer, responses=problems())
async def livez() -> Response:
    """Always ok while the event loop runs."""
    return json_response({"status": "ok"})


@router.get("/readyz", summary="Can it plan?", response_model=HealthAnswer, responses=problems("draining"))
async def readyz(request: Request) -> Response:
    """Ready while workers are up, do not die one after the other, and no shutdown has begun."""
    pool: Scheduler[Any] = request.app.state.pool
    if trouble := pool.trouble:
        raise Refusal("draining", trouble, retry_after=5 if pool.ready else 1)
    return json_response({"status": "ready", "workers": pool.live})


@router.get(
    "/metrics",
    summary="Prometheus metrics",
    response_class=Response,
    responses={200: {"content": {"text/plain": {"schema": {"type": "string"}}}}},
)
async def metrics(request: Request) -> Response:
    """Requests by route and status, planning times by drive, queue and workers."""
    return Response(generate_latest(request.app.state.metrics.registry), media_type=CONTENT_TYPE_LATEST)


@router.get("/v1/limits", summary="Bounds of this server", response_model=LimitsAnswer, responses=problems())
async def limits(request: Request) -> Response:
    """Every bound that a request has to keep to."""
    settings = settings_of(request)
    own = (
        "max_time_budget", "max_samples", "deadline_grace", "max_body_bytes", "max_map_bytes",
        "max_map_cells", "max_maps", "max_store_bytes", "workers", "queue_length", "queue_wait",
        "queue_timeout", "receive_timeout", "max_batches", "max_batch_bytes", "batch_keep",
        "batch_store_bytes", "max_connections", "max_upload_bytes", "max_pending_bytes",
    )  # fmt: skip
    return json_response(
        {name: getattr(settings, name) for name in own}
        | {
            "max_obstacles": schemas.MAX_OBSTACLES,
            "max_vertices": schemas.MAX_VERTICES,
            "max_wheels": schemas.MAX_WHEELS,
            "max_batch_requests": MAX_REQUESTS,
            "max_coordinate": fields.LARGEST_COORDINATE,
            "max_length": fields.LARGEST_LENGTH,
            "max_rate": fields.LARGEST_RATE,
            "min_length": fields.SMALLEST_LENGTH,
            "min_rate": fields.SMALLEST_RATE,
            "sample_period": schemas.SAMPLE_PERIODS,
        }
    )
