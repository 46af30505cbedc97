"""Optimal control problems solved by a primal-dual interior point method, stage by stage.

With slacks s for the rows h(z) of the constraints, z the states and controls of all stages,

    minimize  cost(z) - barrier · Σ (log(s - low) + log(high - s))   subject to   h(z) = s

and to the dynamics, as the barrier goes to zero. Slacks are eliminated from Newton's steps; what is left of
them is Riccati's recursion. Rows that hold as equalities are springs, so stiff that what they give is far
below any tolerance, and their multipliers take up the force: no stage needs controls to spare for them.

Sources: Wächter and Biegler (2006), On the implementation of an interior-point filter line-search algorithm
for large-scale nonlinear programming; Vanroye et al. (2023), Fatrop.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from drives.se2 import Array
from planner.kernels import kernel
from planner.riccati import Index, Law, Parts, Stages, backward, condense, forward, prices, split
from planner.tape import run

__all__ = ["solve"]

_GIVE = 1e-8
"""What an equality gives way per unit of its multiplier."""
_PUSH = 0.1
"""How far inside its bounds a row begins at least, or as a share of the room between them."""
_SHARE, _POWER, _DONE = 0.2, 1.3, 10.0
"""The barrier's next value, as a share or a power of it, once the error is below so many times it."""
_HALVINGS = 12
_LESS_VIOLATION, _LESS_OBJECTIVE, _ARMIJO = 1e-5, 1e-8, 1e-8
"""What a step must gain of either, as shares of the violation, and of what is to be expected."""
_SWITCH_OBJECTIVE, _SWITCH_VIOLATION = 2.3, 1.1
_ROUNDING = 1e-14
_SHIFT, _LEAST_SHIFT, _MOST_SHIFT = 1e-4, 1e-12, 1e10
"""What is added to curvatures where the problem is not convex, to begin with, at least and at most."""
_LARGE = 100.0
"""Multipliers that are larger on average make the tolerance of slopes larger."""
_NEAR = 1e10
"""How many times too large or small a multiplier may be for its slack."""


class _Slacks(NamedTuple):
    """Rows (r, n + 1), their bounds, and the multipliers of these."""

    value: Array
    low: Array
    high: Array
    below: Array
    above: Array


@kernel
def solve(
    stages: Stages, given: Array, low: Array, high: Array, tolerance: float, barrier: float, iterations: int
) -> int:
    """How many iterations it took, or -1 where no solution was found.

    given (i, n + 1): inputs of the tapes at every stage, its state and control where to begin from; there the
    solution is left. low, high (r, n + 1): bounds of rows, infinite where they do not hold.
    """
    m, z, rows, n = stages.states, stages.states + stages.controls, low.shape[0], low.shape[1] - 1
    multipliers = given[given.shape[0] - m - rows :]
    work = np.empty((max(stages.whole.registers, stages.plain.registers), n + 1))
    plain, trial = np.empty((m + rows + 1, n + 1)), given.copy()
    out = np.empty((stages.whole.outputs, n + 1))
    parts = split(stages, rows, out)
    run(stages.plain, given, work, plain)
    slacks = _inside(plain[m : m + rows], low, high, barrier)
    multipliers[:m] = 0.0
    _balance(slacks, multipliers[m:])
    next_slacks = slacks.value.copy()
    weight, push, slack_step = np.zeros(low.shape), np.zeros(low.shape), np.zeros(low.shape)
    hessian, gradient, step = np.empty((z, z, n + 1)), np.empty((z, n + 1)), np.zeros((z, n + 1))
    law = Law(np.empty((n + 1, m, m)), np.empty((n + 1, m)), np.empty((n, z - m)), np.empty((n, z - m, m)))
    past, known = np.empty((iterations + 1, 2)), 0
    worst = 0.0
    shift = 0.0
    for iteration in range(iterations + 1):
        run(stages.whole, given, work, out)
        violation, widest = _violation(parts.after, parts.rows, given, slacks.value, low, high)
        error = max(_slope(stages.jacobian, parts, multipliers, gradient), widest)
        if not error < np.inf:
            return -1
        if max(error, _complementarity(slacks, 0.0)) <= tolerance:
            return iteration
        if iteration == iterations:
            return -1
        if iteration == 0:
            worst = max(1.0, violation)
        least = tolerance / 10
        while barrier > least and max(error, _complementarity(slacks, barrier)) < _DONE * barrier:
            barrier = max(least, min(_SHARE * barrier, barrier**_POWER))
            known = 0
        # Newton's step.
        _weigh(slacks, parts.rows, multipliers[m:], barrier, weight, push)
        condense(stages, parts, weight, push, hessian, gradient)
        added = 0.0
        while not backward(stages.jacobian, parts, given, hessian, gradient, added, law):
            if added == 0.0:
                added = _SHIFT if shift == 0.0 else max(_LEAST_SHIFT, shift / 3)
            else:
                added *= 100.0 if shift == 0.0 else 8.0
            if added > _MOST_SHIFT:
                return -1
        if added > 0.0:
            shift = added
        forward(stages.jacobian, parts, given, law, step)
        _slack_steps(stages.jacobian, parts, slacks, step, slack_step)
        length, dual_length, descent = _lengths(slacks, slack_step, barrier)
        for i in range(z):
            for k in range(n + 1):
                descent += parts.gradient[i, k] * step[i, k]
        # As much of it as makes progress, of which there are two kinds.
        objective = _objective(parts.cost, slacks.value, low, high, barrier)
        found = descends = False
        for _ in range(_HALVINGS):
            for i in range(z):
                for k in range(n + 1):
                    trial[i, k] = given[i, k] + length * step[i, k]
            for i in range(rows):
                for k in range(n + 1):
                    if low[i, k] != high[i, k]:
                        next_slacks[i, k] = slacks.value[i, k] + length * slack_step[i, k]
            run(stages.plain, trial, work, plain)
            reached, _ = _violation(plain[:m], plain[m : m + rows], trial, next_slacks, low, high)
            value = _objective(plain[m + rows], next_slacks, low, high, barrier)
            descends = (
                violation <= 1e-4 * worst
                and descent < 0.0
                and length * (-descent) ** _SWITCH_OBJECTIVE > violation**_SWITCH_VIOLATION
            )
            rounding = _ROUNDING * abs(objective)
            if descends:
                found = value <= objective + _ARMIJO * length * descent + rounding
            else:
                found = (
                    reached <= (1 - _LESS_VIOLATION) * violation
                    or value <= objective - _LESS_OBJECTIVE * violation + rounding
                )
            found = found and reached < 1e4 * worst and value < np.inf
            for f in range(known):
                found = found and not (reached >= past[f, 0] and value >= past[f, 1])
            if found:
                break
            length /= 2
        if not found:
            return -1
        if not descends:
            past[known] = (1 - _LESS_VIOLATION) * violation, objective - _LESS_OBJECTIVE * violation
            known += 1
        prices(law, step, length, multipliers)
        for i in range(rows):
            for k in range(n + 1):
                if low[i, k] == high[i, k]:
                    gap = parts.rows[i, k] - low[i, k]
                    multipliers[m + i, k] += length * (slack_step[i, k] + gap) / _GIVE
        _move(slacks, slack_step, next_slacks, dual_length, barrier)
        _balance(slacks, multipliers[m:])
        given[:z] = trial[:z]
    return -1


@kernel
def _inside(rows: Array, low: Array, high: Array, barrier: float) -> _Slacks:
    """Slacks near the rows that are well inside their bounds."""
    value, below, above = np.zeros(low.shape), np.zeros(low.shape), np.zeros(low.shape)
    for i in range(low.shape[0]):
        for k in range(low.shape[1]):
            a, b = low[i, k], high[i, k]
            if a == b:
                value[i, k] = a
                continue
            s = rows[i, k]
            if a > -np.inf:
                s = max(s, a + _PUSH * min(max(1.0, abs(a)), b - a))
            if b < np.inf:
                s = min(s, b - _PUSH * min(max(1.0, abs(b)), b - a))
            value[i, k] = s
            # Zero where there is no bound.
            below[i, k], above[i, k] = barrier / (s - a), barrier / (b - s)
    return _Slacks(value, low, high, below, above)


@kernel
def _balance(slacks: _Slacks, multipliers: Array) -> None:
    """Multipliers of rows that are no equalities."""
    for i in range(multipliers.shape[0]):
        for k in range(multipliers.shape[1]):
            if slacks.low[i, k] != slacks.high[i, k]:
                multipliers[i, k] = slacks.above[i, k] - slacks.below[i, k]


@kernel
def _slope(jacobian: Index, parts: Parts, multipliers: Array, slope: Array) -> float:
    """The steepest slope of the Lagrangian, in units of the multipliers where these are large."""
    m, n = parts.after.shape[0], slope.shape[1] - 1
    slope[:] = parts.gradient
    for e in range(len(jacobian)):
        row, column = jacobian[e]
        for k in range(n + 1):
            slope[column, k] += parts.jacobian[e, k] * multipliers[row, k]
    for i in range(m):
        for k in range(n):
            slope[i, k + 1] -= multipliers[i, k]
    slope[m:, n] = 0.0
    total, count = 0.0, 1
    for i in range(multipliers.shape[0]):
        for k in range(n + 1):
            total += abs(multipliers[i, k])
            count += multipliers[i, k] != 0.0
    steepest = 0.0
    for i in range(slope.shape[0]):
        for k in range(n + 1):
            steepest = max(steepest, abs(slope[i, k]))
    return steepest / max(_LARGE, total / count) * _LARGE


@kernel
def _violation(
    after: Array, rows: Array, given: Array, slacks: Array, low: Array, high: Array
) -> tuple[float, float]:
    """Sum and largest of all gaps: between stages, and of rows from their slacks."""
    n = given.shape[1] - 1
    total = widest = 0.0
    for i in range(after.shape[0]):
        for k in range(n):
            gap = abs(after[i, k] - given[i, k + 1])
            total += gap
            widest = max(widest, gap)
    for i in range(rows.shape[0]):
        for k in range(n + 1):
            if low[i, k] > -np.inf or high[i, k] < np.inf:
                gap = abs(rows[i, k] - slacks[i, k])
                total += gap
                widest = max(widest, gap)
    return total, widest


@kernel
def _complementarity(slacks: _Slacks, barrier: float) -> float:
    """How far the products of slacks and multipliers are from the barrier at most."""
    most = 0.0
    for i in range(slacks.value.shape[0]):
        for k in range(slacks.value.shape[1]):
            s, low, high = slacks.value[i, k], slacks.low[i, k], slacks.high[i, k]
            if low == high:
                continue
            if low > -np.inf:
                most = max(most, abs((s - low) * slacks.below[i, k] - barrier))
            if high < np.inf:
                most = max(most, abs((high - s) * slacks.above[i, k] - barrier))
    return most


@kernel
def _objective(cost: Array, slacks: Array, low: Array, high: Array, barrier: float) -> float:
    """Cost and barrier: not a number where a slack is outside its bounds."""
    logarithms = 0.0
    for i in range(slacks.shape[0]):
        product = 1.0
        for k in range(slacks.shape[1]):
            if low[i, k] == high[i, k]:
                continue
            if low[i, k] > -np.inf:
                product *= slacks[i, k] - low[i, k]
            if high[i, k] < np.inf:
                product *= high[i, k] - slacks[i, k]
            if not 1e-100 < product < 1e100:
                logarithms += np.log(product)
                product = 1.0
        logarithms += np.log(product)
    return np.sum(cost) - barrier * logarithms


@kernel
def _weigh(
    slacks: _Slacks, rows: Array, multipliers: Array, barrier: float, weight: Array, push: Array
) -> None:
    """What rows add to curvatures and slopes, per unit of their own, once slacks are eliminated."""
    for i in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            s, low, high = slacks.value[i, k], slacks.low[i, k], slacks.high[i, k]
            if low == high:
                weight[i, k] = 1 / _GIVE
                push[i, k] = multipliers[i, k] + (rows[i, k] - low) / _GIVE
            else:
                w = slacks.below[i, k] / (s - low) + slacks.above[i, k] / (high - s)
                weight[i, k] = w
                push[i, k] = barrier / (high - s) - barrier / (s - low) + w * (rows[i, k] - s)


@kernel
def _slack_steps(jacobian: Index, parts: Parts, slacks: _Slacks, step: Array, slack_step: Array) -> None:
    """How rows change with a step; where they are no equalities, how their slacks do."""
    m = parts.after.shape[0]
    slack_step[:] = 0.0
    for e in range(len(jacobian)):
        row, column = jacobian[e, 0] - m, jacobian[e, 1]
        if row >= 0:
            for k in range(slack_step.shape[1]):
                slack_step[row, k] += parts.jacobian[e, k] * step[column, k]
    for i in range(slack_step.shape[0]):
        for k in range(slack_step.shape[1]):
            if slacks.low[i, k] != slacks.high[i, k]:
                slack_step[i, k] += parts.rows[i, k] - slacks.value[i, k]


@kernel
def _rises(slacks: _Slacks, i: int, k: int, step: float, barrier: float) -> tuple[float, float]:
    """By what the multipliers of either bound change with a step of the slack."""
    below, above = slacks.below[i, k], slacks.above[i, k]
    down, up = slacks.value[i, k] - slacks.low[i, k], slacks.high[i, k] - slacks.value[i, k]
    return (barrier - below * step) / down - below, (barrier + above * step) / up - above


@kernel
def _lengths(slacks: _Slacks, slack_step: Array, barrier: float) -> tuple[float, float, float]:
    """How much of a step keeps slacks, and multipliers, inside; how fast the barrier grows along it."""
    inside = max(0.99, 1.0 - barrier)
    length = dual_length = 1.0
    growth = 0.0
    for i in range(slack_step.shape[0]):
        for k in range(slack_step.shape[1]):
            if slacks.low[i, k] == slacks.high[i, k]:
                continue
            d = slack_step[i, k]
            down, up = slacks.value[i, k] - slacks.low[i, k], slacks.high[i, k] - slacks.value[i, k]
            growth += barrier * d * (1 / up - 1 / down)
            if -d * length > inside * down:
                length = -inside * down / d
            if d * length > inside * up:
                length = inside * up / d
            lower, upper = _rises(slacks, i, k, d, barrier)
            if -lower * dual_length > inside * slacks.below[i, k]:
                dual_length = -inside * slacks.below[i, k] / lower
            if -upper * dual_length > inside * slacks.above[i, k]:
                dual_length = -inside * slacks.above[i, k] / upper
    return length, dual_length, growth


@kernel
def _move(slacks: _Slacks, slack_step: Array, to: Array, length: float, barrier: float) -> None:
    """Slacks, and multipliers of their bounds by a length of their step."""
    for i in range(to.shape[0]):
        for k in range(to.shape[1]):
            if slacks.low[i, k] == slacks.high[i, k]:
                continue
            lower, upper = _rises(slacks, i, k, slack_step[i, k], barrier)
            s = slacks.value[i, k] = to[i, k]
            near = barrier / (s - slacks.low[i, k])
            moved = slacks.below[i, k] + length * lower
            slacks.below[i, k] = max(min(moved, _NEAR * near), near / _NEAR)
            near = barrier / (slacks.high[i, k] - s)
            moved = slacks.above[i, k] + length * upper
            slacks.above[i, k] = max(min(moved, _NEAR * near), near / _NEAR)
