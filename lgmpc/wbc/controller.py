"""The whole-body controller: state and reference in, joint torques out, every millisecond."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.typing import Array
from lgmpc.wbc.assembly import QpAssembly, WholeBodyLimits
from lgmpc.wbc.reference import WholeBodyReference
from lgmpc.wbc.solver import QpStatus, WholeBodySolver
from lgmpc.wbc.tasks import (
    AngularMomentumTask,
    BaseOrientationTask,
    BasePositionTask,
    ComTask,
    FootTask,
    Gain,
    PostureTask,
    Task,
    TaskStack,
)
from lgmpc.wbc.terms import WholeBodyTerms

__all__ = ["WholeBodyController", "WholeBodySettings", "standing_tasks"]

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class WholeBodySettings:
    """Weights, feedback gains and limits of the whole-body QP.

    Attributes:
        limits: hard limits.
        com_weight: (3,) weight of the centre-of-mass task, world axes.
        com_gain: 1/s^2 and 1/s.
        base_orientation_weight: weight of the base orientation task.
        base_orientation_gain: 1/s^2 and 1/s.
        base_position_weight: weight of the base position task (0 leaves it out).
        base_position_gain: 1/s^2 and 1/s.
        angular_momentum_weight: weight of the angular momentum task (0 leaves it out).
        angular_momentum_gain: 1/s.
        posture_weight: weight of the posture task.
        posture_gain: 1/s^2 and 1/s.
        stance_weight: weight that holds stance feet.
        stance_damping: 1/s.
        swing_weight: weight of swing foot tracking.
        swing_gain: 1/s^2 and 1/s.
        force_weight: weight of staying near the reference contact forces.
        acceleration_weight: regularisation of joint-space accelerations.
        tolerance: residual at which ProxQP stops.
        max_iterations: ProxQP's outer iterations, each of at most 10 Newton steps.
        fallback_damping: N.m.s/rad, joint damping while the QP does not solve.

    Raises:
        InputError: if a weight or the damping is negative, or the tolerance or the iterations are not positive.
    """

    limits: WholeBodyLimits = field(default_factory=WholeBodyLimits)
    com_weight: tuple[float, float, float] = (10.0, 10.0, 10.0)
    com_gain: Gain = Gain(100.0, 20.0)
    base_orientation_weight: float = 0.1
    base_orientation_gain: Gain = Gain(400.0, 40.0)
    base_position_weight: float = 0.0
    base_position_gain: Gain = Gain(100.0, 20.0)
    angular_momentum_weight: float = 100.0
    angular_momentum_gain: float = 10.0
    posture_weight: float = 1e-3
    posture_gain: Gain = Gain(100.0, 20.0)
    stance_weight: float = 1e3
    stance_damping: float = 20.0
    swing_weight: float = 10.0
    swing_gain: Gain = Gain(400.0, 40.0)
    force_weight: float = 1e-4
    acceleration_weight: float = 1e-6
    tolerance: float = 1e-5
    max_iterations: int = 50
    fallback_damping: float = 0.1

    def __post_init__(self) -> None:
        """Refuse values that no QP can have; the tasks check their own weights and gains."""
        for name in ("base_position_weight", "angular_momentum_weight", "force_weight", "acceleration_weight"):
            self._require(name, getattr(self, name) >= 0, "not negative")
        self._require("fallback_damping", self.fallback_damping >= 0, "not negative")
        self._require("tolerance", self.tolerance > 0, "a positive number")
        self._require("max_iterations", self.max_iterations >= 1, "at least 1")

    def _require(self, name: str, right: bool, expected: str) -> None:
        value = getattr(self, name)
        if not (right and math.isfinite(value)):
            raise InputError(name, value, f"{expected}, finite")


def standing_tasks(robot: Robot, settings: WholeBodySettings) -> list[Task]:
    """Return the tasks whose weight is not zero, in the order of their rows."""
    tasks: list[Task] = [
        FootTask(robot, settings.stance_damping, settings.swing_gain, settings.stance_weight, settings.swing_weight),
        ComTask(robot, settings.com_gain, settings.com_weight),
        BaseOrientationTask(robot, settings.base_orientation_gain, settings.base_orientation_weight),
        PostureTask(robot, settings.posture_gain, settings.posture_weight),
    ]
    if settings.base_position_weight > 0:
        tasks.append(BasePositionTask(robot, settings.base_position_gain, settings.base_position_weight))
    if settings.angular_momentum_weight > 0:
        tasks.append(AngularMomentumTask(robot, settings.angular_momentum_gain, settings.angular_momentum_weight))
    return tasks


class WholeBodyController:
    """Torques that follow a :class:`WholeBodyReference` within the robot's limits.

    A tick never raises: when the QP does not solve, the last torques stay, with joint damping, and the failure is
    counted and logged.

    Args:
        robot: the controller's model of the robot.
        settings: weights, gains, limits.
        tasks: the tasks; by default :func:`standing_tasks`.

    Attributes:
        terms: robot quantities of the last tick.
        tau: (nu,) torque of the last tick, N.m.
        forces: (nc, 3) contact forces of the last tick, N.
        acceleration: (nv,) acceleration of the last tick.
        status: how the last QP ended.
        failures: ticks without a solution so far.
    """

    def __init__(self, robot: Robot, settings: WholeBodySettings, tasks: Sequence[Task] | None = None) -> None:
        self.robot = robot
        self.settings = settings
        self.terms = WholeBodyTerms(robot)
        self._stack = TaskStack(standing_tasks(robot, settings) if tasks is None else tasks, robot.nv)
        self._assembly = QpAssembly(
            robot, self._stack, settings.limits, settings.force_weight, settings.acceleration_weight
        )
        self._solver = WholeBodySolver(self._assembly, settings.tolerance, settings.max_iterations)
        self.tau = np.zeros(robot.nu)
        self.forces = np.zeros((len(robot.contact_ids), 3))
        self.acceleration = np.zeros(robot.nv)
        self.status = QpStatus.SOLVED
        self.failures = 0

    def reset(self) -> None:
        """Forget warm start, last command and failure count."""
        self._solver.reset()
        self.tau[:] = 0.0
        self.forces[:] = 0.0
        self.acceleration[:] = 0.0
        self.status = QpStatus.SOLVED
        self.failures = 0

    def sense(self, q: Array, v: Array) -> WholeBodyTerms:
        """Refresh :attr:`terms` at the measured state; call once a tick, before :meth:`solve`."""
        with _quiet():
            self.terms.update(q, v)
        return self.terms

    def solve(self, reference: WholeBodyReference) -> QpStatus:
        """Solve the QP at the sensed state; :attr:`tau`, :attr:`forces` and :attr:`acceleration` hold the result."""
        solved_before = self.status is QpStatus.SOLVED
        with _quiet():
            self._stack.update(self.terms, reference)
            self._assembly.update(self.terms, reference)
            self.status = self._solver.solve()
        if self.status is not QpStatus.SOLVED:
            self.failures += 1
            if solved_before:
                _LOG.warning(
                    "whole-body QP %s: last torques with joint damping until it solves again", self.status.name
                )
            return self.status
        solution = self._solver.solution
        nv = self.robot.nv
        self.acceleration[:] = solution[:nv]
        self.forces.ravel()[:] = solution[nv:]
        self.tau[:] = self._assembly.torques(self.terms, solution)
        return self.status

    @property
    def damping(self) -> float:
        """Joint damping to add to :attr:`tau`, N.m.s/rad: zero after a solved tick."""
        return 0.0 if self.status is QpStatus.SOLVED else self.settings.fallback_damping


def _quiet() -> np.errstate:
    """Infinite numbers end in NOT_FINITE, not in a NumPy warning that may have been made an exception."""
    return np.errstate(over="ignore", invalid="ignore")
