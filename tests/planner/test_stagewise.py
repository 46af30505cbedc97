"""Problems stated stage by stage: known optima, and derivatives as CasADi would find them itself."""

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
    return program(stage, STAGES, {"tol": 1e-8, "max_iter": 200})


def solved(limit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    one = np.ones(STAGES + 1)
    guess = np.column_stack([np.linspace(0, DISTANCE, STAGES + 1), one, 4 * one])
    found = cart().solve(guess, np.zeros((STAGES, 1)), limit[:, None], np.array([DISTANCE]))
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
    assert cart().solve(guess, np.zeros((STAGES, 1)), limit, np.array([DISTANCE])) is None


@pytest.mark.parametrize("name", ["nlp_jac_g", "nlp_hess_l"])
def test_derivatives_are_those_that_casadi_derives_from_the_whole(name: str) -> None:
    function = cart()._function
    ours = function.get_function(name)
    outputs = {"nlp_jac_g": ["g", "jac:g:x"], "nlp_hess_l": ["grad:gamma:x", "hess:gamma:x:x"]}[name]
    inputs = ["x", "p"] if name == "nlp_jac_g" else ["x", "p", "lam:f", "lam:g"]
    theirs = function.oracle().factory("own", inputs, outputs, {"gamma": ["f", "g"]})
    random = np.random.default_rng(1)
    at = [random.normal(size=ours.size_in(i)) for i in range(ours.n_in())]
    for a, b in zip(ours(*at), theirs(*at), strict=True):
        assert np.array(ca.densify(a)) == pytest.approx(np.array(ca.densify(b)), abs=1e-12)
