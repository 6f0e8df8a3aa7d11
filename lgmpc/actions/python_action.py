"""Actions written in Python: any code that maps arrays to arrays, with derivatives or with differences instead.

An expression that CasADi supports is better given as an :class:`~lgmpc.actions.Action`, which is compiled and much
faster. Here a simulator, a table or a learned model can be an interval. All solvers take it, alone or mixed with other
actions; nothing of it is compiled.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.actions.base import Action, StageValue
from lgmpc.errors import InputError
from lgmpc.typing import Array, IntArray

__all__ = ["Limits", "PythonAction", "StageDerivatives"]

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


class Watch:
    """Exceptions of an action's calls from CasADi, through which none propagates.

    Attributes:
        calls: number of calls since :meth:`begin`.
        error: the first exception since then.
        failed: number of calls before it.
    """

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Reset counts and exception."""
        self.calls, self.failed = 0, 0
        self.error: Exception | None = None

    def note(self, error: Exception) -> None:
        """Store an exception of the current call, if it is the first."""
        if self.error is None:
            self.error, self.failed = error, self.calls

    def raise_at(self, action: str, first: int) -> None:
        """Raise the stored exception, with its node; ``first`` is the node of the first call."""
        if self.error is None:
            return
        error, node = self.error, first + self.failed
        self.begin()
        if isinstance(error, InputError):
            raise InputError(f"{error.argument}, node {node}", error.got, error.expected) from error
        expected = "results for all states and controls near the guess, NaN where there are none"
        raise InputError(f"action '{action}', node {node}", f"{type(error).__name__}: {error}", expected) from error


class _Callback(ca.Callback):
    """A function of columns that calls Python; its results are NaN where Python raises, as ``watch`` reports.

    They are NaN without a call where a state or control is not finite, and where Python's numbers overflow.
    """

    def __init__(
        self, name: str, inputs: dict[str, int], outputs: dict[str, tuple[int, int]], function: Any, watch: Watch
    ) -> None:
        super().__init__()
        self._inputs, self._outputs, self._function = list(inputs.items()), list(outputs.items()), function
        self._watch = watch
        self.construct(name, {"enable_fd": True, "fd_method": "central"})

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
        found = [np.full(shape, np.nan) for _, shape in self._outputs]
        # A trial roll-out that diverges has no results (parameters, such as bounds, may be infinite).
        if all(
            np.isfinite(column).all() for (name, _), column in zip(self._inputs, columns, strict=True) if name != "p"
        ):
            try:
                found = self._function(*columns)
            except OverflowError:
                pass
            except Exception as error:  # of any kind: it is the user's code
                self._watch.note(error)
        self._watch.calls += 1
        return [
            ca.DM(np.asarray(value, dtype=np.float64).reshape(shape))
            for value, (_, shape) in zip(found, self._outputs, strict=True)
        ]


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
                self.checked_limits(x_moved, u_moved, p)[0],
            )

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
        x, u, p = self._arguments(x, u, p)
        r = self._residual(x, u, p)
        return StageValue(self._step(x, u, p), 0.5 * float(r @ r), *self.checked_limits(x, u, p))

    @cached_property
    def watch(self) -> Watch:
        """Exceptions of calls from solvers."""
        return Watch()

    @cached_property
    def value_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""

        def values(x: Array, u: Array, p: Array) -> list[Any]:
            return list(vars(self.evaluate(x, u, p)).values())

        row = (self._sizes["limits"], 1)
        shapes = {"x_next": (self.state.nx, 1), "cost": (1, 1), "constraint": row, "lower": row, "upper": row}
        return self._function("value", ("x", "u", "p"), shapes, values)

    @cached_property
    def quadratic_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""
        ndx, nu, ng = self.state.ndx, self.nu, self._sizes["limits"]
        shapes = {
            "A": (ndx, ndx), "B": (ndx, nu), "b": (ndx, 1), "Q": (ndx, ndx), "S": (nu, ndx), "R": (nu, nu),
            "q": (ndx, 1), "r": (nu, 1), "C": (ng, ndx), "D": (ng, nu), "lower": (ng, 1), "upper": (ng, 1),
            "cost": (1, 1),
        }  # fmt: skip
        return self._function("quadratic", ("x", "u", "x_next", "p"), shapes, self._quadratic)

    @cached_property
    def terminal_value_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""

        def value(x: Array, p: Array) -> list[Any]:
            r = self._end(x, p)
            return [0.5 * float(r @ r)]

        return self._function("terminal_value", ("x", "p"), {"cost": (1, 1)}, value)

    @cached_property
    def terminal_quadratic_function(self) -> ca.Function:
        """As that of :class:`Action`, calling Python."""
        ndx = self.state.ndx

        def quadratic(x: Array, p: Array) -> list[Any]:
            r = self._end(x, p)
            slope = self._array("terminal_derivatives", self.terminal_derivatives(x, p), (r.size, ndx))
            return [slope.T @ slope, slope.T @ r, 0.5 * float(r @ r)]

        shapes = {"Q": (ndx, ndx), "q": (ndx, 1), "cost": (1, 1)}
        return self._function("terminal_quadratic", ("x", "p"), shapes, quadratic)

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

    def bounded_controls(self) -> IntArray:
        """As that of :class:`Action`: derivatives at two points determine the rows."""
        state, rng, p = self.state, np.random.default_rng(0), self.parameters.default.copy()
        rows = np.zeros(self._sizes["limits"], dtype=np.int64)
        for scale in (0.0, 0.1):
            x = state.integrate(state.neutral(), scale * rng.standard_normal(state.ndx))
            d = self.checked_derivatives(x, scale * rng.standard_normal(self.nu), p)
            found = np.abs(d.limits_u).argmax(axis=1) if len(d.limits_u) else rows
            beside = np.hstack([d.limits_x, d.limits_u - np.eye(self.nu)[found]])
            rows = np.where((np.abs(beside).max(axis=1, initial=0.0) > 1e-6) | (rows < 0), -1, found)
        return rows

    def guarded(self, call: Callable[[], int], first: int) -> Callable[[], int]:
        """Return a call that raises an exception of Python with its node."""

        def evaluate() -> int:
            self.watch.begin()
            result = call()
            self.watch.raise_at(self.name, first)
            return result

        return evaluate

    def _function(
        self, part: str, names: tuple[str, ...], shapes: dict[str, tuple[int, int]], function: Callable[..., list[Any]]
    ) -> ca.Function:
        sizes = {"x": self.state.nx, "u": self.nu, "x_next": self.state.nx, "p": self.parameters.size}
        inputs = {name: sizes[name] for name in names}
        return _Callback(f"{self.name}_{part}", inputs, shapes, function, self.watch)

    def _quadratic(self, x: Array, u: Array, x_next: Array, p: Array) -> list[Any]:
        state, reached = self.state, self._step(x, u, p)
        r, (value, lower, upper), d = (
            self._residual(x, u, p),
            self.checked_limits(x, u, p),
            self.checked_derivatives(x, u, p),
        )
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

    def checked_limits(self, x: Array, u: Array, p: Array) -> tuple[Array, Array, Array]:
        """Return value, lower and upper bounds (ng,) of the limits.

        Raises:
            InputError: one has the wrong shape.
        """
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


def _differences(function: Any, size: int) -> list[Array]:
    """Return the derivatives (rows, size) of each of a function's results at zero."""
    rows = [len(value) for value in function(np.zeros(size))]
    found = [np.zeros((n, size)) for n in rows]
    for i, step in enumerate(_STEP * np.eye(size)):
        for matrix, ahead, behind in zip(found, function(step), function(-step), strict=True):
            matrix[:, i] = (ahead - behind) / (2 * _STEP)
    return found
