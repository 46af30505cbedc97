"""Newton's step of a problem stated stage by stage, at a cost that is linear in the number of stages.

Source: Rao, Wright and Rawlings (1998), Application of interior-point methods to model predictive control.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.kernels import kernel
from planner.tape import Tape

__all__ = ["Index", "Law", "Parts", "Stages", "backward", "condense", "forward", "prices", "split"]

Index = NDArray[np.int32]

_PIVOT = 1e-14


class Stages(NamedTuple):
    """A problem. states, controls: of a stage, z together.

    plain: the tape of next states, rows and cost of a stage. whole: of the same, then the entries of the
    Jacobian of next states and rows, the gradient (z,) of the cost, and the entries of the lower half of the
    Lagrangian's Hessian. jacobian (j, 2), hessian (h, 2): rows and columns of entries, the first by rows. The
    tapes' inputs are state, control, parameters, and multipliers of next states and of rows.
    """

    states: int
    controls: int
    plain: Tape
    whole: Tape
    jacobian: Index
    hessian: Index


class Parts(NamedTuple):
    """What the whole tape gives, each (…, n + 1)."""

    after: Array
    rows: Array
    cost: Array
    jacobian: Array
    gradient: Array
    hessian: Array


class Law(NamedTuple):
    """Of every stage, the cost to go (n + 1, m, m), its slope (n + 1, m), and what to do: aim (n, c) and gain
    (n, c, m)."""

    cost: Array
    slope: Array
    aim: Array
    gain: Array


@kernel
def split(stages: Stages, rows: int, out: Array) -> Parts:
    m, z = stages.states, stages.states + stages.controls
    entries = m + rows + 1
    slopes = entries + len(stages.jacobian)
    return Parts(
        out[:m],
        out[m : m + rows],
        out[m + rows],
        out[entries:slopes],
        out[slopes : slopes + z],
        out[slopes + z :],
    )


@kernel
def condense(
    stages: Stages, parts: Parts, weight: Array, push: Array, hessian: Array, gradient: Array
) -> None:
    """Curvatures (z, z, n + 1), lower half, and slopes (z, n + 1) of all but the dynamics."""
    m, columns = stages.states, weight.shape[1]
    jacobian, entries = stages.jacobian, parts.jacobian
    hessian[:] = 0.0
    for e in range(len(stages.hessian)):
        hessian[stages.hessian[e, 0], stages.hessian[e, 1]] = parts.hessian[e]
    gradient[:] = parts.gradient
    weighed = np.empty(columns)
    first = 0
    for e in range(len(jacobian)):
        row, i = jacobian[e]
        if row != jacobian[first, 0]:
            first = e
        if row < m:
            continue
        for k in range(columns):
            weighed[k] = entries[e, k] * weight[row - m, k]
            gradient[i, k] += entries[e, k] * push[row - m, k]
        for f in range(first, e + 1):
            j = jacobian[f, 1]
            for k in range(columns):
                hessian[i, j, k] += weighed[k] * entries[f, k]


@kernel
def _dynamics(jacobian: Index, parts: Parts, k: int, dynamics: Array) -> None:
    """Derivatives (m, z) of the state after stage k."""
    dynamics[:] = 0.0
    for e in range(len(jacobian)):
        if jacobian[e, 0] >= len(dynamics):
            break
        dynamics[jacobian[e, 0], jacobian[e, 1]] = parts.jacobian[e, k]


@kernel
def backward(
    jacobian: Index, parts: Parts, given: Array, hessian: Array, gradient: Array, shift: float, law: Law
) -> bool:
    """Riccati's recursion from the last stage to the first. Whether the problem, with `shift` added to its
    curvatures, is convex along the dynamics."""
    (n, c, m), z = law.gain.shape, gradient.shape[0]
    dynamics, product, ahead = np.empty((m, z)), np.empty((m, z)), np.empty(m)
    # Controls come last: of their block a factor of Cholesky's is made in place. Slopes are the last column.
    q = np.empty((z, z + 1))
    # The gain and, last, the aim.
    back = np.empty((c, m + 1))
    for i in range(m):
        law.slope[n, i] = gradient[i, n]
        for j in range(i + 1):
            law.cost[n, i, j] = law.cost[n, j, i] = hessian[i, j, n]
        law.cost[n, i, i] += shift
    for k in range(n - 1, -1, -1):
        _dynamics(jacobian, parts, k, dynamics)
        cost = law.cost[k + 1]
        for i in range(m):
            ahead[i] = law.slope[k + 1, i]
            for j in range(m):
                ahead[i] += cost[i, j] * (parts.after[j, k] - given[j, k + 1])
            for j in range(z):
                total = 0.0
                for a in range(m):
                    total += cost[i, a] * dynamics[a, j]
                product[i, j] = total
        for i in range(z):
            total = gradient[i, k]
            for a in range(m):
                total += dynamics[a, i] * ahead[a]
            q[i, z] = total
            for j in range(i + 1):
                total = hessian[i, j, k]
                for a in range(m):
                    total += dynamics[a, i] * product[a, j]
                q[i, j] = total
            q[i, i] += shift
        if not _factor(q, m, z):
            return False
        for i in range(c):
            for j in range(m + 1):
                total = q[m + i, j if j < m else z]
                for a in range(i):
                    total -= q[m + i, m + a] * back[a, j]
                back[i, j] = total / q[m + i, m + i]
        for i in range(m):
            total = q[i, z]
            for a in range(c):
                total -= back[a, i] * back[a, m]
            law.slope[k, i] = total
            for j in range(i + 1):
                total = q[i, j]
                for a in range(c):
                    total -= back[a, i] * back[a, j]
                law.cost[k, i, j] = law.cost[k, j, i] = total
        for i in range(c - 1, -1, -1):
            for j in range(m + 1):
                total = back[i, j]
                for a in range(i + 1, c):
                    total -= q[m + a, m + i] * back[a, j]
                back[i, j] = total / q[m + i, m + i]
        law.gain[k] = back[:, :m]
        law.aim[k] = back[:, m]
    return _factor(law.cost[0].copy(), 0, m)


@kernel
def _factor(matrix: Array, begin: int, end: int) -> bool:
    """Cholesky's factor of a block on the diagonal, in its lower half; whether there is one."""
    for i in range(begin, end):
        for j in range(begin, i + 1):
            total = matrix[i, j]
            for a in range(begin, j):
                total -= matrix[i, a] * matrix[j, a]
            if i > j:
                matrix[i, j] = total / matrix[j, j]
            elif total > _PIVOT:
                matrix[i, i] = np.sqrt(total)
            else:
                return False
    return True


@kernel
def forward(jacobian: Index, parts: Parts, given: Array, law: Law, step: Array) -> None:
    """The step (z, n + 1), from the first stage on."""
    n, c, m = law.gain.shape
    dynamics = np.empty((m, m + c))
    step[m:, n] = 0.0
    step[:m, 0] = -np.linalg.solve(law.cost[0], law.slope[0])
    for k in range(n):
        for i in range(c):
            total = law.aim[k, i]
            for j in range(m):
                total += law.gain[k, i, j] * step[j, k]
            step[m + i, k] = -total
        _dynamics(jacobian, parts, k, dynamics)
        for i in range(m):
            total = parts.after[i, k] - given[i, k + 1]
            for j in range(m + c):
                total += dynamics[i, j] * step[j, k]
            step[i, k + 1] = total


@kernel
def prices(law: Law, step: Array, length: float, multipliers: Array) -> None:
    """Multipliers of the dynamics after a step."""
    n, _, m = law.gain.shape
    for k in range(n):
        for i in range(m):
            price = law.slope[k + 1, i]
            for j in range(m):
                price += law.cost[k + 1, i, j] * step[j, k + 1]
            multipliers[i, k] += length * (price - multipliers[i, k])
