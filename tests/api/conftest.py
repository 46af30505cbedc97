"""An application whose planner is a fake and whose worker is a thread, for everything that HTTP decides."""

from __future__ import annotations

import asyncio
import copy
from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

import planner.plan
from api.app import create_app
from api.settings import Settings
from api.workers import Pool
from planner.plan import Plan
from planner.problem import Problem
from planner.schedule import WheelSchedule
from planner.verify import Certificate


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("filterwarnings", "ignore:Using `httpx` with")


BODY: dict[str, Any] = {
    "robot": {
        "drive": {"type": "differential", "wheel_radius": 0.1, "track_width": 0.5},
        "footprint": {"type": "rectangle", "length": 0.8, "width": 0.6},
        "limits": {"wheel_speed": 15.0, "wheel_acceleration": 15},
    },
    "start": {"x": -3.0, "y": 0.0, "theta": 0.0},
    "goal": {"x": 3.0, "y": 0.0, "theta": None},
    "environment": {"bounds": {"x_min": -5, "y_min": -5, "x_max": 5, "y_max": 5}, "obstacles": []},
    "options": {"time_budget": 2.0, "seed": 7},
}


class InlinePool(Pool):
    """Runs every job in a thread of this process."""

    def __init__(self, size: int = 1) -> None:
        super().__init__(size, 1)
        self._started = True
        self.busy = 0

    @property
    def spare(self) -> int:
        return self.size - self.busy

    def start(self) -> None:
        pass

    async def apart(self, function: Callable[..., Any], *args: Any) -> Any:
        return await asyncio.to_thread(function, *args)

    async def run(self, function: Callable[..., Any], *args: Any, **how: Any) -> Any:
        loop, progress = asyncio.get_running_loop(), how.get("progress")
        self.busy += 1
        try:
            with patch("api.planning.report", lambda value: loop.call_soon_threadsafe(progress, value)):
                return await asyncio.to_thread(function, *args)
        finally:
            self.busy -= 1


class FakePlanner:
    """Stands for planner.plan.plan: keeps the problem it got, and answers or raises what a test wants."""

    def __init__(self) -> None:
        self.problem: Problem | None = None
        self.raises: BaseException | None = None
        self.duration = 0.04
        self.meanwhile: Callable[[Problem], None] = lambda _: None
        self.before: list[float] = []
        """Durations of the plans that it tells of on the way."""

    def __call__(self, problem: Problem, improved: Callable[[Plan], None] | None = None) -> Plan:
        self.problem = problem
        for duration in self.before:
            assert improved is not None
            improved(self.made(duration))
        self.meanwhile(problem)
        if self.raises is not None:
            raise self.raises
        return self.made(self.duration)

    def made(self, duration: float) -> Plan:
        assert self.problem is not None
        problem = self.problem
        m, k = len(problem.robot.drive.wheel_names), len(problem.robot.drive.steered_names)
        columns = [np.arange(3.0 * n).reshape(3, n) + n / 10 for n in (m, m, m, k, k, 3, 3)]
        schedule = WheelSchedule(np.array([0.0, 0.02, 0.04]), *columns)
        certificate = Certificate(**{field.name: 0.0 for field in fields(Certificate)})
        about = {"planner": "fake", "seed": problem.options.seed, "refused": 0}
        return Plan(duration, 0.1, schedule, certificate, about)


@pytest.fixture
def planner_() -> Iterator[FakePlanner]:
    real, fake = planner.plan.plan, FakePlanner()
    planner.plan.plan = fake
    yield fake
    planner.plan.plan = real


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return Settings(
        data_dir=tmp_path, max_body_bytes=200_000, max_map_bytes=100_000, max_map_cells=10_000, max_maps=3
    )


@pytest.fixture
def inline_app(settings: Settings, planner_: FakePlanner) -> Callable[..., Any]:
    """A client of an application with other settings, and `size` workers."""
    from starlette.testclient import TestClient

    def made(size: int = 1, **changes: Any) -> TestClient:
        app = create_app(replace(settings, **changes), InlinePool(size))
        return TestClient(app, raise_server_exceptions=False)

    return made


@pytest.fixture
def client(settings: Settings, planner_: FakePlanner) -> Iterator[Any]:
    from starlette.testclient import TestClient

    with TestClient(create_app(settings, InlinePool()), raise_server_exceptions=False) as client:
        yield client


@pytest.fixture
def body() -> dict[str, Any]:
    """A request that is right, to be spoilt."""
    return copy.deepcopy(BODY)
