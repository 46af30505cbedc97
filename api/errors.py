"""Everything a client can be refused for, as problem documents (RFC 9457). One table: code → status."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from starlette.responses import Response

from api.strict_json import write_json
from planner.errors import PlanningError

__all__ = ["CODES", "PROBLEM_JSON", "FieldErrors", "Refusal", "problem_document", "problem_response"]

PROBLEM_JSON = "application/problem+json"

CODES: dict[str, tuple[int, str]] = {
    "malformed-json": (400, "The body is not JSON"),
    "malformed-http": (400, "The request is not HTTP"),
    "unauthorized": (401, "A token is needed"),
    "not-found": (404, "No such resource"),
    "unknown-map": (404, "No such map"),
    "unknown-batch": (404, "No such batch"),
    "method-not-allowed": (405, "The resource does not offer this method"),
    "not-acceptable": (406, "None of the accepted media types can be produced"),
    "request-timeout": (408, "The request took too long to arrive"),
    "payload-too-large": (413, "The payload is too large"),
    "unsupported-media-type": (415, "The body is not of the media type asked for"),
    "invalid-request": (422, "A field is missing, of the wrong type or out of range"),
    "invalid-geometry": (422, "A footprint, obstacle or drive is degenerate"),
    "inadmissible-twist": (422, "The drive cannot do this twist"),
    "start-in-collision": (422, "The start is in collision"),
    "goal-in-collision": (422, "The goal is in collision"),
    "start-out-of-bounds": (422, "The start is out of bounds"),
    "goal-out-of-bounds": (422, "The goal is out of bounds"),
    "no-path-exists": (422, "No path exists"),
    "no-path-found": (422, "No path was found within the time budget"),
    "limits-infeasible": (422, "No motion meets the limits"),
    "too-many-samples": (422, "The motion takes more samples than a plan may have"),
    "overloaded": (429, "The queue is full"),
    "internal-error": (500, "An unexpected error"),
    "worker-crashed": (500, "The process that planned this request died"),
    "audit-failed": (500, "The plan did not pass its own check"),
    "map-corrupt": (500, "The stored map is damaged"),
    "busy": (503, "The server has too much in hand"),
    "draining": (503, "Shutting down or not ready yet"),
    "deadline-exceeded": (504, "A worker overran its deadline and was stopped"),
    "insufficient-storage": (507, "There is no room to store this"),
    "quota-exceeded": (507, "The store of maps is full"),
}


class Refusal(Exception):
    """A request that the service refuses. `code` is one of CODES; `details` go into the document.

    A detail named `retry_after` (s) is also sent as the Retry-After header.
    """

    def __init__(self, code: str, detail: str, **details: Any) -> None:
        super().__init__(detail)
        self.code = code
        self.detail = detail
        self.details = details

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild, (self.code, self.detail, self.details)


def _rebuild(code: str, detail: str, details: dict[str, Any]) -> Refusal:
    return Refusal(code, detail, **details)


class FieldErrors(Refusal):
    """Fields at fault: dicts of pointer, detail and perhaps value and bound."""

    def __init__(self, errors: Sequence[dict[str, Any]], code: str = "invalid-request") -> None:
        more = f" And {len(errors) - 1} more, see errors." if len(errors) > 1 else ""
        super().__init__(code, f"{errors[0]['detail']}{more}", errors=list(errors[:20]))

    def __reduce__(self) -> tuple[Any, ...]:
        return FieldErrors, (self.details["errors"], self.code)


def problem_document(error: Refusal | PlanningError) -> dict[str, Any]:
    """The problem document of a refusal, ready for JSON."""
    code, detail = error.code, error.detail if isinstance(error, Refusal) else error.message
    if code not in CODES:
        code = "internal-error"
    status, title = CODES[code]
    head = {
        "type": f"urn:wheelplan:problem:{code}",
        "title": title,
        "status": status,
        "detail": detail,
        "code": code,
    }
    return {**head, **error.details, **head}


def problem_response(error: Refusal | PlanningError, headers: Mapping[str, str] | None = None) -> Response:
    """The answer to a request that is refused."""
    document = problem_document(error)
    headers = dict(headers or {})
    if "retry_after" in document:
        headers["Retry-After"] = str(document["retry_after"])
    return Response(write_json(document), document["status"], headers, PROBLEM_JSON)
