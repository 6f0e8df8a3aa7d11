"""The same problems on both sides: lgmpc's action and Crocoddyl's models, with equal first state and guess."""

from __future__ import annotations

import runpy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import (
    Action,
    Bounded,
    FreeForwardDynamics,
    ImpulseAction,
    LeastSquares,
    MultibodyAction,
    Parameter,
    ParameterLayout,
)
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import Control, FramePlacement, StateError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.state import StateVector


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "crocoddyl: compares with Crocoddyl, from the extra 'bench'")


@dataclass(frozen=True)
class Pair:
    """One problem on both sides, and a guess for both."""

    ours: ShootingProblem
    theirs: Any
    guess: Trajectory

    def their_us(self, us: Any) -> list[np.ndarray]:
        """Controls (N, nu) without the columns that an interval's action does not have."""
        return [np.array(u[: action.nu]) for u, action in zip(us, self.ours.actions, strict=True)]


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


def _horizon(differential: Any, x0: np.ndarray, nodes: int, dt: float) -> Any:
    import crocoddyl

    running = crocoddyl.IntegratedActionModelEuler(differential, dt)
    terminal = crocoddyl.IntegratedActionModelEuler(differential, 0.0)
    return crocoddyl.ShootingProblem(x0, [running] * nodes, terminal)


def _add(costs: Any, state: Any, name: str, residual: Any, weights: np.ndarray) -> None:
    import crocoddyl

    activation = crocoddyl.ActivationModelWeightedQuad(weights)
    costs.addCost(name, crocoddyl.CostModelResidual(state, activation, residual), 1.0)


def arm(nodes: int = 20, dt: float = 0.02) -> Pair:
    """A six-jointed arm whose hand is drawn to a placement."""
    import crocoddyl

    model = pin.buildSampleModelManipulator()
    nv, hand = model.nv, model.frames[-1].name
    data = model.createData()
    q = pin.integrate(model, pin.neutral(model), 0.3 * np.ones(nv))
    pin.framesForwardKinematics(model, data, pin.integrate(model, q, np.array([0.4, -0.3, 0.5, 0.2, -0.4, 0.3])[:nv]))
    goal = data.oMf[model.getFrameId(hand)].copy()
    x0 = np.concatenate([q, np.zeros(nv)])
    pose = np.concatenate([goal.translation, pin.Quaternion(goal.rotation).coeffs()])
    w_state = np.concatenate([1e-2 * np.ones(nv), 1e-1 * np.ones(nv)])
    dynamics = FreeForwardDynamics(model)
    costs = [
        CostItem("hand", FramePlacement(hand, pose), 10.0),
        CostItem("posture", StateError(dynamics.state, x0), w_state),
        CostItem("effort", Control(nv), 1e-3),
    ]
    ours = ShootingProblem(MultibodyAction("arm", dynamics, costs), nodes)
    ours.set("duration", dt)
    ours.set_initial_state(x0)

    state = crocoddyl.StateMultibody(model)
    actuation = crocoddyl.ActuationModelFull(state)
    theirs = crocoddyl.CostModelSum(state, nv)
    placement = crocoddyl.ResidualModelFramePlacement(state, model.getFrameId(hand), goal, nv)
    _add(theirs, state, "hand", placement, 10.0 * np.ones(6))
    _add(theirs, state, "posture", crocoddyl.ResidualModelState(state, x0, nv), w_state)
    _add(theirs, state, "effort", crocoddyl.ResidualModelControl(state, nv), 1e-3 * np.ones(nv))
    differential = crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, theirs)
    gravity = pin.rnea(model, data, q, np.zeros(nv), np.zeros(nv))
    guess = Trajectory(np.tile(x0, (nodes + 1, 1)), np.tile(gravity, (nodes, 1)))
    return Pair(ours, _horizon(differential, x0, nodes, dt), guess)


def quadrotor(nodes: int = 30, dt: float = 0.03, bounds: tuple[float, float] | None = None) -> Pair:
    """A rigid body with four thrusters that flies to a place and yaw."""
    import crocoddyl

    model = pin.Model()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.appendBodyToJoint(1, pin.Inertia(1.5, np.zeros(3), np.diag([0.03, 0.03, 0.05])), pin.SE3.Identity())
    places = np.array([[0.2, 0.2, 0.0], [0.2, -0.2, 0.0], [-0.2, -0.2, 0.0], [-0.2, 0.2, 0.0]])
    drag = 0.05 * np.array([1.0, -1.0, 1.0, -1.0])  # the turning moment per thrust
    thrust = np.array([[0, 0, 1, p[1], -p[0], d] for p, d in zip(places, drag, strict=True)]).T
    x0 = np.concatenate([[0, 0, 0, 0, 0, 0, 1.0], np.zeros(6)])
    turn = pin.Quaternion(pin.exp3(np.array([0.0, 0.0, 2.0]))).coeffs()
    goal = np.concatenate([[1.0, -0.5, 0.8], turn, np.zeros(6)])
    w_state = np.concatenate([5.0 * np.ones(3), 2.0 * np.ones(3), 0.5 * np.ones(6)])
    dynamics = FreeForwardDynamics(model, thrust)
    costs = [
        CostItem("goal", StateError(dynamics.state, goal), w_state),
        CostItem("thrust", Control(4), 1e-2),
    ]
    limits = [] if bounds is None else [ConstraintItem("limits", Control(4), *bounds)]
    name = "quadrotor" if bounds is None else "quadrotor_bounded"
    ours = ShootingProblem(MultibodyAction(name, dynamics, costs, limits), nodes)
    ours.set("duration", dt)
    ours.set_initial_state(x0)

    state = crocoddyl.StateMultibody(model)
    turning = {True: crocoddyl.ThrusterType.CW, False: crocoddyl.ThrusterType.CCW}
    thrusters = [
        crocoddyl.Thruster(pin.SE3(np.eye(3), place), abs(d), turning[d > 0])
        for place, d in zip(places, drag, strict=True)
    ]
    actuation = crocoddyl.ActuationModelFloatingBaseThrusters(state, thrusters)
    theirs = crocoddyl.CostModelSum(state, 4)
    _add(theirs, state, "goal", crocoddyl.ResidualModelState(state, goal, 4), w_state)
    _add(theirs, state, "thrust", crocoddyl.ResidualModelControl(state, 4), 1e-2 * np.ones(4))
    differential = crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, theirs)
    if bounds is not None:
        differential.u_lb, differential.u_ub = np.full(4, bounds[0]), np.full(4, bounds[1])
    hover = np.full(4, 1.5 * 9.81 / 4)
    guess = Trajectory(np.tile(x0, (nodes + 1, 1)), np.tile(hover, (nodes, 1)))
    return Pair(ours, _horizon(differential, x0, nodes, dt), guess)


def stance() -> Pair:
    """Solo12 on four feet, pushed, moves its centre of mass: what scripts/bench_solver.py times."""
    path = Path(__file__).parents[2] / "scripts" / "bench_solver.py"
    module = runpy.run_path(str(path))
    numbers = module["Stance"].make()
    return Pair(numbers.ours(), numbers.theirs(), numbers.guess())


def hop() -> Pair:
    """Solo12 stands, flies, lands and stands: switched contacts, and an impact that has no control."""
    import crocoddyl

    module = runpy.run_path(str(Path(__file__).parents[2] / "scripts" / "bench_solver.py"))
    numbers, feet, gains = module["Stance"].make(), module["FEET"], module["GAINS"]
    robot, dt, nodes = numbers.robot, 0.015, 17
    model, nu = robot.model, robot.nv - 6
    flying, landing = range(6, 10), 10
    x0, x_ref = numbers.x_reference, numbers.x_reference
    w_impact = np.concatenate([np.zeros(3), np.ones(3 + nu), 0.1 * np.ones(6 + nu)])
    one = numbers.ours().action
    impact = ImpulseAction("impact", model, feet, [CostItem("posture", StateError(one.state, x_ref), w_impact)])
    ours = ShootingProblem([impact if k == landing else one for k in range(nodes)], terminal=one)
    ours.set("duration", dt)
    ours.set("contact_points", numbers.feet.ravel())
    ours.set("contact_gains", gains)
    ours.set("contact_flags", 0.0, nodes=list(flying))
    ours.set_initial_state(x0)

    stand = numbers.theirs().terminalModel.differential
    state, costs = stand.state, stand.costs
    actuation = crocoddyl.ActuationModelFloatingBase(state)
    none = crocoddyl.ContactModelMultiple(state, nu)
    fly = crocoddyl.DifferentialActionModelContactFwdDynamics(state, actuation, none, costs, 0.0, True)
    impulses = crocoddyl.ImpulseModelMultiple(state)
    for name, frame in zip(feet, robot.contact_ids, strict=True):
        impulses.addImpulse(name, crocoddyl.ImpulseModel3D(state, frame, pin.LOCAL_WORLD_ALIGNED))
    paid = crocoddyl.CostModelSum(state, 0)
    _add(paid, state, "posture", crocoddyl.ResidualModelState(state, x_ref, 0), w_impact)
    land = crocoddyl.ActionModelImpulseFwdDynamics(state, impulses, paid, 0.0, 0.0, True)
    models = [
        land if k == landing else crocoddyl.IntegratedActionModelEuler(fly if k in flying else stand, dt)
        for k in range(nodes)
    ]
    theirs = crocoddyl.ShootingProblem(x0, models, crocoddyl.IntegratedActionModelEuler(stand, 0.0))
    us = np.tile(numbers.guess().us[0], (nodes, 1))
    us[landing] = 0.0
    return Pair(ours, theirs, Trajectory(np.tile(x0, (nodes + 1, 1)), us))


PROBLEMS = {"solo12 hop": hop, "unicycle": unicycle, "arm": arm, "quadrotor": quadrotor, "solo12 stance": stance}


@pytest.fixture(params=PROBLEMS)
def pair(request: pytest.FixtureRequest) -> Pair:
    pytest.importorskip("crocoddyl")
    return PROBLEMS[request.param]()


@pytest.fixture
def bounded_quadrotor() -> Pair:
    pytest.importorskip("crocoddyl")
    return quadrotor(bounds=(1.0, 6.0))
