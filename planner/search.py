"""Problem → Path. The only file that imports ompl.

OMPL's planners sample the state space (SE(2), Reeds–Shepp, Dubins) and grow their trees by a
MotionValidator that asks the robot's own Connector; the path is then built again from the same Connector's
motions, so what drives is what was checked. Planners take turns under limits of work, not of time, so that
a seed names its path.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from drives.se2 import Array, Pose, compose
from planner.collision import RADIUS, REACH, pose_free
from planner.connect import Connector
from planner.curves import SEGMENTS
from planner.edges import LINE, joined
from planner.guide import Guide
from planner.hybrid import hybrid_steps
from planner.path import Path, as_path
from planner.problem import Environment, Footprint, MapLayer
from planner.roadmap import quickest_path
from planner.route import Route, route_poses
from planner.stopwatch import now

__all__ = ["HYBRID", "Search"]

ou.setLogLevel(ou.LOG_NONE)

Area: TypeAlias = tuple[float, float, float, float]
"""x_min, y_min, x_max, y_max, m, world frame."""

_OfPose: TypeAlias = Callable[[float, float, float], tuple[float, float, float]]

HYBRID = "HybridAStar"
_TURNS: tuple[tuple[str, int, bool], ...] = (
    ("RRTConnect", 150, False),
    ("RRTConnect", 2_000, True),
    (HYBRID, 1_000, False),
    ("RRTConnect", 2_000, True),
    (HYBRID, 4_000, False),
    ("BKPIECE1", 4_000, False),
    ("RRTConnect", 16_000, True),
    ("RRTConnect", 16_000, False),
    ("BKPIECE1", 16_000, False),
    (HYBRID, 8_000, False),
)
"""Planners in turn, each with the number of motions it may check and whether it follows a route; the last
_REPEATED of them repeat, with twice as many each time."""
_REPEATED = 4
_ROADMAP = "roadmap"
_EVERY, _REACH, _WAYS = 1.5, 8, 2
"""Of poses along a route itself: how far apart they are, in reaches of the footprint, how many of them
further a motion may lead, and how many ways of joining two are tried."""
_WIDER, _REACHES = 0.5, 6.0
"""How far off start and goal poses are drawn at most, the first time: a share of how far these are apart, and
so many reaches of the footprint and turning radii."""
_OTHERS = 2
"""Other ways beside the first one."""
_ANGLE, _FINEST, _CHEAP = 0.1, 1e-3, 8
"""Of hybrid A*: its first cells, halved once all of them are looked at or led to the goal, and its last
(rad); how many of its motions, which are short and compiled, take as long as one of OMPL's."""
_SLICE, _MOST = 500, 64_000
"""How many of them are checked to see how long one takes, and how many at most before others search."""
_STRIDE, _STEP, _BEYOND, _LEAST = 12.0, 1.0, 2.0, 1e-4
"""In reaches of the footprint: the longest motion along a route, and of BKPIECE1, which works its way out of
slots by many small ones; room for poses past a route's ends."""


class _Validator(ob.MotionValidator):  # type: ignore[misc]
    """Counts the motions it checks: that is how work is measured. pose: of the body, of a state's numbers."""

    def __init__(self, information: Any, connector: Connector, pose: _OfPose | None) -> None:
        super().__init__(information)
        law = connector.law
        self.pose, self.steps = pose, np.empty((SEGMENTS, 3))
        self.motion = connector.world.kernel, law.kind, law.radius, law.reverse
        self.count = 0

    def checkMotion(self, a: Any, b: Any) -> bool:
        self.count += 1
        return self.free(a, b, self.steps)

    def free(self, a: Any, b: Any, steps: Array) -> bool:
        """Whether the shortest motion between two states is; what it does is written into steps (k, 3)."""
        ends = a.getX(), a.getY(), a.getYaw(), b.getX(), b.getY(), b.getYaw()
        if self.pose is not None:
            ends = *self.pose(*ends[:3]), *self.pose(*ends[3:])
        return bool(joined(*self.motion, *ends, steps))


class Search:
    """Searches on one problem: every call of `paths` looks for more ways from the start to one of the goals.

    goals: at least one, all free, as the start is. Poses are sampled in the bounds and the map's outline.
    doubt: called where the first, short search fails, and may raise.
    """

    def __init__(
        self,
        connector: Connector,
        environment: Environment,
        start: Pose,
        goals: Sequence[Pose],
        seed: int,
        doubt: Callable[[], None] = lambda: None,
    ) -> None:
        self.connector, self.start, self.goals, self.seed, self.doubt = connector, start, goals, seed, doubt
        self.area = _area(environment, _off(connector.robot.footprint))
        self._guides: dict[Pose, Guide] = {}
        self._angle = _ANGLE
        self._pace = 0.0
        self.work = 0
        """Motions checked so far."""
        self.allowance: int | None = None
        """How many may be checked in all, None: as many as time allows."""
        self.tried: list[dict[str, Any]] = []
        """What was tried: planner, seed, motions checked and outcome of every turn."""
        self.nearest: dict[str, float] | None = None
        """The pose (m, rad) that a search in vain came to and that is least far, distance m, from a goal."""

    def paths(self, clock: Any) -> Iterator[tuple[str, Path]]:
        """Name of the planner and path, one after the other, until clock() says that time is up."""
        turn, found = 0, sum(each["outcome"] == "solved" for each in self.tried)
        while not clock() and (self.allowance is None or self.work < self.allowance):
            again, place = divmod(max(turn - len(_TURNS), -_REPEATED) + _REPEATED, _REPEATED)
            name, work, guided = _TURNS[turn] if again == 0 else _TURNS[place - _REPEATED]
            work *= 2**again
            if not self.connector.reverse and name != HYBRID:
                name = _TURNS[0][0]  # BKPIECE1 takes motions to be as free the other way round
            # Routes that lead nowhere are not followed again once another search has found a way.
            guided = guided and not (found and self._is_misled())
            more = found > 0 and self.allowance is not None
            if more and found > 1 and name == HYBRID:  # it is for narrow passages
                turn += 1
                continue
            if more and not guided and name != HYBRID:
                # Other ways are found by chance, at once, rather than by patience.
                name, work, _ = _TURNS[0]
            if self.allowance is not None:
                work = min(work, self.allowance - self.work)
            goal = self.goals[turn % len(self.goals)]
            route = self._guide(goal).route(self._along(turn), self.connector.reverse) if guided else None
            turn += 1
            if guided and route is None:
                continue
            # Beside a way that is known already, one that a search finds is more often another.
            path = self._along_route(route, goal) if route is not None and not found else None
            if path is not None:
                name = _ROADMAP
            elif name == HYBRID:
                path = self._hybrid(goal, work, clock)
            else:
                path = self._solve(name, self.seed + turn - 1, work, clock, route, goal, turn == 1 or more)
            if path is not None:
                found += 1
                yield name, path
            elif turn == 1 and not found:
                self.doubt()

    def _is_misled(self) -> bool:
        """Whether routes were followed, and none of them to the goal."""
        outcomes = {each["outcome"] for each in self.tried if each["guided"]}
        return outcomes == {"not solved"}

    def others(self, clock: Any) -> Iterator[Path]:
        """A few ways found as the first was, by other draws, where that was at once: by twice its work."""
        if not self.tried or self.tried[0]["outcome"] != "solved":
            return
        name, work = _TURNS[0][0], 2 * self.tried[0]["motions_checked"]
        for k in range(len(_TURNS), len(_TURNS) + _OTHERS):
            path = self._solve(name, self.seed + k, work, clock, None, self.goals[0], near=True)
            if path is not None:
                yield path

    def _along_route(self, route: Route, goal: Pose) -> Path | None:
        """The quickest path by poses along the route itself, which needs no search where there is one."""
        end = route.coordinates(goal, route.length)
        count = 2 + math.ceil(route.length / max(_EVERY * route.reach, _LEAST * route.length))
        on_route = route_poses(route.legs, route.shape, count, 0.0 if route.along else end[2])
        poses = np.concatenate([[self.start], on_route, [goal]])
        path = quickest_path(poses, _REACH, self.connector, _WAYS)
        checked = _REACH * len(poses)
        self.work += checked
        self._tell(_ROADMAP, True, None, checked, path is not None)
        return path

    def _hybrid(self, goal: Pose, work: int, clock: Any) -> Path | None:
        """A path by hybrid A*, its cells as fine as this much work allows, and clock(s) leaves time for."""
        connector, limits, limit = self.connector, self.connector.robot.limits, min(work * _CHEAP, _MOST)
        law, reversal = replace(connector, flows=True).law, limits.wheel_speed / limits.wheel_acceleration
        steps, checked, is_late = np.zeros((0, 3)), 0, False
        while checked < limit and len(steps) == 0 and self._angle >= _FINEST and not is_late:
            allowed, begin = limit - checked, now()
            if self._pace == 0.0:
                allowed = min(allowed, _SLICE)
            while allowed > _SLICE and clock(allowed * self._pace):
                allowed, is_late = allowed // 2, True
            steps, more = hybrid_steps(
                connector.world.kernel, law, np.array(self.start), np.array(goal), self._angle,
                float(reversal.max()), allowed,
            )  # fmt: skip
            self._pace = (now() - begin) / max(more, _SLICE)
            checked += max(more, _CHEAP)
            if len(steps) or more < allowed:  # else the same cells, with more work the next time
                self._angle /= 2
        self.work += checked // _CHEAP
        self._tell(HYBRID, False, None, checked, len(steps) > 0)
        return as_path(np.array(self.start), steps, law.kind == LINE) if len(steps) else None

    def _tell(self, planner: str, guided: bool, seed: int | None, checked: int, solved: bool) -> None:
        self.tried.append({
            "planner": planner, "guided": guided, "seed": seed, "motions_checked": checked,
            "outcome": "solved" if solved else "not solved",
        })  # fmt: skip

    def _guide(self, goal: Pose) -> Guide:
        return self._guides.setdefault(goal, Guide(self.connector.world.kernel, self.start, goal))

    def _along(self, turn: int) -> bool:
        """Whether headings follow the route: those that need not do so by turns."""
        return self.connector.steers or turn % 2 == 1

    def _note(self, x: float, y: float, theta: float) -> None:
        distance = min(math.dist((x, y), goal[:2]) for goal in self.goals)
        if self.nearest is None or distance < self.nearest["distance"]:
            self.nearest = {"x": x, "y": y, "theta": theta, "distance": distance}

    def _near(self) -> Area:
        """The area round start and goals, or what there is of it."""
        ends = np.array([self.start, *self.goals])[:, :2]
        low, high = ends.min(0), ends.max(0)
        beyond = _WIDER * math.dist(low, high) + _REACHES * (self._reach + self.connector.turning_radius)
        (x0, y0), (x1, y1) = (low - beyond).tolist(), (high + beyond).tolist()
        x_min, y_min, x_max, y_max = self.area
        return max(x_min, x0), max(y_min, y0), min(x_max, x1), min(y_max, y1)

    @property
    def _reach(self) -> float:
        """How far the footprint reaches, m."""
        world = self.connector.world.kernel
        return float(world[REACH] + world[RADIUS])

    def _solve(
        self, name: str, seed: int, work: int, clock: Any, route: Route | None, goal: Pose, near: bool
    ) -> Path | None:
        # Before anything of OMPL's is built: that is what makes a plan repeatable.
        ou.RNG.setSeed(seed % (2**31 - 2) + 1)
        area = self._near() if near else self.area
        space = self._space(area) if route is None else self._beside(route)
        pose = None if route is None else route.pose
        information = ob.SpaceInformation(space)
        world = self.connector.world.kernel

        def is_free(state: Any) -> bool:
            at = state.getX(), state.getY(), state.getYaw()
            return bool(pose_free(world, *(at if pose is None else pose(*at))))

        information.setStateValidityChecker(is_free)
        validator = _Validator(information, self.connector, pose)
        information.setMotionValidator(validator)
        information.setup()
        definition = ob.ProblemDefinition(information)
        start, ends = self.start, self.goals
        if route is not None:
            start = Pose(*route.coordinates(self.start, 0.0))
            ends = [Pose(*route.coordinates(goal, route.length))]
        definition.addStartState(_state(information, start))
        goals = ob.GoalStates(information)
        for end in ends:
            goals.addState(_state(information, end))
        definition.setGoal(goals)
        planner = getattr(og, name)(information)
        if route is not None:
            planner.setRange(max(_STRIDE * route.reach, _LEAST * route.length))
        elif name == "BKPIECE1":
            planner.setRange(max(_STEP * self._reach, _LEAST * math.dist(area[:2], area[2:])))
        planner.setProblemDefinition(definition)
        planner.setup()
        asked = 0

        def stop() -> bool:
            # Planners also spend work where they check no motion, such as on states that are not free.
            nonlocal asked
            asked += 1
            if validator.count >= work or asked >= 20 * work:
                return True
            return asked % 16 == 0 and bool(clock())

        status = planner.solve(ob.PlannerTerminationCondition(stop))
        self.work += validator.count
        exact = status.getStatus() == ob.PlannerStatus.EXACT_SOLUTION
        path = self._rebuild(definition.getSolutionPath().getStates(), validator) if exact else None
        self._tell(name, route is not None, seed, validator.count, path is not None)
        if not exact and definition.hasApproximateSolution():
            state = definition.getSolutionPath().getStates()[-1]
            at = state.getX(), state.getY(), state.getYaw()
            self._note(*(at if pose is None else pose(*at)))
        return path

    def _space(self, area: Area) -> Any:
        x_min, y_min, x_max, y_max = area
        match self.connector.state_space:
            case "SE2":
                space = ob.SE2StateSpace()
            case "ReedsShepp":
                space = ob.ReedsSheppStateSpace(self.connector.turning_radius)
            case "Dubins":
                space = ob.DubinsStateSpace(self.connector.turning_radius)
        space.setBounds(_bounds((x_min, x_max), (y_min, y_max)))
        return space

    def _beside(self, route: Route) -> Any:
        """The space of a route's coordinates."""
        beyond, beside = _BEYOND * route.reach, route.beside
        space = ob.SE2StateSpace()
        space.setBounds(_bounds((-beyond, route.length + beyond), (-beside, beside)))
        return space

    def _rebuild(self, states: Sequence[Any], validator: _Validator) -> Path | None:
        """The connector's motions through the states of a path; None where one is not free: BKPIECE1 may have
        checked it the other way round, where of two words as short it is the other."""
        steps = np.empty((len(states) - 1, SEGMENTS, 3))
        if not all(validator.free(a, b, steps[k]) for k, (a, b) in enumerate(pairwise(states))):
            return None
        taken = steps.reshape(-1, 3)
        return as_path(np.array(self.start), taken[taken.any(1)], self.connector.law.kind == LINE)


def _area(environment: Environment, off: float) -> Area:
    """x_min, y_min, x_max, y_max (m, world frame) around where a body origin may be that lies `off` m outside
    its footprint."""
    layer, bounds = environment.map, environment.bounds
    box = (-math.inf, -math.inf, math.inf, math.inf)
    if layer is not None:
        height, width = _size(layer)
        right, top = width * layer.resolution, height * layer.resolution
        corners = [compose(layer.origin, Pose(x, y, 0.0)) for x in (0.0, right) for y in (0.0, top)]
        xs, ys = [c.x for c in corners], [c.y for c in corners]
        box = (min(xs), min(ys), max(xs), max(ys))
    if bounds is not None:
        box = (
            max(box[0], bounds.x_min),
            max(box[1], bounds.y_min),
            min(box[2], bounds.x_max),
            min(box[3], bounds.y_max),
        )
    return box[0] - off, box[1] - off, box[2] + off, box[3] + off


def _off(footprint: Footprint) -> float:
    """Distance (m) from the body origin to the footprint; 0 if it is inside."""
    corner = footprint.vertices @ np.array([1.0, 1j])
    side = np.roll(corner, -1) - corner
    if abs(np.angle((corner + side) * corner.conj()).sum()) > math.pi:  # the sides go round the origin
        return 0.0
    share = -(corner * side.conj()).real / np.maximum(np.abs(side) ** 2, 1e-300)
    nearest = np.abs(corner + np.clip(share, 0.0, 1.0) * side).min()
    return max(0.0, float(nearest) - footprint.radius)


@lru_cache(maxsize=8)
def _size(layer: MapLayer) -> tuple[int, int]:
    """Rows and columns."""
    height, width = np.load(layer.directory / "cells.npy", mmap_mode="r").shape
    return height, width


def _bounds(*axes: tuple[float, float]) -> Any:
    bounds = ob.RealVectorBounds(len(axes))
    for axis, (low, high) in enumerate(axes):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    return bounds


def _state(information: Any, pose: Pose) -> Any:
    state = information.allocState()
    state.setX(pose.x)
    state.setY(pose.y)
    # OMPL's circle is [-π, π): it refuses a state at π, and waits for a better one for ever.
    yaw = math.remainder(pose.theta, math.tau)
    state.setYaw(yaw if yaw < math.pi else -math.pi)
    return state
