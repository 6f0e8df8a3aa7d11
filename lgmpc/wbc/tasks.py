"""Tasks of the whole-body QP: desired accelerations of quantities of the robot, with weights.

A task drives a quantity y of the robot, with y' = J v and y'' = J a + J' v, to its target. Its rows of the QP are

    J a + J' v = y''_target + kp (y_target - y) + kd (y'_target - y')        each with a weight.

A user-defined task takes three lines; its Jacobian, its drift J' v and machine code are generated from the expression:

    class HandHeight(SymbolicTask):
        dim = 1
        def position(self, s): return s.placement("hand").translation[2]

    hand = HandHeight(Gain(kp=100.0), weight=10.0)
    wbc = WholeBodyController(robot, settings, [*standard_tasks(robot, settings), hand])
    hand.target.position[:] = 0.4  # at any tick; nothing is compiled again

``s`` is a :class:`~lgmpc.costs.StageSymbols` with q and v, the task's targets as ``s["position"]`` and so on, and
``s["stance"]`` (nc,), 1 for each foot in contact and 0 for the others. A quantity that no expression describes is a
:class:`NumericTask`: numpy rows, computed at every tick. The built-in tasks are in :mod:`lgmpc.wbc.library`.

Source: A. Del Prete et al., "Implementing torque control with high-ratio gear boxes and without joint-torque sensors",
IJHR 2016, section 3, for the form.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.costs import Parameter, ParameterLayout, StageSymbols
from lgmpc.errors import InputError, LgmpcError
from lgmpc.robot import Robot
from lgmpc.typing import Array
from lgmpc.wbc.settings import Gain
from lgmpc.wbc.terms import WholeBodyTerms


class UnknownTargetError(InputError, AttributeError):
    """The name of a target that a task does not have."""


class Target:
    """The targets of a task: named buffers, attributes of this object, to be written to between two ticks."""

    def __init__(self, task: str, buffers: Mapping[str, Array]) -> None:
        self._task, self._names = task, tuple(buffers)
        self.__dict__.update(buffers)

    def __getattr__(self, name: str) -> Array:
        """Raise for the name of a target that the task does not have.

        Raises:
            UnknownTargetError: names the nearest target.
        """
        if name.startswith("_"):
            raise AttributeError(name)
        raise UnknownTargetError(f"target of task '{self._task}'", name, "one of its targets", self._names)


class Task(ABC):
    """A block of rows of the QP with weights, and the target that they lead to.

    Args:
        gain: feedback.
        weight: one number, or one per row; not negative.
        name: unique among the tasks of a controller; the class's unless given.

    Attributes:
        name: name in messages and in :attr:`lgmpc.wbc.WholeBodyController.tasks`.
        dim: number of rows.
        target: named buffers; position, velocity and acceleration (dim,) unless the class has others.
        targets_together: all of them as one vector, one after the other.
        kp: (dim,) stiffness, 1/s2, a buffer too.
        kd: (dim,) damping, 1/s, a buffer too.
        weight: (dim,) weights, a buffer too.
        layout: names of the slices of :attr:`memory`.
        memory: the vector of which targets, gains and weights are views.

    Raises:
        InputError: if a weight is negative or not finite, or there are not as many weights as rows.
    """

    dim: int
    name: str = ""

    def __init__(self, gain: Gain, weight: float | Sequence[float], name: str = "") -> None:
        self.name = name or self.name or type(self).__name__
        targets = self.targets()
        self.layout = ParameterLayout(
            *(parameter for parameter, _ in targets),
            Parameter("kp", self.dim, "stiffness, 1/s2", gain.kp),
            Parameter("kd", self.dim, "damping, 1/s", gain.damping),
            Parameter("weight", self.dim, "weights of the rows", _checked_weight(self.name, weight, self.dim)),
        )
        self.memory = self.layout.default.copy()
        views = {key: self.layout.view(self.memory, key) for key in self.layout}
        self.kp, self.kd, self.weight = views["kp"], views["kd"], views["weight"]
        self.target = Target(self.name, {each.name: views[each.name].reshape(shape) for each, shape in targets})
        self.targets_together: Array = self.memory[: self.layout["kp"].start]

    def structural_state(self) -> dict[str, Any]:
        """Return the attributes that its expressions depend on (see :mod:`lgmpc.compile`): all but the buffers.

        An array that an expression reads would be missing there: constants are plain numbers and tuples.
        """
        return {name: value for name, value in vars(self).items() if not isinstance(value, (np.ndarray, Target))}

    def targets(self) -> list[tuple[Parameter, tuple[int, ...]]]:
        """Return the targets, each with the shape of its buffer."""
        names = ("position", "velocity", "acceleration")
        return [(Parameter(each, self.dim, f"target {each}"), (self.dim,)) for each in names]

    def hold(self, position: Array) -> None:
        """Set the target to rest at ``position``."""
        self.target.position[:] = position
        self.target.velocity[:] = self.target.acceleration[:] = 0.0

    def stand(self, robot: Robot, terms: WholeBodyTerms) -> None:  # noqa: B027 - not every task has such a target
        """Set the target of standing still at the sensed place in the robot's reference posture."""


@dataclass(frozen=True)
class TaskRows:
    """Rows ``jacobian a = rhs`` as expressions.

    Attributes:
        jacobian: (dim, nv).
        rhs: (dim,).
        weight: (dim,).
    """

    jacobian: Any
    rhs: Any
    weight: Any


class SymbolicTask(Task):
    """A task written as expressions: :meth:`position`, or :meth:`velocity` with :meth:`error` where it has none.

    The velocity must be linear in v. Jacobian and drift are its derivatives; a class overrides them only to share
    what the robot's algorithms compute anyway.
    """

    def position(self, s: StageSymbols) -> Any:
        """Return the (dim,) quantity that follows the target position."""
        raise InputError(f"task '{self.name}'", "neither position nor velocity", "an expression of one of them")

    def velocity(self, s: StageSymbols) -> Any:
        """Return its (dim,) rate, linear in v."""
        return along_motion(s, self.position(s))

    def error(self, s: StageSymbols) -> Any:
        """Return the (dim,) error that the stiffness multiplies."""
        return s["position"] - self.position(s)

    def rate(self, s: StageSymbols) -> Any:
        """Return the (dim,) error of the rate that the damping multiplies."""
        return s["velocity"] - self.velocity(s)

    def acceleration(self, s: StageSymbols) -> Any:
        """Return the (dim,) feed-forward."""
        return s["acceleration"]

    def jacobian(self, s: StageSymbols) -> Any:
        """Return the (dim, nv) derivative of the velocity by v."""
        return ca.jacobian(self.velocity(s), s.v)

    def drift(self, s: StageSymbols) -> Any:
        """Return (dim,) the acceleration at zero joint-space acceleration, J' v."""
        return along_motion(s, self.velocity(s))

    def active(self, s: StageSymbols) -> Any:
        """Return (dim,) 1 for rows that are active at this tick, 0 for the others, whose targets are not read."""
        return ca.SX.ones(self.dim)

    def rows(self, symbols: StageSymbols) -> TaskRows:
        """Return the rows; the task's targets, gains and weights are parameters ``<name>_<parameter>``.

        Raises:
            InputError: an expression does not have as many rows as ``dim``; names it.
        """
        s = symbols.within(self.name)
        parts = {}
        for part in ("velocity", "error", "rate", "acceleration", "drift", "active"):
            what, expected = f"{part} of task '{self.name}'", f"a CasADi column of shape ({self.dim}, 1) for its dim"
            try:
                column = parts[part] = ca.SX(getattr(self, part)(s))
            except LgmpcError:
                raise
            except Exception as error:  # of any kind: CasADi's, or of the user's own code
                reason = str(error).partition("\n")[0]
                raise InputError(what, f"{type(error).__name__}: {reason}", expected) from error
            if column.shape != (self.dim, 1):
                raise InputError(what, f"shape {column.shape}", expected)
        rhs = parts["acceleration"] + s["kp"] * parts["error"] + s["kd"] * parts["rate"] - parts["drift"]
        return TaskRows(self.jacobian(s), *(ca.if_else(parts["active"], each, 0.0) for each in (rhs, s["weight"])))


class NumericTask(Task):
    """A task computed by numpy at every tick: a subclass writes the rows in :meth:`update`.

    Args:
        robot: the robot.
        gain: see :class:`Task`.
        weight: see :class:`Task`.
        name: see :class:`Task`.

    Attributes:
        jacobian: (dim, nv).
        error: (dim,) target minus position.
        rate: (dim,) target velocity minus velocity.
        acceleration: (dim,) feed-forward.
        drift: (dim,) J' v.
    """

    def __init__(self, robot: Robot, gain: Gain, weight: float | Sequence[float], name: str = "") -> None:
        super().__init__(gain, weight, name)
        self.jacobian = np.zeros((self.dim, robot.nv))
        self.error, self.rate, self.acceleration, self.drift = np.zeros((4, self.dim))

    @abstractmethod
    def update(self, terms: WholeBodyTerms) -> None:
        """Write the rows at the sensed state ``terms.q``, ``terms.v``."""

    @property
    def rhs(self) -> Array:
        """(dim,) right-hand side of the rows."""
        return self.acceleration + self.kp * self.error + self.kd * self.rate - self.drift


def along_motion(s: StageSymbols, expression: Any) -> Any:
    """Return the rate of ``expression`` along the motion q' = q'(q, v) at constant v."""
    step = ca.SX.sym("step", s.robot.nv)
    along = ca.jtimes(s.robot.integrate(s.q, step), step, s.v)
    return ca.jtimes(expression, s.q, ca.substitute(along, step, ca.SX.zeros(s.robot.nv)))


def _checked_weight(name: str, weight: float | Sequence[float], dim: int) -> Array:
    values = np.asarray(weight, dtype=np.float64)
    if values.shape not in ((), (dim,)):
        raise InputError(f"weight of task '{name}'", weight, f"one number or {dim}")
    if not (np.isfinite(values).all() and (values >= 0).all()):
        raise InputError(f"weight of task '{name}'", weight, "finite, not negative")
    return values
