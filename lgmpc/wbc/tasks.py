r"""Tasks in the TSID sense: each asks for ``J a = a_des - J' v`` and says how much it matters.

A task supplies its Jacobian, its drift and its error; what the QP makes of them (``1/2 ||J a - rhs||_W^2``) is the same
for all and lives in :mod:`lgmpc.wbc.assembly`. To add a task, subclass :class:`Task` and write ``update``.

Source: A. Del Prete et al., "Implementing torque control with high-ratio gear boxes and without joint-torque sensors",
IJHR 2016, section 3, for the form; Orin, Goswami, Lee, "Centroidal dynamics of a humanoid robot", 2013, for ``A_G``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.typing import Array
from lgmpc.wbc.reference import WholeBodyReference
from lgmpc.wbc.terms import WholeBodyTerms

__all__ = [
    "AngularMomentumTask",
    "BaseOrientationTask",
    "BasePositionTask",
    "ComTask",
    "FootTask",
    "Gain",
    "PostureTask",
    "Task",
    "TaskStack",
]


@dataclass(frozen=True)
class Gain:
    """Feedback of a task: ``a_des = a_ff + kp * error + kd * error rate``.

    Attributes:
        kp: 1/s^2 (one number, or one per row).
        kd: 1/s (one number, or one per row).
    """

    kp: float | tuple[float, ...]
    kd: float | tuple[float, ...]

    @classmethod
    def critically_damped(cls, kp: float, ratio: float = 1.0) -> Gain:
        """Gain with damping ``kd = 2 ratio sqrt(kp)``."""
        return cls(kp, 2.0 * ratio * float(np.sqrt(kp)))


class Task(ABC):
    """One block of rows ``jacobian @ a = rhs`` with weights.

    Attributes:
        name: what it is called in logs and configs.
        dim: number of rows.
        jacobian: (dim, nv) view into the stack.
        rhs: (dim,) view into the stack: desired task acceleration minus drift.
        weight: (dim,) view into the stack.
    """

    jacobian: Array
    rhs: Array
    weight: Array

    def __init__(self, name: str, dim: int, weight: float | Sequence[float]) -> None:
        self.name = name
        self.dim = dim
        self._initial_weight = np.broadcast_to(np.asarray(weight, dtype=float), (dim,))
        if not np.all(np.isfinite(self._initial_weight)) or np.any(self._initial_weight < 0):
            raise InputError(f"weight of task '{name}'", weight, "finite, not negative")

    def bind(self, jacobian: Array, rhs: Array, weight: Array) -> None:
        """Give the task the rows of the stack that it writes to."""
        self.jacobian, self.rhs, self.weight = jacobian, rhs, weight
        self.weight[:] = self._initial_weight

    @abstractmethod
    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write ``jacobian`` and ``rhs`` (and ``weight``, if it changes) for this tick."""


class TaskStack:
    """All tasks' rows in one matrix, so that the QP's Hessian is one product.

    Attributes:
        jacobian: (m, nv).
        rhs: (m,).
        weight: (m,).
    """

    def __init__(self, tasks: Sequence[Task], nv: int) -> None:
        rows = sum(task.dim for task in tasks)
        self.tasks = tuple(tasks)
        self.jacobian = np.zeros((rows, nv))
        self.rhs = np.zeros(rows)
        self.weight = np.zeros(rows)
        start = 0
        for task in tasks:
            block = slice(start, start + task.dim)
            task.bind(self.jacobian[block], self.rhs[block], self.weight[block])
            start += task.dim

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Let every task write its rows."""
        for task in self.tasks:
            task.update(terms, reference)


class ComTask(Task):
    """Centre of mass: ``(A_G[lin] / m) a = c''_des - (A_G' v)[lin] / m``."""

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        super().__init__("com", 3, weight)
        self._inverse_mass = 1.0 / robot.mass
        self._kp, self._kd = np.asarray(gain.kp, dtype=float), np.asarray(gain.kd, dtype=float)

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        inverse_mass = self._inverse_mass
        np.multiply(terms.momentum_matrix[:3], inverse_mass, out=self.jacobian)
        velocity = terms.momentum[:3] * inverse_mass
        self.rhs[:] = (
            reference.com_acceleration
            + self._kp * (reference.com - terms.com)
            + self._kd * (reference.com_velocity - velocity)
            - inverse_mass * terms.momentum_drift[:3]
        )


class BaseOrientationTask(Task):
    """Orientation of the base by the logarithm: ``omega' = kp log(R^T R_d) + kd (R^T R_d omega_d - omega)``, body axes."""

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        super().__init__("base_orientation", 3, weight)
        self._kp, self._kd = np.asarray(gain.kp, dtype=float), np.asarray(gain.kd, dtype=float)

    def bind(self, jacobian: Array, rhs: Array, weight: Array) -> None:
        """Take the rows; the Jacobian is constant, because ``v`` holds the body angular velocity itself."""
        super().bind(jacobian, rhs, weight)
        self.jacobian[:, 3:6] = np.eye(3)

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        to_target = terms.rotation.T @ reference.base_rotation
        self.rhs[:] = self._kp * pin.log3(to_target)
        self.rhs += self._kd * (to_target @ reference.base_angular_velocity - terms.v[3:6])


class BasePositionTask(Task):
    """Position of the base's origin, world axes: ``R (v_lin' + omega x v_lin) = p''_des``."""

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        super().__init__("base_position", 3, weight)
        self._kp, self._kd = np.asarray(gain.kp, dtype=float), np.asarray(gain.kd, dtype=float)

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        rotation, linear, angular = terms.rotation, terms.v[:3], terms.v[3:6]
        self.jacobian[:, :3] = rotation
        self.rhs[:] = (
            self._kp * (reference.base_position - terms.q[:3])
            + self._kd * (reference.base_velocity - rotation @ linear)
            - rotation @ np.cross(angular, linear)
        )


class AngularMomentumTask(Task):
    """Centroidal angular momentum: ``A_G[ang] a = k'_des + kp (k_des - k) - (A_G' v)[ang]``."""

    def __init__(self, robot: Robot, kp: float, weight: float | Sequence[float]) -> None:
        super().__init__("angular_momentum", 3, weight)
        self._kp = kp

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        self.jacobian[:] = terms.momentum_matrix[3:]
        self.rhs[:] = (
            reference.angular_momentum_rate
            + self._kp * (reference.angular_momentum - terms.momentum[3:])
            - terms.momentum_drift[3:]
        )


class PostureTask(Task):
    """Joint positions near the reference posture."""

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        super().__init__("posture", robot.nu, weight)
        self._kp, self._kd = np.asarray(gain.kp, dtype=float), np.asarray(gain.kd, dtype=float)

    def bind(self, jacobian: Array, rhs: Array, weight: Array) -> None:
        """Take the rows; the Jacobian is the constant selector of the joints."""
        super().bind(jacobian, rhs, weight)
        self.jacobian[:, -self.dim :] = np.eye(self.dim)

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        joints, rates = terms.q[-self.dim :], terms.v[-self.dim :]
        self.rhs[:] = self._kp * (reference.joint_position - joints) + self._kd * (reference.joint_velocity - rates)


class FootTask(Task):
    """Contact points: a stance foot keeps still, a swing foot follows its target.

    A stance foot is held by a heavy weight instead of an equality, because equal rows turn infeasible with the torque
    limits near stretched legs; and only its velocity is fed back, because a rolling sphere's contact point moves.
    """

    def __init__(
        self, robot: Robot, stance_damping: float, swing_gain: Gain, stance_weight: float, swing_weight: float
    ) -> None:
        super().__init__("feet", 3 * len(robot.contact_ids), stance_weight)
        self._stance_damping = stance_damping
        self._swing = swing_gain
        self._stance_weight, self._swing_weight = stance_weight, swing_weight

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        self.jacobian[:] = terms.contact_jacobian
        velocity = terms.contact_jacobian @ terms.v
        self.rhs[:] = -self._stance_damping * velocity - terms.contact_drift
        if reference.stance.all():
            self.weight[:] = self._stance_weight
            return
        swing = np.repeat(~reference.stance, 3)
        self.weight[:] = np.where(swing, self._swing_weight, self._stance_weight)
        follow = (
            reference.foot_acceleration.ravel()
            + self._swing.kp * (reference.foot_position - terms.contact_points).ravel()
            + self._swing.kd * (reference.foot_velocity.ravel() - velocity)
            - terms.contact_drift
        )
        self.rhs[swing] = follow[swing]
