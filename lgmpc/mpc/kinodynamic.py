"""Receding-horizon control of momentum and posture by contact forces and joint velocities."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin

from lgmpc.actions import KinodynamicAction, StateMomentum
from lgmpc.costs import CostItem
from lgmpc.costs.library import Control
from lgmpc.mpc.settings import KinodynamicMpcSettings
from lgmpc.mpc.whole_body import WholeBodyMpc, common_constraints, common_costs, contact_point_model
from lgmpc.ocp import Trajectory
from lgmpc.robot import Robot
from lgmpc.typing import Array

__all__ = ["KinodynamicMpc"]


class KinodynamicMpc(WholeBodyMpc):
    """Plans contact forces and joint velocities: centroidal momentum with full kinematics, friction limited.

    State (q, h), control the forces and the joint velocities. Torques do not appear: keeping them within their limits
    is left to the controller below.

    Args:
        robot: the robot, with a floating base and contact frames.
        settings: horizon, weights, limits.
        progress: told what is being compiled, when something is.

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
    ) -> None:
        s = KinodynamicMpcSettings() if settings is None else settings
        self._model, contacts = contact_point_model(robot)
        self._data = self._model.createData()
        self._nf = 3 * robot.nc
        state = StateMomentum(self._model)
        costs = [*common_costs(state), CostItem("control", Control(self._nf + robot.nu))]
        self._action = KinodynamicAction(
            f"kinodynamic_{robot.nc}x{s.facets}", self._model, contacts, costs, common_constraints(contacts, s.facets)
        )
        super().__init__(robot, self._action, s, progress)
        w = s.weights
        self._set_weight(self.problem, "control", [*w.forces(robot.nc), *[w.joint_velocity] * robot.nu], s)
        self._force_reference = self.problem.view("control_reference")[:, : self._nf]

    def _measure(self, q: Array, v: Array) -> None:
        nq = self.robot.nq
        self.problem.x0[:nq] = q
        self.problem.x0[nq:] = pin.computeCentroidalMomentum(self._model, self._data, q, v).np

    def _state_weights(self, robot: Robot, settings: KinodynamicMpcSettings) -> Array:
        w = settings.weights
        turn = np.broadcast_to(w.base_orientation, 3)
        return np.concatenate([np.zeros(3), turn, np.full(robot.nu, w.posture), np.zeros(6)])

    def _read_out(self, x: Any, u: Any, values: dict[str, Any]) -> list[Any]:
        robot = self._action.robot
        q, h, forces, joints = x[: robot.nq], x[robot.nq :], u[: self._nf], u[self._nf :]
        matrix = robot.momentum_matrix(q)
        base = ca.solve(matrix[:, :6], h - matrix[:, 6:] @ joints)
        return [robot.com(q), h, ca.vertcat(base, joints), forces]

    def _refer_forces(self, shares: Array) -> None:
        self._force_reference[...] = shares.reshape(len(shares), -1)

    def _rest(self) -> Trajectory:
        n = self.settings.nodes
        return Trajectory(np.tile(self.problem.x0, (n + 1, 1)), self.problem.view("control_reference")[:n].copy())
