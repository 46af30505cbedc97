"""What the README shows is there, and is answered."""

from __future__ import annotations

import re
from pathlib import Path

from api.convert import to_problem
from api.maps import MapStore
from api.planning import make_plan, plan_document
from api.schemas import PlanRequest
from api.strict_json import read_json
from api.validation import validated

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def test_the_curl_is_answered_with_what_is_printed(tmp_path: Path) -> None:
    curl = re.search(r"curl .*?/v1/plans -d '(.*?)'", README, re.DOTALL)
    assert curl, "the README shows no curl"
    request = validated(PlanRequest, read_json(curl.group(1).encode()))
    problem = to_problem(request, MapStore(tmp_path, 1).layer, 30.0)
    plan = plan_document(problem, make_plan(problem))

    answer = README[curl.end() :].partition("With `?format=csv`")[0]
    given = set(plan).union(*(plan[part] for part in ("schedule", "trajectory", "certificate", "planning")))
    inner = {"left", "right", "angle", "velocity", "acceleration", "total"}
    shown = set(re.findall(r'"(\w+)":', answer))
    assert {"duration", "length", "certificate"} <= shown <= given | inner


def test_every_file_that_it_links_to_is_there() -> None:
    top = Path(__file__).parents[2]
    links = re.findall(r"\]\(([^)#]+)\)", README)
    assert links
    for link in links:
        assert (top / link).exists(), link
