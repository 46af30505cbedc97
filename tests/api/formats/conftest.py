"""Real plans of the examples, made once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from api.convert import to_problem
from api.maps import MapStore
from api.planning import make_plan, plan_document
from api.schemas import PlanRequest
from api.strict_json import read_json
from api.validation import validated
from planner.problem import Problem
from planner.warm_up import warm_up

EXAMPLES = Path(__file__).parents[3] / "examples"
Planned = tuple[dict[str, Any], Problem]


@pytest.fixture(scope="session")
def planned() -> Callable[..., Planned]:
    """planned(drive, effort, **changes): the plan of an example and its problem."""
    warm_up()

    @cache
    def made(drive: str, effort: str = "first", changes: tuple[tuple[str, Any], ...] = ()) -> Planned:
        request = read_json((EXAMPLES / f"{drive}.json").read_bytes())
        request["options"] = {"seed": 1, "time_budget": 20.0, "effort": effort}
        for name, (x, y, theta) in changes:
            request[name] = {"x": x, "y": y, "theta": theta}
        problem = to_problem(validated(PlanRequest, request), MapStore(Path(), 1).layer, 30.0)
        return plan_document(problem, make_plan(problem)), problem

    return made
