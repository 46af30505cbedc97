"""Example requests have the time budgets of a service that is warm."""

from __future__ import annotations

import pytest

from planner.warm_up import warm_up


@pytest.fixture(scope="package", autouse=True)
def _warm() -> None:
    warm_up()
