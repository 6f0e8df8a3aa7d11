"""The whole-body controller: state and targets in, joint torques out, every millisecond."""

import logging
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lgmpc.errors import InputError
from lgmpc.robot import Robot
from lgmpc.status import Status
from lgmpc.typing import Array, instance, typed
from lgmpc.wbc.assembly import WholeBodyQp
from lgmpc.wbc.hands import HandMotion, HandTask
from lgmpc.wbc.library import standard_tasks
from lgmpc.wbc.settings import WholeBodySettings
from lgmpc.wbc.solver import WholeBodySolver
from lgmpc.wbc.tasks import Task
from lgmpc.wbc.terms import WholeBodyTerms

_LOG = logging.getLogger(__name__)


class WholeBodyController:
    """Torques that follow the tasks' targets within the robot's limits.

    At every tick: :meth:`sense`; write targets and contacts; :meth:`solve`. A tick never raises: when the QP does not
    solve, the last torques stay, with joint damping, and the failure is counted and logged.

    Args:
        robot: the controller's model of the robot.
        settings: weights, gains, limits, for a robot of any mass.
        tasks: the tasks; by default :func:`~lgmpc.wbc.standard_tasks`. Those without any weight are left out of the QP.

    Attributes:
        settings: as given.
        terms: robot quantities of the last tick.
        qp: the data of the QP.
        solver: the data is written to its memory.
        tasks: the tasks by name; each holds its target.
        hands: motions of the hands of the settings.
        contacts: stance flags, friction, normals, target forces and normal-force bounds of the feet.
        external_wrench: (6,) known or estimated [force; moment about the centre of mass] on the base, N and N.m.
        joint_load: (nu,) known or estimated torques on the legs of what pushes them, N.m.
        joint_friction: (nu,) Coulomb friction of the joints that the torques overcome, N.m; the robot's at first.
        tau: (nu,) torque of the last tick, N.m.
        forces: (nc, 3) contact forces of the last tick, world axes, N.
        acceleration: (nv,) acceleration of the last tick.
        status: outcome of the last QP.
        failures: ticks without a solution so far.

    Raises:
        InputError: two tasks of one name, or a robot that cannot stand.
        CompileError: the compiler failed on the tasks' expressions.
    """

    @typed
    def __init__(self, robot: Robot, settings: WholeBodySettings, tasks: Sequence[Task] | None = None) -> None:
        self.robot, self.settings = robot, settings
        self.terms = WholeBodyTerms(robot)
        self.tasks: Mapping[str, Task] = _by_name(standard_tasks(robot, settings) if tasks is None else tasks)
        held = [(self.tasks.get(hand.frame), hand) for hand in settings.hands]
        self.hands = [HandMotion(robot, task, hand) for task, hand in held if isinstance(task, HandTask)]
        scaled = settings.scaled(robot)
        rows = WholeBodyQp.rows(robot, scaled)
        self.solver = WholeBodySolver(
            robot.nv + 3 * robot.nc,
            robot.nv - robot.nu,
            rows,
            settings.tolerance,
            settings.max_iterations,
            settings.solver,
        )
        self.qp = WholeBodyQp(robot, scaled, list(self.tasks.values()), self.solver, self.terms)
        self._stepping: bool | None = None
        self._weights = self._weights_of(scaled)
        self.contacts = self.qp.contacts
        self.external_wrench = self.qp.external_wrench
        self.joint_load, self.joint_friction = self.qp.joint_load, self.qp.joint_friction
        self.tau = np.zeros(robot.nu)
        self._flat_forces = np.zeros(3 * robot.nc)
        self.forces = self._flat_forces.reshape(robot.nc, 3)
        self.acceleration = np.zeros(robot.nv)
        self._solved = self.solver.solution[: robot.nv]
        self.status = Status.CONVERGED
        self.failures = 0
        self.use_stepping_weights(False)
        self.stand()

    def _weights_of(self, scaled: WholeBodySettings) -> dict[bool, dict[str, Array]]:
        """Return the weights of tasks that differ between standing and stepping, which is the key."""
        standing = dict(scaled.short_support_weights) if self.robot.short_support else {}
        moving = {**{k: standing[k] for k in standing if k == "upper_body_joints"}, **dict(scaled.stepping_weights)}
        own = {name: task.weight.copy() for name, task in self.tasks.items() if name in standing or name in moving}
        return {False: own | _weights(standing, own), True: own | _weights(moving, own)}

    def retune(self, settings: WholeBodySettings) -> None:
        """Change weights and gains of the standard tasks, between two ticks; other settings act at construction.

        A task without any weight is not part of the QP, and does not become one.
        """
        self.settings, stepping = settings, bool(self._stepping)
        for task in standard_tasks(self.robot, settings):
            if task.name in self.tasks:
                mine = self.tasks[task.name]
                mine.kp[:], mine.kd[:], mine.weight[:] = task.kp, task.kd, task.weight
        self._weights, self._stepping = self._weights_of(settings.scaled(self.robot)), None
        self.use_stepping_weights(stepping)

    def reset(self) -> None:
        """Discard warm start, last command and failure count; targets and contacts stay."""
        self.solver.reset()
        self.tau[:] = 0.0
        self.forces[:] = 0.0
        self.acceleration[:] = 0.0
        self.status = Status.CONVERGED
        self.failures = 0

    def stand(self) -> None:
        """Set every task's target to standing still at the sensed place, in the robot's reference posture."""
        for task in self.tasks.values():
            task.stand(self.robot, self.terms)
        for hand in self.hands:
            hand.begin(self.terms)

    def use_stepping_weights(self, stepping: bool) -> None:
        """Set the tasks' weights to those of a robot that steps, or to their own; returns at once if unchanged.

        Those of a robot that stands on a support short of its height are its own, too.
        A task whose own weights are zero is not part of the QP in either case.
        """
        if stepping is not self._stepping:
            self._stepping = stepping
            for name, weight in self._weights[stepping].items():
                self.tasks[name].weight[:] = weight

    def sense(self, q: Array, v: Array) -> WholeBodyTerms:
        """Refresh :attr:`terms` at the measured state; call once a tick, before :meth:`solve`."""
        self.terms.update(q, v)
        return self.terms

    def solve(self) -> Status:
        """Solve the QP at the sensed state; :attr:`tau`, :attr:`forces` and :attr:`acceleration` hold the result."""
        solved_before = self.status is Status.CONVERGED
        if not math.isfinite(self.qp.update()):
            self.solver.reset()
            self.status = Status.NOT_FINITE
        else:
            self.status = self.solver.solve()
        if self.status is Status.CONVERGED:
            self.acceleration[...] = self._solved
            self.qp.write_forces(self._flat_forces)
            self.qp.write_torques(self.tau)
        else:
            self.failures += 1
            if solved_before:
                _LOG.warning(
                    "whole-body QP %s: last torques with joint damping until it solves again", self.status.name
                )
        return self.status

    @property
    def damping(self) -> float:
        """Joint damping to add to :attr:`tau`, N.m.s/rad: zero after a solved tick."""
        return 0.0 if self.status is Status.CONVERGED else self.settings.fallback_damping_nms


def _weights(settings: Mapping[str, Any], tasks: Mapping[str, Array]) -> dict[str, Array]:
    """Return the weights that settings have for some of the tasks."""
    return {name: np.asarray(weight, dtype=np.float64) for name, weight in settings.items() if name in tasks}


def _by_name(tasks: Sequence[Task]) -> dict[str, Task]:
    instance("tasks", tasks, (list, tuple), "a list of tasks")
    for task in tasks:
        instance("tasks", task, Task, "a list of tasks, such as of classes derived from lgmpc.SymbolicTask")
    named = {task.name: task for task in tasks}
    if len(named) < len(tasks):
        names = [task.name for task in tasks]
        twice = sorted({name for name in names if names.count(name) > 1})
        raise InputError("tasks", f"two called '{twice[0]}'", "a name of its own for each")
    return named
