"""One request planned in this process as a worker of the service does it, and its answer checked."""

from __future__ import annotations

import copy
import functools
import tempfile
import time
import traceback
import types
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from api.convert import to_problem
from api.errors import FieldErrors, Refusal
from api.maps import MapStore
from api.occupancy import decode_map
from api.planning import plan_document
from api.schemas import PlanRequest
from api.validation import validated
from benchmarks.fuzz.check import Fault, check
from benchmarks.fuzz.law import LAWS
from benchmarks.fuzz.request import Case, draw_case
from benchmarks.fuzz.world import solid_cells
from planner import optimal_control, stopwatch
from planner.errors import AuditFailed, PlanningError
from planner.plan import plan

__all__ = ["Outcome", "Trial", "run", "try_case", "use_processor_time"]

_MOST_CELLS = 1 << 24
_MOST_BUDGET = 60.0
_LATE = 0.5
"""By how much (s) planning may exceed the time budget."""
_SHARE = 0.06
"""Share of the requests that each law is tried on."""
_EFFORTS = ("first", "good", "best")
_EFFORT_BUDGET = 1.5


@dataclass(frozen=True)
class Outcome:
    """Of one request. status: "planned", the code of a refusal, "invalid", or "5xx". duration s; seconds: of
    processor time of planning; refused: motions that failed certification on the way; error: what a 5xx or a
    refusal says."""

    status: str
    duration: float = float("nan")
    seconds: float = 0.0
    faults: tuple[Fault, ...] = ()
    refused: int = 0
    error: str = ""


@dataclass(frozen=True)
class Trial:
    """Of one seed. laws: by name, the share by which the changed request's duration passes what the law
    allows (0: it holds), or a word for what went wrong."""

    seed: int
    drive: str
    scene: str
    effort: str
    known: float
    outcome: Outcome
    laws: dict[str, float | str] = field(default_factory=dict)
    others: tuple[tuple[str, Outcome], ...] = ()


def run(seed: int, laws: bool = True) -> Trial:
    """Draws the case of a seed, plans it, and tries some laws on it."""
    case = draw_case(seed)
    outcome = try_case(case)
    effort = case.request["options"]["effort"]
    trial = Trial(seed, case.drive, case.scene, effort, case.known, outcome)
    if not laws or outcome.status == "invalid" or effort == "best":
        return trial
    rng = np.random.default_rng([seed, 1])
    held: dict[str, float | str] = {}
    others = []
    for name, law in LAWS.items():
        changed = law(case, rng) if rng.random() < _SHARE else None
        if changed is None:
            continue
        other = try_case(changed.case)
        others.append((name, other))
        held[name] = _compared(outcome, other, changed.times, changed.slack, changed.below)
    if rng.random() < _SHARE:
        efforts = [try_case(_with_effort(case, effort)) for effort in _EFFORTS]
        others += [(f"effort {name}", each) for name, each in zip(_EFFORTS, efforts, strict=True)]
        pairs = [_compared(efforts[i], efforts[i + 1], 1.0, 1e-6, True) for i in range(2)]
        held["efforts"] = next((p for p in pairs if isinstance(p, str)), max(pairs, key=lambda p: float(p)))
    return replace(trial, laws=held, others=tuple(others))


def _compared(first: Outcome, other: Outcome, times: float, slack: float, below: bool) -> float | str:
    if first.status != "planned" or other.status != "planned":
        same = (first.status == "planned") == (other.status == "planned")
        return 0.0 if same or (below and other.status == "planned") else f"{first.status} / {other.status}"
    expected = first.duration * times
    more = (other.duration - expected) / max(expected, 1e-3)
    passed = more if below else abs(more)
    return max(0.0, passed) if passed > slack else 0.0


def _with_effort(case: Case, effort: str) -> Case:
    request = copy.deepcopy(case.request)
    request["options"] |= {"effort": effort}
    if effort == "best":
        request["options"]["time_budget"] = _EFFORT_BUDGET
    return replace(case, request=request)


def use_processor_time() -> None:
    """Lets time budgets count the processor time of this process, so that others on the machine do not."""
    clock = types.SimpleNamespace(perf_counter=time.process_time)
    setattr(stopwatch, "time", clock)  # noqa: B010
    setattr(optimal_control, "perf_counter", time.process_time)  # noqa: B010


@functools.cache
def _store() -> tuple[tempfile.TemporaryDirectory[str], MapStore]:
    """Where maps are stored, until the process ends."""
    folder = tempfile.TemporaryDirectory(prefix="fuzz-maps-")
    return folder, MapStore(Path(folder.name), 1_000_000)


def try_case(case: Case) -> Outcome:
    """Validates, converts, plans and checks one request."""
    request, solid, maps = case.request, None, _store()[1]
    if case.map is not None:
        decoded = decode_map(case.map.description, case.map.image, _MOST_CELLS)
        request = copy.deepcopy(request)
        request["environment"]["map"]["id"] = maps.add(decoded)[0]["id"]
        unknown = request["environment"]["map"]["unknown"]
        solid = solid_cells(decoded.cells, decoded.resolution, decoded.origin, unknown)
    began = time.process_time()
    try:
        problem = to_problem(validated(PlanRequest, request), maps.layer, _MOST_BUDGET)
        made = plan(problem)
        seconds = time.process_time() - began
        document = plan_document(problem, made)
    except (FieldErrors, Refusal) as error:
        return Outcome("invalid", error=f"{error!r} {getattr(error, 'errors', '')}"[:500])
    except AuditFailed as error:
        return Outcome("5xx", seconds=time.process_time() - began, error=f"audit-failed: {error.message}")
    except PlanningError as error:
        return Outcome(error.code, seconds=time.process_time() - began, error=error.message)
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        at = f"{Path(last.filename).name}:{last.lineno}"
        return Outcome(
            "5xx", seconds=time.process_time() - began, error=f"{type(error).__name__}: {error} ({at})"
        )
    faults = check(request, document, solid)
    budget = request["options"].get("time_budget", 1.0)
    if seconds > budget + _LATE:
        faults.append(Fault("late", f"planning took {seconds:.2f} s of {budget:.2f} s"))
    refused = made.planning.get("refused", 0)
    return Outcome("planned", made.duration, seconds, tuple(faults), int(refused))
