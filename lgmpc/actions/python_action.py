"""Actions written in Python: any code that maps arrays to arrays, with derivatives or with differences instead.

An expression that CasADi supports is better given as an :class:`~lgmpc.actions.Action`, which is compiled and much
faster. Here a simulator, a table or a learned model can be an interval. All solvers take it, alone or mixed with other
actions; nothing of it is compiled.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.actions.base import Action, StageValue
from lgmpc.actions.callback import Watch, python_function
from lgmpc.actions.penalized import penalty_parameters
from lgmpc.costs import Bounded, Cost, CostTerm
from lgmpc.errors import InputError
from lgmpc.typing import Array, IntArray

__all__ = ["Limits", "PenalizedPythonAction", "PythonAction", "StageDerivatives"]

_STEP = 6e-6
"""Step of central differences: about the cube root of the rounding unit."""

_VALUES = ("x_next", "cost", "constraint", "lower", "upper")
_QUADRATIC = ("A", "B", "b", "Q", "S", "R", "q", "r", "C", "D", "lower", "upper", "cost")


@dataclass(frozen=True, eq=False)
class Limits:
    """The hard constraint ``lower <= value <= upper`` at one point.

    Attributes:
        value: (ng,).
        lower: (ng,) minus infinity for no bound; a number for all.
        upper: (ng,) infinity for no bound; a number for all.
    """

    value: Array
    lower: Any = 0.0
    upper: Any = 0.0


@dataclass(frozen=True, eq=False)
class StageDerivatives:
    """Derivatives at one point, in tangent coordinates of the state (dx) and of the next state.

    Attributes:
        step_x: (ndx, ndx) of the next state.
        step_u: (ndx, nu).
        residual_x: (nr, ndx) of the cost's residual.
        residual_u: (nr, nu).
        limits_x: (ng, ndx) of the constraint's value.
        limits_u: (ng, nu).
    """

    step_x: Array
    step_u: Array
    residual_x: Array
    residual_u: Array
    limits_x: Array
    limits_u: Array


class PythonAction(Action):
    """One interval in Python: a subclass sets the attributes of an :class:`Action` and writes at least ``step``.

    The running cost is half the square of :meth:`residual`, which includes the weights; the Hessian is that of
    Gauss and Newton. The sizes of all results are those at the neutral state, zero control and default parameters.
    """

    smooth = False

    @abstractmethod
    def step(self, x: Array, u: Array, p: Array) -> Array:
        """Return the state (nx,) at the end of the interval."""

    def residual(self, x: Array, u: Array, p: Array) -> Array:
        """Return r (nr,) of the running cost ``1/2 r^T r``; none unless overridden."""
        return np.zeros(0)

    def terminal_residual(self, x: Array, p: Array) -> Array:
        """Return r (nr,) of the terminal cost ``1/2 r^T r``; none unless overridden."""
        return np.zeros(0)

    def limits(self, x: Array, u: Array, p: Array) -> Limits:
        """Return the path constraint; none unless overridden."""
        return Limits(np.zeros(0))

    def derivatives(self, x: Array, u: Array, p: Array) -> StageDerivatives:
        """Return the derivatives of step, residual and limits; central differences unless overridden."""
        state, reached = self.state, self._step(x, u, p)

        def outcome(dx: Array, du: Array) -> tuple[Array, Array, Array]:
            x_moved, u_moved = state.integrate(x, dx), u + du
            return (
                state.diff(reached, self._step(x_moved, u_moved, p)),
                self._residual(x_moved, u_moved, p),
                self._limits(x_moved, u_moved, p)[0],
            )

        zero_x, zero_u = np.zeros(state.ndx), np.zeros(self.nu)
        by_x = _differences(lambda d: outcome(d, zero_u), state.ndx)
        by_u = _differences(lambda d: outcome(zero_x, d), self.nu)
        return StageDerivatives(*(each for pair in zip(by_x, by_u, strict=True) for each in pair))

    def terminal_derivatives(self, x: Array, p: Array) -> Array:
        """Return the derivative (nr, ndx) of the terminal residual; central differences unless overridden."""
        return _differences(lambda d: (self._end(self.state.integrate(x, d), p),), self.state.ndx)[0]

    # The interface of solvers.

    def cost(self, x: Any, u: Any, p: Any) -> Cost:
        """Return the running cost at one point."""
        return Cost((CostTerm(ca.DM(self._residual(*_arrays(x, u, p)))),))

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        """Return the terminal cost at one point."""
        return Cost((CostTerm(ca.DM(self._end(*_arrays(x, p)))),))

    def constraint(self, x: Any, u: Any, p: Any) -> Bounded:
        """Return the path constraint at one point."""
        return Bounded(*map(ca.DM, self._limits(*_arrays(x, u, p))))

    def evaluate(self, x: Array, u: Array, p: Array) -> StageValue:
        """Evaluate the action at one point."""
        x, u, p = self._arguments(x, u, p)
        r = self._residual(x, u, p)
        return StageValue(self._step(x, u, p), 0.5 * float(r @ r), *self._limits(x, u, p))

    @cached_property
    def watch(self) -> Watch:
        """Exceptions of calls from solvers."""
        return Watch()

    @cached_property
    def value_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""

        def values(x: Array, u: Array, p: Array) -> list[Any]:
            found = self.evaluate(x, u, p)
            return [getattr(found, name) for name in _VALUES]

        ng = self._sizes["limits"]
        shapes = [(self.state.nx, 1), (1, 1), (ng, 1), (ng, 1), (ng, 1)]
        inputs = self._inputs("x", "u", "p")
        return python_function(
            f"{self.name}_value", inputs, dict(zip(_VALUES, shapes, strict=True)), values, self.watch
        )

    @cached_property
    def quadratic_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""
        ndx, nu, ng = self.state.ndx, self.nu, self._sizes["limits"]
        shapes = [(ndx, ndx), (ndx, nu), (ndx, 1), (ndx, ndx), (nu, ndx), (nu, nu), (ndx, 1), (nu, 1)]
        shapes += [(ng, ndx), (ng, nu), (ng, 1), (ng, 1), (1, 1)]
        inputs = self._inputs("x", "u", "x_next", "p")
        outputs = dict(zip(_QUADRATIC, shapes, strict=True))
        return python_function(f"{self.name}_quadratic", inputs, outputs, self._quadratic, self.watch)

    @cached_property
    def terminal_value_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""

        def value(x: Array, p: Array) -> list[Any]:
            r = self._end(x, p)
            return [0.5 * float(r @ r)]

        return python_function(
            f"{self.name}_terminal_value", self._inputs("x", "p"), {"cost": (1, 1)}, value, self.watch
        )

    @cached_property
    def terminal_quadratic_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""
        ndx = self.state.ndx

        def quadratic(x: Array, p: Array) -> list[Any]:
            r = self._end(x, p)
            slope = self._array("terminal_derivatives", self.terminal_derivatives(x, p), (r.size, ndx))
            return [slope.T @ slope, slope.T @ r, 0.5 * float(r @ r)]

        shapes = {"Q": (ndx, ndx), "q": (ndx, 1), "cost": (1, 1)}
        name = f"{self.name}_terminal_quadratic"
        return python_function(name, self._inputs("x", "p"), shapes, quadratic, self.watch)

    def structural_state(self) -> dict[str, Any]:
        """Raise: kernels of Python are not stored (see :mod:`lgmpc.compile`).

        Raises:
            TypeError: always.
        """
        raise TypeError(f"action '{self.name}' is written in Python")

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes without CasADi's callbacks, which cannot be copied."""
        made = {
            "watch",
            "value_function",
            "quadratic_function",
            "terminal_value_function",
            "terminal_quadratic_function",
        }
        return {name: value for name, value in vars(self).items() if name not in made}

    def bounded_controls(self) -> tuple[IntArray, ca.Function]:
        """As that of :class:`Action`: derivatives at two points determine the rows."""
        state, rng, p = self.state, np.random.default_rng(0), self.parameters.default.copy()
        rows = np.zeros(self._sizes["limits"], dtype=np.int64)
        for scale in (0.0, 0.1):
            x = state.integrate(state.neutral(), scale * rng.standard_normal(state.ndx))
            d = self.checked_derivatives(x, scale * rng.standard_normal(self.nu), p)
            found = np.abs(d.limits_u).argmax(axis=1) if len(d.limits_u) else rows
            beside = np.hstack([d.limits_x, d.limits_u - np.eye(self.nu)[found]])
            rows = np.where((np.abs(beside).max(axis=1, initial=0.0) > 1e-6) | (rows < 0), -1, found)
        given = ca.MX.sym("p", self.parameters.size)
        _, _, value, lower, upper = self.value_function.call([state.neutral(), ca.DM.zeros(self.nu), given])
        return rows, ca.Function("limits", [given], [lower - value, upper - value])

    def penalized(self) -> Action:
        """Return the action with its constraint as a cost."""
        return PenalizedPythonAction(self)

    def guarded(self, call: Callable[[], int], first: int) -> Callable[[], int]:
        """Return a call that raises an exception of Python with its node."""

        def evaluate() -> int:
            self.watch.begin()
            result = call()
            self.watch.raise_at(self.name, first)
            return result

        return evaluate

    def _inputs(self, *names: str) -> dict[str, int]:
        sizes = {"x": self.state.nx, "u": self.nu, "x_next": self.state.nx, "p": self.parameters.size}
        return {name: sizes[name] for name in names}

    def _quadratic(self, x: Array, u: Array, x_next: Array, p: Array) -> list[Any]:
        state, reached = self.state, self._step(x, u, p)
        r, (value, lower, upper), d = self._residual(x, u, p), self._limits(x, u, p), self.checked_derivatives(x, u, p)
        onto = state.Jdiff(x_next, reached)[1]
        by_x, by_u = d.residual_x, d.residual_u
        return [
            onto @ d.step_x, onto @ d.step_u, state.diff(x_next, reached),
            by_x.T @ by_x, by_u.T @ by_x, by_u.T @ by_u, by_x.T @ r, by_u.T @ r,
            d.limits_x, d.limits_u, lower - value, upper - value, 0.5 * float(r @ r),
        ]  # fmt: skip

    @cached_property
    def _sizes(self) -> dict[str, int]:
        """Sizes of residual, terminal residual and limits."""
        x, u, p = self.state.neutral(), np.zeros(self.nu), self.parameters.default.copy()
        try:
            reached, limits = self.step(x, u, p), self.limits(x, u, p)
            columns = {"residual": self.residual(x, u, p), "terminal_residual": self.terminal_residual(x, p)}
        except Exception as error:
            expected = "results in the neutral state at zero controls, which determine their sizes"
            raise InputError(f"action '{self.name}'", f"{type(error).__name__}: {error}", expected) from error
        self._array("step", reached, (self.state.nx,))
        if not isinstance(limits, Limits):
            raise InputError(f"limits of '{self.name}'", type(limits).__name__, "Limits(value, lower, upper)")
        columns["limits"] = limits.value
        for name, column in columns.items():
            if np.ndim(column) != 1:
                raise InputError(f"{name} of '{self.name}'", f"shape {np.shape(column)}", "an array with one index")
        return {name: len(column) for name, column in columns.items()}

    def _step(self, x: Array, u: Array, p: Array) -> Array:
        return self._array("step", self.step(x, u, p), (self.state.nx,))

    def _residual(self, x: Array, u: Array, p: Array) -> Array:
        return self._array("residual", self.residual(x, u, p), (self._sizes["residual"],))

    def _end(self, x: Array, p: Array) -> Array:
        return self._array("terminal_residual", self.terminal_residual(x, p), (self._sizes["terminal_residual"],))

    def _limits(self, x: Array, u: Array, p: Array) -> tuple[Array, Array, Array]:
        found, shape = self.limits(x, u, p), (self._sizes["limits"],)
        value = self._array("value of the limits", found.value, shape)
        bounds = [np.asarray(bound, dtype=np.float64) for bound in (found.lower, found.upper)]
        for name, bound in zip(("lower", "upper"), bounds, strict=True):
            if bound.shape not in ((), shape):
                expected = f"a number or shape {shape}"
                raise InputError(f"{name} of the limits of '{self.name}'", f"shape {bound.shape}", expected)
        lower, upper = (np.broadcast_to(bound, shape) for bound in bounds)
        return value, lower, upper

    def checked_derivatives(self, x: Array, u: Array, p: Array) -> StageDerivatives:
        """Return the derivatives.

        Raises:
            InputError: one has the wrong shape.
        """
        found = self.derivatives(x, u, p)
        if not isinstance(found, StageDerivatives):
            raise InputError(f"derivatives of '{self.name}'", type(found).__name__, "StageDerivatives")
        rows = {"step": self.state.ndx, "residual": self._sizes["residual"], "limits": self._sizes["limits"]}
        columns = {"x": self.state.ndx, "u": self.nu}
        checked = []
        for entry in fields(StageDerivatives):
            of, by = entry.name.rsplit("_", 1)
            checked.append(self._array(entry.name, getattr(found, entry.name), (rows[of], columns[by])))
        return StageDerivatives(*checked)

    def _array(self, name: str, value: Any, shape: tuple[int, ...]) -> Array:
        array = np.asarray(value, dtype=np.float64)
        if array.shape != shape:
            raise InputError(f"{name} of '{self.name}'", f"shape {array.shape}", f"shape {shape}")
        return array


class PenalizedPythonAction(PythonAction):
    """An action of Python whose constraint is a cost, as :class:`~lgmpc.actions.PenalizedAction`.

    Args:
        action: the action.

    Attributes:
        base: the action.
        ng: rows of its path constraint.
    """

    def __init__(self, action: PythonAction) -> None:
        self.base = action
        self._own = action.parameters.size
        self.ng = action.path_rows
        self.name, self.state, self.nu = f"{action.name}_penalized", action.state, action.nu
        self.parameters = penalty_parameters(action)

    @cached_property
    def watch(self) -> Watch:
        """Exceptions of calls from solvers."""
        return self.base.watch

    def step(self, x: Array, u: Array, p: Array) -> Array:
        """Return the action's own."""
        return self.base._step(x, u, p[: self._own])

    def residual(self, x: Array, u: Array, p: Array) -> Array:
        """Return the action's own, and the root of the penalty times the distance from the bounds."""
        outside, rho = self._outside(x, u, p)
        return np.concatenate([self.base._residual(x, u, p[: self._own]), np.sqrt(rho) * outside])

    def terminal_residual(self, x: Array, p: Array) -> Array:
        """Return the action's own."""
        return self.base._end(x, p[: self._own])

    def derivatives(self, x: Array, u: Array, p: Array) -> StageDerivatives:
        """Return the action's own, and those of the distance; at bounds, one of its two."""
        outside, rho = self._outside(x, u, p)
        own, scale = self.base.checked_derivatives(x, u, p[: self._own]), np.sqrt(rho) * (outside != 0.0)[:, None]
        return StageDerivatives(
            own.step_x,
            own.step_u,
            np.vstack([own.residual_x, scale * own.limits_x]),
            np.vstack([own.residual_u, scale * own.limits_u]),
            np.zeros((0, self.state.ndx)),
            np.zeros((0, self.nu)),
        )

    def terminal_derivatives(self, x: Array, p: Array) -> Array:
        """Return the action's own."""
        return self.base.terminal_derivatives(x, p[: self._own])

    def _outside(self, x: Array, u: Array, p: Array) -> tuple[Array, float]:
        """Return the distance of the constraint, shifted by the multipliers, above (positive) or below its bounds."""
        value, lower, upper = self.base._limits(x, u, p[: self._own])
        rho = float(p[-1])
        moved = value + p[self._own : -1] / rho
        return np.maximum(moved - upper, 0.0) + np.minimum(moved - lower, 0.0), rho


def _differences(function: Any, size: int) -> list[Array]:
    """Return the derivatives (rows, size) of each of a function's results at zero."""
    rows = [len(value) for value in function(np.zeros(size))]
    found = [np.zeros((n, size)) for n in rows]
    for i, step in enumerate(_STEP * np.eye(size)):
        for matrix, ahead, behind in zip(found, function(step), function(-step), strict=True):
            matrix[:, i] = (ahead - behind) / (2 * _STEP)
    return found


def _arrays(*columns: Any) -> list[Array]:
    return [np.asarray(column, dtype=np.float64).reshape(-1) for column in columns]
