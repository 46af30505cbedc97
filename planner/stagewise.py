"""Optimal control problems, stated stage by stage: the expressions of one stage, which are differentiated
once, and which rows hold where."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from drives.se2 import Array
from planner.interior_point import solve
from planner.riccati import Stages
from planner.tape import record

__all__ = ["Program", "Rows", "Stage", "program"]


@dataclass(frozen=True, eq=False)
class Rows:
    """Expressions, each within two bounds."""

    values: list[Any]
    low: float
    high: float

    @property
    def column(self) -> Any:
        """All of them (k, 1)."""
        return ca.vertcat(*self.values)

    @property
    def bounds(self) -> Array:
        """Of all of them (k, 2)."""
        return np.full((self.column.shape[0], 2), [self.low, self.high])


@dataclass(frozen=True, eq=False)
class Stage:
    """What holds at one stage and until the next, as expressions of symbols.

    state, control: its variables. own: its parameters, shared: those that all stages have. after: the next
    state. cost: its share of what is minimized. held: rows of every stage; first: of the first one only;
    later: of all others; last, last_cost: of the state, after the last stage.
    """

    state: Any
    control: Any
    own: Any
    shared: Any
    after: Any
    cost: Any
    held: list[Rows]
    first: list[Rows]
    later: list[Rows]
    last: list[Rows]
    last_cost: Any


@dataclass(frozen=True, eq=False)
class Program:
    """A solver for any number of stages.

    bounds: (rows, 2) of each group of rows, in order: held, later, first, last. tolerance: of the solution's
    gaps and slopes. barrier: to begin with, see interior_point.
    """

    stages: Stages
    bounds: tuple[Array, ...]
    tolerance: float
    barrier: float

    def solve(
        self, states: Array, controls: Array, own: Array, shared: Array, iterations: int
    ) -> tuple[Array, Array] | None:
        """States (n + 1, s) and controls (n, c), or None.

        states, controls: where to start from; own (n, p), shared (q,): the parameters. iterations: at most so
        many.
        """
        (m, c), n, rows = self.stages[:2], len(controls), sum(map(len, self.bounds))
        given = np.concatenate([
            states.T, np.append(controls, np.zeros((1, c)), 0).T, np.append(own, own[-1:], 0).T,
            np.repeat(shared[:, None], n + 1, 1), (np.arange(n + 1) == n)[None], np.zeros((m + rows, n + 1)),
        ])  # fmt: skip
        low, high = self._everywhere(n, 0), self._everywhere(n, 1)
        taken = solve(self.stages, given, low, high, self.tolerance, self.barrier, iterations)
        return None if taken < 0 else (given[:m].T, given[m : m + c, :n].T)

    def _everywhere(self, n: int, side: int) -> Array:
        """Lower or upper bounds (rows, n + 1)."""
        parts = []
        for group, where in zip(self.bounds, (np.s_[:n], np.s_[1:n], np.s_[:1], np.s_[n:]), strict=True):
            part = np.full((len(group), n + 1), (-math.inf, math.inf)[side])
            part[:, where] = group[:, side, None]
            parts.append(part)
        return np.concatenate(parts)


def program(stage: Stage, tolerance: float, barrier: float) -> Program:
    """The solver for a stage."""
    groups = (stage.held, stage.later, stage.first, stage.last)
    rows = ca.vertcat(*(part.column for group in groups for part in group))
    bounds = tuple(np.concatenate([np.zeros((0, 2)), *(part.bounds for part in group)]) for group in groups)
    end = ca.SX.sym("end")
    z = ca.vertcat(stage.state, stage.control)
    cost = (1 - end) * stage.cost + end * stage.last_cost
    ahead = ca.vertcat(stage.after, rows)
    multipliers = ca.SX.sym("multipliers", ahead.shape[0])
    symbols = [z, stage.own, stage.shared, end, multipliers]
    jacobian: Any = ca.jacobian(ahead, z)
    by_rows = np.array(jacobian.sparsity().get_triplet(), np.int32).reshape(2, -1)
    order = np.lexsort((by_rows[1], by_rows[0]))
    gradient = ca.gradient(cost, z)
    hessian: Any = ca.tril(ca.hessian(cost + ca.dot(multipliers, ahead), z)[0])
    lower = np.array(hessian.sparsity().get_triplet(), np.int32).reshape(2, -1)
    plain = [ahead, cost]
    whole = [*plain, jacobian.nz[order.tolist()], ca.densify(gradient), hessian.nz[:]]
    stages = Stages(
        stage.state.shape[0], stage.control.shape[0], record(symbols, plain), record(symbols, whole),
        np.ascontiguousarray(by_rows[:, order].T), np.ascontiguousarray(lower.T),
    )  # fmt: skip
    return Program(stages, bounds, tolerance, barrier)
