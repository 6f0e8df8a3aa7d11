from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from samples import Unicycle, standing_quadruped

from lgmpc.actions import Action
from lgmpc.costs import Bounded, LeastSquares, Parameter, ParameterLayout
from lgmpc.ocp import ShootingProblem
from lgmpc.state import StateMultibody, StateVector


@pytest.fixture(scope="session")
def centroidal() -> Callable[..., ShootingProblem]:
    """Return the problem of a standing quadruped, whose weight is balanced by the reference forces."""

    def make(nodes: int = 20, facets: int = 8) -> ShootingProblem:
        problem = standing_quadruped(nodes, facets)
        problem.view("x_weight")[-1] *= 10.0
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


class Linear(Action):
    """``x+ = A x + B u + c`` with ``1/2 |x - g|^2 + 1/2 w |u|^2``, all given."""

    def __init__(self, a, b, c, name: str = "linear") -> None:
        self.a, self.b, self.c = a, b, c
        self.name = name
        self.state = StateVector(a.shape[0])
        self.nu = b.shape[1]
        self.parameters = ParameterLayout(Parameter("goal", a.shape[0], ""), Parameter("weight", 1, "of u"))

    def step(self, x, u, p):
        return ca.mtimes(ca.DM(self.a), x) + ca.mtimes(ca.DM(self.b), u) + ca.DM(self.c)

    def cost(self, x, u, p):
        s = self.parameters.split(p)
        weight = ca.vertcat(ca.SX.ones(self.state.nx), ca.repmat(s["weight"], self.nu, 1))
        return LeastSquares(ca.vertcat(x - s["goal"], u), weight)

    def terminal_cost(self, x, p):
        return LeastSquares(x - self.parameters.split(p)["goal"], 10 * ca.SX.ones(self.state.nx))

    def constraint(self, x, u, p):
        return Bounded.stack()


class Satellite(Action):
    """A free body on SE(3) controlled by torques and forces, bounded unless it is free."""

    nu = 6

    def __init__(self, bounded: bool = True) -> None:
        model = pin.Model()
        model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
        self.bounded = bounded
        self.name = f"satellite_{'bounded' if bounded else 'free'}"
        self.state = StateMultibody(model)
        self.parameters = ParameterLayout(Parameter("goal", 13, "state to reach"), Parameter("limit", 1, "of u"))

    def step(self, x, u, p):
        v = x[7:] + 0.1 * u
        return self.state.integrate_symbolic(x, ca.vertcat(0.1 * v, 0.1 * u))

    def cost(self, x, u, p):
        error = self.state.diff_symbolic(self.parameters.split(p)["goal"], x)
        return LeastSquares(ca.vertcat(error, u), ca.vertcat(*[0.1] * 12, *[0.01] * 6))

    def terminal_cost(self, x, p):
        error = self.state.diff_symbolic(self.parameters.split(p)["goal"], x)
        return LeastSquares(error, ca.vertcat(*[100.0] * 12))

    def constraint(self, x, u, p):
        limit = self.parameters.split(p)["limit"]
        if not self.bounded:
            return Bounded.stack()
        return Bounded(u, ca.repmat(-limit, 6, 1), ca.repmat(limit, 6, 1))


def unicycle_problem(nodes: int = 20) -> ShootingProblem:
    problem = ShootingProblem(Unicycle(), nodes)
    problem.set("weights", [10.0, 1.0])
    problem.set_initial_state([-1.0, -1.0, 1.0])
    return problem


def satellite_problem(bounded: bool, nodes: int = 10) -> ShootingProblem:
    problem = ShootingProblem(Satellite(bounded), nodes)
    problem.set("goal", np.concatenate([[0, 0, 0, 0, 0, 0, 1.0], np.zeros(6)]))
    problem.set("limit", 4.0)
    problem.set_initial_state(
        np.concatenate([[0.3, -0.2, 0.1], [0.5, -0.5, 0.5, 0.5], [0.1, 0.0, 0.2, 0.3, -0.4, 0.2]])
    )
    return problem


@pytest.fixture
def unicycle() -> ShootingProblem:
    return unicycle_problem()


@pytest.fixture
def satellite(monkeypatch: pytest.MonkeyPatch) -> Callable[..., ShootingProblem]:
    """Makes the problem of a satellite, and has its functions interpreted: compiling them takes seconds."""

    def make(bounded: bool, nodes: int = 10) -> ShootingProblem:
        monkeypatch.setenv("LGMPC_JIT", "0")
        return satellite_problem(bounded, nodes)

    return make


@pytest.fixture
def linear() -> Callable[..., Action]:
    """Makes a linear action from matrices."""
    return Linear
