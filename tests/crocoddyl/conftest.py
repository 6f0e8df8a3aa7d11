"""The same problems on both sides: lgmpc's action and Crocoddyl's models, with equal first state and guess."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from paired_problems import ANYMAL_GAITS, FEET, GAINS, Stance, Trot, anymal_gait, weighted
from paired_robots import Pair, arm, paired, quadrotor, talos

from lgmpc.actions import (
    Action,
    Bounded,
    ImpulseAction,
    LeastSquares,
    Parameter,
    ParameterLayout,
)
from lgmpc.costs import CostItem
from lgmpc.costs.library import StateError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.state import StateVector


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "crocoddyl: compares with Crocoddyl, from the extra 'bench'")


class Unicycle(Action):
    """Crocoddyl's ActionModelUnicycle."""

    name, nu = "their_unicycle", 2

    def __init__(self) -> None:
        self.state = StateVector(3)
        self.parameters = ParameterLayout(Parameter("weights", 2, "of state and control, squared in the cost"))

    def step(self, x, u, p):
        return x + 0.1 * ca.vertcat(ca.cos(x[2]) * u[0], ca.sin(x[2]) * u[0], u[1])

    def cost(self, x, u, p):
        return LeastSquares(ca.vertcat(x, u), ca.vertcat(*[p[0] ** 2] * 3, *[p[1] ** 2] * 2))

    def terminal_cost(self, x, p):
        return LeastSquares(x, ca.vertcat(*[p[0] ** 2] * 3))

    def constraint(self, x, u, p):
        return Bounded.stack()


def unicycle() -> Pair:
    import crocoddyl

    ours = ShootingProblem(Unicycle(), 20)
    ours.set("weights", [10.0, 1.0])
    ours.set_initial_state([-1.0, -1.0, 1.0])
    model = crocoddyl.ActionModelUnicycle()
    theirs = crocoddyl.ShootingProblem(ours.x0, [model] * 20, model)
    rng = np.random.default_rng(0)
    guess = Trajectory(rng.standard_normal((21, 3)), rng.standard_normal((20, 2)))
    guess.xs[0] = ours.x0
    return Pair(ours, theirs, guess)


def hop() -> Pair:
    """Solo12 stands, flies, lands and stands: switched contacts, and an impact that has no control."""
    import crocoddyl

    dt, nodes = 0.015, 17
    numbers = Stance(nodes, dt)
    model, nu, x_ref = numbers.robot.model, numbers.robot.nv - 6, numbers.x_reference
    flying, landing = range(6, 10), 10
    w_impact = np.concatenate([np.zeros(3), np.ones(3 + nu), 0.1 * np.ones(6 + nu)])
    one = numbers.ours().action
    impact = ImpulseAction("impact", model, FEET, [CostItem("posture", StateError(one.state, x_ref), w_impact)])
    ours = ShootingProblem([impact if k == landing else one for k in range(nodes)], terminal=one)
    ours.set("duration", dt)
    ours.set("contact_points", numbers.feet.ravel())
    ours.set("contact_gains", GAINS)
    ours.set("contact_flags", 0.0, nodes=list(flying))
    ours.set_initial_state(x_ref)

    stand = numbers.theirs().terminalModel.differential
    state, costs = stand.state, stand.costs
    actuation = crocoddyl.ActuationModelFloatingBase(state)
    none = crocoddyl.ContactModelMultiple(state, nu)
    fly = crocoddyl.DifferentialActionModelContactFwdDynamics(state, actuation, none, costs, 0.0, True)
    impulses = crocoddyl.ImpulseModelMultiple(state)
    for name, frame in zip(FEET, numbers.robot.contact_ids, strict=True):
        impulses.addImpulse(name, crocoddyl.ImpulseModel3D(state, frame, pin.LOCAL_WORLD_ALIGNED))
    paid = crocoddyl.CostModelSum(state, 0)
    weighted(paid, "posture", crocoddyl.ResidualModelState(state, x_ref, 0), w_impact)
    land = crocoddyl.ActionModelImpulseFwdDynamics(state, impulses, paid, 0.0, 0.0, True)
    models = [
        land if k == landing else crocoddyl.IntegratedActionModelEuler(fly if k in flying else stand, dt)
        for k in range(nodes)
    ]
    theirs = crocoddyl.ShootingProblem(x_ref, models, crocoddyl.IntegratedActionModelEuler(stand, 0.0))
    us = np.tile(numbers.guess().us[0], (nodes, 1))
    us[landing] = 0.0
    return Pair(ours, theirs, Trajectory(np.tile(x_ref, (nodes + 1, 1)), us))


TAME = {
    "solo12 hop": hop,
    "unicycle": unicycle,
    "arm": arm,
    "quadrotor": quadrotor,
    "solo12 stance": lambda: paired(Stance()),
}
PROBLEMS = {**TAME, "solo12 trot": lambda: paired(Trot()), "talos": talos}


@pytest.fixture(params=[pytest.param(n, marks=pytest.mark.slow) if n == "talos" else n for n in PROBLEMS])
def pair(request: pytest.FixtureRequest) -> Pair:
    pytest.importorskip("crocoddyl")
    return PROBLEMS[request.param]()


@pytest.fixture(params=TAME)
def tame_pair(request: pytest.FixtureRequest) -> Pair:
    """Problems whose guess can be rolled out without feedback: on two feet, or with one arm ahead, a robot falls."""
    pytest.importorskip("crocoddyl")
    return PROBLEMS[request.param]()


@pytest.fixture
def bounded_quadrotor() -> Pair:
    pytest.importorskip("crocoddyl")
    return quadrotor(bounds=(1.0, 6.0))


@pytest.fixture(params=ANYMAL_GAITS)
def gait(request: pytest.FixtureRequest) -> Pair:
    pytest.importorskip("crocoddyl")
    return paired(anymal_gait(request.param))
