"""The same problems on both sides: lgmpc's action and Crocoddyl's models, with equal first state and guess."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from paired_problems import ANYMAL_GAITS, FEET, GAINS, Stance, Trot, anymal_gait, weighted
from paired_robots import Pair, arm, horizon, paired, quadrotor, talos
from samples import Unicycle

from lgmpc.actions import Contact, ContactForwardDynamics, ImpulseAction, MultibodyAction
from lgmpc.costs import CostItem
from lgmpc.costs.library import Control, StateError
from lgmpc.ocp import ShootingProblem, Trajectory


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "crocoddyl: compares with Crocoddyl, from the extra 'bench'")


def unicycle() -> Pair:
    import crocoddyl

    ours = ShootingProblem(Unicycle("their_unicycle"), 20)
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


def planar_biped() -> pin.Model:
    """A trunk that moves in the plane of x and z, with two legs of two joints."""
    model, joint = pin.Model(), 0
    for name, kind in (("x", pin.JointModelPX()), ("z", pin.JointModelPZ()), ("pitch", pin.JointModelRY())):
        joint = model.addJoint(joint, kind, pin.SE3.Identity(), name)
    model.appendBodyToJoint(joint, pin.Inertia(2.0, np.array([0.02, 0.0, 0.1]), 0.02 * np.eye(3)), pin.SE3.Identity())
    down = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.2]))
    for side in ("left", "right"):
        hip = model.addJoint(joint, pin.JointModelRY(), pin.SE3.Identity(), f"hip_{side}")
        knee = model.addJoint(hip, pin.JointModelRY(), down, f"knee_{side}")
        for part in (hip, knee):
            shank = pin.Inertia(0.2, np.array([0.01, 0.0, -0.1]), 1e-3 * np.eye(3))
            model.appendBodyToJoint(part, shank, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"foot_{side}", knee, down, pin.FrameType.OP_FRAME))
    return model


def planar_stance(nodes: int = 15, dt: float = 0.02) -> Pair:
    """The planar biped moves its trunk on feet that hold x and z, each with a damping of its own."""
    import crocoddyl

    model, feet, dampings = planar_biped(), ("foot_left", "foot_right"), (20.0, 5.0)
    nv = model.nv
    q = np.array([0.0, 0.33, 0.1, 0.5, -1.1, 0.9, -1.2])
    x0 = np.concatenate([q, np.zeros(nv)])
    goal = x0 + np.concatenate([[0.05, -0.04, -0.1], np.zeros(4 + nv)])
    w_state = np.concatenate([np.full(3, 50.0), np.full(4, 0.1), np.full(nv, 0.1)])
    dynamics = ContactForwardDynamics(model, [Contact(foot, 2) for foot in feet])
    costs = [CostItem("posture", StateError(dynamics.state, goal), w_state), CostItem("effort", Control(nv), 1e-3)]
    ours = ShootingProblem(MultibodyAction("planar_stance", dynamics, costs), nodes)
    ours.set("duration", dt)
    ours.set("contact_gains", np.column_stack([np.zeros(2), dampings]).ravel())
    ours.set_initial_state(x0)

    state = crocoddyl.StateMultibody(model)
    contacts, sums = crocoddyl.ContactModelMultiple(state, nv), crocoddyl.CostModelSum(state, nv)
    for foot, damping in zip(feet, dampings, strict=True):
        # In the foot's axes, whose x and z span the same plane; a stiffness would mix them with the world's.
        gains = np.array([0.0, damping])
        contacts.addContact(foot, crocoddyl.ContactModel2D(state, model.getFrameId(foot), np.zeros(2), nv, gains))
    weighted(sums, "posture", crocoddyl.ResidualModelState(state, goal, nv), w_state)
    weighted(sums, "effort", crocoddyl.ResidualModelControl(state, nv), np.full(nv, 1e-3))
    actuation = crocoddyl.ActuationModelFull(state)
    stand = crocoddyl.DifferentialActionModelContactFwdDynamics(state, actuation, contacts, sums, 0.0, True)
    return Pair(ours, horizon(stand, x0, nodes, dt), Trajectory(np.tile(x0, (nodes + 1, 1)), np.zeros((nodes, nv))))


TAME = {
    "solo12 hop": hop,
    "planar stance": planar_stance,
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
