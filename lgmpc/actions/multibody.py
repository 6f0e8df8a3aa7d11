"""Actions of a robot: dynamics, integrator, costs and constraints; impacts, and intervals that hold a state."""

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any, TypeVar

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from lgmpc.actions.base import Action, Stage
from lgmpc.actions.contacts import Contact, ContactSet
from lgmpc.actions.dynamics import Dynamics, actuated
from lgmpc.actions.implicit import Unknowns
from lgmpc.actions.integrators import Integrator, SemiImplicitEuler
from lgmpc.actions.linearisation import ExpansionSteps, expand_in_steps
from lgmpc.costs import (
    Bounded,
    ConstraintItem,
    Cost,
    CostItem,
    Parameter,
    ParameterLayout,
    StageSymbols,
    constraint_of,
    cost_of,
)
from lgmpc.errors import InputError
from lgmpc.robot.symbolic import SymbolicModel
from lgmpc.state import State, StateMultibody
from lgmpc.typing import identifier, instance, numbers

Item = TypeVar("Item", CostItem, ConstraintItem)


class ItemAction(Action):
    """An action with lists of costs and constraints.

    Args:
        name: a C identifier; part of the names of the compiled functions.
        robot: the symbolic algorithms.
        state: the space of x.
        nu: dimension of the control.
        parameters: the action's own, before those of the items.
        costs: the costs.
        constraints: the constraints.

    Attributes:
        own_parameters: number of entries of the action's own parameters, the first ones.

    Raises:
        InputError: a name that is no identifier, or two parameters of one name.
    """

    def __init__(
        self,
        name: str,
        robot: SymbolicModel,
        state: State,
        nu: int,
        parameters: Iterable[Parameter],
        costs: Sequence[CostItem],
        constraints: Sequence[ConstraintItem],
    ) -> None:
        identifier("name", name)
        self.name, self.robot, self.state, self.nu = name, robot, state, nu
        self.costs = _items("costs", costs, CostItem)
        self.constraints = _items("constraints", constraints, ConstraintItem)
        items, own = (*self.costs, *self.constraints), tuple(parameters)
        self.parameters = ParameterLayout(*own, *(p for item in items for p in item.parameters()))
        self.own_parameters = sum(parameter.size for parameter in own)

    @cached_property
    def expansion(self) -> ExpansionSteps | None:
        """The expansion in steps; None where it has other unknowns than those of one linear equation."""
        return expand_in_steps(self)

    def step(self, x: Any, u: Any, p: Any) -> Any:
        """Return the state (nx,) at the end of the interval."""
        return self.stage(x, u, p, Unknowns()).x_next

    def cost(self, x: Any, u: Any, p: Any) -> Cost:
        """Return the running cost."""
        return self.stage(x, u, p, Unknowns()).cost

    def constraint(self, x: Any, u: Any, p: Any) -> Bounded:
        """Return the path constraint."""
        return self.stage(x, u, p, Unknowns()).path

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        """Return the costs that depend on the state alone, not multiplied by a duration."""
        symbols = StageSymbols(self.robot, x, self.parameters.split(p))
        return cost_of(self.costs, symbols, terminal=True)


def _items(name: str, items: Sequence[Item], kind: type[Item]) -> tuple[Item, ...]:
    given = tuple(items) if isinstance(items, Iterable) else (items,)
    for i, item in enumerate(given):
        if not isinstance(item, kind):
            expected = f"a {kind.__name__}: {kind.__name__}(name, residual, ...)"
            raise InputError(f"{name}[{i}]", type(item).__name__, expected)
    if not isinstance(items, Iterable):
        raise InputError(name, type(items).__name__, f"a list of {kind.__name__}")
    return given


class MultibodyAction(ItemAction):
    """A robot over an interval: its running costs are multiplied by the interval's duration, its terminal ones not.

    Parameters: ``duration`` (s), those of the dynamics, and those of the items, called ``<item>_<parameter>``.

    Args:
        name: a C identifier; part of the names of the compiled functions.
        dynamics: equations of motion.
        costs: evaluated at the interval's beginning; those of the state alone are the terminal cost.
        constraints: evaluated at the interval's beginning.
        integrator: semi-implicit Euler unless given.

    Attributes:
        dynamics: equations of motion.
        integrator: the integration method.

    Raises:
        InputError: a name that is no identifier, or two items of one name.
    """

    def __init__(
        self,
        name: str,
        dynamics: Dynamics,
        costs: Sequence[CostItem] = (),
        constraints: Sequence[ConstraintItem] = (),
        integrator: Integrator | None = None,
    ) -> None:
        for what, given, base in (("dynamics", dynamics, Dynamics), ("integrator", integrator, Integrator)):
            if given is not None or what == "dynamics":
                instance(what, given, base, f"an object of a class of {base.__name__}")
        self.dynamics = dynamics
        self.integrator = SemiImplicitEuler() if integrator is None else integrator
        parameters = (Parameter("duration", 1, "length of the interval, s", 0.01, "positive"), *dynamics.parameters)
        super().__init__(name, dynamics.robot, dynamics.state, dynamics.nu, parameters, costs, constraints)

    def stage(self, x: Any, u: Any, p: Any, unknowns: Unknowns) -> Stage:
        """Return all expressions of the interval."""
        values, nq = self.parameters.split(p), self.robot.nq
        x_next, motion = self.integrator.step(self.dynamics, x[:nq], x[nq:], u, values, unknowns)
        symbols = StageSymbols(self.robot, x, values, u=u, a=motion.a, tau=motion.tau, forces=motion.forces)
        cost = cost_of(self.costs, symbols, scale=values["duration"])
        path = constraint_of(self.constraints, symbols)
        return Stage(x_next, cost, path, self.integrator.move(x[nq:], x_next[nq:], values))


class ImpulseAction(ItemAction):
    """An impact of contacts on the ground: the velocity jumps, the configuration stays; no control, no duration.

        M (v+ - v) = J^T f,        J v+ = -restitution J v

    for the contacts whose flag is 1. In costs and constraints ``forces`` are the impulses f (N.s), and x is the state
    before the impact.

    Parameters: contact_flags, contact_damping, restitution, and those of the items.

    Args:
        name: a C identifier; part of the names of the compiled functions.
        model: the robot.
        contacts: names of frames (points) or contacts.
        costs: counted once, not multiplied by any duration.
        constraints: evaluated at the impact.

    Raises:
        InputError: a name that is no identifier, an unknown contact frame, or two items of one name.
        ModelError: unsupported joints.
    """

    def __init__(
        self,
        name: str,
        model: pin.Model,
        contacts: Sequence[str | Contact],
        costs: Sequence[CostItem] = (),
        constraints: Sequence[ConstraintItem] = (),
    ) -> None:
        self.contacts = ContactSet(model, contacts)
        restitution = Parameter("restitution", 1, "speed after over speed before the impact")
        parameters = (*self.contacts.parameters, restitution)
        super().__init__(name, SymbolicModel(model), StateMultibody(model), 0, parameters, costs, constraints)

    def stage(self, x: Any, u: Any, p: Any, unknowns: Unknowns) -> Stage:
        """Return all expressions of the impact."""
        values, robot, contacts = self.parameters.split(p), self.robot, self.contacts
        q, v, nv = x[: robot.nq], x[robot.nq :], robot.nv
        solver, flags = contacts.solver(robot, q, values), contacts.flags(values)
        before = values["restitution"] * contacts.velocity(robot, q, v)
        # The impact takes no time: gravity and Coriolis forces have no impulse.
        mass, rows = robot.crba(q), contacts.jacobian(robot, q)

        def residual(z: Any) -> Any:
            after, f = z[:nv], z[nv:]
            loose = (1 - flags + values["contact_damping"]) * f
            momentum = mass @ (after - v) - rows.T @ (flags * f)
            return ca.vertcat(momentum, flags * (contacts.velocity(robot, q, after) + before) + loose)

        z = unknowns.define_linear(solver, ca.vertcat(mass @ v, -flags * before), residual)
        symbols = StageSymbols(robot, x, values, u=u, forces=contacts.by_frame(z[nv:], robot, q))
        path = constraint_of(self.constraints, symbols)
        move = ca.vertcat(ca.SX(nv, 1), z[:nv] - v)
        return Stage(ca.vertcat(q, z[:nv]), cost_of(self.costs, symbols), path, move)


class HoldAction(ItemAction):
    """An interval of zero length without control: the state stays the same and satisfies constraints.

    Behind the last interval it makes them terminal constraints; the horizon then ends with the same state twice:

        arrive = HoldAction("arrive", model, costs, [ConstraintItem("hand", FramePlacement("hand", goal))])
        problem = ShootingProblem([move] * 50 + [arrive])

    Between two others it is a waypoint. SQP and nonlinear programmes satisfy it; FDDP supports no constraints.

    Args:
        name: a C identifier; part of the names of the compiled functions.
        model: the robot.
        costs: of the last state, where this is the last action (counted once).
        constraints: on the state: configuration and velocity.

    Raises:
        InputError: a name that is no identifier, or two items of one name.
        ModelError: unsupported joints.
    """

    def __init__(
        self, name: str, model: pin.Model, costs: Sequence[CostItem] = (), constraints: Sequence[ConstraintItem] = ()
    ) -> None:
        actuated(model)  # checks its type
        super().__init__(name, SymbolicModel(model), StateMultibody(model), 0, (), costs, constraints)

    def stage(self, x: Any, u: Any, p: Any, unknowns: Unknowns) -> Stage:
        """Return the state itself, no cost, and the constraints."""
        symbols = StageSymbols(self.robot, x, self.parameters.split(p))
        return Stage(x, Cost(), constraint_of(self.constraints, symbols))


def thrusters(model: pin.Model, positions: ArrayLike, directions: ArrayLike, drag_ratio: ArrayLike = 0.0) -> Any:
    """Return (nv, n) the actuation of thrusters fixed to a free base: column i is the wrench of unit thrust.

    Args:
        model: its first joint is a free-flyer.
        positions: (n, 3) of the thrusters, base frame, m.
        directions: (n, 3) unit vectors of positive thrust, base frame.
        drag_ratio: (n,) or a number: moment about the direction per thrust, signed by the sense of rotation, m.

    Raises:
        InputError: no free base, inconsistent shapes, or directions that are not of unit length.
    """
    if actuated(model).start == 0:
        raise InputError("model", f"{model.name}, whose base is fixed", "a model whose first joint is a free-flyer")
    points = numbers("positions", positions, finite=True)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError("positions", f"shape {points.shape}", "shape (n, 3)")
    axes = numbers("directions", directions, points.shape)
    ratio = numbers("drag_ratio", drag_ratio, (), (len(points),), finite=True)
    if not np.allclose(np.linalg.norm(axes, axis=1), 1.0, rtol=0, atol=1e-9):
        raise InputError("directions", "vectors of other lengths", "unit vectors")
    matrix = np.zeros((int(model.nv), len(points)))
    matrix[:3] = axes.T
    matrix[3:6] = (np.cross(points, axes) + np.broadcast_to(ratio, len(points))[:, None] * axes).T
    return matrix
