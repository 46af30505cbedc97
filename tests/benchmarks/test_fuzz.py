"""The short part of the fuzz: small requests of every drive at effort first, and the fuzz's own promises."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.fuzz.check import check
from benchmarks.fuzz.law import LAWS
from benchmarks.fuzz.report import missed_targets
from benchmarks.fuzz.request import draw_case
from benchmarks.fuzz.robot import DRIVES
from benchmarks.fuzz.trial import Outcome, Trial, try_case
from benchmarks.fuzz.world import World
from drives import DRIVES as KINDS
from tests.benchmarks.schedules import answer_of

SEEDS = range(44)
CAREFUL = ("mirror", "translate", "walls", "far obstacle")


def test_every_drive_is_fuzzed() -> None:
    assert sorted(DRIVES) == sorted(KINDS)
    assert {draw_case(seed).drive for seed in range(len(DRIVES))} == set(DRIVES)


def test_the_same_seed_gives_the_same_request() -> None:
    assert draw_case(17).request == draw_case(17).request


@pytest.mark.parametrize("seed", SEEDS)
def test_a_random_request_is_planned_and_its_answer_passes_the_check(seed: int) -> None:
    outcome = try_case(draw_case(seed, quick=True))
    assert (outcome.status, outcome.faults) == ("planned", ()), outcome.error


@pytest.mark.parametrize("seed", range(len(DRIVES)))
def test_a_changed_request_takes_as_long(seed: int) -> None:
    case = draw_case(seed, "open", quick=True)
    case.request["options"]["effort"] = "good"
    first, rng = try_case(case), np.random.default_rng(seed)
    for name in CAREFUL:
        changed = LAWS[name](case, rng)
        if changed is not None:
            other = try_case(changed.case)
            assert other.duration == pytest.approx(first.duration * changed.times, rel=changed.slack), name


@pytest.mark.parametrize("seed", [seed for seed in range(55) if draw_case(seed).drive != "powered_caster"])
def test_the_known_motion_solves_its_request_in_the_known_time(seed: int) -> None:
    case = draw_case(seed)
    if case.map is not None:
        case = draw_case(seed, "clutter")
    answer = answer_of(case)
    assert check(case.request, answer) == []
    assert answer["duration"] <= case.known + 1e-9


def spoil_wheel(answer: dict[str, Any]) -> None:
    column = next(iter(answer["schedule"]["wheels"].values()))
    column["angle"], column["velocity"] = 1.01 * column["angle"], 1.01 * column["velocity"]


def jump(answer: dict[str, Any]) -> None:
    column = next(iter(answer["schedule"]["wheels"].values()))
    column["velocity"] = column["velocity"].copy()
    column["velocity"][len(column["velocity"]) // 2] *= 1.2


def shorten(answer: dict[str, Any]) -> None:
    answer["schedule"]["time"] = 0.9 * answer["schedule"]["time"]


def state_too_much(answer: dict[str, Any]) -> None:
    answer["certificate"] = {"clearance": 1e3, "wheel_speed_ratio": 1.001}


@pytest.mark.parametrize(
    ("spoil", "seen"),
    [
        (spoil_wheel, {"closure", "drift"}),
        (jump, {"wheel acceleration"}),
        (shorten, {"grid"}),
        (state_too_much, {"certificate wheel_speed_ratio"}),
    ],
)
def test_a_spoiled_answer_is_seen(spoil: Callable[[dict[str, Any]], None], seen: set[str]) -> None:
    case = draw_case(DRIVES.index("differential"), "tube")
    answer = answer_of(case)
    assert check(case.request, answer) == []
    spoil(answer)
    assert seen <= {fault.what for fault in check(case.request, answer)}


def test_a_stated_clearance_that_is_too_large_is_seen() -> None:
    case = draw_case(DRIVES.index("mecanum"), "tube")
    request, answer = case.request, answer_of(case)
    path = np.stack([answer["trajectory"][key] for key in ("x", "y", "theta")], 1)
    found = World(request).clearance(path, 0.0)
    for stated, faults in ((found, set()), (found + 1e-3, {"certificate clearance"})):
        answer["certificate"]["clearance"] = stated
        assert {fault.what for fault in check(request, answer)} == faults


def test_a_body_in_the_way_is_seen() -> None:
    case = draw_case(DRIVES.index("mecanum"), "open")
    request, answer = copy.deepcopy(case.request), answer_of(case)
    x, y, _ = case.motion.goal
    request["environment"]["obstacles"] = [{"type": "circle", "center": [x, y], "radius": 1e-3}]
    assert {fault.what for fault in check(request, answer)} >= {"clearance"}


@pytest.mark.parametrize(
    ("limit", "by", "seen"),
    [
        ("wheel_speed", 0.5, "wheel speed"),
        ("wheel_acceleration", 0.5, "wheel acceleration"),
        ("steering_rate", 0.1, "steering rate"),
    ],
)
def test_a_limit_that_is_passed_is_seen(limit: str, by: float, seen: str) -> None:
    case = draw_case(DRIVES.index("tricycle"), "open", quick=True)
    case.request["start"]["steering"] = {"front": 0.3}
    request, answer = copy.deepcopy(case.request), answer_of(case)
    value = request["robot"]["limits"][limit]
    request["robot"]["limits"][limit] = (
        {name: each * by for name, each in value.items()} if isinstance(value, dict) else value * by
    )
    assert seen in {fault.what for fault in check(request, answer)}


def test_an_internal_error_and_a_missed_solution_miss_the_targets() -> None:
    case = draw_case(0)

    def trial(outcome: Outcome) -> Trial:
        return Trial(0, case.drive, case.scene, "good", 1.0, outcome)

    assert missed_targets([trial(Outcome("planned", 1.0))]) == []
    for bad in (
        Outcome("5xx"),
        Outcome("no-path-found"),
        Outcome("planned", 1.2),
        Outcome("planned", 1.0, refused=1),
    ):
        assert len(missed_targets([trial(bad)])) == 1
