"""Whether an answer keeps the contract: rolled forward as a client does, with kinematics of its own.

Between samples each angle is the cubic Hermite polynomial of its angles and rates (CONTRACT: "Between
samples"). A rate is then a parabola and an acceleration is linear, so their extremes have closed forms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import cumulative_simpson

from benchmarks.fuzz.kinematics import HOLONOMIC, Array, solve, steered_names, wheel_names
from benchmarks.fuzz.world import CLEARANCE, World

__all__ = ["Fault", "check"]

# Shares by which limits may be passed at any instant: rates and angles, accelerations, and ratios stated.
RATE, ACCELERATION, STATED = 0.01, 0.03, 5e-4
BACKWARDS = 5e-4  # m/s
# How far rolling may end from the goal: m, per metre travelled, rad.
POSITION, POSITION_PER_METRE, HEADING = 1e-3, 1e-4, 2e-3
_NODES = 8
"""Steps of the integration in a sample period of 0.02 s or more."""


@dataclass(frozen=True)
class Fault:
    """what: a short name, the same for faults of one kind. detail: the sentence. between: whether the limit
    holds at the samples and fails between them only."""

    what: str
    detail: str
    between: bool = False


@dataclass
class _Faults:
    found: list[Fault] = field(default_factory=list)

    def limit(self, what: str, at_samples: float, anywhere: float, slack: float) -> None:
        """Of a limit, the largest share used at samples and at any instant."""
        used = max(at_samples, anywhere)
        if not used <= 1 + slack:
            self.found.append(Fault(what, f"{what} reaches {used:.4f} of its limit", at_samples <= 1 + slack))

    def unless(self, holds: bool, what: str, detail: str) -> None:
        if not holds:
            self.found.append(Fault(what, detail))


@dataclass(frozen=True)
class _Column:
    """Angles (n, k) and rates (n, k) of wheels or of steering over time (n,)."""

    time: Array
    angle: Array
    rate: Array

    def accelerations(self) -> tuple[Array, Array]:
        """(n - 1, k) at the beginning and at the end of each interval."""
        h = np.diff(self.time)[:, None]
        mean, first, last = np.diff(self.angle, axis=0) / h, self.rate[:-1], self.rate[1:]
        begin: Array = (6 * mean - 4 * first - 2 * last) / h
        return begin, (2 * first + 4 * last - 6 * mean) / h

    def noise(self) -> Array:
        """(n - 1, 1) how far rounding can move an acceleration."""
        h = np.diff(self.time)[:, None]
        noise: Array = 12 * 2.3e-16 * (1 + np.abs(self.angle).max(initial=0.0)) / h**2
        return noise

    def at(self, share: Array) -> tuple[Array, Array]:
        """Angles and rates (n - 1, nodes, k) at shares of each interval."""
        h, u = np.diff(self.time)[:, None, None], share[None, :, None]
        a, b = self.angle[:-1, None], self.angle[1:, None]
        v, w = self.rate[:-1, None] * h, self.rate[1:, None] * h
        cubic, square = v + w - 2 * (b - a), 3 * (b - a) - 2 * v - w
        return a + u * (v + u * (square + u * cubic)), (v + u * (2 * square + u * 3 * cubic)) / h

    def largest_rate(self) -> Array:
        """(k,) the largest |rate| at any instant: at samples or at the vertex of a parabola."""
        begin, end = self.accelerations()
        h = np.diff(self.time)[:, None]
        with np.errstate(all="ignore"):
            u = begin / (begin - end)  # where the acceleration is zero
            vertex = np.where((u > 0) & (u < 1), self.rate[:-1] + h * begin * u / 2, 0.0)
        most: Array = np.maximum(np.abs(self.rate).max(0), np.abs(np.nan_to_num(vertex)).max(0, initial=0.0))
        return most


def check(request: dict[str, Any], plan: dict[str, Any], map_cells: Any = None) -> list[Fault]:
    """All faults of an answer to a request. map_cells: the solid parts of the map (see World)."""
    faults = _Faults()
    drive, schedule = request["robot"]["drive"], plan["schedule"]
    time = np.array(schedule["time"], dtype=float)
    wheel = _column(time, schedule["wheels"], wheel_names(drive), "velocity")
    steering = _column(time, schedule["steering"], steered_names(drive), "rate")
    stated = np.stack([np.array(plan["trajectory"][key], dtype=float) for key in ("x", "y", "theta")], 1)
    for key, value in plan["certificate"].items():
        faults.unless(
            not key.endswith("_ratio") or value <= 1 + STATED, f"certificate {key}", f"{key} is {value:.6f}"
        )
    if len(time) == 1:
        _standing(request, plan, faults)
        return faults.found
    _grid(request, plan, time, faults)
    _ends(request, wheel, steering, stated, faults)
    _actuators(request, wheel, steering, faults)
    poses, twists = _roll(request, wheel, steering, stated, faults)
    _body(request, time, poses, twists, faults)
    _route(request, twists, faults)
    _clearance(request, plan, poses, map_cells, faults)
    return faults.found


def _column(time: Array, columns: dict[str, Any], names: list[str], rate: str) -> _Column:
    def table(key: str) -> Array:
        return np.array([columns[name][key] for name in names], dtype=float).reshape(len(names), -1).T

    if not names:
        return _Column(time, np.zeros((len(time), 0)), np.zeros((len(time), 0)))
    return _Column(time, table("angle"), table(rate))


def _standing(request: dict[str, Any], plan: dict[str, Any], faults: _Faults) -> None:
    start, goal = request["start"], request["goal"]
    apart = math.hypot(goal["x"] - start["x"], goal["y"] - start["y"])
    turn = 0.0 if goal["theta"] is None else abs(_wrap(goal["theta"] - start["theta"]))
    faults.unless(apart < 2e-9 and turn < 2e-9 and plan["duration"] == 0, "grid", "a single sample")


def _grid(request: dict[str, Any], plan: dict[str, Any], time: Array, faults: _Faults) -> None:
    period, step = request["options"].get("sample_period", 0.02), np.diff(time)
    even = np.abs(step[:-1] - period).max(initial=0.0) < 1e-6
    faults.unless(
        bool(time[0] == 0 and (step > 0).all() and even and step[-1] <= period * (1 + 1e-6)), "grid",
        f"steps from {step.min():.6g} to {step.max():.6g} s, period {period:.6g} s",
    )  # fmt: skip
    faults.unless(abs(time[-1] - plan["duration"]) < 1e-6, "grid", "duration is not the last time")


def _ends(request: dict[str, Any], wheel: _Column, steering: _Column, stated: Array, faults: _Faults) -> None:
    limits, start = request["robot"]["limits"], request["start"]
    names = wheel_names(request["robot"]["drive"])
    speed = _per_wheel(limits["wheel_speed"], names)
    moving = (np.abs(wheel.rate[[0, -1]]) / speed).max()
    faults.unless(moving < 1e-6, "rest", f"a wheel has {moving:.2e} of its speed at an end")
    if steering.rate.size:
        moving = np.abs(steering.rate[[0, -1]]).max() / limits["steering_rate"]
        faults.unless(moving < 1e-6, "rest", f"a steering has {moving:.2e} of its rate at an end")
    for name, angle in start.get("steering", {}).items():
        stands = steering.angle[0, steered_names(request["robot"]["drive"]).index(name)]
        faults.unless(abs(stands - angle) < 1e-6, "present steering", f"{name} begins at {stands:.6f}")
    off = np.abs(stated[0] - [start["x"], start["y"], start["theta"]])
    off[2] = abs(_wrap(off[2]))
    faults.unless(off.max() < 1e-6, "start", f"the trajectory begins {off.max():.2e} off")


def _actuators(request: dict[str, Any], wheel: _Column, steering: _Column, faults: _Faults) -> None:
    limits, names = request["robot"]["limits"], wheel_names(request["robot"]["drive"])
    speed = _per_wheel(limits["wheel_speed"], names)
    top = _per_wheel(limits["wheel_acceleration"], names)
    faults.limit(
        "wheel speed", (np.abs(wheel.rate) / speed).max(), (wheel.largest_rate() / speed).max(), RATE
    )
    h = np.diff(wheel.time)[:, None]
    mean = np.diff(wheel.rate, axis=0) / h
    noise = wheel.noise()
    between = max((np.abs(end) - noise).max() if end.ndim == 1 else ((np.abs(end) - noise) / top).max()
                  for end in wheel.accelerations())  # fmt: skip
    faults.limit("wheel acceleration", ((np.abs(mean) - noise) / top).max(), between, ACCELERATION)
    if "wheel_jerk" in limits and len(mean) > 1:
        jerk = np.abs(np.diff(mean, axis=0)) - noise[1:] - noise[:-1]
        used = (jerk / ((h[1:] + h[:-1]) / 2) / _per_wheel(limits["wheel_jerk"], names)).max()
        faults.limit("wheel jerk", used, 0.0, ACCELERATION)
    if not steering.rate.size:
        return
    most = limits["steering_rate"]
    fastest = steering.largest_rate().max()
    faults.limit("steering rate", np.abs(steering.rate).max() / most, fastest / most, RATE)
    if "steering_angle" in limits:
        reached = np.abs(steering.at(np.linspace(0, 1, 9))[0]).max()
        most = limits["steering_angle"]
        faults.limit("steering angle", np.abs(steering.angle).max() / most, reached / most, RATE)


def _roll(
    request: dict[str, Any], wheel: _Column, steering: _Column, stated: Array, faults: _Faults
) -> tuple[Array, Array]:
    """Poses and twists (n - 1, nodes, 3) of the motion that the wheels alone make, and its faults."""
    drive, start, goal = request["robot"]["drive"], request["start"], request["goal"]
    period = request["options"].get("sample_period", 0.02)
    nodes = 2 * max(1, min(_NODES, math.ceil(_NODES * period / 0.02))) + 1
    share = np.linspace(0.0, 1.0, nodes)
    (_, rate), (angle, swing) = wheel.at(share), steering.at(share)
    n = len(rate)
    flat, slip = solve(
        drive, rate.reshape(n * nodes, -1), angle.reshape(n * nodes, -1), swing.reshape(n * nodes, -1)
    )
    twist, slip = flat.reshape(n, nodes, 3), slip.reshape(n, nodes)
    top = max(float(np.abs(twist[..., :2]).max()), 1e-3)
    used = slip / (1e-3 * top + 1e-4)
    faults.limit("slip", max(used[:, 0].max(), used[-1, -1]), used.max(), 0.0)
    step = np.diff(wheel.time) / (nodes - 1)
    heading = _integral(twist[..., 2], step, start["theta"])
    c, s = np.cos(heading), np.sin(heading)
    x = _integral(c * twist[..., 0] - s * twist[..., 1], step, start["x"])
    y = _integral(s * twist[..., 0] + c * twist[..., 1], step, start["y"])
    poses = np.stack([x, y, heading], -1)
    length = float(np.hypot(*np.diff(poses[..., :2].reshape(-1, 2), axis=0).T).sum())
    near = POSITION + POSITION_PER_METRE * length
    end = poses[-1, -1]
    apart = math.hypot(end[0] - goal["x"], end[1] - goal["y"])
    faults.unless(apart <= near, "closure", f"rolling ends {apart * 1e3:.3f} mm from the goal")
    if goal["theta"] is not None:
        turn = abs(_wrap(end[2] - goal["theta"]))
        faults.unless(
            turn <= HEADING, "closure", f"rolling ends {turn * 1e3:.3f} mrad from the goal's heading"
        )
    own = np.concatenate([poses[:, 0], poses[-1:, -1]])
    drift = np.hypot(*(own - stated)[:, :2].T).max()
    turned = np.abs((own - stated)[:, 2] - (start["theta"] - stated[0, 2])).max()
    faults.unless(
        drift <= near and turned <= HEADING, "drift",
        f"rolled and stated poses differ by {drift * 1e3:.3f} mm, {turned * 1e3:.3f} mrad",
    )  # fmt: skip
    return poses, twist


def _integral(values: Array, step: Array, begin: float) -> Array:
    """Of values (n, nodes) at even steps (n,) in each interval, continuous from interval to interval."""
    own = cumulative_simpson(values, dx=step[:, None], axis=1, initial=0.0)
    before = begin + np.concatenate([[0.0], np.cumsum(own[:-1, -1])])
    found: Array = own + before[:, None]
    return found


def _body(request: dict[str, Any], time: Array, poses: Array, twists: Array, faults: _Faults) -> None:
    limits, holonomic = request["robot"]["limits"], request["robot"]["drive"]["type"] in HOLONOMIC
    speed, turning = np.hypot(twists[..., 0], twists[..., 1]), np.abs(twists[..., 2])

    def judge(what: str, used: Array, bound: str, slack: float) -> None:
        if bound in limits:
            at_samples = max(used[:, 0].max(), used[-1, -1]) / limits[bound]
            faults.limit(what, at_samples, used.max() / limits[bound], slack)

    judge("linear speed", speed, "linear_speed", RATE)
    judge("angular speed", turning, "angular_speed", RATE)
    if not holonomic:
        judge("lateral acceleration", speed * turning, "lateral_acceleration", ACCELERATION)
    c, s = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    velocity = np.stack(
        [c * twists[..., 0] - s * twists[..., 1], s * twists[..., 0] + c * twists[..., 1]], -1
    )
    step = (np.diff(time) / (twists.shape[1] - 1))[:, None]
    gain = np.diff(speed, axis=1)
    ahead = (velocity[:, 1:] * velocity[:, :-1]).sum(-1) >= 0
    gain = np.where(ahead, np.abs(gain), speed[:, 1:] + speed[:, :-1])  # a reversal passes through rest
    noise = 1e-11 * (1 + speed.max())
    used = (gain - noise) / step
    if "linear_acceleration" in limits:
        mean = np.abs(speed[:, -1] - speed[:, 0]) / np.diff(time)
        most = limits["linear_acceleration"]
        faults.limit(
            "linear acceleration",
            (mean - noise / np.diff(time)).max() / most,
            used.max() / most,
            ACCELERATION,
        )
    if holonomic and "lateral_acceleration" in limits:
        crossed = velocity[:, :-1, 0] * velocity[:, 1:, 1] - velocity[:, :-1, 1] * velocity[:, 1:, 0]
        pace = np.maximum((speed[:, 1:] + speed[:, :-1]) / 2, 1e-6 + 1e-3 * speed.max())
        across = np.where(ahead, np.abs(crossed) / pace - noise, 0.0) / step
        faults.limit("lateral acceleration", 0.0, across.max() / limits["lateral_acceleration"], ACCELERATION)


def _route(request: dict[str, Any], twists: Array, faults: _Faults) -> None:
    options, forward = request["options"], twists[..., 0]
    top = max(float(np.abs(twists[..., :2]).max()), 0.05)
    slow = max(BACKWARDS, 1e-3 * top)
    if options.get("reverse") is False:
        back = float(-forward.min())
        samples = float(-min(forward[:, 0].min(), forward[-1, -1]))
        faults.limit("reverse", max(samples, 0.0) / slow, max(back, 0.0) / slow, 0.0)
    radius = options.get("turning_radius", 0.0)
    if radius and request["robot"]["drive"]["type"] not in HOLONOMIC:
        tight = (np.abs(twists[..., 2]) * radius - np.abs(forward) * 1.01) / (2e-3 * max(top, 1.0))
        faults.limit("turning radius", max(tight[:, 0].max(), tight[-1, -1]), tight.max(), 0.0)


def _clearance(
    request: dict[str, Any], plan: dict[str, Any], poses: Array, map_cells: Any, faults: _Faults
) -> None:
    asked = request["options"].get("min_clearance", 0.0)
    path = np.concatenate([poses[:1, 0], poses[:, 1:].reshape(-1, 3)])
    found = World(request, map_cells).clearance(path, asked)
    sentence = f"the clearance is {found * 1e3:.3f} mm, asked {asked * 1e3:.3f}"
    faults.unless(found >= asked - CLEARANCE, "clearance", sentence)
    stated = plan["certificate"]["clearance"]
    sentence = f"the certificate states {stated * 1e3:.3f} mm, found {found * 1e3:.3f}"
    faults.unless(stated <= found + CLEARANCE, "certificate clearance", sentence)


def _per_wheel(value: Any, names: list[str]) -> Array:
    return np.array([value[name] if isinstance(value, dict) else value for name in names], dtype=float)


def _wrap(angle: float) -> float:
    return math.remainder(angle, math.tau)
