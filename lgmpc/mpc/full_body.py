"""Receding-horizon control of the whole robot by the torques of its motors.

The limits are hard constraints of an SQP, which satisfies all of them, not barriers of an FDDP. An iteration takes
longer while a push changes the active rows.
"""

import dataclasses
import time
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.actions import ContactForwardDynamics, ExternalWrench, MultibodyAction, Unknowns
from lgmpc.compile import StageKernel
from lgmpc.costs import ConstraintItem, CostItem, library
from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.interface import MeasuredState
from lgmpc.mpc.plan import Plan, PosturePlan
from lgmpc.mpc.settings import CentroidalWeights, MpcSettings
from lgmpc.mpc.sqp import SqpMpc, input_error, write_intervals
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.robot import Robot
from lgmpc.robot.scaling import weight_factor
from lgmpc.settings import Extension, NonNegative, Positive, key
from lgmpc.solvers import Solution
from lgmpc.typing import Array, BoolArray


class FullBodyWeights(CentroidalWeights):
    """Weights of the squared deviations that the full-body MPC minimises."""

    base_orientation: NonNegative = key(200.0, "Rotation of the base, 1/rad2.")
    posture: NonNegative = key(0.01, "Joints, from the reference posture, 1/rad2.")
    swing: NonNegative = key(1e3, "Feet in the air, from their way to the next foothold, 1/m2.")
    joint_velocity: NonNegative = key(0.01, "Speeds of the joints, 1/(rad/s)2.")
    effort: Positive = key(1e-3, "Joint torques, from those that hold the posture, 1/(N.m)2 (scaled by mass).")


class OwnCost(Extension):
    """A cost of one's own: a class derived from :class:`lgmpc.Residual`, called with the arguments.

    Or a function, called with the robot and the arguments, that returns a residual or a :class:`lgmpc.CostItem`.
    """

    weight: Positive = key(1.0, "Weight of the squared residual; not that of a CostItem.")


class FullBodyMpcSettings(MpcSettings):
    """Model-predictive control of the whole robot by its torques, which have limits as the forces have."""

    model: Literal["full_body"] = key("full_body", "Model that predicts.")
    rate_hz: Annotated[Positive, Field(ge=1.0, le=1e4)] = key(50.0, "Updates per second, Hz, 1 to 10000.")
    reach_rad: Positive = key(
        0.9,
        "Largest joint displacement of a plan from the reference posture, rad; below that of a stretched"
        " leg. Beyond it, the centroidal model plans instead.",
    )
    weights: FullBodyWeights = key(FullBodyWeights(), "Weights of the cost.")
    costs: tuple[OwnCost, ...] = key((), "Costs of one's own, beside those with weights.")


class FullBodyMpc(SqpMpc):
    """Plans joint torques: contact forward dynamics, with friction, normal forces and torques limited.

    State (q, v), control the torques. A foot whose flag is 1 does not move (an initial velocity is reduced to zero
    within an interval), one whose flag is 0 has no force. An external wrench acts on the base, so that plans are valid
    during a push. The limits are hard constraints of each subproblem, which has no solution where they contradict each
    other: feet that have left the ground under a push beyond the limits. Then the last plan remains in use. Plans with
    stretched legs are rejected: see :meth:`keeps_reach`.

    Args:
        robot: the robot, with a floating base and contact frames.
        settings: horizon, weights, limits.
        costs: further costs, whose weights are in the units of ``settings.weights``.

    Raises:
        InputError: the robot has no contact frames.
        MissingDependencyError: the QP solver is not installed.
        ModelError: unsupported joints.
    """

    def __init__(
        self, robot: Robot, settings: FullBodyMpcSettings | None = None, costs: Sequence[CostItem] = ()
    ) -> None:
        s = FullBodyMpcSettings() if settings is None else settings
        model, contacts = contact_point_model(robot)
        dynamics = ContactForwardDynamics(model, contacts, [ExternalWrench(model)])
        items = [
            CostItem("com", library.CoMPosition()),
            CostItem("momentum", library.CentroidalMomentum()),
            CostItem("state", library.StateError(dynamics.state)),
            CostItem("effort", library.Control(robot.nu)),
            *(CostItem(f"force{i}", library.ContactForce(frame)) for i, frame in enumerate(contacts)),
            *(CostItem(f"swing{i}", library.FrameTranslation(frame)) for i, frame in enumerate(contacts)),
            *costs,
        ]
        cones = [library.FrictionCone(frame, s.facets(robot)) for frame in contacts]
        limits = [
            *(ConstraintItem(f"cone{i}", cone, 0.0, np.inf) for i, cone in enumerate(cones)),
            ConstraintItem("effort_limit", library.Control(robot.nu), -robot.effort_limit, robot.effort_limit),
        ]
        action = MultibodyAction(f"full_body_{robot.nc}x{s.facets(robot)}", dynamics, items, limits)
        n, nc = s.nodes, robot.nc
        problem = ShootingProblem(action, n)
        problem.set("duration", s.node_s)
        super().__init__(problem, s, robot.mass, -robot.mass * robot.gravity)
        self.settings: FullBodyMpcSettings = s
        self.robot = robot
        self._efforts = holding_efforts(model, contacts, robot.q_reference)
        problem.set("contact_gains", [0.0, 1.0 / s.node_s])
        problem.set("effort_reference", self._efforts)
        w, free = s.weights, np.zeros(3)
        turn, posture = np.full(3, w.base_orientation), np.full(robot.nu, w.posture)
        motion = np.concatenate([free, turn, posture, np.zeros(6), np.full(robot.nu, w.joint_velocity)])
        centroidal = w.state(robot.mass)
        self._set_weight("com", centroidal[:3])
        self._set_weight("momentum", centroidal[3:])
        self._set_weight("state", motion)
        self._set_weight("effort", np.full(robot.nu, weight_factor(robot.mass) * w.effort))
        for i in range(nc):
            self._set_weight(f"force{i}", w.forces(1, robot.mass))
        self._feet = FootPaths(model, contacts, s.node_s)
        self._swing_weight = np.full(n + 1, w.swing / s.node_s)
        self._swing_weight[-1] = w.terminal * w.swing
        for item in costs:
            self._set_weight(item.name, item.weight)
        self._normal_force = s.normal_force(robot.mass)
        view = problem.view
        self._wrench = view("external_wrench")
        self._com_reference, self._momentum_reference = view("com_reference"), view("momentum_reference")
        self._q_reference = view("state_reference")[:, : robot.nq]
        self._swings = tuple((view(f"swing{i}_reference"), view(f"swing{i}_weight")) for i in range(nc))
        self._force_references = tuple(view(f"force{i}_reference") for i in range(nc))
        self._cones = tuple((view(f"cone{i}_lower"), view(f"cone{i}_upper")) for i in range(nc))
        self._surfaces = tuple((view(f"cone{i}_friction")[:, 0], view(f"cone{i}_normal")) for i in range(nc))
        read = StageKernel.of(_read_out, action)
        self._points = {name: np.zeros((n + 1, size)) for name, size in read.input_sizes.items()}
        self._found = {name: np.zeros((n + 1, size)) for name, size in read.output_sizes.items()}
        self._read = read.bind(n + 1, **self._points, **self._found)

    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured configuration and velocity; see :meth:`lgmpc.mpc.interface.Mpc.update`.

        The external wrench acts on the base. Contact points are those of the feet, not of the horizon.
        """
        start = time.perf_counter()
        q, v, nq, nv = state.q, state.v, self.robot.nq, self.robot.nv
        if np.shape(q) != (nq,) or np.shape(v) != (nv,):
            raise InputError("measured state", f"shapes {np.shape(q)} and {np.shape(v)}", f"q ({nq},) and v ({nv},)")
        self._load(state, contacts, reference, wrench)
        self.problem.x0[:nq], self.problem.x0[nq:] = q, v
        return self._advance(state.time, start)

    def keeps_reach(self, plan: Plan) -> bool:
        """Return whether no joint of a plan is further than ``settings.reach_rad`` from the reference, at any node."""
        assert plan.posture is not None
        return bool((np.abs(plan.posture.qs[:, 7:] - self._q_reference[:, 7:]) <= self.settings.reach_rad).all())

    def _set_weight(self, name: str, weight: Any) -> None:
        """Set a cost's weights; the action multiplies those of the running nodes by the intervals' duration."""
        s, weight = self.settings, np.asarray(weight)
        self.problem.set(f"{name}_weight", weight / s.node_s, range(s.nodes))
        self.problem.set(f"{name}_weight", s.weights.terminal * weight, [s.nodes])

    def _load(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> None:
        try:
            write_intervals(self._flags, contacts.flags)
            write_intervals(self._wrench, wrench)
            for i, (friction, normal) in enumerate(self._surfaces):
                write_intervals(friction, contacts.friction[:, i])
                write_intervals(normal, contacts.normals[:, i])
            self._com_reference[...] = reference.com
            np.multiply(reference.com_velocity, self.mass, out=self._momentum_reference[:, :3])
            self._momentum_reference[:, 3:] = state.angular_momentum(reference.angular_velocity)
            self._q_reference[...] = reference.q
        except ValueError as error:
            raise input_error(error, self.settings.nodes, self.robot.nc) from error
        ways, in_air = self._feet.ahead(state.q, state.v, contacts)
        for i, (target, weight) in enumerate(self._swings):
            target[...] = ways[:, i]
            np.multiply(self._swing_weight, in_air[:, i], out=weight[:, 0])
            weight[:, 1:] = weight[:, :1]
        lowest, highest = self._normal_force
        for i, (lower, upper) in enumerate(self._cones):
            # A foot in the air has no force, which lies strictly inside its bounds.
            flag = self._flags[:, i]
            opened = (flag - 1.0) * highest
            lower[:, :-1] = opened[:, None]
            lower[:, -1] = flag * lowest + opened
            upper[:, -1] = highest
        shares = self._shares()
        for i, desired in enumerate(self._force_references):
            desired[...] = shares[:, i]

    def _rest(self) -> Trajectory:
        n = self.settings.nodes
        return Trajectory(np.tile(self.problem.x0, (n + 1, 1)), np.tile(self._efforts, (n, 1)))

    def _describe(self, t: float, trajectory: Trajectory, result: Solution) -> Plan:
        xs, us, parameters = self._points.values()
        xs[...] = trajectory.xs
        us[:-1] = trajectory.us
        us[-1] = trajectory.us[-1]
        parameters[...] = self.problem.parameters
        self._read()
        com, momentum, vs, forces = self._found.values()
        nodes = self.settings.nodes
        plan = self._make_plan(
            t, np.hstack([com, momentum]), forces[:nodes].reshape(nodes, -1, 3) * self._flags[:nodes, :, None]
        )
        return self._with_posture(plan, trajectory.xs[:, : self.robot.nq].copy(), vs.copy())

    def _standing_plan(self, t: float) -> Plan:
        n, robot = self.settings.nodes, self.robot
        x = np.concatenate([self._com_reference[0], np.zeros(6)])
        xs, forces, q = (
            np.where(np.isfinite(array), array, otherwise)
            for array, otherwise in (
                (np.tile(x, (n + 1, 1)), 0.0),
                (self._shares()[:n], 0.0),
                (self._q_reference, robot.q_reference),
            )
        )
        plan = self._make_plan(t, xs, forces)
        return self._with_posture(plan, q, np.zeros((n + 1, robot.nv)))

    def _with_posture(self, plan: Plan, qs: Array, vs: Array) -> Plan:
        qs.flags.writeable = vs.flags.writeable = False
        return dataclasses.replace(plan, posture=PosturePlan(plan.time, plan.node_duration, qs, vs))


class FootPaths:
    """Ways of the contact points of feet in the air to their next footholds, at the nodes of a horizon.

    Each is the cubic that begins with the measured position and velocity, or at rest where the foot lifts off later,
    and ends at rest. A plan without them leaves the legs where the posture draws them, and so predicts neither their
    momentum nor where the next forces act.

    Args:
        model: with a frame at each contact point.
        contacts: names of these frames.
        dt: length of an interval, s.
    """

    def __init__(self, model: pin.Model, contacts: Sequence[str], dt: float) -> None:
        self._model, self._data, self._dt = model, model.createData(), dt
        self._frames = [model.getFrameId(name) for name in contacts]

    def ahead(self, q: Array, v: Array, contacts: ContactHorizon) -> tuple[Array, Array]:
        """Return (N+1, nc, 3) positions, world, m, and the (N+1, nc) nodes at which feet are in the air or land."""
        model, data = self._model, self._data
        pin.forwardKinematics(model, data, q, v)
        flags, (n, nc) = contacts.flags, contacts.flags.shape
        ways, in_air = np.zeros((n + 1, nc, 3)), np.zeros((n + 1, nc), dtype=np.bool_)
        swings = [(i, *swing) for i in range(nc) for swing in _swings(flags[:, i])]
        longest = max((end - begin for _, begin, end in swings if end < n), default=n)
        for i, begin, end in swings:
            if begin:
                start, velocity = contacts.points[begin - 1, i], np.zeros(3)
            else:
                frame = self._frames[i]
                start = pin.updateFramePlacement(model, data, frame).translation
                velocity = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED).linear
            target = contacts.points[end - 1, i]
            steps = end - begin if end < n else max(longest, end - begin)
            s = (np.arange(end - begin + 1) / steps)[:, None]
            left = steps * self._dt * velocity * s * (1.0 - s) ** 2
            ways[begin : end + 1, i] = start + s * s * (3.0 - 2.0 * s) * (target - start) + left
            in_air[begin : end + 1, i] = True
        return ways, in_air


def _swings(flags: BoolArray) -> list[tuple[int, int]]:
    """Return first and last node of each swing: of each run of intervals whose flag is not set."""
    changes = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=1, append=1)).tolist()
    return list(zip(changes[::2], changes[1::2], strict=True))


def contact_point_model(robot: Robot) -> tuple[pin.Model, tuple[str, ...]]:
    """Return a copy of the robot's model with a frame at each contact point, and these frames' names.

    A spherical foot touches the ground a radius below its frame. Forces act on that material point, which does not
    slip; it is that of the reference posture, from which a foot that rolls by an angle a departs by
    ``radius (1 - cos a)``.
    """
    model = robot.model.copy()
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    names = []
    for name, frame in zip(robot.contact_frames, robot.contact_ids, strict=True):
        joint = model.frames[frame].parentJoint
        point = pin.SE3(np.eye(3), data.oMf[frame].translation + robot.foot_points.lever())
        names.append(f"{name}_contact_point")
        model.addFrame(pin.Frame(names[-1], joint, frame, data.oMi[joint].inverse() * point, pin.FrameType.OP_FRAME))
    return model, tuple(names)


def holding_efforts(model: pin.Model, contacts: tuple[str, ...], q: Array) -> Array:
    """Return the (nu,) joint efforts that hold a configuration at rest, by the smallest contact forces that do."""
    data = model.createData()
    load = pin.computeGeneralizedGravity(model, data, q)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    frames = [model.getFrameId(name) for name in contacts]
    rows = [pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3] for frame in frames]
    jacobian = np.vstack(rows)
    forces = np.linalg.lstsq(jacobian[:, :6].T, load[:6])[0]
    return (load - jacobian.T @ forces)[6:]


def _read_out(action: MultibodyAction) -> ca.Function:
    """Return the quantities of plans other than states and controls, at one point."""
    sizes = {"x": action.state.nx, "u": action.nu, "p": action.parameters.size}
    x, u, p = (ca.SX.sym(name, size) for name, size in sizes.items())
    dynamics = action.dynamics
    assert isinstance(dynamics, ContactForwardDynamics)
    robot = dynamics.robot
    q, v = x[: robot.nq], x[robot.nq :]
    motion = dynamics.motion(q, v, u, action.parameters.split(p), Unknowns())
    outputs = [robot.com(q), robot.momentum(q, v), v, ca.vertcat(*motion.forces.values())]
    names = ["com", "momentum", "v", "forces"]
    return ca.Function(f"{action.name}_read_out", [x, u, p], outputs, list(sizes), names)
