r"""Tasks in the TSID sense: each asks for ``J a = a_des - J' v`` and says how much it matters.

A task supplies its Jacobian, its error and what else its acceleration has (feed-forward, drift). The feedback ``rhs =
acceleration + kp error + kd rate`` is the same for all and made by :class:`TaskStack` at once; what the QP makes of the
rows (``1/2 ||J a - rhs||_W^2``) lives in :mod:`lgmpc.wbc.assembly`. To add a task, subclass :class:`Task` and write
``update``.

Source: A. Del Prete et al., "Implementing torque control with high-ratio gear boxes and without joint-torque sensors",
IJHR 2016, section 3, for the form; Orin, Goswami, Lee, "Centroidal dynamics of a humanoid robot", 2013, for ``A_G``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields

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
    "TaskRows",
    "TaskStack",
]


@dataclass(frozen=True)
class Gain:
    """Feedback of a task: ``a_des = a_ff + kp * error + kd * error rate``.

    Attributes:
        kp: 1/s^2, one number or one per row.
        kd: 1/s, one number or one per row.
    """

    kp: float | tuple[float, ...]
    kd: float | tuple[float, ...]

    @classmethod
    def critically_damped(cls, kp: float, ratio: float = 1.0) -> Gain:
        """Gain with damping ``kd = 2 ratio sqrt(kp)``."""
        return cls(kp, 2.0 * ratio * float(np.sqrt(kp)))


@dataclass(frozen=True)
class TaskRows:
    """Rows of a :class:`TaskStack` (views, m rows each) that a task writes to.

    Attributes:
        jacobian: (m, nv).
        error: (m,) target minus position, 0 where only rates are fed back.
        rate: (m,) target velocity minus velocity.
        acceleration: (m,) feed-forward minus drift: the acceleration asked for at zero error, less ``J' v``.
        kp: (m,) gain of the error, 1/s^2.
        kd: (m,) gain of the rate, 1/s.
        weight: (m,).
    """

    jacobian: Array
    error: Array
    rate: Array
    acceleration: Array
    kp: Array
    kd: Array
    weight: Array

    def part(self, rows: slice) -> TaskRows:
        """Return views of some of the rows."""
        return TaskRows(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})


class Task(ABC):
    """One block of rows ``jacobian @ a = acceleration + kp error + kd rate`` with weights.

    Args:
        name: what it is called in messages.
        dim: number of rows.
        gain: feedback.
        weight: one number, or one per row.

    Attributes:
        name: as given.
        dim: as given.
        rows: the rows of the stack that are this task's, once it is in one.

    Raises:
        InputError: if a weight is negative or not finite, or there are not as many gains or weights as rows.
    """

    rows: TaskRows

    def __init__(self, name: str, dim: int, gain: Gain, weight: float | Sequence[float]) -> None:
        self.name = name
        self.dim = dim
        self._kp = _per_row(f"kp of task '{name}'", gain.kp, dim)
        self._kd = _per_row(f"kd of task '{name}'", gain.kd, dim)
        self._weight = _per_row(f"weight of task '{name}'", weight, dim)

    def bind(self, rows: TaskRows) -> None:
        """Take the rows of the stack, all zero, and write what never changes."""
        self.rows = rows
        rows.kp[:], rows.kd[:], rows.weight[:] = self._kp, self._kd, self._weight

    @abstractmethod
    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write what changed in :attr:`rows` since the last tick."""


def _per_row(name: str, value: float | Sequence[float], dim: int) -> Array:
    numbers = np.asarray(value, dtype=float)
    if numbers.shape not in ((), (dim,)):
        raise InputError(name, value, f"one number or {dim}")
    if not np.isfinite(numbers).all() or (numbers < 0).any():
        raise InputError(name, value, "finite, not negative")
    return numbers


class TaskStack:
    """All tasks' rows in one matrix, so that the feedback is one expression and the QP's Hessian one product.

    Attributes:
        tasks: in the order of their rows.
        rows: all tasks' rows.
        jacobian: (m, nv).
        rhs: (m,) ``acceleration + kp error + kd rate``.
        weight: (m,).
    """

    def __init__(self, tasks: Sequence[Task], nv: int) -> None:
        m = sum(task.dim for task in tasks)
        self.tasks = tuple(tasks)
        self.rows = TaskRows(np.zeros((m, nv)), *np.zeros((6, m)))
        self.jacobian, self.weight = self.rows.jacobian, self.rows.weight
        self.rhs = np.zeros(m)
        self._damping = np.zeros(m)
        start = 0
        for task in tasks:
            task.bind(self.rows.part(slice(start, start + task.dim)))
            start += task.dim

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Let every task write its rows, and add the feedback."""
        for task in self.tasks:
            task.update(terms, reference)
        rows, rhs = self.rows, self.rhs
        np.multiply(rows.kp, rows.error, out=rhs)
        np.multiply(rows.kd, rows.rate, out=self._damping)
        rhs += self._damping
        rhs += rows.acceleration


class ComTask(Task):
    """Centre of mass: ``(A_G[lin] / m) a = c''_des - (A_G' v)[lin] / m``."""

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        super().__init__("com", 3, gain, weight)
        self._inverse_mass = 1.0 / robot.mass

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        rows, inverse_mass = self.rows, self._inverse_mass
        np.multiply(terms.momentum_matrix[:3], inverse_mass, out=rows.jacobian)
        np.subtract(reference.com, terms.com, out=rows.error)
        np.multiply(terms.momentum[:3], -inverse_mass, out=rows.rate)
        np.add(rows.rate, reference.com_velocity, out=rows.rate)
        np.multiply(terms.momentum_drift[:3], -inverse_mass, out=rows.acceleration)
        np.add(rows.acceleration, reference.com_acceleration, out=rows.acceleration)


class BaseOrientationTask(Task):
    """Orientation of the base, body axes: error ``log(R^T R_d)``, rate ``R^T R_d omega_d - omega``."""

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        super().__init__("base_orientation", 3, gain, weight)

    def bind(self, rows: TaskRows) -> None:
        """Take the rows; the Jacobian is constant, because ``v`` holds the body angular velocity itself."""
        super().bind(rows)
        rows.jacobian[:, 3:6] = np.eye(3)

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        rows = self.rows
        to_target = np.dot(terms.rotation.T, reference.base_rotation)
        rows.error[:] = pin.log3(to_target)
        np.subtract(np.dot(to_target, reference.base_angular_velocity), terms.v[3:6], out=rows.rate)


class BasePositionTask(Task):
    """Position of the base's origin, world axes: ``R (v_lin' + omega x v_lin) = p''_des``."""

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        super().__init__("base_position", 3, gain, weight)

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        rows, rotation, linear = self.rows, terms.rotation, terms.v[:3]
        rows.jacobian[:, :3] = rotation
        np.subtract(reference.base_position, terms.q[:3], out=rows.error)
        np.subtract(reference.base_velocity, rotation @ linear, out=rows.rate)
        rows.acceleration[:] = rotation @ (pin.skew(linear) @ terms.v[3:6])


class AngularMomentumTask(Task):
    """Centroidal angular momentum: ``A_G[ang] a = k'_des + kd (k_des - k) - (A_G' v)[ang]``.

    It has no error: ``gain`` (1/s) feeds back the momentum, which is a rate itself.
    """

    def __init__(self, robot: Robot, gain: float, weight: float | Sequence[float]) -> None:
        super().__init__("angular_momentum", 3, Gain(0.0, gain), weight)

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        rows = self.rows
        rows.jacobian[:] = terms.momentum_matrix[3:]
        np.subtract(reference.angular_momentum, terms.momentum[3:], out=rows.rate)
        np.subtract(reference.angular_momentum_rate, terms.momentum_drift[3:], out=rows.acceleration)


class PostureTask(Task):
    """Joint positions near the reference posture."""

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float]) -> None:
        super().__init__("posture", robot.nu, gain, weight)

    def bind(self, rows: TaskRows) -> None:
        """Take the rows; the Jacobian is the constant selector of the joints."""
        super().bind(rows)
        rows.jacobian[:, -self.dim :] = np.eye(self.dim)

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        np.subtract(reference.joint_position, terms.q[-self.dim :], out=self.rows.error)
        np.subtract(reference.joint_velocity, terms.v[-self.dim :], out=self.rows.rate)


class FootTask(Task):
    """Feet: the contact point of a stance foot keeps still, the lowest point of a swing foot follows its target.

    A stance foot is held by a heavy weight instead of an equality, because equal rows turn infeasible with the torque
    limits near stretched legs; and only its velocity is fed back, because a rolling sphere's contact point moves.
    """

    def __init__(
        self, robot: Robot, stance_damping: float, swing_gain: Gain, stance_weight: float, swing_weight: float
    ) -> None:
        super().__init__("feet", 3 * len(robot.contact_ids), Gain(0.0, stance_damping), stance_weight)
        self._swing_kp = _per_row("kp of swing feet", swing_gain.kp, 3)
        self._swing_kd = _per_row("kd of swing feet", swing_gain.kd, 3)
        self._swing_weight = _per_row("weight of swing feet", swing_weight, 3)
        self._stance: list[bool] = []

    def update(self, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        """Write the rows for this tick."""
        rows = self.rows
        stance = reference.stance.tolist()
        if stance != self._stance:
            self._stance = stance
            self._switch()
        rows.jacobian[:] = terms.contact_jacobian
        np.dot(terms.contact_jacobian, terms.v, out=rows.rate)
        np.negative(rows.rate, out=rows.rate)
        np.negative(terms.contact_drift, out=rows.acceleration)
        for foot, held in enumerate(stance):
            if not held:
                self._follow(foot, terms, reference)

    def _switch(self) -> None:
        """Write gains and weights of the feet that stand and of those that swing."""
        super().bind(self.rows)
        for foot, held in enumerate(self._stance):
            block = self._block(foot)
            block.error[:] = 0.0
            if not held:
                block.kp[:], block.kd[:], block.weight[:] = self._swing_kp, self._swing_kd, self._swing_weight

    def _follow(self, foot: int, terms: WholeBodyTerms, reference: WholeBodyReference) -> None:
        block = self._block(foot)
        jacobian, drift = terms.foot_centre(foot)
        block.jacobian[:] = jacobian
        block.error[:] = reference.foot_position[foot] - terms.contact_points[foot]
        block.rate[:] = reference.foot_velocity[foot] - jacobian @ terms.v
        block.acceleration[:] = reference.foot_acceleration[foot] - drift

    def _block(self, foot: int) -> TaskRows:
        return self.rows.part(slice(3 * foot, 3 * foot + 3))
