"""What the first plan of a process would otherwise wait for."""

from __future__ import annotations

import numpy as np

from drives import Ackermann, Differential, Mecanum, PoweredCaster
from drives.drive import Limits
from drives.se2 import Pose
from drives.wheel import Module
from planner import curves, environment
from planner.connect import connector
from planner.environment import CollisionWorld
from planner.guide import Guide
from planner.path import arc
from planner.plan import plan
from planner.problem import Bounds, Circle, Environment, Footprint, Goal, Options, Polygon, Problem, Robot
from planner.roadmap import quickest_path
from planner.route import route_poses

__all__ = ["warm_up"]


def warm_up() -> None:
    """Import and compile whatever the first plan would otherwise wait for, by planning a little of
    everything."""
    environment.warm_up()
    curves.warm_up()
    modules = tuple(Module(name, x, y) for name, x, y in (("left", 0.0, 0.2), ("right", 0.0, -0.2)))
    wall = Polygon(np.array([[-0.1, -4.0], [0.1, -4.0], [0.1, 1.0], [-0.1, 1.0]]))
    around = Environment(Bounds(-4.0, -4.0, 4.0, 4.0), (wall, Circle(0.0, 1.0, 0.1)))
    footprint = Footprint(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]))
    for drive, turned in (
        (Mecanum(0.05, 0.3, 0.4), np.inf),
        (Differential(0.05, 0.3), np.inf),
        (Ackermann(0.05, 0.4, 0.3), 0.7),
        (PoweredCaster(0.05, 0.04, modules), np.inf),
    ):
        m = len(drive.wheel_names)
        limits = Limits(np.full(m, 20.0), np.full(m, 40.0), np.full(m, np.inf), turned, 5.0)
        # Compiling counts as planning time here.
        problem = Problem(
            Robot(drive, footprint, limits),
            Pose(-2.0, 0.0, 0.0),
            Goal(2.0, 0.0, 0.5),
            around,
            Options(time_budget=60.0),
        )
        plan(problem)
        world = CollisionWorld.build(around, footprint)
        goal = Pose(2.0, 0.0, 0.5)
        local = connector(problem.robot, world, problem.options)
        local.edge_free(problem.start, goal)
        local.duration((arc(problem.start, 0.0, 1.0),))
        quickest_path(np.array([problem.start, goal]), 1, local, 1)
        route = Guide(world.kernel, problem.start, goal).route(along=True)
        assert route is not None
        route_poses(route.legs, route.shape, 2, 0.0)
