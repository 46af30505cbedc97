"""Every example request is one that the service takes, and answers with a plan."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from api.convert import to_problem
from api.maps import MapStore, decode_map
from api.planning import make_plan, plan_document
from api.schemas import PlanRequest
from api.strict_json import read_json
from api.validation import validated
from drives import DRIVES
from planner.problem import Problem

EXAMPLES = Path(__file__).parents[2] / "examples"
INLINE = sorted(EXAMPLES.glob("*.json"))
MAPPED = sorted((EXAMPLES / "warehouse").glob("*.json"))
REQUESTS = [
    pytest.param(file, id=str(file.relative_to(EXAMPLES).with_suffix(""))) for file in INLINE + MAPPED
]


def problem(file: Path, store: MapStore) -> Problem:
    request = read_json(file.read_bytes())
    if "map" in request["environment"]:
        kept = EXAMPLES / "warehouse" / "warehouse.yaml"
        decoded = decode_map(kept.read_bytes(), kept.with_suffix(".pgm").read_bytes(), 10**6)
        request["environment"]["map"]["id"] = store.add(decoded)[0]["id"]
    return to_problem(validated(PlanRequest, request), store.layer, 30.0)


def drive_of(file: Path) -> Any:
    return json.loads(file.read_text())["robot"]["drive"]["type"]


def test_there_is_one_for_each_drive() -> None:
    assert {file.stem: drive_of(file) for file in INLINE} == {kind: kind for kind in DRIVES}


def test_those_at_hand_need_no_map() -> None:
    for file in INLINE:
        assert "map" not in json.loads(file.read_text())["environment"], file.name


def test_those_in_the_warehouse_lack_only_the_id() -> None:
    assert {file.stem: drive_of(file) for file in MAPPED} == {
        k: k for k in ("ackermann", "differential", "mecanum")
    }
    for file in MAPPED:
        assert json.loads(file.read_text())["environment"] == {"map": {"unknown": "occupied"}}


@pytest.mark.parametrize("file", REQUESTS)
def test_is_planned(file: Path, tmp_path: Path) -> None:
    asked = problem(file, MapStore(tmp_path, 1))
    plan = plan_document(asked, make_plan(asked))
    assert plan["duration"] > 0
    for name in ("x", "y"):
        assert plan["trajectory"][name][-1] == pytest.approx(getattr(asked.goal, name), abs=1e-3)
    ratios = {name: ratio for name, ratio in plan["certificate"].items() if name.endswith("_ratio")}
    assert max(ratios.values()) <= 1.001, ratios
