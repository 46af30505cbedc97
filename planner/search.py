"""Problem → Path. The only file that imports ompl.

OMPL's planners sample the state space (SE(2), Reeds–Shepp, Dubins) and grow their trees by a
MotionValidator that asks the robot's own Connector; the path is then built again from the same Connector's
motions, so what drives is what was checked. Planners take turns under limits of work, not of time, so that
a seed names its path.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from drives.se2 import Pose, compose
from planner.connect import Connector
from planner.path import Path, merge
from planner.problem import Environment

__all__ = ["Search"]

ou.setLogLevel(ou.LOG_NONE)

_TURNS: tuple[tuple[str, int], ...] = (
    ("RRTConnect", 2_000),
    ("RRTConnect", 4_000),
    ("KPIECE1", 4_000),
    ("RRTConnect", 16_000),
    ("BKPIECE1", 16_000),
)
"""Planners in turn, each with the number of motions it may check; the last ones repeat, with more each
time."""


class _Validator(ob.MotionValidator):  # type: ignore[misc]
    """Counts the motions it checks: that is how work is measured."""

    def __init__(self, information: Any, connector: Connector) -> None:
        super().__init__(information)
        self.free = connector.edge_free
        self.count = 0

    def checkMotion(self, a: Any, b: Any) -> bool:
        self.count += 1
        return self.free(Pose(a.getX(), a.getY(), a.getYaw()), Pose(b.getX(), b.getY(), b.getYaw()))


class Search:
    """OMPL on one problem: every call of `paths` looks for more ways from the start to one of the goals.

    goals: at least one, all free, as the start is. Poses are sampled in the bounds and the map's outline.
    """

    def __init__(
        self, connector: Connector, environment: Environment, start: Pose, goals: Sequence[Pose], seed: int
    ) -> None:
        self.connector, self.start, self.goals, self.seed = connector, start, goals, seed
        self.area = _area(environment)
        self.work = 0
        """Motions checked so far."""
        self.allowance: int | None = None
        """How many may be checked in all, None: as many as time allows."""
        self.tried: list[dict[str, Any]] = []
        """What was tried: planner, seed, motions checked and outcome of every turn."""

    def paths(self, clock: Any) -> Iterator[tuple[str, Path]]:
        """Name of the planner and path, one after the other, until clock() says that time is up."""
        turn = 0
        while not clock() and not self._is_spent(0):
            name, work = _TURNS[min(turn, len(_TURNS) - 1 - turn % 2)]
            work *= 2 ** max(0, (turn - len(_TURNS)) // 2)
            path = self._solve(name, self.seed + turn, work, clock)
            turn += 1
            if path is not None:
                yield name, path

    def _solve(self, name: str, seed: int, work: int, clock: Any) -> Path | None:
        # Before anything of OMPL's is built: that is what makes a plan repeatable.
        ou.RNG.setSeed(seed % (2**31 - 2) + 1)
        space = self._space()
        information = ob.SpaceInformation(space)
        world = self.connector.world
        information.setStateValidityChecker(lambda s: world.is_free(Pose(s.getX(), s.getY(), s.getYaw())))
        validator = _Validator(information, self.connector)
        information.setMotionValidator(validator)
        information.setup()
        definition = ob.ProblemDefinition(information)
        definition.addStartState(_state(information, self.start))
        goals = ob.GoalStates(information)
        for goal in self.goals:
            goals.addState(_state(information, goal))
        definition.setGoal(goals)
        planner = getattr(og, name)(information)
        planner.setProblemDefinition(definition)
        planner.setup()
        asked = 0

        def stop() -> bool:
            # Planners also spend work where they check no motion, such as on states that are not free.
            nonlocal asked
            asked += 1
            if validator.count >= work or asked >= 20 * work or self._is_spent(validator.count):
                return True
            return asked % 16 == 0 and bool(clock())

        status = planner.solve(ob.PlannerTerminationCondition(stop))
        self.work += validator.count
        exact = status.getStatus() == ob.PlannerStatus.EXACT_SOLUTION
        self.tried.append({
            "planner": name, "seed": seed, "motions_checked": validator.count,
            "outcome": "solved" if exact else "not solved",
        })  # fmt: skip
        return self._rebuild(definition.getSolutionPath()) if exact else None

    def _is_spent(self, more: int) -> bool:
        return self.allowance is not None and self.work + more >= self.allowance

    def _space(self) -> Any:
        x_min, y_min, x_max, y_max = self.area
        match self.connector.state_space:
            case "SE2":
                space = ob.SE2StateSpace()
            case "ReedsShepp":
                space = ob.ReedsSheppStateSpace(self.connector.turning_radius)
            case "Dubins":
                space = ob.DubinsStateSpace(self.connector.turning_radius)
        bounds = ob.RealVectorBounds(2)
        for axis, low, high in ((0, x_min, x_max), (1, y_min, y_max)):
            bounds.setLow(axis, low)
            bounds.setHigh(axis, high)
        space.setBounds(bounds)
        return space

    def _rebuild(self, found: Any) -> Path | None:
        """The connector's own motions through the states of an OMPL path."""
        pieces: list[Any] = []
        pose = self.start
        for state in list(found.getStates())[1:]:
            target = Pose(state.getX(), state.getY(), state.getYaw())
            step = self.connector.connect(pose, target)
            if step is None:
                return None
            pieces += step
            pose = step[-1].end if step else pose
        return merge(pieces)


def _area(environment: Environment) -> tuple[float, float, float, float]:
    """x_min, y_min, x_max, y_max (m, world frame) around where poses may be."""
    layer, bounds = environment.map, environment.bounds
    box = (-math.inf, -math.inf, math.inf, math.inf)
    if layer is not None:
        height, width = np.load(layer.directory / "cells.npy", mmap_mode="r").shape
        right, top = width * layer.resolution, height * layer.resolution
        corners = [compose(layer.origin, Pose(x, y, 0.0)) for x in (0.0, right) for y in (0.0, top)]
        xs, ys = [c.x for c in corners], [c.y for c in corners]
        box = (min(xs), min(ys), max(xs), max(ys))
    if bounds is None:
        return box
    return (
        max(box[0], bounds.x_min),
        max(box[1], bounds.y_min),
        min(box[2], bounds.x_max),
        min(box[3], bounds.y_max),
    )


def _state(information: Any, pose: Pose) -> Any:
    state = information.allocState()
    state.setX(pose.x)
    state.setY(pose.y)
    state.setYaw(math.remainder(pose.theta, 2 * math.pi))
    return state
