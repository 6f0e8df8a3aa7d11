"""Problems of other robots for lgmpc and for Crocoddyl: an arm, a quadrotor, Talos; see ``paired_problems.py``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from paired_problems import Stance, weighted

from lgmpc.actions import Contact, ContactForwardDynamics, FreeForwardDynamics, MultibodyAction
from lgmpc.costs import ConstraintItem, CostItem, QuadraticBarrier
from lgmpc.costs.library import CenterOfPressure, Control, FramePlacement, FrameTranslation, StateError
from lgmpc.ocp import ShootingProblem, Trajectory


@dataclass(frozen=True)
class Pair:
    """One problem on both sides, and a guess for both."""

    ours: ShootingProblem
    theirs: Any
    guess: Trajectory

    def their_us(self, us: Any) -> list[np.ndarray]:
        """Controls (N, nu) without the columns that an interval's action does not have."""
        return [np.array(u[: action.nu]) for u, action in zip(us, self.ours.actions, strict=True)]


def paired(problem: Stance, *, theirs: bool = True) -> Pair:
    """A problem of ``paired_problems.py``; without Crocoddyl's side on request."""
    return Pair(problem.ours(), problem.theirs() if theirs else None, problem.guess())


def horizon(differential: Any, x0: np.ndarray, nodes: int, dt: float) -> Any:
    """Crocoddyl's problem of equal intervals of one model."""
    import crocoddyl

    running = crocoddyl.IntegratedActionModelEuler(differential, dt)
    terminal = crocoddyl.IntegratedActionModelEuler(differential, 0.0)
    return crocoddyl.ShootingProblem(x0, [running] * nodes, terminal)


def arm(nodes: int = 20, dt: float = 0.02) -> Pair:
    """A six-jointed arm whose hand reaches a placement."""
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
    return Pair(ours, horizon(differential, x0, nodes, dt), guess)


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
    costs = [CostItem("goal", StateError(dynamics.state, goal), w_state), CostItem("thrust", Control(4), 1e-2)]
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
    return Pair(ours, horizon(differential, x0, nodes, dt), guess)


def talos(nodes: int = 20, dt: float = 0.02, *, still: tuple[str, ...] = ("head", "arm_left", "gripper")) -> Pair:
    """Talos reaches for a place with its right hand and keeps its balance.

    On two feet, with soft limits on their centres of pressure, some of which are reached.

    Args:
        nodes: N.
        dt: length of an interval, s.
        still: beginnings of the names of the joints that do not move.
    """
    import crocoddyl

    model, q = _talos_without(still)
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
    ours = ShootingProblem(MultibodyAction(f"talos_{model.nv}", dynamics, costs), nodes)
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
            # In local axes, as in lgmpc: in world axes, Crocoddyl ignores the tilt of the sole.
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


def _talos_without(still: tuple[str, ...]) -> tuple[pin.Model, np.ndarray]:
    """Talos without some of its joints, and its half-sitting posture."""
    import example_robot_data

    model = example_robot_data.load("talos").model
    q = model.referenceConfigurations["half_sitting"]
    locked = [model.getJointId(name) for name in model.names if still and name.startswith(still)]
    reduced = pin.buildReducedModel(model, locked, q)
    kept = [model.joints[model.getJointId(name)] for name in reduced.names[1:]]
    return reduced, np.concatenate([q[joint.idx_q : joint.idx_q + joint.nq] for joint in kept])
