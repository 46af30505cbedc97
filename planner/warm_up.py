"""Compiles and loads all kernels, by planning small problems."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from itertools import chain
from signal import SIG_IGN, SIGINT, signal
from threading import Thread
from typing import Literal

import numpy as np

from drives import Ackermann, Differential, Mecanum, PoweredCaster
from drives.drive import Drive, Limits
from drives.se2 import Pose
from drives.wheel import Module
from planner.errors import NoPathExists
from planner.kernels import assume_ready, make_ready
from planner.plan import plan
from planner.problem import Bounds, Circle, Environment, Footprint, Goal, Options, Polygon, Problem, Robot

__all__ = ["compile_share", "warm_up"]

_CASTERS = Module("left", 0.0, 0.2), Module("right", 0.0, -0.2)
_DRIVES: tuple[tuple[Drive, float], ...] = (
    (Mecanum(0.05, 0.3, 0.4), np.inf),
    (Differential(0.05, 0.3), np.inf),
    (Ackermann(0.05, 0.4, 0.3), 0.7),
    (PoweredCaster(0.05, 0.04, _CASTERS), np.inf),
)
"""A drive of each kind of motion, and how far it steers, rad."""


def warm_up() -> None:
    """Compiles all kernels that the cache lacks, and loads all of them into this process."""
    make_ready()
    for problem in _problems():
        _plan(problem)


def compile_share(share: int, of: int) -> None:
    """Compiles the kernels of every `of`-th problem, from `share` on, in a process of make_ready's."""
    signal(SIGINT, SIG_IGN)  # the parent tells us when to end
    Thread(target=_end_with_parent, daemon=True).start()
    assume_ready()
    for problem in _problems()[share::of]:
        _plan(problem)


def _end_with_parent() -> None:
    sys.stdin.read()
    os._exit(1)


def _plan(problem: Problem) -> None:
    with suppress(NoPathExists):
        plan(problem)


def _problems() -> list[Problem]:
    """Problems that together use all kernels: two walls with a detour, one wall, no way, and an open floor.

    Neighbours in the list begin with different kernels, so that two processes seldom wait for each other.
    """
    firsts = [_problem(*each, "first", _wall(-1.0, -4.0, 2.0), _wall(1.0, -2.0, 4.0)) for each in _DRIVES]
    goods = [_problem(*each, "good", _wall(0.0, -4.0, 1.0)) for each in _DRIVES]
    open_floor = _problem(*_DRIVES[0], "good")
    shut = _problem(*_DRIVES[0], "first", _wall(0.0, -4.0, 4.0))
    return [firsts[0], open_floor, shut, *chain(*zip(goods, firsts[1:], strict=False)), goods[-1]]


def _wall(x: float, y_min: float, y_max: float) -> Polygon:
    return Polygon(np.array([[x - 0.1, y_min], [x + 0.1, y_min], [x + 0.1, y_max], [x - 0.1, y_max]]))


def _problem(drive: Drive, steering: float, effort: Literal["first", "good"], *walls: Polygon) -> Problem:
    m = len(drive.wheel_names)
    limits = Limits(np.full(m, 20.0), np.full(m, 40.0), np.full(m, np.inf), steering, 5.0)
    footprint = Footprint(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]))
    return Problem(
        Robot(drive, footprint, limits),
        Pose(-2.0, 0.0, 0.0),
        Goal(2.0, 0.0, 0.5),
        Environment(Bounds(-4.0, -4.0, 4.0, 4.0), (*walls, Circle(0.0, 1.0, 0.1))),
        Options(time_budget=3600.0, effort=effort),  # a slow machine may need it
        np.zeros(len(drive.steered_names)),
    )
