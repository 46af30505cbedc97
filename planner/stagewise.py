"""Optimal control problems, stated stage by stage, for Fatrop.

CasADi could derive the whole problem by itself. Told what a stage is, it takes a third of the time: first and
second derivatives are those of one stage, as plain expressions, mapped over all of them; what remains is to
put their entries where they belong.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array

__all__ = ["Program", "Rows", "Stage", "program"]

Index = NDArray[np.intp]


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
    """A compiled solver."""

    stages: int
    state: int
    _function: Any
    _lower: Array
    _upper: Array

    def solve(self, states: Array, controls: Array, own: Array, shared: Array) -> tuple[Array, Array] | None:
        """States (n + 1, s) and controls (n, c), or None.

        states, controls: where to start from; own (n, p), shared (q,): the parameters.
        """
        n, m = self.stages, self.state
        first = np.concatenate([np.hstack([states[:-1], controls]).ravel(), states[-1]])
        found = self._function(
            x0=first, p=np.concatenate([shared, own.ravel()]), lbg=self._lower, ubg=self._upper
        )
        values = np.array(found["x"]).ravel()
        if not self._function.stats()["success"] or not np.isfinite(values).all():
            return None
        body = values[:-m].reshape(n, -1)
        return np.vstack([body[:, :m], values[-m:]]), body[:, m:]


def program(stage: Stage, n: int, fatrop: dict[str, Any]) -> Program:
    """The solver for n stages. fatrop: its options."""
    z = ca.vertcat(stage.state, stage.control)
    m, each, total = stage.state.shape[0], z.shape[0], n * z.shape[0] + stage.state.shape[0]
    # Of one stage: next state, rows that are held always, later, first.
    groups = (stage.held, stage.later, stage.first)
    rows = ca.vertcat(-stage.after, *(part.column for group in groups for part in group))
    last = ca.vertcat(*(part.column for part in stage.last))
    held, later, first = (sum(part.column.shape[0] for part in group) for group in groups)
    size = m + held + later + first
    body = np.arange(n * size).reshape(n, size)
    kept = [np.delete(body[0], np.s_[m + held : m + held + later]), body[1:, : m + held + later].ravel()]
    index = np.concatenate([*kept, n * size + np.arange(last.shape[0])])
    # Where a row, or none, is among the problem's.
    place = np.full(n * size + last.shape[0] + 1, len(index))
    place[index] = np.arange(len(index))
    lower, upper = _bounds(stage, n)

    variables = ca.MX.sym("x", total)
    own, shared = ca.MX.sym("own", stage.own.shape[0], n), ca.MX.sym("shared", stage.shared.shape[0])
    parameters = ca.MX.sym("p", shared.shape[0] + own.shape[0] * n)
    given = [
        ca.reshape(variables[: n * each], each, n),
        ca.reshape(parameters[shared.shape[0] :], *own.shape),
        ca.repmat(parameters[: shared.shape[0]], 1, n),
    ]
    end = [variables[n * each :], parameters[: shared.shape[0]]]
    symbols, end_symbols = [z, stage.own, stage.shared], [stage.state, stage.shared]

    def mapped(expressions: list[Any], last_expressions: list[Any], *more: tuple[Any, Any, Any, Any]) -> Any:
        """Expressions of every stage, then of the last state, all in one column."""
        at = _function([*symbols, *(s for s, *_ in more)], expressions).map(n)
        at_end = _function([*end_symbols, *(s for _, s, *_ in more)], last_expressions)
        return ca.vertcat(ca.vec(at(*given, *(v for *_, v, _ in more))), at_end(*end, *(v for *_, v in more)))

    # The next state is that of the next stage.
    steps = body[:, :m].ravel()
    joined = np.full(n * size + last.shape[0], total)
    joined[steps] = (each + np.arange(n)[:, None] * each + np.arange(m)).ravel()
    g = (mapped([rows], [last]) + ca.vertcat(variables, 0)[joined.tolist()])[index.tolist()]
    f = ca.sum1(mapped([stage.cost], [stage.last_cost]))

    jacobian, last_jacobian = ca.jacobian(rows, z), ca.jacobian(last, stage.state)
    entries = ca.vertcat(mapped([jacobian.nz[:]], [last_jacobian.nz[:]]), ca.DM.ones(n * m))
    where = _spread(jacobian.sparsity(), last_jacobian.sparsity(), n, size, each)
    where = np.hstack([where, [steps, joined[steps]]])
    jac_g = _scattered(entries, place[where[0]], where[1], len(index), total)

    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", len(index))
    weight, of_rows, of_last = ca.SX.sym("f"), ca.SX.sym("l", size), ca.SX.sym("l", last.shape[0])
    spread = ca.vertcat(lam_g, 0)[place[:-1].tolist()]
    multipliers = (of_rows, of_last, ca.reshape(spread[: n * size], size, n), spread[n * size :])
    weights = (weight, weight, ca.repmat(lam_f, 1, n), lam_f)
    hessian, gradient = ca.hessian(weight * stage.cost + ca.dot(of_rows, rows), z)
    last_hessian, last_gradient = ca.hessian(weight * stage.last_cost + ca.dot(of_last, last), stage.state)
    arriving = np.full(total, len(index))
    arriving[joined[steps]] = place[steps]
    grad = mapped([gradient], [last_gradient], multipliers, weights)
    grad += ca.vertcat(lam_g, 0)[arriving.tolist()]
    entries = mapped([hessian.nz[:]], [last_hessian.nz[:]], multipliers, weights)
    where = _spread(hessian.sparsity(), last_hessian.sparsity(), n, each, each)
    hess = _scattered(entries, where[0], where[1], total, total)

    derivatives = [
        ca.Function("nlp_jac_g", [variables, parameters], [g, jac_g], ["x", "p"], ["g", "jac_g_x"]),
        ca.Function("nlp_hess_l", [variables, parameters, lam_f, lam_g], [grad, hess],
                    ["x", "p", "lam_f", "lam_g"], ["grad_gamma_x", "hess_gamma_x_x"]),
    ]  # fmt: skip
    options = {
        "print_time": False, "structure_detection": "auto", "equality": (lower == upper).tolist(),
        "cache": {made.name(): made for made in derivatives}, "fatrop": {"print_level": 0, **fatrop},
    }  # fmt: skip
    stated = {"x": variables, "p": parameters, "f": f, "g": g}
    return Program(n, m, ca.nlpsol("fastest", "fatrop", stated, options), lower, upper)


def _function(symbols: list[Any], values: list[Any]) -> Any:
    return ca.Function("of", symbols, [ca.cse(ca.densify(ca.vertcat(*values)))])


def _bounds(stage: Stage, n: int) -> tuple[Array, Array]:
    """Of the rows, in the problem's order."""
    step = [(0.0, 0.0)] * stage.state.shape[0]
    held, later, first, last = (
        [(part.low, part.high) for part in group for _ in range(part.column.shape[0])]
        for group in (stage.held, stage.later, stage.first, stage.last)
    )
    bounds = np.array([*step, *held, *first, *([*step, *held, *later] * (n - 1)), *last])
    return bounds[:, 0].copy(), bounds[:, 1].copy()


def _spread(block: Any, last: Any, n: int, down: int, right: int) -> Index:
    """Rows and columns (2, k) of the entries of n blocks along a diagonal, and of a last one."""
    at, end = np.array(block.get_triplet(), dtype=np.intp), np.array(last.get_triplet(), dtype=np.intp)
    step = np.array([[down], [right]])
    parts = at[:, None, :] + (np.arange(n) * step)[:, :, None]
    return np.hstack([parts.reshape(2, -1), end + n * step])


def _scattered(entries: Any, row: Index, column: Index, height: int, width: int) -> Any:
    """A sparse matrix of entries; those below its last row are left out."""
    inside = np.flatnonzero(row < height)
    order = inside[np.lexsort((row[inside], column[inside]))]
    pattern = ca.Sparsity.triplet(height, width, row[order].tolist(), column[order].tolist())
    return ca.MX(pattern, entries[order.tolist()])
