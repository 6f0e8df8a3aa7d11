"""Receding-horizon control of the whole robot by the torques of its motors.

The limits are hard constraints of an SQP, which satisfies all of them, not barriers of an FDDP. An iteration takes
longer while a push changes the active rows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import casadi as ca
import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.actions import ContactForwardDynamics, ExternalWrench, MultibodyAction, Unknowns
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import ContactForce, Control
from lgmpc.mpc.multibody import (
    MultibodyMpc,
    MultibodyMpcSettings,
    common_constraints,
    common_costs,
    contact_point_model,
)
from lgmpc.mpc.settings import MultibodyWeights
from lgmpc.ocp import Trajectory
from lgmpc.robot import Robot
from lgmpc.robot.scaling import weight_factor
from lgmpc.settings import NonNegative, Positive
from lgmpc.typing import Array

__all__ = ["FullBodyMpc", "FullBodyMpcSettings", "FullBodyWeights"]


class FullBodyWeights(MultibodyWeights):
    """Weights of the squared deviations that the full-body MPC minimises."""

    joint_velocity: NonNegative = Field(default=1e-3, description="Speeds of the joints, 1/(rad/s)2.")
    effort: Positive = Field(
        default=1e-3, description="Joint torques, from those that hold the posture, 1/(N.m)2 (scaled by mass)."
    )


class FullBodyMpcSettings(MultibodyMpcSettings):
    """Model-predictive control of the whole robot by its torques, which have limits as the forces have."""

    model: Literal["full_body"] = Field(default="full_body", description="Model that predicts.")
    weights: FullBodyWeights = Field(default=FullBodyWeights(), description="Weights of the cost.")


class FullBodyMpc(MultibodyMpc):
    """Plans joint torques: contact forward dynamics, with friction, normal forces and torques limited.

    State (q, v), control the torques. The limits are hard constraints of each subproblem, which has no solution where
    they contradict each other: feet that have left the ground under a push beyond the limits. Then the last plan
    remains in use. Plans with stretched legs are rejected: see :meth:`keeps_reach`.

    Args:
        robot: the robot, with a floating base and contact frames.
        settings: horizon, weights, limits.
        progress: called with a description of what is being compiled.
        costs: further costs, whose weights are in the units of ``settings.weights``.

    Raises:
        InputError: the robot has no contact frames.
        MissingDependencyError: the QP solver is not installed.
        ModelError: unsupported joints.
    """

    def __init__(
        self,
        robot: Robot,
        settings: FullBodyMpcSettings | None = None,
        progress: Callable[[str], None] | None = None,
        costs: Sequence[CostItem] = (),
    ) -> None:
        s = FullBodyMpcSettings() if settings is None else settings
        model, contacts = contact_point_model(robot)
        self._dynamics = ContactForwardDynamics(model, contacts, [ExternalWrench(model)])
        items = [
            *common_costs(self._dynamics.state),
            CostItem("effort", Control(robot.nu)),
            *(CostItem(f"force{i}", ContactForce(frame)) for i, frame in enumerate(contacts)),
            *costs,
        ]
        limits = [
            *common_constraints(contacts, s.friction_facets),
            ConstraintItem("effort_limit", Control(robot.nu), -robot.effort_limit, robot.effort_limit),
        ]
        action = MultibodyAction(f"full_body_{robot.nc}x{s.friction_facets}", self._dynamics, items, limits)
        super().__init__(robot, action, s, s.weights, costs, progress)
        efforts = holding_efforts(model, contacts, robot.q_reference)
        self._efforts = efforts
        self.problem.set("contact_gains", [0.0, 1.0 / s.node_s])
        self.problem.set("effort_reference", efforts)
        w, free = s.weights, np.zeros(3)
        turn, posture = np.full(3, w.base_orientation), np.full(robot.nu, w.posture)
        motion = np.concatenate([free, turn, posture, np.zeros(6), np.full(robot.nu, w.joint_velocity)])
        self._set_weight(self.problem, "state", motion)
        self._set_weight(self.problem, "effort", np.full(robot.nu, weight_factor(robot.mass) * w.effort))
        for i in range(robot.nc):
            self._set_weight(self.problem, f"force{i}", w.forces(1, robot.mass))
        self._force_references = tuple(self.problem.view(f"force{i}_reference") for i in range(robot.nc))

    def _measure(self, q: Array, v: Array) -> None:
        nq = self.robot.nq
        self.problem.x0[:nq], self.problem.x0[nq:] = q, v

    @staticmethod
    def _read_out(action: MultibodyAction, x: Any, u: Any, values: dict[str, Any]) -> list[Any]:
        dynamics = action.dynamics
        assert isinstance(dynamics, ContactForwardDynamics)
        robot = dynamics.robot
        q, v = x[: robot.nq], x[robot.nq :]
        motion = dynamics.motion(q, v, u, values, Unknowns())
        return [robot.com(q), robot.momentum(q, v), v, ca.vertcat(*motion.forces.values())]

    def _refer_forces(self, shares: Array) -> None:
        for i, reference in enumerate(self._force_references):
            reference[...] = shares[:, i]

    def _rest(self) -> Trajectory:
        n = self.settings.nodes
        return Trajectory(np.tile(self.problem.x0, (n + 1, 1)), np.tile(self._efforts, (n, 1)))


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
    efforts: Array = (load - jacobian.T @ forces)[6:]
    return efforts
