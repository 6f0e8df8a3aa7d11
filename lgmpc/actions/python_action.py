"""Actions written in Python: any code that maps arrays to arrays, with derivatives or with differences instead.

An expression that CasADi supports is better given as an :class:`~lgmpc.actions.Action`, which is compiled and much
faster. Here a simulator, a table or a learned model can be an interval. All solvers take it, alone or mixed with other
actions; nothing of it is compiled.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.actions.base import Action, StageValue
from lgmpc.errors import InputError
from lgmpc.typing import Array, IntArray, numbers

_Shapes = dict[str, tuple[int, int]]

_STEP = 6e-6
"""Step of central differences: about the cube root of the rounding unit."""


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


class _Callback(ca.Callback):
    """A function of columns that calls an action's Python, and tells the action what it raised.

    Its results are NaN there, where numbers overflow, and, without a call, where a state or control is not finite.
    """

    def __init__(
        self, action: "PythonAction", part: str, inputs: tuple[str, ...], outputs: _Shapes, function: Callable[..., Any]
    ) -> None:
        super().__init__()
        sizes = {"x": action.state.nx, "u": action.nu, "x_next": action.state.nx, "p": action.parameters.size}
        self._inputs, self._outputs = [(name, sizes[name]) for name in inputs], list(outputs.items())
        self._action, self._function = action, function
        self.construct(f"{action.name}_{part}", {"enable_fd": True, "fd_method": "central"})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_name_in(self, i: int) -> str:
        return self._inputs[i][0]

    def get_name_out(self, i: int) -> str:
        return self._outputs[i][0]

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._inputs[i][1], 1)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._outputs[i][1])

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        columns = [argument.full()[:, 0] for argument in arguments]
        found: Any = [np.full(shape, np.nan) for _, shape in self._outputs]
        error: Exception | None = None
        # A trial roll-out that diverges has no results (parameters, such as bounds, may be infinite).
        given = zip(self._inputs, columns, strict=True)
        if all(np.isfinite(column).all() for (name, _), column in given if name != "p"):
            try:
                found = self._function(*columns)
            except OverflowError:
                pass
            except Exception as raised:  # of any kind: it is the user's code, and CasADi lets none through
                error = raised
        self._action.count(error)
        pairs = zip(found, self._outputs, strict=True)
        return [ca.DM(np.asarray(value, dtype=np.float64).reshape(shape)) for value, (_, shape) in pairs]


class PythonAction(Action):
    """One interval in Python: a subclass sets the attributes of an :class:`Action` and writes at least ``step``.

    The running cost is half the square of :meth:`residual`, which includes the weights; the Hessian is that of
    Gauss and Newton. The sizes of all results are those at the neutral state, zero control and default parameters.
    """

    smooth = False
    _calls = 0
    _raised: tuple[int, Exception] | None = None  # the call that raised first, and what

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
        state, reached = self.state, self.values(x, u, p)[0]

        def outcome(dx: Array, du: Array) -> tuple[Array, Array, Array]:
            x_next, r, value, *_ = self.values(state.integrate(x, dx), u + du, p)
            return state.diff(reached, x_next), r, value

        zero_x, zero_u = np.zeros(state.ndx), np.zeros(self.nu)
        by_x = _differences(lambda d: outcome(d, zero_u), state.ndx)
        by_u = _differences(lambda d: outcome(zero_x, d), self.nu)
        return StageDerivatives(*(each for pair in zip(by_x, by_u, strict=True) for each in pair))

    def terminal_derivatives(self, x: Array, p: Array) -> Array:
        """Return the derivative (nr, ndx) of the terminal residual; central differences unless overridden."""
        return _differences(lambda d: (self._end(self.state.integrate(x, d), p),), self.state.ndx)[0]

    # The interface of solvers.

    def evaluate(self, x: Array, u: Array, p: Array) -> StageValue:
        """Evaluate the action at one point."""
        x_next, r, *limits = self.values(*self._arguments(x, u, p))
        return StageValue(x_next, 0.5 * float(r @ r), *limits)

    @cached_property
    def value_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""
        row = (self._sizes["limits"], 1)
        shapes = {"x_next": (self.state.nx, 1), "cost": (1, 1), "constraint": row, "lower": row, "upper": row}
        return _Callback(self, "value", ("x", "u", "p"), shapes, lambda x, u, p: vars(self.evaluate(x, u, p)).values())

    @cached_property
    def quadratic_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""
        ndx, nu, ng = self.state.ndx, self.nu, self._sizes["limits"]
        shapes = {
            "A": (ndx, ndx), "B": (ndx, nu), "b": (ndx, 1), "Q": (ndx, ndx), "S": (nu, ndx), "R": (nu, nu),
            "q": (ndx, 1), "r": (nu, 1), "C": (ng, ndx), "D": (ng, nu), "lower": (ng, 1), "upper": (ng, 1),
            "cost": (1, 1),
        }  # fmt: skip

        def quadratic(x: Array, u: Array, x_next: Array, p: Array) -> list[Any]:
            reached, r, value, lower, upper = self.values(x, u, p)
            d, onto = self.slopes(x, u, p), self.state.Jdiff(x_next, reached)[1]
            by_x, by_u = d.residual_x, d.residual_u
            return [
                onto @ d.step_x, onto @ d.step_u, self.state.diff(x_next, reached),
                by_x.T @ by_x, by_u.T @ by_x, by_u.T @ by_u, by_x.T @ r, by_u.T @ r,
                d.limits_x, d.limits_u, lower - value, upper - value, 0.5 * float(r @ r),
            ]  # fmt: skip

        return _Callback(self, "quadratic", ("x", "u", "x_next", "p"), shapes, quadratic)

    @cached_property
    def terminal_value_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""
        cost = {"cost": (1, 1)}
        return _Callback(self, "terminal_value", ("x", "p"), cost, lambda x, p: [0.5 * np.sum(self._end(x, p) ** 2)])

    @cached_property
    def terminal_quadratic_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""
        ndx = self.state.ndx

        def quadratic(x: Array, p: Array) -> list[Any]:
            r = self._end(x, p)
            slope = self._array("terminal_derivatives", self.terminal_derivatives(x, p), (r.size, ndx))
            return [slope.T @ slope, slope.T @ r, 0.5 * float(r @ r)]

        shapes = {"Q": (ndx, ndx), "q": (ndx, 1), "cost": (1, 1)}
        return _Callback(self, "terminal_quadratic", ("x", "p"), shapes, quadratic)

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes without CasADi's callbacks, which cannot be copied."""
        return {name: value for name, value in vars(self).items() if not isinstance(value, ca.Function)}

    def bounded_controls(self) -> IntArray:
        """As that of :class:`Action`: derivatives at two points determine the rows."""
        state, rng, p = self.state, np.random.default_rng(0), self.parameters.default.copy()
        rows = np.zeros(self._sizes["limits"], dtype=np.int64)
        for scale in (0.0, 0.1):
            x = state.integrate(state.neutral(), scale * rng.standard_normal(state.ndx))
            d = self.slopes(x, scale * rng.standard_normal(self.nu), p)
            found = np.abs(d.limits_u).argmax(axis=1) if len(d.limits_u) else rows
            beside = np.hstack([d.limits_x, d.limits_u - np.eye(self.nu)[found]])
            rows = np.where((np.abs(beside).max(axis=1, initial=0.0) > 1e-6) | (rows < 0), -1, found)
        return rows

    def count(self, error: Exception | None) -> None:
        """Count a call from CasADi, and keep the first exception."""
        if error is not None and self._raised is None:
            self._raised = self._calls, error
        self._calls += 1

    def guarded(self, call: Callable[[], int], first: int) -> Callable[[], int]:
        """Return a call that raises an exception of Python with its node."""

        def evaluate() -> int:
            self._calls, self._raised = 0, None
            result = call()
            if self._raised is not None:
                node, error = first + self._raised[0], self._raised[1]
                if isinstance(error, InputError):
                    raise InputError(f"{error.argument}, node {node}", error.got, error.expected) from error
                expected = "results for all states and controls near the guess, NaN where there are none"
                got = f"{type(error).__name__}: {error}"
                raise InputError(f"action '{self.name}', node {node}", got, expected) from error
            return result

        return evaluate

    # Results of the right shapes; an InputError names the others.

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

    def values(self, x: Array, u: Array, p: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return next state, residual, and value, lower and upper bounds of the limits."""
        limits, sizes = self.limits(x, u, p), self._sizes
        rows = (sizes["limits"],)
        bounds = []
        for name, given in (("lower", limits.lower), ("upper", limits.upper)):
            bound = numbers(f"{name} of the limits of '{self.name}'", given, (), rows)
            bounds.append(np.broadcast_to(bound, rows))
        return (
            self._array("step", self.step(x, u, p), (self.state.nx,)),
            self._array("residual", self.residual(x, u, p), (sizes["residual"],)),
            self._array("value of the limits", limits.value, rows),
            bounds[0],
            bounds[1],
        )

    def slopes(self, x: Array, u: Array, p: Array) -> StageDerivatives:
        """Return the derivatives."""
        found = self.derivatives(x, u, p)
        if not isinstance(found, StageDerivatives):
            raise InputError(f"derivatives of '{self.name}'", type(found).__name__, "StageDerivatives")
        rows, columns = {**self._sizes, "step": self.state.ndx}, {"x": self.state.ndx, "u": self.nu}
        checked = []
        for name, value in vars(found).items():
            of, by = name.rsplit("_", 1)
            checked.append(self._array(name, value, (rows[of], columns[by])))
        return StageDerivatives(*checked)

    def _end(self, x: Array, p: Array) -> Array:
        return self._array("terminal_residual", self.terminal_residual(x, p), (self._sizes["terminal_residual"],))

    def _array(self, name: str, value: Any, shape: tuple[int, ...]) -> Array:
        return numbers(f"{name} of '{self.name}'", value, shape)


def _differences(function: Any, size: int) -> list[Array]:
    """Return the derivatives (rows, size) of each of a function's results at zero."""
    rows = [len(value) for value in function(np.zeros(size))]
    found = [np.zeros((n, size)) for n in rows]
    for i, step in enumerate(_STEP * np.eye(size)):
        for matrix, ahead, behind in zip(found, function(step), function(-step), strict=True):
            matrix[:, i] = (ahead - behind) / (2 * _STEP)
    return found
