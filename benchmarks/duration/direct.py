"""The whole problem as one nonlinear program: pose, wheel rates, steering and time, solved by IPOPT.

Between knots the coordinates of the motion are linear in time: the twist; (v, omega); (v, curvature) of a
car; of a synchro drive v, its omega being constant. The intervals of a group share their length, which is
free, so that switches of acceleration fall where they like. A powered caster's angles are states, by Radau's
collocation, as they are stiff. Sources: Hairer and Wanner (1996), sect. IV.5; Wächter and Biegler (2006).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from benchmarks.duration.robots import ROBOTS
from drives import PoweredCaster
from drives.drive import Car, Holonomic
from drives.se2 import Array

__all__ = ["PLANES", "Guess", "Program", "Solution", "program"]

PLANES = 5
"""Half-planes at every knot, at most."""

_GROUP = 4
_GAUSS = ((0.5 - 0.15**0.5, 5 / 18), (0.5, 8 / 18), (0.5 + 0.15**0.5, 5 / 18))
_R = math.sqrt(6)
_RADAU_AT = ((4 - _R) / 10, (4 + _R) / 10, 1.0)
_RADAU = np.array([
    [(88 - 7 * _R) / 360, (296 - 169 * _R) / 1800, (-2 + 3 * _R) / 225],
    [(296 + 169 * _R) / 1800, (88 + 7 * _R) / 360, (-2 - 3 * _R) / 225],
    [(16 - _R) / 36, (16 + _R) / 36, 1 / 9],
])  # fmt: skip
_SMOOTH = 1e-4
_REGULAR = 1e-4
_OPTIONS = {
    "print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-5, "ipopt.max_iter": 250,
    "ipopt.acceptable_tol": 1e-3, "ipopt.acceptable_iter": 8, "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_wall_time": 8.0, "ipopt.mu_init": 1e-2, "ipopt.linear_solver": "mumps",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Guess:
    """A motion to start from: time (n + 1,), pose and twist (n + 1, 3), angles of casters (n + 1, k)."""

    time: Array
    pose: Array
    twist: Array
    steering: Array


@dataclass(frozen=True, eq=False)
class Solution:
    """time (n + 1,); pose (n + 1, 3); coefficients (n, 2, c): of coordinates that are linear in time;
    curves: whether they are (v, curvature)."""

    time: Array
    pose: Array
    coefficients: Array
    curves: bool


class Program:
    """The program of one robot, compiled for a number of knots."""

    def __init__(self, drive: str, knots: int, cluttered: bool) -> None:
        robot = ROBOTS[drive]
        self.n, self.drive, self.limits = knots, robot.drive, robot.limits
        self.law = robot.drive.rolling_law()
        mobility = robot.drive.mobility(robot.limits)
        self.kind = (
            "synchro" if self.law.heading_steers
            else "twist" if isinstance(mobility, Holonomic)
            else "car" if isinstance(mobility, Car) else "unicycle"
        )  # fmt: skip
        self.bend = (1 - 1e-6) / mobility.min_turning_radius if isinstance(mobility, Car) else np.inf
        self.caster = robot.drive.caster_offset if isinstance(robot.drive, PoweredCaster) else 0.0
        self.casters = len(robot.drive.steered_names) if self.caster else 0
        self.vertices, self.planes = robot.footprint.vertices, PLANES if cluttered else 0
        self.size = {"synchro": 1, "unicycle": 2, "car": 2, "twist": 3}[self.kind]
        self.controls = 2 if self.kind == "synchro" else self.size
        self._build()

    def _build(self) -> None:
        n, c = self.n, self.casters
        x = ca.SX.sym("x", 3 + self.size + c, n + 1)
        u = ca.SX.sym("u", self.controls, n)
        stages = ca.SX.sym("b", 3 * c, n)
        h = ca.SX.sym("h", -(-n // _GROUP))
        ends, planes = ca.SX.sym("ends", 6), ca.SX.sym("planes", 3 * self.planes, n + 1)
        equal, within, beyond = [], [], []
        total, regular = 0, 0
        equal += [x[:3, 0] - ends[:3], x[:3, n] - ends[3:]]
        still = 1 if self.kind == "car" else self.size
        equal += [x[3 : 3 + still, 0], x[3 : 3 + still, n], x[3 + self.size :, 0]]
        for i in range(n):
            step = h[i // _GROUP]
            now, after = x[:, i], x[:, i + 1]
            equal += self._step(now, u[:, i], step, after, stages[:, i])
            within += self._limits(now, u[:, i], step, stages[:, i])
            for j in range(self.planes if i else 0):
                nx, ny, d = (planes[3 * j + k, i] for k in range(3))
                cos, sin = ca.cos(now[2]), ca.sin(now[2])
                if self.drive.fixed_body_heading is not None:
                    cos, sin = (
                        math.cos(self.drive.fixed_body_heading),
                        math.sin(self.drive.fixed_body_heading),
                    )
                for vx, vy in self.vertices:
                    px, py = now[0] + cos * vx - sin * vy, now[1] + sin * vx + cos * vy
                    beyond.append(nx * px + ny * py - d)
            total += step
            regular += step * ca.sumsqr(self._share(u[:, i]))
        if self.kind == "car":
            within += [ca.vertcat(x[4, n]) / self.bend]
        self._sizes = (x.numel(), u.numel(), stages.numel(), h.numel())
        constraints = [ca.vertcat(*rows) for rows in (equal, within, beyond)]
        sizes = [rows.numel() for rows in constraints]
        self._low = np.concatenate([np.zeros(sizes[0]), -np.ones(sizes[1]), np.zeros(sizes[2])])
        self._high = np.concatenate([np.zeros(sizes[0]), np.ones(sizes[1]), np.full(sizes[2], np.inf)])
        self._solver = ca.nlpsol("reference", "ipopt", {
            "x": ca.vertcat(ca.vec(x), ca.vec(u), ca.vec(stages), h), "p": ca.vertcat(ends, ca.vec(planes)),
            "g": ca.vertcat(*constraints), "f": total + _REGULAR * regular,
        }, _OPTIONS)  # fmt: skip

    def _share(self, u: Any) -> Any:
        """Controls over about the most that wheels allow."""
        law, limits = self.law, self.limits
        radius = law.radius[-1] if law.steered.any() else 1 / np.abs(law.rows[:, 0]).max()
        push = float(limits.wheel_acceleration.min()) * radius
        reach = max(float(np.abs(self.vertices).max()), 0.2)
        most = {"twist": [push, push, push / reach], "unicycle": [push, push / reach],
                "car": [push, 1.0], "synchro": [push, limits.steering_rate]}[self.kind]  # fmt: skip
        return u / np.array(most)

    def _coordinates(self, x: Any, u: Any, t: Any) -> Any:
        return x[3 : 3 + self.size] + t * u[: self.size]

    def _twist(self, q: Any, u: Any) -> tuple[Any, Any, Any]:
        match self.kind:
            case "synchro":
                return q[0], 0.0, u[1]
            case "unicycle":
                return q[0], 0.0, q[1]
            case "car":
                return q[0], 0.0, q[0] * q[1]
        return q[0], q[1], q[2]

    def _turned(self, x: Any, u: Any, t: Any) -> Any:
        match self.kind:
            case "synchro":
                return t * u[1]
            case "car":
                v, k = x[3], x[4]
                return t * v * k + t**2 / 2 * (u[0] * k + v * u[1]) + t**3 / 3 * u[0] * u[1]
        return t * x[2 + self.size] + t**2 / 2 * u[self.size - 1]

    def _step(self, x: Any, u: Any, h: Any, after: Any, stages: Any) -> list[Any]:
        px, py = x[0], x[1]
        for at, weight in _GAUSS:
            vx, vy, _ = self._twist(self._coordinates(x, u, at * h), u)
            theta = x[2] + self._turned(x, u, at * h)
            px += weight * h * (ca.cos(theta) * vx - ca.sin(theta) * vy)
            py += weight * h * (ca.sin(theta) * vx + ca.cos(theta) * vy)
        arrived = ca.vertcat(px, py, x[2] + self._turned(x, u, h), self._coordinates(x, u, h))
        rows = [after[: 3 + self.size] - arrived]
        if self.casters:
            c = self.casters
            rates = [
                self._swing(x, u, at * h, stages[c * k : c * k + c])[0] for k, at in enumerate(_RADAU_AT)
            ]
            for k in range(3):
                gained = h * sum(_RADAU[k, j] * rates[j] for j in range(3))
                rows.append(stages[c * k : c * k + c] - x[3 + self.size :] - gained)
            rows.append(after[3 + self.size :] - stages[2 * c :])
        return rows

    def _swing(self, x: Any, u: Any, t: Any, beta: Any) -> tuple[Any, Any, Any]:
        """Steering rates of casters at angles beta, their rates and accelerations."""
        vx, vy, omega = self._twist(self._coordinates(x, u, t), u)
        steering, rate, change = [], [], []
        for i, (mx, my) in enumerate(self.law.points):
            c, s = ca.cos(beta[i]), ca.sin(beta[i])
            px, py, ax, ay = vx - my * omega, vy + mx * omega, u[0] - my * u[2], u[1] + mx * u[2]
            across = c * py - s * px
            steering.append(across / self.caster - omega)
            rate.append((c * px + s * py) / self.law.radius[i])
            change.append((c * ax + s * ay + steering[-1] * across) / self.law.radius[i])
        return ca.vertcat(*steering), ca.vertcat(*rate), ca.vertcat(*change)

    def _limits(self, x: Any, u: Any, h: Any, stages: Any) -> list[Any]:
        """Rows within [-1, 1]."""
        limits, law = self.limits, self.law
        speed, push = limits.wheel_speed, limits.wheel_acceleration
        if self.casters:
            rows, c = [], self.casters
            places = [(0.0, x[3 + self.size :])]
            places += [(at, stages[c * k : c * k + c]) for k, at in enumerate(_RADAU_AT)]
            for at, beta in places:
                steering, rate, change = self._swing(x, u, at * h, beta)
                rows += [steering / limits.steering_rate, rate / speed, change / push]
            return rows
        rows = []
        q, later = x[3 : 3 + self.size], self._coordinates(x, u, h)
        if self.kind == "synchro":
            rate = law.rows[0, 0] / speed[0]
            return [later[0] * rate, u[0] * law.rows[0, 0] / push[0], u[1] / limits.steering_rate]
        if self.kind == "car":
            return [q[1] / self.bend, *(row for at in (0.0, 0.5, 1.0) for row in self._car(x, u, at * h))]
        for i in range(len(law.rows)):
            if not law.steered[i]:
                row = law.rows[i] if self.kind == "twist" else law.rows[i, [0, 2]]
                rows += [ca.dot(row, later) / speed[i], ca.dot(row, u) / push[i]]
                continue
            (mx, my), r = law.points[i], law.radius[i]
            ax, ay = u[0] - my * u[2], u[1] + mx * u[2]
            for at in (0.0, 0.5, 1.0):
                p = self._coordinates(x, u, at * h)
                px, py = p[0] - my * p[2], p[1] + mx * p[2]
                square = px**2 + py**2
                length = ca.sqrt(square + _SMOOTH**2)
                rows += [length / (r * speed[i]), (px * ax + py * ay) / length / (r * push[i])]
                rows.append((px * ay - py * ax) / (square + _SMOOTH) / limits.steering_rate)
        return rows

    def _car(self, x: Any, u: Any, t: Any) -> list[Any]:
        v, k = x[3] + t * u[0], x[4] + t * u[1]
        rows = []
        for i, (mx, my) in enumerate(self.law.points):
            # Signed as v; the rate's derivative by the chain rule.
            a, b = 1 - my * k, mx * k
            g = ca.sqrt(a**2 + b**2) if self.law.steered[i] else a
            slope = (b * mx - a * my) / g if self.law.steered[i] else -my
            r = 1 / self.law.rows[i, 0] if not self.law.steered[i] else self.law.radius[i]
            rows.append(v * g / (r * self.limits.wheel_speed[i]))
            rows.append((u[0] * g + v * slope * u[1]) / (r * self.limits.wheel_acceleration[i]))
            if self.law.steered[i]:
                rows.append(mx * u[1] / (a**2 + b**2) / self.limits.steering_rate)
        return rows

    def solve(self, guess: Guess, start: Array, goal: Array, planes: Array) -> Solution | None:
        """The fastest motion near a guess that keeps to planes (n + 1, k, 3): n·vertex >= d; None where none
        was found. Headings of start and goal are taken as they are."""
        n, time = self.n, guess.time
        q = self._first(guess)
        rate = np.diff(q, axis=0) / np.diff(time)[:, None]
        if self.kind == "synchro":
            rate = np.column_stack([rate, np.diff(guess.pose[:, 2]) / np.diff(time)])
        beta = guess.steering[:, : self.casters]
        x = np.hstack([guess.pose, q, beta])
        stages = np.tile(beta[1:], 3)
        lengths = np.diff(time)[::_GROUP]
        free = [x, rate, stages, lengths]
        first = np.concatenate([np.ravel(part) for part in free])
        low, high = np.full(len(first), -np.inf), np.full(len(first), np.inf)
        low[-len(lengths) :], high[-len(lengths) :] = 0.15 * lengths, 4 * lengths
        near = np.zeros((n + 1, self.planes, 3))
        near[..., 2] = -1.0
        near[:, : planes.shape[1]] = planes[:, : self.planes]
        packed = np.concatenate([start, goal, near.ravel()])
        try:
            found = self._solver(x0=first, lbx=low, ubx=high, lbg=self._low, ubg=self._high, p=packed)
        except RuntimeError:
            return None
        values = np.array(found["x"]).ravel()
        if not np.isfinite(values).all():
            return None
        parts = np.split(values, np.cumsum(self._sizes)[:-1])
        pose = parts[0].reshape(n + 1, -1)
        u, steps = parts[1].reshape(n, -1), np.repeat(parts[3], _GROUP)[:n]
        coefficients = np.stack([pose[:-1, 3 : 3 + self.size], u[:, : self.size]], 1)
        if self.kind == "synchro":
            turn = np.stack([u[:, 1:2], np.zeros((n, 1))], 1)
            coefficients = np.concatenate([coefficients, turn], 2)
        violation = np.array(found["g"]).ravel()
        worst = max((self._low - violation).max(), (violation - self._high).max())
        if worst > 1e-2:
            return None
        whole = np.concatenate([[0.0], np.cumsum(steps)])
        return Solution(whole, pose[:, :3], coefficients, self.kind == "car")

    def _first(self, guess: Guess) -> Array:
        """Coordinates (n + 1, c) of the guess."""
        match self.kind:
            case "twist":
                return guess.twist
            case "unicycle":
                return guess.twist[:, [0, 2]]
            case "synchro":
                return guess.twist[:, :1]
        v, omega = guess.twist[:, 0], guess.twist[:, 2]
        moving = np.abs(v) > 0.02 * np.abs(v).max()
        bend = np.interp(guess.time, guess.time[moving], omega[moving] / v[moving])
        return np.column_stack([v, np.clip(bend, -self.bend, self.bend)])


@lru_cache(maxsize=4)
def program(drive: str, knots: int, cluttered: bool) -> Program:
    """The program, built when first asked for."""
    return Program(drive, knots, cluttered)
