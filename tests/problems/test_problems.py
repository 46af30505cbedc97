"""One row a bug ever found: each is a request as a client posts it, and what must come of it.

A row has a `name`, `wrong` (what went wrong, or would), the `request`, and what to `expect`: `plan`, or the
code of the error; `at_most` (s), if it is given, bounds the plan's duration.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
import yaml

from api.convert import to_problem
from api.errors import CODES, FieldErrors
from api.schemas import PlanRequest
from api.validation import validated
from drives.se2 import wrap
from planner.errors import PlanningError
from planner.plan import plan

FILES = sorted(Path(__file__).parent.glob("*.yaml"))
ROWS: list[dict[str, Any]] = [
    row for file in FILES for row in yaml.safe_load(file.read_text("utf-8"))["rows"]
]


def no_map(_: str) -> NoReturn:
    raise LookupError("rows have no maps")


def test_rows_are_well_formed() -> None:
    assert len(ROWS) >= 10
    assert len({row["name"] for row in ROWS}) == len(ROWS)
    for row in ROWS:
        assert row.keys() - {"at_most"} == {"name", "wrong", "request", "expect"}, row["name"]
        assert row["expect"] == "plan" or row["expect"] in CODES, row["name"]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: str(row["name"]).replace(" ", "-"))
def test_row(row: dict[str, Any]) -> None:
    if row["expect"] != "plan":
        with pytest.raises((PlanningError, FieldErrors)) as caught:
            plan(to_problem(validated(PlanRequest, row["request"]), no_map, 60.0))
        assert caught.value.code == row["expect"], row["wrong"]
        return
    problem = to_problem(validated(PlanRequest, row["request"]), no_map, 60.0)
    made = plan(problem)
    at_once = plan(replace(problem, options=replace(problem.options, effort="first")))
    assert made.duration <= at_once.duration * (1 + 1e-6), row["wrong"]
    assert made.duration <= row.get("at_most", np.inf), row["wrong"]
    assert made.planning.get("refused", 0) == 0, row["wrong"]
    found, goal, pose = asdict(made.certificate), problem.goal, made.schedule.pose
    assert all(value <= 1.0005 for name, value in found.items() if name.endswith("_ratio")), row["wrong"]
    assert found["slip"] < 8e-4
    assert found["clearance"] >= problem.options.min_clearance - 1e-4
    assert pose[0].tolist() == list(problem.start)
    assert np.hypot(pose[-1, 0] - goal.x, pose[-1, 1] - goal.y) < 1e-5
    if goal.theta is not None:
        assert abs(wrap(float(pose[-1, 2]) - goal.theta)) < 1e-5
    if problem.steering is not None:
        assert made.schedule.steering_angle[0].tolist() == problem.steering.tolist()
