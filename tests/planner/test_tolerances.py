"""docs/certificate.md lists every tolerance of the certificate with its value."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from planner import tolerances

PAGE = (Path(__file__).parents[2] / "docs" / "certificate.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.split("|")[1:3]] for line in PAGE.splitlines() if line.startswith("| ")
]
LISTED = dict(ROWS)


@pytest.mark.parametrize("key", [key for key, (_, _, slack) in tolerances.QUANTITIES.items() if slack > 0])
def test_the_page_lists_by_how_much_a_limit_may_be_exceeded(key: str) -> None:
    what, _, slack = tolerances.QUANTITIES[key]
    assert float(LISTED[what].removesuffix(" %")) / 100 == pytest.approx(slack)


def test_the_page_lists_every_other_tolerance() -> None:
    found = {}
    for names, values in ROWS:
        numbers = [float(each) for each in re.findall(r"\d[\d.]*(?:e-?\d+)?", values)]
        constants = re.findall(r"`(\w+)`", names)
        found |= dict(zip(constants, numbers if len(constants) > 1 else [numbers], strict=len(constants) > 1))
    for name in set(tolerances.__all__) - {"QUANTITIES"}:
        value = getattr(tolerances, name)
        listed = found[name]
        assert listed == (list(value) if isinstance(value, tuple) else value) or listed == [value], name
