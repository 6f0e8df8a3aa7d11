from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from lgmpc.actions import Action, Bounded, CentroidalAction, LeastSquares, Parameter, ParameterLayout
from lgmpc.ocp import ShootingProblem
from lgmpc.state import StateVector

FEET = np.array([[0.2, 0.15, 0.0], [0.2, -0.15, 0.0], [-0.2, 0.15, 0.0], [-0.2, -0.15, 0.0]])
STANDING = np.array([0.0, 0.0, 0.24, 0, 0, 0, 0, 0, 0])


@pytest.fixture(scope="session")
def centroidal() -> Callable[..., ShootingProblem]:
    """Makes the problem of a standing quadruped; its weight is carried when all forces are the reference."""

    def make(nodes: int = 20, facets: int = 8) -> ShootingProblem:
        problem = ShootingProblem(CentroidalAction(4, facets), nodes)
        for name, value in {
            "mass": 2.5,
            "gravity": [0.0, 0.0, -9.81],
            "duration": 0.02,
            "contact_points": FEET.ravel(),
            "contact_flags": 1.0,
            "friction": 0.6,
            "normal_force_min": 0.5,
            "normal_force_max": 25.0,
            "x_reference": STANDING,
            "u_reference": np.tile([0.0, 0.0, 2.5 * 9.81 / 4], 4),
            "x_weight": [1e3] * 3 + [10.0] * 3 + [1e3] * 3,
            "u_weight": 1e-3,
        }.items():
            problem.set(name, value)
        problem.view("x_weight")[-1] *= 10.0
        problem.set_initial_state(STANDING)
        return problem

    return make


class Cart(Action):
    """A damped cart with rows and cost terms that couple state and control, a bound on the state and none above."""

    def __init__(self) -> None:
        self.name = "cart"
        self.state = StateVector(2)
        self.nu = 1
        self.parameters = ParameterLayout(Parameter("limit", 3, "of the rows"), Parameter("target", 1, "position"))

    def step(self, x, u, p):
        return ca.vertcat(x[0] + 0.1 * x[1], 0.9 * x[1] + 0.1 * u[0] + 0.02 * ca.sin(x[0]))

    def cost(self, x, u, p):
        s = self.parameters.split(p)
        residual = ca.vertcat(x[0] - s["target"], x[1] + 0.5 * u[0], u[0])
        return LeastSquares(residual, ca.vertcat(3.0, 0.2, 0.1))

    def terminal_cost(self, x, p):
        return LeastSquares(ca.vertcat(x[0] - self.parameters.split(p)["target"], x[1]), ca.vertcat(5.0, 1.0))

    def constraint(self, x, u, p):
        limit = self.parameters.split(p)["limit"]
        return Bounded(
            ca.vertcat(u[0], x[1] + 0.1 * u[0], u[0] + 0.3 * x[1]),
            ca.vertcat(-limit[0], -limit[1], -ca.inf),
            ca.vertcat(limit[0], limit[1], limit[2]),
        )


@pytest.fixture
def cart() -> ShootingProblem:
    problem = ShootingProblem(Cart(), 8)
    problem.set("limit", [2.0, 0.6, 1.5])
    problem.set("target", 1.0)
    problem.set_initial_state([0.1, 0.2])
    return problem
