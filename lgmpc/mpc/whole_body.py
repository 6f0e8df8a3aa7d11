"""What predictive controllers on a robot's full kinematics share: contact points, costs, references and plans."""

from __future__ import annotations

import dataclasses
import time
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.actions.multibody import ItemAction
from lgmpc.compile import compile_map
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import CentroidalMomentum, CoMPosition, FrictionCone, StateError
from lgmpc.errors import InputError
from lgmpc.mpc.keeping import write_intervals
from lgmpc.mpc.plan import CentroidalPlan, PosturePlan
from lgmpc.mpc.receding import RecedingHorizon
from lgmpc.mpc.settings import FullBodyMpcSettings, KinodynamicMpcSettings
from lgmpc.ocp import KktResidual, ShootingProblem, Trajectory
from lgmpc.robot import Robot
from lgmpc.solvers import RealTimeResult
from lgmpc.state import State
from lgmpc.typing import Array, BoolArray

__all__ = ["WholeBodyMpc", "common_constraints", "common_costs", "contact_point_model"]


def contact_point_model(robot: Robot) -> tuple[pin.Model, tuple[str, ...]]:
    """Return a copy of the robot's model with a frame at each contact point, and these frames' names.

    A spherical foot touches the ground a radius below its frame. Forces act there, and what does not slip is that
    material point; it is taken at the reference posture, from which a foot that rolls by an angle a departs by
    ``radius (1 - cos a)``.
    """
    model = robot.model.copy()
    data = model.createData()
    pin.framesForwardKinematics(model, data, robot.q_reference)
    names = []
    for name, frame in zip(robot.contact_frames, robot.contact_ids, strict=True):
        joint = model.frames[frame].parentJoint
        point = pin.SE3(np.eye(3), data.oMf[frame].translation - [0.0, 0.0, robot.contact_radius])
        names.append(f"{name}_contact_point")
        model.addFrame(pin.Frame(names[-1], joint, frame, data.oMi[joint].inverse() * point, pin.FrameType.OP_FRAME))
    return model, tuple(names)


def common_costs(state: State) -> list[CostItem]:
    """Costs ``com``, ``momentum`` and ``state``; their weights are written by :class:`WholeBodyMpc`."""
    return [
        CostItem("com", CoMPosition()),
        CostItem("momentum", CentroidalMomentum()),
        CostItem("state", StateError(state)),
    ]


def common_constraints(contacts: tuple[str, ...], facets: int) -> list[ConstraintItem]:
    """Constraints ``cone0``, ``cone1``, ...: friction pyramid and normal force of each contact."""
    return [ConstraintItem(f"cone{i}", FrictionCone(frame, facets), 0.0, np.inf) for i, frame in enumerate(contacts)]


class WholeBodyMpc(RecedingHorizon):
    """Plans the motion of base and joints with the contact forces; see :class:`~lgmpc.mpc.receding.RecedingHorizon`.

    A foot whose flag is 1 does not move (its velocity, should it have one, is taken back within an interval), one whose
    flag is 0 has no force. An external wrench acts on the base, so that the plan is right while somebody pushes.

    Args:
        robot: the robot.
        action: whose items are those of :func:`common_costs` and :func:`common_constraints`, and others.
        settings: horizon, weights, limits.
        progress: told what is being compiled, when something is.

    Raises:
        MissingDependencyError: the QP solver is not installed.
    """

    def __init__(
        self,
        robot: Robot,
        action: ItemAction,
        settings: FullBodyMpcSettings | KinodynamicMpcSettings,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        n, nc = settings.nodes, robot.nc
        problem = ShootingProblem(action, n)
        problem.set("duration", settings.node_duration)
        weights = settings.weights
        self._set_weight(problem, "com", weights.state()[:3], settings)
        self._set_weight(problem, "momentum", weights.state()[3:], settings)
        self._set_weight(problem, "state", self._state_weights(robot, settings), settings)
        for i in range(nc):
            problem.set(f"cone{i}_friction", settings.friction)
        super().__init__(problem, settings, robot.mass, -robot.mass * robot.gravity, progress)
        self.robot = robot
        self._reach = settings.reach
        view = problem.view
        self._wrench = view("external_wrench")
        self._com_reference, self._momentum_reference = view("com_reference"), view("momentum_reference")
        self._q_reference = view("state_reference")[:, : robot.nq]
        self._cones = tuple((view(f"cone{i}_lower"), view(f"cone{i}_upper")) for i in range(nc))
        x, u, p = (
            ca.SX.sym(name, size)
            for name, size in (("x", action.state.nx), ("u", action.nu), ("p", action.parameters.size))
        )
        outputs = self._read_out(x, u, action.parameters.split(p))
        names = ["com", "momentum", "v", "forces"]
        function = ca.Function(f"{action.name}_read_out", [x, u, p], outputs, ["x", "u", "p"], names)
        self._read = compile_map(function, n + 1, progress=progress)

    @abstractmethod
    def _measure(self, q: Array, v: Array) -> None:
        """Write ``problem.x0``."""

    @abstractmethod
    def _state_weights(self, robot: Robot, settings: Any) -> Array:
        """(ndx,) weights of the state's deviation."""

    @abstractmethod
    def _read_out(self, x: Any, u: Any, values: dict[str, Any]) -> list[Any]:
        """Return centre of mass (3,), momentum (6,), velocity (nv,) and forces (3 nc,) as expressions."""

    @abstractmethod
    def _refer_forces(self, shares: Array) -> None:
        """Write the forces (N+1, nc, 3) to stay near."""

    def update(
        self,
        t: float,
        q: Array,
        v: Array,
        contact_flags: Array | BoolArray,
        x_reference: Array,
        q_reference: Array,
        external_wrench: Array | None = None,
    ) -> CentroidalPlan:
        """Plan from the measured state; world axes.

        Args:
            t: time of the state, s.
            q: (nq,) configuration.
            v: (nv,) velocity.
            contact_flags: (nc,), or (N, nc) an interval each: whether each foot is in contact.
            x_reference: (9,), or (N+1, 9) a node each: [centre of mass; linear momentum; angular momentum] to stay
                near.
            q_reference: (nq,) whose base orientation and joint positions to stay near.
            external_wrench: (6,), or (N, 6): [force; moment about the centre of mass] that acts on the base, as far as
                it is known; none if omitted.

        Returns:
            The new plan with its posture, or after a failure the last valid one with the status that says why.

        Raises:
            InputError: an array of the wrong shape (values are never refused).
        """
        start = time.perf_counter()
        nq, nv = self.robot.nq, self.robot.nv
        if np.shape(q) != (nq,) or np.shape(v) != (nv,):
            raise InputError("measured state", f"shapes {np.shape(q)} and {np.shape(v)}", f"q ({nq},) and v ({nv},)")
        self._load(contact_flags, x_reference, q_reference, external_wrench)
        with np.errstate(over="ignore", invalid="ignore"):
            self._measure(q, v)
        return self._advance(t, start)

    def keeps_reach(self, plan: CentroidalPlan) -> bool:
        """Whether no joint of a plan is further from the reference posture than ``settings.reach``, at any node."""
        assert plan.posture is not None
        return bool((np.abs(plan.posture.qs[:, 7:] - self._q_reference[:, 7:]) <= self._reach).all())

    @property
    def _friction_names(self) -> tuple[str, ...]:
        return tuple(f"cone{i}_friction" for i in range(self.robot.nc))

    @staticmethod
    def _set_weight(
        problem: ShootingProblem, name: str, weight: Any, settings: FullBodyMpcSettings | KinodynamicMpcSettings
    ) -> None:
        """Set a cost's weights; the action multiplies those of the running nodes by the intervals' duration."""
        weight, nodes = np.asarray(weight), settings.nodes
        problem.set(f"{name}_weight", weight / settings.node_duration, range(nodes))
        problem.set(f"{name}_weight", settings.weights.terminal * weight, [nodes])

    def _load(self, flags: Array | BoolArray, x_reference: Array, q_reference: Array, wrench: Array | None) -> None:
        try:
            write_intervals(self._flags, flags)
            write_intervals(self._wrench, 0.0 if wrench is None else wrench)
            self._com_reference[...] = x_reference[..., :3]
            self._momentum_reference[...] = x_reference[..., 3:]
            self._q_reference[...] = q_reference
        except ValueError as error:
            n, nc = self.settings.nodes, self.robot.nc
            expected = (
                f"contact_flags ({nc},) or ({n}, {nc}), x_reference (9,) or ({n + 1}, 9), q_reference"
                f" ({self.robot.nq},), external_wrench (6,) or ({n}, 6)"
            )
            raise InputError("inputs of the MPC", str(error), expected) from error
        s = self.settings
        for i, (lower, upper) in enumerate(self._cones):
            # A foot in the air has no force, which lies strictly inside its bounds.
            flag = self._flags[:, i]
            opened = (flag - 1.0) * s.normal_force_max
            lower[:, :-1] = opened[:, None]
            lower[:, -1] = flag * s.normal_force_min + opened
            upper[:, -1] = s.normal_force_max
        self._refer_forces(self._shares())

    def _describe(self, t: float, trajectory: Trajectory, result: RealTimeResult) -> CentroidalPlan:
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

    def _standing_plan(self, t: float) -> CentroidalPlan:
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

    def _with_posture(self, plan: CentroidalPlan, qs: Array, vs: Array) -> CentroidalPlan:
        qs.flags.writeable = vs.flags.writeable = False
        return dataclasses.replace(plan, posture=PosturePlan(plan.time, plan.node_duration, qs, vs))
