from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from lgmpc.actions import Action, CentroidalAction, Stage, Unknowns
from lgmpc.costs import Bounded, Cost, LeastSquares, ParameterLayout
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, Trajectory, check_derivatives
from lgmpc.state import StateVector


class Pendulum(Action):
    """x+ = z with ``z - x - 0.1 sin x - u = 0``; the slope of z is taken times ``factor``, so that it can be wrong."""

    def __init__(self, factor: float) -> None:
        self.name, self.state, self.nu = "pendulum", StateVector(1), 1
        self.parameters = ParameterLayout()
        self.factor = factor

    def stage(self, x: Any, u: Any, p: Any, unknowns: Unknowns) -> Stage:
        there = x + 0.1 * ca.sin(x) + u
        z = unknowns.define(there, lambda z: z - there, lambda right: self.factor * right)
        none = ca.SX(0, 1)
        return Stage(z, LeastSquares(z, ca.SX(1)), Bounded(none, none, none))

    def step(self, x: Any, u: Any, p: Any) -> Any:
        return self.stage(x, u, p, Unknowns()).x_next

    def cost(self, x: Any, u: Any, p: Any) -> Cost:
        return self.stage(x, u, p, Unknowns()).cost

    def constraint(self, x: Any, u: Any, p: Any) -> Bounded:
        return self.stage(x, u, p, Unknowns()).path

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        return LeastSquares(x, ca.SX(1))


def test_right_derivatives_pass() -> None:
    report = check_derivatives(Pendulum(1.0))
    assert report.passed and len(report.checks) == 13
    assert "13 derivatives agree" in str(report)


@pytest.mark.parametrize("factor", [1.01, np.nan])
def test_wrong_derivatives_are_named_with_their_entry(factor: float) -> None:
    report = check_derivatives(Pendulum(factor), points=1)
    assert {check.quantity for check in report.wrong} >= {"A", "B", "q", "r"}
    assert "pendulum, node 0, A (next state by state): entry [0, 0] is" in str(report)


def test_problem_is_checked_at_every_node_of_a_trajectory() -> None:
    problem = ShootingProblem(CentroidalAction(2, 4), 3)
    rng = np.random.default_rng(0)
    problem.parameters[...] = rng.uniform(0.5, 1.0, problem.parameters.shape)
    assert check_derivatives(problem).passed
    report = check_derivatives(problem, trajectory=Trajectory(rng.standard_normal((4, 9)), rng.standard_normal((3, 6))))
    assert report.passed
    assert sorted({check.node for check in report.checks}) == [0, 1, 2, 3]


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="parameters: got shape"):
        check_derivatives(Pendulum(1.0), parameters=np.zeros(3))
    with pytest.raises(InputError, match="points: got 0; expected at least 1"):
        check_derivatives(Pendulum(1.0), points=0)
    with pytest.raises(InputError, match=r"step: got 0\.0; expected a positive number"):
        check_derivatives(Pendulum(1.0), step=0.0)
