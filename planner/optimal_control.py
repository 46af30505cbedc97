"""The fastest motion as an optimal control problem: multiple shooting, stated in CasADi. This
file, retime.py and stagewise.py import casadi.

Between N + 1 knots the coordinates of the motion (see trajectory.Flowing) are
linear in time, or quadratic where the wheels' jerk is limited. Headings are then polynomials and positions
are integrated by Gauss's rule, so a long interval costs no accuracy. Every limit is a row that must stay
in [-1, 1]; wheel accelerations and jerks are the rates' derivatives, taken symbolically, so that one
formula for the rate of a wheel serves fixed and steered wheels alike. The duration is a state that does
not change. Angles of casters are states, too; how far they swing in an interval, and in a third of it, are
controls, which Radau's method ties to the motion of the body.

Sources: Bock and Plitt (1984), direct multiple shooting; Hairer and Wanner (1996), sect. IV.5, Radau IIA.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np

from drives.se2 import Array
from planner.shape import Shape
from planner.stagewise import Program, Rows, Stage, program

__all__ = ["Solver", "build_time", "solver"]

_STILL = 1e-3
"""Added to the speed of a steered wheel, in units of the problem, so that it is smooth at rest."""
_EFFORT = 1e-3
"""Share of the duration that the guess's effort, the sum of squares of the controls, is weighed with. It
settles what would be undetermined."""

_KEPT = 32
"""Solvers at most."""

_TOLERANCE, _BARRIER = 1e-5, 3e-4
"""Of interior_point.solve: from a larger barrier a motion first doubles its duration; from a smaller one,
more of them get stuck."""


@dataclass(frozen=True, eq=False)
class Solver:
    """A compiled solver for problems of one shape."""

    shape: Shape
    _program: Program

    def solve(
        self, parameters: dict[str, Any], guess: Array, controls: Array, iterations: int
    ) -> tuple[Array, Array] | None:
        """States (knots + 1, state) and controls (knots, size), or None.

        guess (knots + 1, state) and controls: where to start from. A state is pose, coordinates, their
        rates where jerk is limited, angles of casters, and the duration, which should be about 1, as should
        be lengths; controls are followed by swings of casters. Besides Shape.parameters: planes (2 knots,
        planes, 5), at each knot and after it; shares (knots,) of the intervals, where those after a knot
        hold; parts (knots,) of the duration that the intervals are. iterations: at most so many.
        """
        knots = len(controls)
        states, unit = self.shape.units(float(knots))
        guess, controls = guess / states, controls / unit
        given = [np.ravel(parameters[name]) for name in self.shape.parameters() if name != "knots"]
        planes = np.reshape(parameters["planes"], (knots, -1))
        own = np.column_stack([planes, parameters["shares"], parameters["parts"]])
        effort = _EFFORT / max(float((controls[:, : self.shape.size] ** 2).sum()), 1e-9)
        shared = np.concatenate([*given, [knots, effort]])
        found = self._program.solve(guess, controls, own, shared, iterations)
        return None if found is None else (found[0] * states, found[1] * unit)


class _Solvers:
    """Solvers, each built when first asked for, and the latest ones kept."""

    def __init__(self) -> None:
        self._kept: dict[Shape, Solver] = {}
        self._slow = 1.0
        """Time that the last one took to build over what was expected of an idle machine."""

    def solver(self, shape: Shape) -> Solver:
        """The solver for a shape, built if it is not kept (see build_time)."""
        if shape not in self._kept:
            begin = perf_counter()
            built = _built(shape)
            self._slow = (perf_counter() - begin) / _usual_time(shape)
            if len(self._kept) == _KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[shape] = built
        return self._kept[shape]

    def build_time(self, shape: Shape) -> float:
        """About how long (s) it takes until the solver for a shape is built; 0 if it is kept."""
        return 0.0 if shape in self._kept else _usual_time(shape) * max(self._slow, 1.0)


def _usual_time(shape: Shape) -> float:
    """About how long (s) it takes to build a solver: 0.02 s, casters of limited jerk up to 1 s."""
    wheels = 1.0 + shape.steered + 0.1 * shape.planes
    return 0.02 * wheels * (3 if shape.jerk and shape.steered else 1) * (2 if shape.trail else 1)


def _built(shape: Shape) -> Solver:
    symbols = {name: ca.SX.sym(name, size) for name, size in shape.parameters().items()}
    motion = _Motion(shape, symbols)
    scale, unit = shape.units(symbols["knots"])
    x, u, effort = ca.SX.sym("x", shape.state), ca.SX.sym("u", len(unit)), ca.SX.sym("effort")
    here, later = ca.SX.sym("n", 5 * shape.planes), ca.SX.sym("m", 5 * shape.planes)
    share, part = ca.SX.sym("t"), ca.SX.sym("h")
    states = ca.vertcat(*scale)
    at, by = x * states, u * ca.vertcat(*unit)
    after, between = motion.step(at, by, part, share)
    bends = [Rows(motion.bends(at), -1, 1)] if shape.given == "rest" else []
    stage = Stage(
        x, u, ca.vertcat(here, later, share, part), ca.vertcat(*symbols.values(), effort),
        after=after / states,
        cost=ca.sumsqr(u[: shape.size]) * effort,
        held=[Rows(motion.changes(at, by, part), -1, 1), Rows(motion.gaps(between, later), 0, math.inf),
              Rows(motion.steering(at, by, part), 0, math.inf),
              Rows(motion.ahead(at, part), 0, math.inf),
              Rows(motion.swings(at, by, part), 0, 0)],
        first=[Rows(motion.begin(at), 0, 0), Rows([x[-1]], 1e-3, 1e3), *bends],
        later=[*motion.speeds(at), Rows(motion.gaps(at, here), 0, math.inf)],
        last=[*motion.speeds(at), Rows(motion.finish(at), 0, 0)],
        last_cost=x[-1],
    )  # fmt: skip
    return Solver(shape, program(stage, _TOLERANCE, _BARRIER))


_SOLVERS = _Solvers()
solver, build_time = _SOLVERS.solver, _SOLVERS.build_time


_INSIDE: dict[str, tuple[float, ...]] = {
    "fixed": (0.0,),
    "car": (0.0, 0.5, 1.0),
    "caster": (0.0, 1 / 3, 2 / 3, 1.0),
    "twist": (0.5,),
    "jerk": (0.25, 0.75),
}
"""Where in an interval limits on changes are held: fixed wheels accelerate evenly there, steered ones do
not."""

_GAUSS = {
    1: ((0.5, 1.0),),
    2: ((0.5 - 12**-0.5, 0.5), (0.5 + 12**-0.5, 0.5)),
    3: ((0.5 - 0.15**0.5, 5 / 18), (0.5, 8 / 18), (0.5 + 0.15**0.5, 5 / 18)),
}
"""Points and weights of Gauss's rule, exact for polynomials of degree 2n - 1."""
_PARTS = np.linalg.inv(np.vander([a for a, _ in _GAUSS[3]], increasing=True)) / [[1], [2], [3]]
"""Times (t, t², t³), weights of the three points for the integral up to t."""


_RADAU = {1 / 3: (5 / 12, -1 / 12), 1.0: (3 / 4, 1 / 4)}
"""Points and weights of Radau's method of third order: stable however quickly casters swing into line."""
_SWUNG = {0.0: (0.0, 0.0), 1 / 3: (1.0, 0.0), 2 / 3: (1.0, 1 / 3), 1.0: (0.0, 1.0)}
"""By what share of the swings until these points they have swung elsewhere: on the parabola through them."""


class _Motion:
    """The rows of one shape, as expressions."""

    def __init__(self, shape: Shape, symbols: dict[str, Any]) -> None:
        self.shape, self.p = shape, symbols

    def _split(self, x: Any) -> tuple[Any, Any, Any]:
        """Pose, coordinates and their rates (none where they are the control)."""
        size = self.shape.size
        return x[:3], x[3 : 3 + size], x[3 + size : 3 + 2 * size] if self.shape.jerk else None

    def _later(self, x: Any, u: Any, t: Any) -> tuple[Any, Any]:
        """Coordinates and their rates a time t after a knot."""
        _, q, r = self._split(x)
        u = u[: self.shape.size]
        return (q + t * u, u) if r is None else (q + t * r + t**2 / 2 * u, r + t * u)

    def twist(self, q: Any) -> tuple[Any, Any, Any]:
        match self.shape.coordinates:
            case "twist":
                return q[0], q[1], q[2]
            case "unicycle":
                return q[0], 0, q[1]
            case "car":
                return q[0], 0, q[0] * q[1]

    def step(self, x: Any, u: Any, part: Any, share: Any) -> tuple[Any, list[Any]]:
        """The state at the next knot; the pose at a share of the way there."""
        h = part * x[-1]
        degree = self.shape.order * (2 if self.shape.coordinates == "car" else 1)

        def heading(t: Any) -> Any:
            inside = _GAUSS[degree // 2 + 1]
            return x[2] + sum(w * t * self.twist(self._later(x, u, a * t)[0])[2] for a, w in inside)

        ways = []
        for a, _ in _GAUSS[3]:
            vx, vy, _ = self.twist(self._later(x, u, a * h)[0])
            c, s = ca.cos(heading(a * h)), ca.sin(heading(a * h))
            ways.append(h * ca.vertcat(c * vx - s * vy, s * vx + c * vy))
        whole = sum(w * way for (_, w), way in zip(_GAUSS[3], ways, strict=True))
        weights = ca.horzcat(share, share**2, share**3) @ ca.DM(_PARTS)
        moved = sum(w * way for w, way in zip(ca.horzsplit(weights), ways, strict=True))
        q, r = self._later(x, u, h)
        after = [x[:2] + whole, heading(h), q, *([r] if self.shape.jerk else [])]
        there = [x[0] + moved[0], x[1] + moved[1], heading(share * h)]
        return ca.vertcat(*after, self._angles(x, u, 1.0), x[-1]), there

    def swings(self, x: Any, u: Any, part: Any) -> list[Any]:
        """What is zero where casters swing as their controls say, until either of Radau's points."""
        h, k = part * x[-1], self.shape.casters
        swung = u[self.shape.size :]
        rates = [self._swing(self._later(x, u, t * h)[0], self._angles(x, u, t)) for t in _RADAU] if k else []
        return [
            swung[i * k : i * k + k] - h * sum(w * rate for w, rate in zip(row, rates, strict=True))
            for i, row in enumerate(_RADAU.values() if k else ())
        ]

    def _angles(self, x: Any, u: Any, share: float) -> Any:
        """Where casters stand after a share of the interval after a knot."""
        swung, k = u[self.shape.size :], self.shape.casters
        first, last = _SWUNG.get(share, (0.0, 0.0))
        return x[self.shape.angles] + first * swung[:k] + last * swung[k:]

    def _swing(self, q: Any, angles: Any) -> Any:
        """Steering rates of casters, see drives.powered_caster."""
        vx, vy, omega = self.twist(q)
        px, py = vx - self.p["y"] * omega, vy + self.p["x"] * omega
        return (py * ca.cos(angles) - px * ca.sin(angles)) / self.p["trail"] - omega

    def begin(self, x: Any) -> list[Any]:
        """What is zero in the state to begin in."""
        return self._differences(x, self.p["start"], self.shape.given)

    def finish(self, x: Any) -> list[Any]:
        """What is zero at rest at the goal."""
        still = np.zeros(self.shape.state - 4)
        return self._differences(x, ca.vertcat(self.p["goal"], still), "rest")

    def _differences(self, x: Any, to: Any, given: str) -> list[Any]:
        """Of a state to another one, as far as that is given."""
        curvature, its_rate = 4, 4 + self.shape.size
        left = {"all": (), "curvature": (its_rate,), "rest": (curvature, its_rate)}[given]
        angles = self.shape.angles
        if self.shape.coordinates != "car":
            left = () if given == "all" else tuple(range(angles.start, angles.stop))
        return [x[i] - to[i] for i in range(self.shape.state - 1) if i not in left]

    def _rates(self, q: Any, angles: Any) -> list[Any]:
        """Every wheel's rate over its limit; angles: of casters."""
        p, (vx, vy, omega) = self.p, self.twist(q)
        rates = [
            p["rate"][3 * i] * vx + p["rate"][3 * i + 1] * vy + p["rate"][3 * i + 2] * omega
            for i in range(self.shape.rows)
        ]
        for i in range(self.shape.steered):
            if self.shape.coordinates == "car":
                # Of the sign of v, as the wheel's direction follows from the curvature alone.
                rolled = q[0] * ca.sqrt((1 - p["y"][i] * q[1]) ** 2 + (p["x"][i] * q[1]) ** 2)
            else:
                px, py = vx - p["y"][i] * omega, vy + p["x"][i] * omega
                rolled = (
                    px * ca.cos(angles[i]) + py * ca.sin(angles[i])
                    if self.shape.trail
                    else ca.sqrt(px**2 + py**2 + _STILL**2)
                )
            rates.append(rolled * p["speed"][i])
        return rates

    def speeds(self, x: Any) -> list[Rows]:
        """What depends on the coordinates only."""
        _, q, _ = self._split(x)
        vx, vy, omega = self.twist(q)
        body = self.p["body"]
        rows, capped = [*self._rates(q, x[self.shape.angles]), omega * body[1]], []
        if self.shape.coordinates == "twist":
            capped.append((vx**2 + vy**2) * body[0] ** 2)
        else:
            rows += [vx * body[0], vx * omega * body[3]]
        if self.shape.forward:
            capped.append(1 - vx)
        return [Rows([*rows, *self.bends(x)], -1, 1), Rows(capped, -math.inf, 1)]

    def bends(self, x: Any) -> list[Any]:
        """The row that limits a car's curvature."""
        return [x[4] * self.p["curvature"]] if self.shape.coordinates == "car" else []

    def changes(self, x: Any, u: Any, part: Any) -> list[Any]:
        """Rows that depend on how the coordinates change, over the interval after a knot."""
        rows, h = [], part * x[-1]
        kind: str = self.shape.coordinates if self.shape.steered else "fixed"
        if self.shape.trail:
            kind = "caster"
        elif kind == "twist" and self.shape.jerk:
            kind = "jerk"
        for share in _INSIDE[kind]:
            q, r = self._later(x, u, share * h)
            angles = self._angles(x, u, share)
            rows += self._changes(q, r, u, angles)
            if kind in ("car", "caster") and 0 < share < 1:
                # Between knots rates are no straight lines.
                rows += self._rates(q, angles)
        for share in (0.0, 0.5, 1.0) if self.shape.pushes else ():
            rows += self._pushes(*self._later(x, u, share * h))
        if self.shape.coordinates == "car" and self.shape.jerk:
            rows.append(self._between(x, h)[1] * self.p["curvature"])
        return rows

    def _between(self, x: Any, h: Any) -> Any:
        """The middle control points of parabolas over an interval of h after a knot. A parabola stays within
        its control points, and the others are its values at the knots."""
        _, q, r = self._split(x)
        return q + r * h / 2

    def ahead(self, x: Any, part: Any) -> list[Any]:
        """What is positive if a robot that must not drive back does not between knots."""
        curved = self.shape.forward and self.shape.jerk
        return [self._between(x, part * x[-1])[0]] if curved else []

    def _changes(self, q: Any, r: Any, u: Any, angles: Any) -> list[Any]:
        shape, u = self.shape, u[: self.shape.size]
        at, change, beta = (
            ca.SX.sym(*sized) for sized in (("q", shape.size), ("r", shape.size), ("b", shape.casters))
        )
        rates = ca.vertcat(*self._rates(at, beta))
        swing = self._swing(at, beta) if shape.trail else beta
        state, moved = ca.vertcat(at, beta), ca.vertcat(change, swing)
        acceleration = ca.jtimes(rates, state, moved)
        values = [acceleration * self.p["acceleration"]]
        if shape.jerk:
            jerk = ca.jtimes(acceleration, state, moved) + ca.jtimes(acceleration, change, u)
            values.append(jerk * self.p["jerk"])
        if shape.coordinates != "twist":
            values.append(change[0] * self.p["body"][2])
        values.append(swing * self.p["steering"])
        for i in range(0 if shape.trail else shape.steered):
            if self.shape.coordinates == "car":
                a, b = 1 - self.p["y"][i] * at[1], self.p["x"][i] * at[1]
                values.append(self.p["x"][i] / (a**2 + b**2) * change[1] * self.p["steering"])
            elif not shape.slow:
                across, square = self._across(i, at, change)
                values.append(across / (square + _STILL) * self.p["steering"])
        return [ca.substitute(ca.vertcat(*values), ca.vertcat(at, change, beta), ca.vertcat(q, r, angles))]

    def _across(self, i: int, q: Any, r: Any) -> tuple[Any, Any]:
        """p × p′ and |p|² of a steered wheel whose velocity is p."""
        px, py = q[0] - self.p["y"][i] * q[2], q[1] + self.p["x"][i] * q[2]
        ax, ay = r[0] - self.p["y"][i] * r[2], r[1] + self.p["x"][i] * r[2]
        return px * ay - py * ax, px**2 + py**2

    def steering(self, x: Any, u: Any, part: Any) -> list[Any]:
        """What is positive if wheels whose velocity is p are steered slowly enough, at both ends of the
        interval after a knot, where they are steered fastest: |p × p′| <= rate·|p|²."""
        rows = []
        for share in (0.0, 1.0) if self.shape.slow else ():
            for i in range(self.shape.steered):
                across, square = self._across(i, *self._later(x, u, share * part * x[-1]))
                across, square = across * self.p["steering"], square + _STILL
                rows += [square - across, square + across]
        return rows

    def _pushes(self, q: Any, r: Any) -> list[Any]:
        """Rows that limit how the speed of the body origin changes, and its acceleration across."""
        (vx, vy, omega), (ax, ay, _) = self.twist(q), self.twist(r)
        speed = ca.sqrt(vx**2 + vy**2 + _STILL**2)
        along, across = (vx * ax + vy * ay) / speed, (vx * ay - vy * ax) / speed + omega * speed
        return [along * self.p["body"][2], across * self.p["body"][3]]

    def gaps(self, pose: Any, planes: Any) -> list[Any]:
        """How far points of the body are on the right side of half-planes."""
        c, s = ca.cos(pose[2]), ca.sin(pose[2])
        rows = []
        for j in range(self.shape.planes):
            nx, ny, bx, by, d = (planes[5 * j + i] for i in range(5))
            rows.append(nx * (pose[0] + c * bx - s * by) + ny * (pose[1] + s * bx + c * by) - d)
        return rows
