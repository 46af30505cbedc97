"""What batches look like in requests and answers, for the OpenAPI document and for the checks."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, SkipValidation

from api.answers import PlanAnswer, Problem
from api.fields import Strict, amount, quantity
from api.schemas import PlanRequest

__all__ = ["MAX_NAME", "MAX_REQUESTS", "BatchAnswer", "BatchItem", "BatchLine", "BatchRequest"]

MAX_REQUESTS = 1000
MAX_NAME = 100


class BatchItem(PlanRequest):
    """A plan request as POST /v1/plans takes it, and what the client calls it."""

    model_config = ConfigDict(json_schema_extra={"examples": []})

    name: str | None = quantity(
        "The client's own name for this item, returned with its result",
        "", None, max_length=MAX_NAME, example="dock-7",
    )  # fmt: skip


class BatchRequest(Strict):
    """Plan requests that are worked on while no single request needs the workers."""

    # Each item is checked when its turn comes: a bad one is one bad result.
    requests: list[SkipValidation[BatchItem]] = quantity(
        "What to plan", "", min_length=1, max_length=MAX_REQUESTS
    )


class BatchAnswer(BaseModel):
    """How far a batch is: total = done + failed + running + waiting + cancelled."""

    id: str = quantity("The batch's id", "", example="799f47ac1eee446eae4d01aa931a8b24")
    total: int = amount("Requests in the batch", "requests", example=40)
    done: int = amount("Requests with a plan", "requests", example=12)
    failed: int = amount("Requests with a problem", "requests", example=1)
    running: int = amount("Requests that a worker is planning", "requests", example=2)
    waiting: int = amount("Requests that wait for a worker with nothing else to do", "requests", example=25)
    cancelled: int = amount("Requests given up because the batch was cancelled", "requests", example=0)
    created: str = quantity("When it was taken, RFC 3339", "", example="2026-01-31T12:00:00.000+00:00")
    finished: str | None = quantity(
        "When it ended; null while it runs", "", example="2026-01-31T12:01:30.000+00:00"
    )
    expires: str | None = quantity(
        "When its results go, at the latest; null while it runs", "", example="2026-02-01T12:01:30.000+00:00"
    )


class BatchLine(BaseModel):
    """One line of the results: either a plan or a problem."""

    index: int = amount("The request's place in the batch, from 0", "requests", example=0)
    name: str | None = quantity("The request's name", "", example="dock-7")
    plan: PlanAnswer | None = quantity("As POST /v1/plans answers; absent where there is a problem", "", None)
    problem: Problem | None = quantity(
        "As POST /v1/plans refuses, JSON pointers relative to the item; absent where there is a plan",
        "",
        None,
    )
