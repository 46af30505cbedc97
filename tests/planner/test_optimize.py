"""Direct optimization: faster than stopping, never at the price of a limit, an obstacle or the goal."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.duration.queries import query
from benchmarks.duration.reference import load
from drives import Ackermann, Differential, Mecanum, PoweredCaster, Swerve, Synchro, Tricycle
from drives.drive import Drive, Limits
from drives.se2 import Pose
from drives.wheel import Module
from planner.corridor import cover, half_planes, hull
from planner.environment import CollisionWorld
from planner.plan import Plan, plan
from planner.problem import Bounds, Circle, Environment, Footprint, Goal, Options, Polygon, Problem, Robot

SQUARE = Footprint(np.array([[-0.3, -0.25], [0.3, -0.25], [0.3, 0.25], [-0.3, 0.25]]))
OPEN = Environment(Bounds(-12, -12, 12, 12))
MODULES = tuple(
    Module(f"m{i}", x, y) for i, (x, y) in enumerate([(0.2, 0.2), (0.2, -0.2), (-0.2, 0), (0, 0.3)])
)
STOPPING: list[Drive] = [
    Differential(0.1, 0.5),
    Tricycle(0.15, 1.2, 0.8),
    Ackermann(0.15, 0.8, 0.5),
    Synchro(0.06),
]


def robot(drive: Drive, jerk: float = np.inf, footprint: Footprint = SQUARE) -> Robot:
    m = len(drive.wheel_names)
    limits = Limits(np.full(m, 12.0), np.full(m, 14.0), np.full(m, jerk), steering_rate=1.5)
    is_car = isinstance(drive, Ackermann | Tricycle)
    return Robot(drive, footprint, replace(limits, steering_angle=0.7) if is_car else limits)


def answer(problem: Problem, effort: str) -> Plan:
    return plan(replace(problem, options=replace(problem.options, effort=effort, time_budget=60.0)))


@pytest.mark.parametrize("drive", STOPPING, ids=lambda d: d.kind)
def test_a_good_plan_on_open_floor_does_not_stop_and_is_faster_than_the_first(drive: Drive) -> None:
    problem = Problem(robot(drive), Pose(0, 0, 0.3), Goal(5.0, 2.0, 1.2), OPEN)
    first, good = answer(problem, "first"), answer(problem, "good")
    assert good.planning["stops"] == 0
    assert good.duration < 0.99 * first.duration


@pytest.mark.parametrize(
    ("kind", "draw", "stops", "ratio"),
    [
        ("tricycle", 21, 1, 1.15),
        ("tricycle", 22, 0, 1.15),
        ("ackermann", 7, 1, 1.15),
        ("omni", 17, 0, 1.05),
        ("swedish", 2, 0, 1.15),  # its way is narrower than a disc over the footprint
        ("powered_caster", 1, 0, 1.03),  # all wheels stand while the body moves
        ("powered_caster", 13, 0, 1.03),
    ],
)
def test_a_good_plan_in_clutter_stops_only_at_cusps(kind: str, draw: int, stops: int, ratio: float) -> None:
    """Where the first answer of the optimizer hits something, or direct ways turn back."""
    (known,) = [known for known in load()[kind]["clutter"] if known.draw == draw]
    made = answer(query(kind, "clutter", draw), "good")
    assert made.planning["stops"] <= stops
    assert made.duration <= ratio * known.duration


@pytest.mark.parametrize(
    ("kind", "draw"),
    [("swerve", 2), ("swerve", 3), ("swedish", 3), ("tricycle", 3), ("powered_caster", 13)],
)
def test_a_jerk_limit_brings_no_stops_in_clutter(kind: str, draw: int) -> None:
    problem = query(kind, "clutter", draw)
    limits = problem.robot.limits
    limited = replace(problem.robot, limits=replace(limits, wheel_jerk=10 * limits.wheel_acceleration))
    made = answer(replace(problem, robot=limited), "good")
    assert made.planning["stops"] == 0
    assert made.duration <= 1.06 * answer(problem, "good").duration


@pytest.mark.parametrize(("budget", "cut"), [(0.001, True), (60.0, False)])
def test_a_good_plan_says_whether_the_time_budget_cut_it_short(budget: float, cut: bool) -> None:
    options = Options(effort="good", time_budget=budget)
    problem = Problem(robot(Differential(0.1, 0.5)), Pose(0, 0, 0), Goal(4.0, 1.0, 0.5), OPEN, options)
    assert plan(problem).planning["cut_short"] is cut


def test_the_best_plan_is_never_slower_than_the_good_one() -> None:
    blocks = (Circle(2.0, 0.3, 0.8), Circle(4.0, -0.9, 0.7))
    problem = Problem(
        robot(Mecanum(0.05, 0.3, 0.4)), Pose(0, 0, 0), Goal(6.0, 0.0, 1.0), replace(OPEN, obstacles=blocks)
    )
    good = answer(problem, "good")
    best = plan(replace(problem, options=Options(effort="best", time_budget=5.0)))
    assert best.duration <= good.duration * (1 + 1e-9)


def test_a_straight_line_of_a_differential_drive_is_as_fast_as_its_trapezoid() -> None:
    problem = Problem(robot(Differential(0.1, 0.5)), Pose(0, 0, 0), Goal(4.0, 0.0, 0.0), OPEN)
    speed, acceleration = 12.0 * 0.1, 14.0 * 0.1
    assert answer(problem, "good").duration == pytest.approx(4 / speed + speed / acceleration, rel=1e-6)


def test_forward_only_holds_for_optimized_motions() -> None:
    problem = Problem(
        robot(Differential(0.1, 0.5)), Pose(0, 0, 0), Goal(-2.0, 0.5, 0.0), OPEN, Options(reverse=False)
    )
    made = answer(problem, "good")
    assert made.planning["optimized"]
    assert made.schedule.twist[:, 0].min() > -1e-3


def test_turning_radius_holds_for_optimized_motions() -> None:
    options = Options(turning_radius=0.8)
    problem = Problem(robot(Differential(0.1, 0.5)), Pose(0, 0, 0), Goal(0.0, 3.0, 3.0), OPEN, options)
    made = answer(problem, "good")
    assert made.planning["optimized"]
    twist = made.schedule.twist
    assert (np.abs(twist[:, 2]) * 0.8 <= np.abs(twist[:, 0]) * (1 + 1e-4) + 1e-6).all()


@pytest.mark.parametrize(("kind", "draw"), [("mecanum", 3), ("swerve", 2), ("powered_caster", 3)])
@pytest.mark.parametrize("limit", ["linear_acceleration", "lateral_acceleration"])
def test_limits_of_the_body_bring_no_stops_in_clutter(kind: str, draw: int, limit: str) -> None:
    problem = query(kind, "clutter", draw)
    limits = replace(problem.robot.limits, **{limit: 0.8})
    problem = replace(problem, robot=replace(problem.robot, limits=limits))
    first, good = answer(problem, "first"), answer(problem, "good")
    assert good.planning["stops"] == 0
    assert good.duration < 0.9 * first.duration
    assert getattr(good.certificate, f"{limit}_ratio") <= 1.01


def test_casters_swing_round_while_the_body_gets_to_speed() -> None:
    """From stop to stop, along a straight line, this one takes 10 % longer."""
    (known,) = [known for known in load()["powered_caster"]["open"] if known.draw == 19]
    made = answer(query("powered_caster", "open", 19), "good")
    assert made.planning["stops"] == 0
    assert made.duration <= 1.02 * known.duration


@pytest.mark.parametrize("stand", [0.0, 1.5, -1.5, 4.0])
def test_casters_begin_as_they_stand_and_the_fastest_motion_makes_use_of_it(stand: float) -> None:
    steering = stand * np.array([1.0, -1.0, 0.5, 1.0])
    problem = Problem(
        robot(PoweredCaster(0.05, 0.04, MODULES)),
        Pose(0, 0, 0.3),
        Goal(-2.0, 2.5, 1.2),
        OPEN,
        steering=steering,
    )
    first, good = answer(problem, "first"), answer(problem, "good")
    assert good.planning["optimized"]
    assert good.schedule.steering_angle[0] == pytest.approx(steering, abs=1e-9)
    assert good.duration < first.duration
    used = good.certificate
    assert max(used.wheel_acceleration_ratio, used.steering_rate_ratio) > 0.97


@pytest.mark.parametrize(
    "drive",
    [*STOPPING, Mecanum(0.05, 0.3, 0.4), Swerve(0.05, MODULES), PoweredCaster(0.05, 0.04, MODULES)],
    ids=lambda d: d.kind,
)
def test_optimized_motions_keep_the_jerk_limit(drive: Drive) -> None:
    problem = Problem(robot(drive, jerk=140.0), Pose(0, 0, 0.3), Goal(4.0, 1.5, 1.2), OPEN)
    assert answer(problem, "good").certificate.wheel_jerk_ratio <= 1.02


@pytest.mark.parametrize("drive", [*STOPPING, Mecanum(0.05, 0.3, 0.4)], ids=lambda d: d.kind)
@pytest.mark.parametrize(
    "blocks", [(), (Circle(1.8, 0.3, 0.4), Circle(3.4, 1.9, 0.4))], ids=["open", "blocks"]
)
def test_a_jerk_limit_costs_a_few_per_cent(drive: Drive, blocks: tuple[Circle, ...]) -> None:
    free = Problem(
        robot(drive), Pose(0, 0, 0.3), Goal(5.0, 2.0, 1.2), replace(OPEN, obstacles=blocks), Options(seed=1)
    )
    made = answer(replace(free, robot=robot(drive, jerk=140.0)), "good")
    assert made.planning["optimized"]
    assert made.duration <= 1.06 * answer(free, "good").duration


def test_a_car_begins_with_the_steering_it_has_and_goes_on_from_there() -> None:
    drive = Tricycle(0.15, 1.2, 0.8)
    problem = Problem(robot(drive), Pose(0, 0, 0), Goal(5.0, 1.0, 0.4), OPEN, steering=np.array([-0.5]))
    made = answer(problem, "good")
    assert made.planning["optimized"]
    assert made.schedule.steering_angle[0, 0] == pytest.approx(-0.5, abs=1e-9)
    assert np.abs(np.diff(made.schedule.steering_angle[:, 0])).max() <= 1.5 * 0.02 * (1 + 1e-3)


def test_between_obstacles_the_optimized_motion_keeps_clear() -> None:
    gate = tuple(
        Polygon(np.array([[1.8, y], [2.2, y], [2.2, y + 5.0], [1.8, y + 5.0]])) for y in (0.45, -5.45)
    )
    problem = Problem(
        robot(Mecanum(0.05, 0.3, 0.4)), Pose(0, -2, 0), Goal(4.0, 2.0, 1.5), replace(OPEN, obstacles=gate)
    )
    made = answer(problem, "good")
    assert made.planning["optimized"]
    assert made.certificate.clearance > 0


def test_half_planes_of_a_disc_before_a_wall_say_how_near_it_may_come() -> None:
    wall = Polygon(np.array([[1.0, -5.0], [2.0, -5.0], [2.0, 5.0], [1.0, 5.0]]))
    disc = Footprint(np.zeros((1, 2)), 0.2)
    world = CollisionWorld.build(replace(OPEN, obstacles=(wall,)), disc, 0.1)
    pose = np.array([[0.4, 0.3, math.pi / 3]])
    plane, _ = half_planes(world.kernel, disc.vertices, 0.0, pose, False, 0.005)[0]
    assert plane[:2] == pytest.approx([-1.0, 0.0], abs=1e-12)
    # n·point >= d: x <= 1 - radius - clearance, less a little to spare.
    assert -0.71 < plane[4] < -0.69


def test_half_planes_that_a_pose_does_not_keep_to_are_moved_to_where_it_does() -> None:
    wall = Polygon(np.array([[1.0, -5.0], [2.0, -5.0], [2.0, 5.0], [1.0, 5.0]]))
    world = CollisionWorld.build(replace(OPEN, obstacles=(wall,)), SQUARE)
    pose = np.array([[0.695, 0.0, 0.0]])
    for corners, radius in ((SQUARE.vertices, 0.0), (np.zeros((1, 2)), 0.4)):
        for nx, ny, x, y, d in half_planes(world.kernel, corners, radius, pose, True, 0.02)[0]:
            assert nx * (pose[0, 0] + x) + ny * (pose[0, 1] + y) >= d
    first = half_planes(world.kernel, SQUARE.vertices, 0.0, pose, False, 0.02)[0, 0]
    assert first[:2] @ (pose[0, :2] + first[2:4]) < first[4]


@pytest.mark.parametrize("seed", range(20))
def test_poses_that_keep_to_half_planes_keep_clear_of_what_is_nearest(seed: int) -> None:
    """The wedge turns and moves anywhere on the right side of its half-planes: it never touches the wall."""
    random = np.random.default_rng(seed)
    wedge = Footprint(np.array([[0.4, -0.1], [0.4, 0.1], [-0.3, 0.35], [-0.3, -0.35]]))
    slope = Polygon(np.array([[1.0, -9.0], [3.0, 9.0], [9.0, 9.0], [9.0, -9.0]]))
    world = CollisionWorld.build(replace(OPEN, obstacles=(slope,)), wedge)
    pose = np.append(random.uniform([-0.5, -1.0], [0.9, 1.0]), random.uniform(-math.pi, math.pi))
    if not world.is_free(Pose(*pose)):
        return
    corners = hull(wedge.vertices)
    planes = half_planes(world.kernel, corners, 0.0, pose[None], True, 0.005)[0]
    moved = pose + random.uniform(-0.5, 0.5, (4000, 3)) * [1.0, 1.0, 0.6]
    c, s = np.cos(moved[:, 2]), np.sin(moved[:, 2])
    keeps = np.ones(len(moved), bool)
    for nx, ny, x, y, d in planes:
        keeps &= nx * (moved[:, 0] + c * x - s * y) + ny * (moved[:, 1] + s * x + c * y) >= d
    assert np.count_nonzero(keeps) > 100
    assert world.clearance(moved[keeps]).min() > -1e-9


def test_discs_cover_the_footprint() -> None:
    for size in ((0.8, 0.5), (0.5, 2.0), (0.6, 0.6)):
        corners = np.array([[0.1, 0.0], [0.1, 1.0], [1.1, 1.0], [1.1, 0.0]]) * size
        centres, radius = cover(corners)
        inside = np.random.default_rng(0).uniform(corners.min(0), corners.max(0), (2000, 2))
        assert np.linalg.norm(inside[:, None] - centres, axis=2).min(1).max() <= radius
        assert radius < 0.75 * np.hypot(*size)
