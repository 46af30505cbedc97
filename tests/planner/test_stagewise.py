"""Problems stated stage by stage: known optima, and those that another solver finds."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from planner.stagewise import Program, Rows, Stage, program

STAGES, DISTANCE = 10, 3.0


def cart() -> Program:
    """A mass is moved from rest to rest in the least time, its acceleration within ±1, its speed below a
    limit of each stage; the time of all is a state."""
    x, u, own, shared = (ca.SX.sym(name, size) for name, size in (("x", 3), ("u", 1), ("p", 1), ("d", 1)))
    place, speed, time = ca.vertsplit(x)
    h = time / STAGES
    stage = Stage(
        x, u, own, shared,
        after=ca.vertcat(place + h * speed + h**2 / 2 * u, speed + h * u, time),
        cost=1e-9 * u**2,
        held=[Rows([u], -1, 1)],
        first=[Rows([place, speed], 0, 0), Rows([time], 0.1, 100)],
        later=[Rows([speed - own], -math.inf, 0)],
        last=[Rows([place - shared, speed], 0, 0)],
        last_cost=time,
    )  # fmt: skip
    return program(stage, 1e-8, 1e-2)


def solved(limit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    one = np.ones(STAGES + 1)
    guess = np.column_stack([np.linspace(0, DISTANCE, STAGES + 1), one, 4 * one])
    found = cart().solve(guess, np.zeros((STAGES, 1)), limit[:, None], np.array([DISTANCE]), 200)
    assert found is not None
    return found


def test_a_mass_moves_from_rest_to_rest_in_the_least_time_that_is_known() -> None:
    states, controls = solved(np.full(STAGES, 100.0))
    assert states[-1, 2] == pytest.approx(2 * math.sqrt(DISTANCE), rel=1e-5)
    assert controls[:, 0] == pytest.approx(np.repeat([1.0, -1.0], STAGES // 2), abs=1e-3)
    assert states[-1, :2] == pytest.approx([DISTANCE, 0.0], abs=1e-6)


def test_parameters_of_a_stage_hold_at_that_stage_alone_and_not_at_the_first() -> None:
    limit = np.full(STAGES, 100.0)
    limit[[0, 5]] = -1.0, 0.5  # the speed at the beginning is 0: above -1
    states, _ = solved(limit)
    assert states[5, 1] == pytest.approx(0.5, abs=1e-5)
    assert states[4, 1] > 0.6
    assert states[6, 1] > 0.6


def test_what_cannot_be_is_no_solution() -> None:
    guess = np.ones((STAGES + 1, 3))
    limit = np.full((STAGES, 1), -1.0)  # never forwards, but to a place ahead
    assert cart().solve(guess, np.zeros((STAGES, 1)), limit, np.array([DISTANCE]), 200) is None


def test_too_few_iterations_are_no_solution() -> None:
    guess = np.ones((STAGES + 1, 3))
    given = guess, np.zeros((STAGES, 1)), np.full((STAGES, 1), 100.0), np.array([DISTANCE])
    assert cart().solve(*given, 2) is None
    assert cart().solve(*given, 50) is not None


def test_where_to_begin_may_be_left_open() -> None:
    """From any speed up to 0.5, the fastest is the quickest way there."""
    x, u, none, shared = (ca.SX.sym(name, size) for name, size in (("x", 3), ("u", 1), ("p", 0), ("d", 1)))
    place, speed, time = ca.vertsplit(x)
    h = time / STAGES
    stage = Stage(
        x, u, none, shared,
        after=ca.vertcat(place + h * speed + h**2 / 2 * u, speed + h * u, time),
        cost=1e-9 * u**2,
        held=[Rows([u], -1, 1)],
        first=[Rows([place], 0, 0), Rows([speed], 0, 0.5), Rows([time], 0.1, 100)],
        later=[],
        last=[Rows([place - shared, speed], 0, 0)],
        last_cost=time,
    )  # fmt: skip
    guess = np.column_stack([np.linspace(0, DISTANCE, STAGES + 1), *np.ones((2, STAGES + 1))])
    found = program(stage, 1e-8, 1e-2).solve(
        guess, np.zeros((STAGES, 1)), np.zeros((STAGES, 0)), np.array([DISTANCE]), 200
    )
    assert found is not None
    # 0.5 at first, up to v at t1, down to rest: v = 0.5 + t1 and (v² - 0.25)/2 + v²/2 = 3.
    top = math.sqrt(DISTANCE + 0.125)
    # Controls change at stages only: a little later than that.
    assert 2 * top - 0.5 <= found[0][-1, 2] <= 1.01 * (2 * top - 0.5)
    assert found[0][0, 1] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_curved_problem_has_the_optimum_that_ipopt_finds(seed: int) -> None:
    """A car among two discs: a problem that is not convex, with rows of every kind."""
    random = np.random.default_rng(seed)
    discs = np.array([[0.8, 0.4], [2.0, -0.3]]) + random.uniform(-0.2, 0.2, (2, 2))
    n = 16
    x, u, own, shared = (ca.SX.sym(name, size) for name, size in (("x", 5), ("u", 2), ("p", 1), ("d", 4)))
    px, py, heading, speed, time = ca.vertsplit(x)
    h = time / n
    middle = heading + h / 2 * speed * u[1]
    after = ca.vertcat(
        px + h * speed * ca.cos(middle), py + h * speed * ca.sin(middle), heading + h * speed * u[1],
        speed + h * u[0], time,
    )  # fmt: skip
    gaps = [(px - shared[2 * i]) ** 2 + (py - shared[2 * i + 1]) ** 2 for i in range(2)]
    stage = Stage(
        x, u, own, shared, after,
        cost=1e-3 * ca.sumsqr(u),
        held=[Rows([u, speed], -1, 1)],
        first=[Rows([px, py, heading, speed], 0, 0), Rows([time], 0.1, 100)],
        later=[Rows(gaps, 0.16, math.inf)],
        last=[Rows([px - 3, py, heading, speed], 0, 0)],
        last_cost=time,
    )  # fmt: skip
    along = np.linspace(0, 1, n + 1)
    guess = np.column_stack([3 * along, 0 * along, 0 * along, 0 * along + 0.6, 0 * along + 5])
    found = program(stage, 1e-8, 1e-2).solve(guess, np.zeros((n, 2)), np.zeros((n, 1)), discs.ravel(), 300)
    assert found is not None

    step = ca.Function("step", [x, u], [after])
    opti = ca.Opti()
    states, controls = opti.variable(5, n + 1), opti.variable(2, n)
    opti.minimize(states[4, n] + 1e-3 * ca.sumsqr(controls))
    for k in range(n):
        opti.subject_to(states[:, k + 1] == step(states[:, k], controls[:, k]))
        if k > 0:
            for disc in discs:
                opti.subject_to(ca.sumsqr(states[:2, k] - disc) >= 0.16)
    opti.subject_to(opti.bounded(-1, ca.vec(controls), 1))
    opti.subject_to(opti.bounded(-1, ca.vec(states[3, :n]), 1))
    opti.subject_to(opti.bounded(0.1, states[4, 0], 100))
    opti.subject_to(states[:4, 0] == 0)
    opti.subject_to(states[:4, n] == ca.DM([3, 0, 0, 0]))
    # Near ours, so that it is a matter of the optimum, not of which one.
    opti.set_initial(states, found[0].T)
    opti.set_initial(controls, found[1].T)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes", "tol": 1e-9})
    solution = opti.solve()
    assert found[0][-1, 4] == pytest.approx(float(solution.value(states[4, n])), abs=1e-5)
    assert found[0] == pytest.approx(solution.value(states).T, abs=2e-3)
