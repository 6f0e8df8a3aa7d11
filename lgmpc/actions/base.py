"""The base class of actions: one interval of an optimal control problem, written as CasADi expressions.

Solvers use the two stage functions that follow from the expressions (values; linear-quadratic expansion in tangent
coordinates), which :mod:`lgmpc.ocp` maps over a horizon and compiles.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.actions.implicit import Unknowns
from lgmpc.actions.linearisation import ExpansionSteps, at_zero
from lgmpc.compile import cached
from lgmpc.costs import Bounded, Cost, ParameterLayout
from lgmpc.errors import InputError
from lgmpc.state.base import State
from lgmpc.typing import Array, IntArray, numbers


@dataclass(frozen=True)
class Stage:
    """An action's expressions at one point.

    Attributes:
        x_next: (nx,) state at the end of the interval.
        cost: running cost.
        path: path constraint.
        move: m of ``x_next = x (+) m``, if the interval is one such motion: its derivatives are then known in closed
            form.
    """

    x_next: Any
    cost: Cost
    path: Bounded
    move: Any = None


@dataclass(frozen=True)
class StageValue:
    """The values of an action at one point.

    Attributes:
        x_next: (nx,) state at the end of the interval.
        cost: running cost.
        constraint: (ng,) value of the path constraint.
        lower: (ng,) its lower bounds.
        upper: (ng,) its upper bounds.
    """

    x_next: Array
    cost: float
    constraint: Array
    lower: Array
    upper: Array

    @property
    def violation(self) -> float:
        """Largest violation of the constraint's bounds; 0 if they hold."""
        if self.constraint.size == 0:
            return 0.0
        outside = np.maximum(self.lower - self.constraint, self.constraint - self.upper)
        return float(max(outside.max(), 0.0))


class Action(ABC):
    """One interval: dynamics, cost and path constraint as expressions of state x, control u and parameters p.

    A subclass sets the attributes and writes at least :meth:`step`, with CasADi operations that SX symbols support.
    All that may change between two solves is a parameter, never a number inside an expression.

    Attributes:
        name: a C identifier; part of the names of the compiled functions.
        state: the space of x.
        nu: dimension of the control.
        parameters: layout of p.
        smooth: whether derivatives of any order exist, as of expressions.
    """

    smooth: bool = True
    name: str
    state: State
    nu: int
    parameters: ParameterLayout

    @abstractmethod
    def step(self, x: Any, u: Any, p: Any) -> Any:
        """Return the state (nx,) at the end of the interval."""

    def cost(self, x: Any, u: Any, p: Any) -> Cost:
        """Return the running cost; none unless overridden."""
        return Cost()

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        """Return the cost of the state at the end of the horizon; none unless overridden."""
        return Cost()

    def constraint(self, x: Any, u: Any, p: Any) -> Bounded:
        """Return the path constraint; none unless overridden."""
        return Bounded.stack()

    def stage(self, x: Any, u: Any, p: Any, unknowns: Unknowns) -> Stage:
        """Return all expressions of the interval.

        An action whose expressions share work, or that defines quantities by equations (see
        :mod:`lgmpc.actions.implicit`), overrides this method and derives the others from it.
        """
        return Stage(self.step(x, u, p), self.cost(x, u, p), self.constraint(x, u, p))

    @cached_property
    def value_function(self) -> ca.Function:
        """``(x, u, p) -> (x_next, cost, constraint, lower, upper)``."""
        x, u, p = (
            ca.SX.sym(name, n) for name, n in (("x", self.state.nx), ("u", self.nu), ("p", self.parameters.size))
        )
        stage = self._checked(self.stage(x, u, p, Unknowns()))
        outputs = [stage.x_next, stage.cost.value, stage.path.value, stage.path.lower, stage.path.upper]
        names = ["x_next", "cost", "constraint", "lower", "upper"]
        return ca.Function(f"{self.name}_value", [x, u, p], outputs, ["x", "u", "p"], names)

    @cached_property
    def path_rows(self) -> int:
        """Number of rows of the path constraint."""
        return cached(_path_rows, self)

    @cached_property
    def terminal_value_function(self) -> ca.Function:
        """``(x, p) -> cost``."""
        x, p = ca.SX.sym("x", self.state.nx), ca.SX.sym("p", self.parameters.size)
        cost = self._checked_cost("terminal_cost", self.terminal_cost(x, p)).value
        return ca.Function(f"{self.name}_terminal_value", [x, p], [cost], ["x", "p"], ["cost"])

    @cached_property
    def quadratic_function(self) -> ca.Function:
        """``(x, u, x_next, p) -> (A, B, b, Q, S, R, q, r, C, D, lower, upper, cost)``.

        The expansion around (x, u) in tangent coordinates, for a trajectory whose next state is ``x_next``:

            dx+  = A dx + B du + b,                     b = f(x, u) (-) x_next
            cost + [q; r]^T [dx; du] + 1/2 [dx; du]^T [Q S^T; S R] [dx; du]
            lower <= C dx + D du <= upper               (bounds minus the constraint's value)

        With ``x_next = f(x, u)`` A and B are the derivatives of the dynamics in tangent coordinates at both ends.
        """
        x, p = ca.SX.sym("x", self.state.nx), ca.SX.sym("p", self.parameters.size)
        x_next, u, dx = ca.SX.sym("x_next", self.state.nx), ca.SX.sym("u", self.nu), ca.SX.sym("dx", self.state.ndx)
        unknowns = Unknowns(keep=True)
        stage = self.stage(self.state.integrate_symbolic(x, dx), u, p, unknowns)
        gap, cost, path = self.state.diff_symbolic(x_next, stage.x_next), stage.cost, stage.path
        a, b = unknowns.jacobians(gap, dx, u)
        c, d = unknowns.jacobians(path.value, dx, u)
        weight = cost.weight
        hessian, gradient = unknowns.square(cost.residual, weight * cost.curvature, weight * cost.gradient, dx, u)
        expressions = {
            "A": a,
            "B": b,
            "b": gap,
            "Q": hessian[0][0],
            "S": hessian[1][0],
            "R": hessian[1][1],
            "q": gradient[0],
            "r": gradient[1],
            "C": c,
            "D": d,
            "lower": path.lower - path.value,
            "upper": path.upper - path.value,
            "cost": cost.value,
        }
        inputs = [x, u, x_next, p]
        outputs = at_zero(unknowns.resolve([*inputs, dx], list(expressions.values())), dx)
        names = ["x", "u", "x_next", "p"]
        return ca.Function(f"{self.name}_quadratic", inputs, outputs, names, list(expressions))

    @cached_property
    def bounds_function(self) -> ca.Function:
        """``p -> (lower, upper)`` of the path constraint."""
        value = self.value_function
        p: Any = value.sx_in(2) if value.is_a("SXFunction") else value.mx_in(2)
        *_, lower, upper = value.call([self.state.neutral(), ca.DM.zeros(self.nu), p])
        return ca.Function(f"{self.name}_bounds", [p], [ca.densify(lower), ca.densify(upper)])

    def bounded_controls(self) -> IntArray:
        """Return the control (ng,) that each row of the path constraint bounds.

        A row is a control plus an expression in the parameters, a reference for instance; any other has the index -1.
        """
        x, u, p = (
            ca.SX.sym(name, n) for name, n in (("x", self.state.nx), ("u", self.nu), ("p", self.parameters.size))
        )
        value = ca.SX(self.constraint(x, u, p).value)
        of_state, slope = ca.jacobian(value, x), ca.jacobian(value, u)
        rows = np.full(value.shape[0], -1, dtype=np.int64)
        for i in range(value.shape[0]):
            row = slope[i, :]
            if of_state[i, :].nnz() == 0 and row.nnz() == 1 and ca.SX(row.nz[0]).is_one():
                rows[i] = row.sparsity().get_triplet()[1][0]
        return rows

    def guarded(self, call: Callable[[], int], first: int) -> Callable[[], int]:
        """Return a call that names the node of an exception of the action's own; calls of expressions have none.

        Args:
            call: evaluates the action at consecutive nodes, once each.
            first: the first of these nodes.
        """
        return call

    def _checked(self, stage: Stage) -> Stage:
        """Return a stage of the right types and shapes."""
        self._checked_column("step", stage.x_next, self.state.nx)
        self._checked_cost("cost", stage.cost)
        if not isinstance(stage.path, Bounded):
            raise InputError(f"constraint of '{self.name}'", type(stage.path).__name__, "Bounded(value, lower, upper)")
        rows = ca.SX(stage.path.value).shape[0]
        for name in ("value", "lower", "upper"):
            self._checked_column(f"{name} of the constraint", getattr(stage.path, name), rows)
        return stage

    def _checked_cost(self, name: str, cost: Cost) -> Cost:
        if not isinstance(cost, Cost):
            expected = "Cost((CostTerm(residual, weight=...), ...))"
            raise InputError(f"{name} of '{self.name}'", type(cost).__name__, expected)
        for i, term in enumerate(cost.terms):
            rows, weights = ca.SX(term.residual).shape, ca.SX(term.weight).shape
            if rows[1] != 1:
                raise InputError(f"residual {i} of {name} of '{self.name}'", f"shape {rows}", "a column")
            if weights not in ((1, 1), rows):
                expected = f"a number or shape {rows}, as its residual"
                raise InputError(f"weight {i} of {name} of '{self.name}'", f"shape {weights}", expected)
        return cost

    def _checked_column(self, name: str, column: Any, rows: int) -> None:
        kinds = (ca.SX, ca.DM, np.ndarray, float, int)
        if not isinstance(column, kinds):
            raise InputError(f"{name} of '{self.name}'", type(column).__name__, f"a CasADi column of shape ({rows}, 1)")
        shape = column.shape if hasattr(column, "shape") else ()
        if shape not in ((rows, 1), (rows,)) and not (rows == 1 and shape == ()):
            raise InputError(f"{name} of '{self.name}'", f"shape {shape}", f"shape ({rows}, 1)")

    @property
    def expansion(self) -> ExpansionSteps | None:
        """The same expansion in steps, for actions that have one."""
        return None

    @cached_property
    def terminal_quadratic_function(self) -> ca.Function:
        """``(x, p) -> (Q, q, cost)``: the expansion of the terminal cost in tangent coordinates."""
        x, p = ca.SX.sym("x", self.state.nx), ca.SX.sym("p", self.parameters.size)
        dx = ca.SX.sym("dx", self.state.ndx)
        cost = self.terminal_cost(self.state.integrate_symbolic(x, dx), p)
        weight = cost.weight
        hessian, gradient = Unknowns().square(cost.residual, weight * cost.curvature, weight * cost.gradient, dx)
        outputs = at_zero([hessian[0][0], gradient[0], cost.value], dx)
        return ca.Function(f"{self.name}_terminal_quadratic", [x, p], outputs, ["x", "p"], ["Q", "q", "cost"])

    def evaluate(self, x: Array, u: Array, p: Array) -> StageValue:
        """Evaluate the action at one point (interpreted: for inspection and tests, not for loops).

        Args:
            x: (nx,) state.
            u: (nu,) control.
            p: (np,) parameters.

        Raises:
            InputError: wrong shapes.
        """
        x, u, p = self._arguments(x, u, p)
        x_next, cost, value, lower, upper = (np.asarray(v.full()[:, 0]) for v in self.value_function(x, u, p))
        return StageValue(x_next, float(cost[0]), value, lower, upper)

    def _arguments(self, x: Array, u: Array, p: Array) -> tuple[Array, Array, Array]:
        """Return the arguments of :meth:`evaluate` as arrays; CasADi would repeat scalars and cut what is too long."""
        sizes = {"x": self.state.nx, "u": self.nu, "p": self.parameters.size}
        x, u, p = (numbers(name, value, (sizes[name],)) for name, value in (("x", x), ("u", u), ("p", p)))
        return x, u, p


def _path_rows(action: Action) -> int:
    return int(action.value_function.size1_out("constraint"))
