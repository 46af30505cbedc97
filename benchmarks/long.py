"""What long paths cost: milliseconds to shorten, to time and to optimize them, by length.

Aisles side by side, walls between them open at alternate ends, and a path along their middles. No search is
part of it.

python -m benchmarks.long [--drive D ...] [--length M ...] [--repeat N] [--jerk]
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from benchmarks.duration.robots import ROBOTS
from drives.drive import Car, Holonomic
from drives.se2 import Pose, Twist
from planner.connect import connector
from planner.environment import CollisionWorld
from planner.optimize import Optimizer
from planner.path import LinePiece, Path, Piece, TwistPiece, merge
from planner.problem import Bounds, Environment, Goal, Options, Polygon, Problem, Robot
from planner.shorten import shorten
from planner.time_law import time_path
from planner.warm_up import warm_up

T = TypeVar("T")

LENGTHS = (25.0, 50.0, 100.0, 200.0)
WALL = 0.1


def serpentine(robot: Robot, length: float) -> tuple[Problem, Path]:
    """Aisles, and a path of about `length` m along their middles from the first to the last."""
    mobility = robot.drive.mobility(robot.limits)
    size = float(np.hypot(*robot.footprint.vertices.T).max())
    radius = max(1.2 * mobility.min_turning_radius, size) if isinstance(mobility, Car) else 0.0
    width, straight = max(2.0, 2 * radius), 2.0
    # From the middle of an aisle's end to the wall beyond it, and to that between aisles.
    beyond, short = (radius + 1.0, 0.0) if radius else (width / 2, width / 2)
    bend = math.pi * radius if radius else width
    aisles = max(2, round((length + bend) / (straight + bend)))
    walls = []
    for k in range(1, aisles):
        begin, end = (-beyond, straight - short) if k % 2 else (short, straight + beyond)
        y = k * width
        sides = ((begin, y - WALL / 2), (end, y - WALL / 2), (end, y + WALL / 2), (begin, y + WALL / 2))
        walls.append(Polygon(np.array(sides)))
    pose = Pose(0.0, width / 2, 0.0)
    start, pieces = pose, list[Piece]()
    for k in range(aisles):
        side = 1 if k % 2 == 0 else -1
        if isinstance(mobility, Holonomic):
            beside = moved(pose, side * straight, 0.0)
            above = moved(beside, 0.0, width)
            legs: list[Piece] = [LinePiece(pose, beside), LinePiece(beside, above)]
        elif radius:
            ahead = TwistPiece(pose, Twist(straight, 0.0, 0.0))
            legs = [ahead, TwistPiece(ahead.end, Twist(bend, 0.0, side / radius * bend))]
        else:
            quarter = Twist(0.0, 0.0, side * math.pi / 2)
            ahead = TwistPiece(pose, Twist(straight, 0.0, 0.0))
            turn = TwistPiece(ahead.end, quarter)
            across = TwistPiece(turn.end, Twist(width, 0.0, 0.0))
            legs = [ahead, turn, across, TwistPiece(across.end, quarter)]
        pieces += legs if k < aisles - 1 else legs[:1]
        pose = pieces[-1].end
    floor = Environment(Bounds(-beyond, 0.0, straight + beyond, aisles * width), tuple(walls))
    return Problem(robot, start, Goal(*pose), floor, Options(time_budget=30.0)), merge(pieces)


def moved(pose: Pose, dx: float, dy: float) -> Pose:
    return Pose(pose.x + dx, pose.y + dy, pose.theta)


def clocked(work: Callable[[], T], repeat: int) -> tuple[T, float]:
    """What it returns, and the least time (ms) that it took."""
    least = math.inf
    for _ in range(repeat):
        begin = time.perf_counter()
        made = work()
        least = min(least, (time.perf_counter() - begin) * 1e3)
    return made, least


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--drive", nargs="+", default=["differential", "mecanum", "ackermann", "swerve"])
    parser.add_argument("--length", nargs="+", type=float, default=LENGTHS)
    parser.add_argument("--repeat", type=int, default=2, help="the first also builds solvers")
    parser.add_argument("--jerk", action="store_true", help="limit the wheels' jerk")
    arguments = parser.parse_args()
    warm_up()
    print("drive           m pieces  shorten ms   time ms     optimize ms    with stops optimized")
    for kind in arguments.drive:
        robot = ROBOTS[kind]
        if arguments.jerk:
            limits = replace(robot.limits, wheel_jerk=10 * robot.limits.wheel_acceleration)
            robot = replace(robot, limits=limits)
        base: list[float] = []
        for length in arguments.length:
            base = report(robot, length, arguments.repeat, base)


def report(robot: Robot, length: float, repeat: int, base: list[float]) -> list[float]:
    """Print a row. base: ms/m of the first row, or nothing; returned is that, or this row's."""
    problem, path = serpentine(robot, length)
    world = CollisionWorld.build(
        problem.environment, robot.footprint, fixed_heading=robot.drive.fixed_body_heading
    )
    local = connector(robot, world, problem.options)
    optimizer = Optimizer(problem, world, lambda _: False)
    _, shortening = clocked(lambda: shorten(path, local), repeat)
    timed, timing = clocked(lambda: time_path(path, robot.drive, robot.limits), repeat)
    faster, optimizing = clocked(lambda: optimizer.faster(timed, 1), repeat)
    way = sum(piece.length for piece in path)
    costs = [cost / way for cost in (shortening, timing, optimizing)]
    base = base or costs
    row = "".join(f"{cost * way:7.0f} {cost / first:4.2f}" for cost, first in zip(costs, base, strict=True))
    duration = f"{faster.duration:8.1f} s" if faster is not None else "    none"
    print(f"{robot.drive.kind:12}{way:5.0f}{len(path):7d}{row}{timed.duration:12.1f} s{duration}", flush=True)
    return base


if __name__ == "__main__":
    main()
