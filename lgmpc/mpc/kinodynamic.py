"""Receding-horizon control of momentum and posture by contact forces and joint velocities."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import casadi as ca
import numpy as np
import pinocchio as pin
from pydantic import Field

from lgmpc.actions import KinodynamicAction, StateMomentum
from lgmpc.costs import CostItem
from lgmpc.costs.library import Control
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
from lgmpc.settings import Positive
from lgmpc.typing import Array

__all__ = ["KinodynamicMpc", "KinodynamicMpcSettings", "KinodynamicWeights"]


class KinodynamicWeights(MultibodyWeights):
    """Weights of the squared deviations that the kinodynamic MPC minimises."""

    joint_velocity: Positive = Field(default=1e-3, description="Speeds of the joints, 1/(rad/s)2.")


class KinodynamicMpcSettings(MultibodyMpcSettings):
    """Model-predictive control of momenta and posture by contact forces and joint velocities."""

    model: Literal["kinodynamic"] = Field(default="kinodynamic", description="Model that predicts.")
    weights: KinodynamicWeights = Field(default=KinodynamicWeights(), description="Weights of the cost.")


class KinodynamicMpc(MultibodyMpc):
    """Plans contact forces and joint velocities: centroidal momentum with full kinematics, friction limited.

    State (q, h), control the forces and the joint velocities. Torques do not appear: keeping them within their limits
    is left to the controller below.

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
        settings: KinodynamicMpcSettings | None = None,
        progress: Callable[[str], None] | None = None,
        costs: Sequence[CostItem] = (),
    ) -> None:
        s = KinodynamicMpcSettings() if settings is None else settings
        self._model, contacts = contact_point_model(robot)
        self._data = self._model.createData()
        self._nf = 3 * robot.nc
        state = StateMomentum(self._model)
        items = [*common_costs(state), CostItem("control", Control(self._nf + robot.nu)), *costs]
        limits = common_constraints(contacts, s.friction_facets)
        name = f"kinodynamic_{robot.nc}x{s.friction_facets}"
        self._action = KinodynamicAction(name, self._model, contacts, items, limits)
        super().__init__(robot, self._action, s, s.weights, costs, progress)
        w = s.weights
        turn, posture = np.full(3, w.base_orientation), np.full(robot.nu, w.posture)
        self._set_weight(self.problem, "state", np.concatenate([np.zeros(3), turn, posture, np.zeros(6)]))
        self._set_weight(self.problem, "control", [*w.forces(robot.nc, robot.mass), *[w.joint_velocity] * robot.nu])
        self._force_reference = self.problem.view("control_reference")[:, : self._nf]

    def _measure(self, q: Array, v: Array) -> None:
        nq = self.robot.nq
        self.problem.x0[:nq] = q
        self.problem.x0[nq:] = pin.computeCentroidalMomentum(self._model, self._data, q, v).np

    @staticmethod
    def _read_out(action: KinodynamicAction, x: Any, u: Any, values: dict[str, Any]) -> list[Any]:
        robot = action.robot
        nf = action.nu - (robot.nv - 6)
        q, h, forces, joints = x[: robot.nq], x[robot.nq :], u[:nf], u[nf:]
        matrix = robot.momentum_matrix(q)
        base = ca.solve(matrix[:, :6], h - matrix[:, 6:] @ joints)
        return [robot.com(q), h, ca.vertcat(base, joints), forces]

    def _refer_forces(self, shares: Array) -> None:
        self._force_reference[...] = shares.reshape(len(shares), -1)

    def _rest(self) -> Trajectory:
        n = self.settings.nodes
        return Trajectory(np.tile(self.problem.x0, (n + 1, 1)), self.problem.view("control_reference")[:n].copy())
