"""Expressions, written down as a list of operations, and evaluated for many stages at once.

An operation is done for all stages before the next one, at the cost of a few vector instructions: a tenth of
what CasADi takes stage by stage, and nothing is compiled for a new expression.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from drives.se2 import Array
from planner.kernels import kernel

__all__ = ["Tape", "record", "run"]

_CONST, _INPUT, _OUTPUT, _ADD, _SUB, _MUL, _DIV, _NEG, _SQ, _TWICE, _SQRT, _SIN, _COS, _INV = range(14)
_NAMES = (
    "CONST",
    "INPUT",
    "OUTPUT",
    "ADD",
    "SUB",
    "MUL",
    "DIV",
    "NEG",
    "SQ",
    "TWICE",
    "SQRT",
    "SIN",
    "COS",
    "INV",
)
_KNOWN = {getattr(ca, f"OP_{name}"): operation for operation, name in enumerate(_NAMES)}


class Tape(NamedTuple):
    """code (k, 4): operation, register or output to write, and what to read: registers, or the row of the
    input, or of the constants (c,). registers, outputs: how many there are."""

    code: NDArray[np.int32]
    constants: Array
    registers: int
    outputs: int


def record(symbols: list[Any], values: list[Any]) -> Tape:
    """The tape of values of symbols, both columns, whose inputs are the symbols one after another."""
    function = ca.Function("of", [ca.vertcat(*symbols)], [ca.cse(ca.densify(ca.vertcat(*values)))])
    steps = [
        (_KNOWN[function.instruction_id(k)], function.instruction_input(k), function.instruction_output(k))
        for k in range(function.n_instructions())
    ]
    # CasADi's registers hold one value after another: which values a step reads, and when for the last time.
    holds: dict[int, int] = {}
    reads: list[list[int]] = []
    last: dict[int, int] = {}
    for k, (operation, given, written) in enumerate(steps):
        reads.append([] if operation in (_CONST, _INPUT) else [holds[register] for register in given])
        last.update(dict.fromkeys(reads[k], k))
        if operation != _OUTPUT:
            holds[written[0]] = k
    code = np.zeros((len(steps), 4), np.int32)
    constants: list[float] = []
    where: dict[int, int] = {}
    free: list[int] = []
    registers = 0
    for k, (operation, given, written) in enumerate(steps):
        read = [where[value] for value in reads[k]]
        if operation == _CONST:
            read = [len(constants)]
            constants.append(function.instruction_constant(k))
        elif operation == _INPUT:
            read = [given[1]]
        if operation == _OUTPUT:
            to = written[1]
        else:
            # Never one that is read here: vectors that overlap are slow.
            if not free:
                free.append(registers)
                registers += 1
            to = where[k] = free.pop()
        code[k] = operation, to, read[0], read[-1]
        free += [where[value] for value in set(reads[k]) if last[value] == k]
        if operation != _OUTPUT and k not in last:
            free.append(to)
    return Tape(code, np.array(constants), registers, int(function.size1_out(0)))


@kernel
def run(tape: Tape, given: Array, work: Array, out: Array) -> None:
    """out (outputs, n) of inputs (i, n). work (registers, n): to write on."""
    code, n = tape.code, given.shape[1]
    for k in range(code.shape[0]):
        operation, to, a, b = code[k, 0], code[k, 1], code[k, 2], code[k, 3]
        if operation == _MUL:
            for j in range(n):
                work[to, j] = work[a, j] * work[b, j]
        elif operation == _ADD:
            for j in range(n):
                work[to, j] = work[a, j] + work[b, j]
        elif operation == _SUB:
            for j in range(n):
                work[to, j] = work[a, j] - work[b, j]
        elif operation == _INPUT:
            for j in range(n):
                work[to, j] = given[a, j]
        elif operation == _OUTPUT:
            for j in range(n):
                out[to, j] = work[a, j]
        elif operation == _NEG:
            for j in range(n):
                work[to, j] = -work[a, j]
        elif operation == _SQ:
            for j in range(n):
                work[to, j] = work[a, j] * work[a, j]
        elif operation == _TWICE:
            for j in range(n):
                work[to, j] = 2.0 * work[a, j]
        elif operation == _CONST:
            for j in range(n):
                work[to, j] = tape.constants[a]
        elif operation == _DIV:
            for j in range(n):
                work[to, j] = work[a, j] / work[b, j]
        elif operation == _INV:
            for j in range(n):
                work[to, j] = 1.0 / work[a, j]
        elif operation == _SQRT:
            for j in range(n):
                work[to, j] = np.sqrt(work[a, j])
        elif operation == _SIN:
            for j in range(n):
                work[to, j] = np.sin(work[a, j])
        else:
            for j in range(n):
                work[to, j] = np.cos(work[a, j])
