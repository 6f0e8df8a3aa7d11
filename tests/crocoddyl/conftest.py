"""The same problems on both sides: lgmpc's action and Crocoddyl's models, with equal first state and guess."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from paired_problems import FEET, GAINS, Stance, Trot, weighted

from lgmpc.actions import (
    Action,
    Bounded,
    Contact,
    ContactForwardDynamics,
    FreeForwardDynamics,
    ImpulseAction,
    LeastSquares,
    MultibodyAction,
    Parameter,
    ParameterLayout,
)
from lgmpc.costs import ConstraintItem, CostItem, QuadraticBarrier
from lgmpc.costs.library import CenterOfPressure, Control, FramePlacement, FrameTranslation, StateError
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
    weighted(theirs, "hand", placement, 10.0 * np.ones(6))
    weighted(theirs, "posture", crocoddyl.ResidualModelState(state, x0, nv), w_state)
    weighted(theirs, "effort", crocoddyl.ResidualModelControl(state, nv), 1e-3 * np.ones(nv))
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
    weighted(theirs, "goal", crocoddyl.ResidualModelState(state, goal, 4), w_state)
    weighted(theirs, "thrust", crocoddyl.ResidualModelControl(state, 4), 1e-2 * np.ones(4))
    differential = crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, theirs)
    if bounds is not None:
        differential.u_lb, differential.u_ub = np.full(4, bounds[0]), np.full(4, bounds[1])
    hover = np.full(4, 1.5 * 9.81 / 4)
    guess = Trajectory(np.tile(x0, (nodes + 1, 1)), np.tile(hover, (nodes, 1)))
    return Pair(ours, _horizon(differential, x0, nodes, dt), guess)


def paired(problem: Stance) -> Pair:
    """One of the problems that scripts/bench_optimiser.py times."""
    return Pair(problem.ours(), problem.theirs(), problem.guess())


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


def talos(nodes: int = 20, dt: float = 0.02) -> Pair:
    """Talos reaches for a place with its right hand and keeps its balance.

    On two feet, with soft limits on their centres of pressure, some of which are reached. Head, left arm and fingers
    are still.
    """
    import crocoddyl

    model, q = talos_with_one_arm()
    data, soles, hand = model.createData(), ("left_sole_link", "right_sole_link"), "gripper_right_base_link"
    pin.framesForwardKinematics(model, data, q)
    held = [data.oMf[model.getFrameId(sole)].copy() for sole in soles]
    goal = data.oMf[model.getFrameId(hand)].translation + [0.25, -0.05, 0.25]
    x0, nv = np.concatenate([q, np.zeros(model.nv)]), model.nv
    nu, half_size, gains = nv - 6, (0.03, 0.02), np.array([0.0, 20.0])
    w_state = np.concatenate([0.1 * np.ones(3), np.ones(3), 0.2 * np.ones(nu), 0.1 * np.ones(nv)])
    inside = QuadraticBarrier(0.0, np.inf)
    dynamics = ContactForwardDynamics(model, [Contact(sole, 6) for sole in soles])
    costs = [
        CostItem("hand", FrameTranslation(hand, goal), 100.0),
        CostItem("posture", StateError(dynamics.state, x0), w_state),
        CostItem("effort", Control(nu), 1e-4),
        *(CostItem(f"cop_{i}", CenterOfPressure(sole, half_size), 0.1, inside) for i, sole in enumerate(soles)),
    ]
    ours = ShootingProblem(MultibodyAction("talos", dynamics, costs), nodes)
    ours.set("duration", dt)
    ours.set("contact_points", np.concatenate([place.translation for place in held]))
    ours.set("contact_orientations", np.concatenate([pin.Quaternion(place.rotation).coeffs() for place in held]))
    ours.set("contact_gains", gains)
    ours.set_initial_state(x0)

    state = crocoddyl.StateMultibody(model)
    actuation = crocoddyl.ActuationModelFloatingBase(state)

    def stage(*, last: bool) -> Any:
        contacts, theirs = crocoddyl.ContactModelMultiple(state, nu), crocoddyl.CostModelSum(state, nu)
        support = crocoddyl.CoPSupport(np.eye(3), 2.0 * np.array(half_size))
        for sole, place in zip(soles, held, strict=True):
            frame = model.getFrameId(sole)
            # In local axes, as ours has it: in the world's, Crocoddyl takes no notice of how the sole is tilted.
            contacts.addContact(sole, crocoddyl.ContactModel6D(state, frame, place, pin.LOCAL, nu, gains))
            if not last:
                bounds = crocoddyl.ActivationBounds(support.lb, support.ub)
                pressure = crocoddyl.ResidualModelContactCoPPosition(state, frame, support, nu)
                barrier = crocoddyl.ActivationModelQuadraticBarrier(bounds)
                theirs.addCost(f"cop_{sole}", crocoddyl.CostModelResidual(state, barrier, pressure), 0.1)
        place = crocoddyl.ResidualModelFrameTranslation(state, model.getFrameId(hand), goal, nu)
        weighted(theirs, "hand", place, 100.0 * np.ones(3))
        weighted(theirs, "posture", crocoddyl.ResidualModelState(state, x0, nu), w_state)
        weighted(theirs, "effort", crocoddyl.ResidualModelControl(state, nu), 1e-4 * np.ones(nu))
        return crocoddyl.DifferentialActionModelContactFwdDynamics(state, actuation, contacts, theirs, 0.0, True)

    running = crocoddyl.IntegratedActionModelEuler(stage(last=False), dt)
    terminal = crocoddyl.IntegratedActionModelEuler(stage(last=True), 0.0)
    problem = crocoddyl.ShootingProblem(x0, [running] * nodes, terminal)
    us = np.array(problem.quasiStatic([x0] * nodes))
    return Pair(ours, problem, Trajectory(np.tile(x0, (nodes + 1, 1)), us))


def talos_with_one_arm() -> tuple[pin.Model, np.ndarray]:
    """Talos' legs, torso and right arm, and its half-sitting posture."""
    import example_robot_data

    model = example_robot_data.load("talos").model
    q = model.referenceConfigurations["half_sitting"]
    still = [model.getJointId(n) for n in model.names if n.startswith(("head", "arm_left", "gripper"))]
    reduced = pin.buildReducedModel(model, still, q)
    kept = [model.joints[model.getJointId(name)] for name in reduced.names[1:]]
    return reduced, np.concatenate([q[joint.idx_q : joint.idx_q + joint.nq] for joint in kept])


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
