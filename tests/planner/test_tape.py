"""Tapes: what they give is what CasADi gives, for every stage."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from planner.tape import record, run


def played(symbols: list[ca.SX], values: list[ca.SX], given: np.ndarray) -> np.ndarray:
    tape = record(symbols, values)
    out = np.full((tape.outputs, given.shape[1]), np.nan)
    run(tape, given, np.full((tape.registers, given.shape[1]), np.nan), out)
    return out


def test_every_operation_gives_what_casadi_gives_at_every_stage() -> None:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    values = ca.vertcat(
        x[0] + y, x[1] - y, x[0] * y, x[0] / x[1], -x[1], x[0] ** 2, 2 * y, ca.sqrt(x[0]), ca.sin(x[1]),
        ca.cos(y), 1 / y, 3.25, x[1], ca.SX(0),
    )  # fmt: skip
    # Parts that are used again after others have come and gone.
    again = ca.vertcat(values[0] * values[2], values[0] + values[7] * values[9], x[0] * values[4])
    given = np.random.default_rng(1).uniform(0.5, 2.0, (3, 7))
    expected = np.array(ca.Function("of", [ca.vertcat(x, y)], [ca.vertcat(values, again)])(given))
    assert played([x, y], [values, again], given) == pytest.approx(expected, rel=1e-15, abs=1e-15)


def test_derivatives_of_a_long_expression_are_casadis() -> None:
    x = ca.SX.sym("x", 4)
    y = ca.vertcat(*(ca.sin(x[i] * x[i - 1]) / ca.sqrt(1 + x[i - 2] ** 2) for i in range(4)))
    for _ in range(3):
        y = ca.vertcat(*(y[i] * ca.cos(y[i - 1]) + x[i] for i in range(4)))
    hessian = ca.densify(ca.vec(ca.hessian(ca.sumsqr(y), x)[0]))
    given = np.random.default_rng(2).normal(size=(4, 5))
    expected = np.array(ca.Function("of", [x], [hessian])(given))
    assert played([x], [hessian], given) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_an_operation_that_no_tape_knows_is_refused_when_it_is_recorded() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(KeyError):
        record([x], [ca.erf(x)])
