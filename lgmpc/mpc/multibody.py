"""The base of predictive controllers whose models have base and joints: contact points, costs, references, plans."""

from __future__ import annotations

import dataclasses
import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Annotated, Any

import casadi as ca
import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.actions.multibody import ItemAction
from lgmpc.compile import CompiledFunction, cached, compile_map
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import CentroidalMomentum, CoMPosition, FrictionCone, StateError
from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.base import input_error, write_intervals
from lgmpc.mpc.interface import MeasuredState
from lgmpc.mpc.plan import Plan, PosturePlan
from lgmpc.mpc.settings import MultibodyWeights, SqpMpcSettings
from lgmpc.mpc.sqp import SqpMpc
from lgmpc.ocp import KktResidual, ShootingProblem, Trajectory
from lgmpc.robot import Robot
from lgmpc.robot.feet import UP, touching
from lgmpc.settings import Extension, Positive
from lgmpc.solvers import Solution
from lgmpc.state import State
from lgmpc.typing import Array

__all__ = ["MultibodyMpc", "MultibodyMpcSettings", "common_constraints", "common_costs", "contact_point_model"]


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
        point = pin.SE3(np.eye(3), touching(data.oMf[frame].translation, robot.contact_radius, np.array(UP)))
        names.append(f"{name}_contact_point")
        model.addFrame(pin.Frame(names[-1], joint, frame, data.oMi[joint].inverse() * point, pin.FrameType.OP_FRAME))
    return model, tuple(names)


def common_costs(state: State) -> list[CostItem]:
    """Return the costs ``com``, ``momentum`` and ``state``; their weights are written by :class:`MultibodyMpc`."""
    return [
        CostItem("com", CoMPosition()),
        CostItem("momentum", CentroidalMomentum()),
        CostItem("state", StateError(state)),
    ]


def common_constraints(contacts: tuple[str, ...], facets: int) -> list[ConstraintItem]:
    """Return the constraints ``cone0``, ``cone1``, ...: friction pyramid and normal force of each contact."""
    return [ConstraintItem(f"cone{i}", FrictionCone(frame, facets), 0.0, np.inf) for i, frame in enumerate(contacts)]


class OwnCost(Extension):
    """A cost of one's own: a class derived from :class:`lgmpc.Residual`, called with the arguments.

    Or a function, called with the robot and the arguments, that returns a residual or a :class:`lgmpc.CostItem`.
    """

    weight: Positive = Field(default=1.0, description="Weight of the squared residual; not that of a CostItem.")


class MultibodyMpcSettings(SqpMpcSettings):
    """Settings of models that have base and joints."""

    rate_hz: Annotated[Positive, Field(ge=1.0, le=1e4)] = Field(
        default=50.0, description="Updates per second, Hz, 1 to 10000."
    )
    reach_rad: Positive = Field(
        default=0.9,
        description="Largest joint displacement of a plan from the reference posture, rad; below that of a stretched"
        " leg. Beyond it, the centroidal model plans instead.",
    )
    costs: tuple[OwnCost, ...] = Field(default=(), description="Costs of one's own, beside those with weights.")


class MultibodyMpc(SqpMpc):
    """Plans the motion of base and joints with the contact forces; see :class:`~lgmpc.mpc.sqp.SqpMpc`.

    A foot whose flag is 1 does not move (an initial velocity is reduced to zero within an interval), one whose flag is
    0 has no force. An external wrench acts on the base, so that plans are valid during a push.

    Args:
        robot: the robot.
        action: with the items of :func:`common_costs` and :func:`common_constraints`, and others.
        settings: horizon, limits.
        weights: of the common costs.
        own: further costs among those of the action, each with the weight of its item.
        progress: called with a description of what is being compiled.

    Raises:
        MissingDependencyError: the QP solver is not installed.
    """

    def __init__(
        self,
        robot: Robot,
        action: ItemAction,
        settings: MultibodyMpcSettings,
        weights: MultibodyWeights,
        own: Sequence[CostItem] = (),
        progress: Callable[[str], None] | None = None,
    ) -> None:
        n, nc = settings.nodes, robot.nc
        problem = ShootingProblem(action, n)
        self._node_s, self._terminal = settings.node_s, weights.terminal
        problem.set("duration", settings.node_s)
        self._set_weight(problem, "com", weights.state(robot.mass)[:3])
        self._set_weight(problem, "momentum", weights.state(robot.mass)[3:])
        for item in own:
            self._set_weight(problem, item.name, item.weight)
        super().__init__(problem, settings, robot.mass, -robot.mass * robot.gravity, progress)
        self.settings: MultibodyMpcSettings = settings
        self.robot = robot
        self._normal_force = settings.normal_force(robot.mass)
        view = problem.view
        self._wrench = view("external_wrench")
        self._com_reference, self._momentum_reference = view("com_reference"), view("momentum_reference")
        self._q_reference = view("state_reference")[:, : robot.nq]
        self._cones = tuple((view(f"cone{i}_lower"), view(f"cone{i}_upper")) for i in range(nc))
        self._surfaces = tuple((view(f"cone{i}_friction")[:, 0], view(f"cone{i}_normal")) for i in range(nc))
        self._read = cached(_compile_read_out, type(self)._read_out, action, n + 1, progress=progress)

    @abstractmethod
    def _measure(self, q: Array, v: Array) -> None:
        """Write ``problem.x0``."""

    @staticmethod
    @abstractmethod
    def _read_out(action: Any, x: Any, u: Any, values: dict[str, Any]) -> list[Any]:
        """Return centre of mass (3,), momentum (6,), velocity (nv,) and forces (3 nc,) as expressions."""

    @abstractmethod
    def _refer_forces(self, shares: Array) -> None:
        """Write the reference (N+1, nc, 3) of the forces."""

    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured configuration and velocity; see :meth:`lgmpc.mpc.interface.Mpc.update`.

        The external wrench acts on the base. Contact points are those of the feet, not of the horizon.
        """
        start = time.perf_counter()
        q, v, nq, nv = state.q, state.v, self.robot.nq, self.robot.nv
        if np.shape(q) != (nq,) or np.shape(v) != (nv,):
            raise InputError("measured state", f"shapes {np.shape(q)} and {np.shape(v)}", f"q ({nq},) and v ({nv},)")
        self._load(state, contacts, reference, wrench)
        with np.errstate(over="ignore", invalid="ignore"):
            self._measure(q, v)
        return self._advance(state.time, start)

    def keeps_reach(self, plan: Plan) -> bool:
        """Return whether no joint of a plan is further than ``settings.reach_rad`` from the reference, at any node."""
        assert plan.posture is not None
        return bool((np.abs(plan.posture.qs[:, 7:] - self._q_reference[:, 7:]) <= self.settings.reach_rad).all())

    def _set_weight(self, problem: ShootingProblem, name: str, weight: Any) -> None:
        """Set a cost's weights; the action multiplies those of the running nodes by the intervals' duration."""
        weight, nodes = np.asarray(weight), problem.nodes
        problem.set(f"{name}_weight", weight / self._node_s, range(nodes))
        problem.set(f"{name}_weight", self._terminal * weight, [nodes])

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
        lowest, highest = self._normal_force
        for i, (lower, upper) in enumerate(self._cones):
            # A foot in the air has no force, which lies strictly inside its bounds.
            flag = self._flags[:, i]
            opened = (flag - 1.0) * highest
            lower[:, :-1] = opened[:, None]
            lower[:, -1] = flag * lowest + opened
            upper[:, -1] = highest
        self._refer_forces(self._shares())

    def _describe(self, t: float, trajectory: Trajectory, result: Solution) -> Plan:
        xs, us, parameters = self._read.inputs
        xs[...] = trajectory.xs
        us[:-1] = trajectory.us
        us[-1] = trajectory.us[-1]
        parameters[...] = self.problem.parameters
        self._read.run()
        com, momentum, vs, forces = self._read.outputs
        nodes = self.settings.nodes
        plan = self._make_plan(
            t,
            np.hstack([com, momentum]),
            forces[:nodes].reshape(nodes, -1, 3) * self._flags[:nodes, :, None],
            result.kkt,
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
        plan = self._make_plan(t, xs, forces, KktResidual.unknown())
        return self._with_posture(plan, q, np.zeros((n + 1, robot.nv)))

    def _with_posture(self, plan: Plan, qs: Array, vs: Array) -> Plan:
        qs.flags.writeable = vs.flags.writeable = False
        return dataclasses.replace(plan, posture=PosturePlan(plan.time, plan.node_duration, qs, vs))


def _compile_read_out(
    read_out: Callable[[Any, Any, Any, dict[str, Any]], list[Any]],
    action: ItemAction,
    points: int,
    progress: Callable[[str], None] | None,
) -> CompiledFunction:
    """Compile the quantities of plans other than states and controls, for all points of a horizon."""
    sizes = {"x": action.state.nx, "u": action.nu, "p": action.parameters.size}
    x, u, p = (ca.SX.sym(name, size) for name, size in sizes.items())
    outputs = read_out(action, x, u, action.parameters.split(p))
    names = ["com", "momentum", "v", "forces"]
    function = ca.Function(f"{action.name}_read_out", [x, u, p], outputs, list(sizes), names)
    return compile_map(function, points, progress=progress)
