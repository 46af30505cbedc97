"""A client of a running service.

    with Client("http://127.0.0.1:8000") as wheelplan:
        plan = wheelplan.plan(request)
        print(plan.duration, plan.schedule.wheels["left"].velocity)

Requests are what the contract says, as plain dicts; answers are the models that the OpenAPI document is made
from. It needs nothing of the planner.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx
from httpx_sse import EventSource

from api.answers import (
    DriveAnswer,
    DrivesAnswer,
    ForwardAnswer,
    InverseAnswer,
    LimitsAnswer,
    MapAnswer,
    MapsAnswer,
    PlanAnswer,
)

__all__ = ["BatchResult", "Client", "Improvement", "Problem"]

Json = Mapping[str, Any]


class Problem(Exception):
    """The service's refusal (RFC 9457). document is the whole problem document; other details, such as
    `pose` or `proof`, are in it."""

    def __init__(self, document: dict[str, Any]) -> None:
        super().__init__(f"{document.get('code')}: {document.get('detail')}")
        self.document = document

    @property
    def code(self) -> str:
        """Stable name of the kind of problem."""
        return str(self.document.get("code", "unknown"))

    @property
    def status(self) -> int:
        """HTTP status."""
        return int(self.document.get("status", 0))

    @property
    def detail(self) -> str:
        """What went wrong, as a sentence."""
        return str(self.document.get("detail", ""))

    @property
    def pointers(self) -> list[str]:
        """JSON pointers to the fields at fault."""
        return [error["pointer"] for error in self.document.get("errors", []) if "pointer" in error]

    @property
    def retry_after(self) -> float | None:
        """Seconds after which to try again, where that may help."""
        wait = self.document.get("retry_after")
        return None if wait is None else float(wait)


@dataclass(frozen=True, slots=True)
class Improvement:
    """A plan on the way to the best; elapsed s of planning; final: the last."""

    plan: PlanAnswer
    elapsed: float
    final: bool


@dataclass(frozen=True, slots=True)
class BatchResult:
    """What became of one request of a batch: its place in it, its name, and a plan or a problem."""

    index: int
    name: str | None
    plan: PlanAnswer | None
    problem: Problem | None


class Client:
    """Talks to the service at url. Every method raises Problem where the service refuses, and
    httpx.TransportError where it cannot be reached.

    timeout: s without a byte from the service; a plan takes its time_budget, and its place in the queue.
    """

    def __init__(
        self, url: str = "http://127.0.0.1:8000", *, token: str | None = None, timeout: float = 60.0
    ) -> None:
        headers = {} if token is None else {"Authorization": f"Bearer {token}"}
        # Proxies that the environment names are not for loopback.
        direct = {"all://127.0.0.1": None, "all://localhost": None}
        self._http = httpx.Client(base_url=url, headers=headers, timeout=timeout, mounts=direct)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: Any, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        self._http.close()

    def plan(self, request: Json) -> PlanAnswer:
        """A certified plan."""
        return PlanAnswer.model_validate_json(self._call("POST", "/v1/plans", json=request).content)

    def plan_as(self, request: Json, format: str) -> bytes:
        """A plan in another form: csv, svg, png, msgpack, ros-trajectory, vda5050-3.0, wpilib, …"""
        return self._call("POST", "/v1/plans", json=request, params={"format": format}).content

    def plan_stream(self, request: Json) -> Iterator[Improvement]:
        """Each better plan as it is found, with effort "best"; leaving early stops the work."""
        with self._stream(
            "POST", "/v1/plans", json=request, headers={"Accept": "text/event-stream"}
        ) as answer:
            for event in EventSource(answer).iter_sse():
                data = event.json()
                if event.event == "problem":
                    raise Problem(data)
                plan = PlanAnswer.model_validate(data["plan"])
                yield Improvement(plan, data["elapsed"], data["final"])

    def batch(self, requests: Sequence[Json]) -> Iterator[BatchResult]:
        """Plans many; the results in the order in which they are done. Leaving early cancels the batch."""
        made = self._call("POST", "/v1/batches", json={"requests": list(requests)}).json()
        place, finished = f"/v1/batches/{made['id']}", False
        try:
            with self._stream("GET", f"{place}/results", timeout=None) as answer:
                for line in answer.iter_lines():
                    if line:  # an empty one says that the batch still runs
                        yield _result(json.loads(line))
            finished = True
        finally:
            if not finished:
                self._call("DELETE", place)

    def inverse(self, drive: Json, twist: Json, steering: Json | None = None) -> InverseAnswer:
        """The wheel rates and steering angles of a twist of the body."""
        asked = {"drive": drive, "twist": twist, "steering": steering}
        return InverseAnswer.model_validate_json(
            self._call("POST", "/v1/kinematics/inverse", json=_given(asked)).content
        )

    def forward(
        self, drive: Json, wheels: Json, steering: Json | None = None, steering_rates: Json | None = None
    ) -> ForwardAnswer:
        """The twist of wheel rates, and how far they are from agreeing on it."""
        asked = {"drive": drive, "wheels": wheels, "steering": steering, "steering_rates": steering_rates}
        return ForwardAnswer.model_validate_json(
            self._call("POST", "/v1/kinematics/forward", json=_given(asked)).content
        )

    def drives(self) -> list[DriveAnswer]:
        """The catalogue of drives."""
        return DrivesAnswer.model_validate_json(self._call("GET", "/v1/drives").content).drives

    def limits(self) -> LimitsAnswer:
        """The bounds that the service sets."""
        return LimitsAnswer.model_validate_json(self._call("GET", "/v1/limits").content)

    def upload_map(self, yaml: Path, image: Path) -> MapAnswer:
        """Stores a map_server pair; again the same map is the same id."""
        files = {"yaml": yaml.read_bytes(), "image": image.read_bytes()}
        return MapAnswer.model_validate_json(self._call("POST", "/v1/maps", files=files).content)

    def maps(self) -> list[MapAnswer]:
        """The stored maps."""
        return MapsAnswer.model_validate_json(self._call("GET", "/v1/maps").content).maps

    def delete_map(self, id: str) -> None:
        """Deletes a map."""
        self._call("DELETE", f"/v1/maps/{id}")

    def _call(self, method: str, path: str, **how: Any) -> httpx.Response:
        return _checked(self._http.request(method, path, **how))

    @contextmanager
    def _stream(self, method: str, path: str, **how: Any) -> Iterator[httpx.Response]:
        with self._http.stream(method, path, **how) as answer:
            if answer.is_error:
                answer.read()
            yield _checked(answer)


def _checked(answer: httpx.Response) -> httpx.Response:
    if not answer.is_error:
        return answer
    if answer.headers.get("content-type", "").startswith("application/problem+json"):
        raise Problem(answer.json())
    # Something between us and the service has answered.
    detail = f"{answer.request.url} answered {answer.status_code} {answer.reason_phrase}."
    raise Problem({"code": "unknown", "status": answer.status_code, "detail": detail})


def _given(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in fields.items() if value is not None}


def _result(line: dict[str, Any]) -> BatchResult:
    plan, problem = line.get("plan"), line.get("problem")
    return BatchResult(
        line["index"],
        line.get("name"),
        None if plan is None else PlanAnswer.model_validate(plan),
        None if problem is None else Problem(problem),
    )
