"""State spaces, manifolds of points ``x`` (nx,) with tangent vectors ``dx`` (ndx,): contract, vectors, products."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import cached_property
from numbers import Integral
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.errors import InputError
from lgmpc.typing import Array


class State(ABC):
    """A manifold with ``x (+) dx`` and ``x1 (-) x0``: the space of the points of a trajectory.

    A subclass writes both as CasADi expressions; what acts on arrays evaluates them, and Jacobians are their
    derivatives unless it knows them in closed form.

    Points, tangents and Jacobians may carry leading batch axes, the same for all arguments of a call. ``integrate``,
    ``diff`` and their Jacobians check shapes and nothing else.

    Attributes:
        nx: number of coordinates of a point.
        ndx: dimension of the manifold.
    """

    def __init__(self, nx: int, ndx: int) -> None:
        self.nx, self.ndx = nx, ndx

    @abstractmethod
    def neutral(self) -> Array:
        """Return the origin (nx,)."""

    @abstractmethod
    def integrate_symbolic(self, x: Any, dx: Any) -> Any:
        """Return ``x (+) dx`` as a CasADi column (SX, MX or DM); its derivatives at ``dx = 0`` are exact."""

    @abstractmethod
    def diff_symbolic(self, x0: Any, x1: Any) -> Any:
        """Return ``x1 (-) x0`` as a CasADi column (SX, MX or DM); its derivatives at ``x0 = x1`` are exact."""

    def Jintegrate_symbolic(self, x: Any, dx: Any) -> tuple[Any, Any]:
        """Return the derivatives of :meth:`integrate_symbolic` in tangent coordinates, as CasADi matrices."""
        reached = self.integrate_symbolic(x, dx)
        return self._slopes(
            lambda e: self.diff_symbolic(reached, self.integrate_symbolic(self.integrate_symbolic(x, e), dx)),
            lambda e: self.diff_symbolic(reached, self.integrate_symbolic(x, dx + e)),
        )

    def Jdiff_symbolic(self, x0: Any, x1: Any) -> tuple[Any, Any]:
        """Return the derivatives of :meth:`diff_symbolic` in tangent coordinates, as CasADi matrices."""
        return self._slopes(
            lambda e: self.diff_symbolic(self.integrate_symbolic(x0, e), x1),
            lambda e: self.diff_symbolic(x0, self.integrate_symbolic(x1, e)),
        )

    def project(self, x: Array) -> Array:
        """Return points (..., nx) moved onto the manifold, from which rounding may have taken them."""
        return x

    def integrate(self, x: Array, dx: Array) -> Array:
        """Return ``x (+) dx`` (..., nx).

        Raises:
            InputError: an argument of the wrong shape.
        """
        self._check_shapes(x, dx, self.ndx, ("x", "dx"))
        return self.project(self._evaluate("integrate", x, dx)[0][..., 0])

    def diff(self, x0: Array, x1: Array) -> Array:
        """Return ``x1 (-) x0`` (..., ndx): the shortest ``dx`` with ``integrate(x0, dx) = x1``.

        Raises:
            InputError: an argument of the wrong shape.
        """
        self._check_shapes(x0, x1, self.nx, ("x0", "x1"))
        return self._evaluate("diff", x0, x1)[0][..., 0]

    def Jintegrate(self, x: Array, dx: Array) -> tuple[Array, Array]:
        """Return the derivatives (..., ndx, ndx) of ``integrate`` with respect to ``x`` and to ``dx``.

        Between tangent spaces: that of ``x`` (or ``dx``'s own) to that of the result.
        """
        self._check_shapes(x, dx, self.ndx, ("x", "dx"))
        by_x, by_dx = self._evaluate("Jintegrate", x, dx)
        return by_x, by_dx

    def Jdiff(self, x0: Array, x1: Array) -> tuple[Array, Array]:
        """Return the derivatives (..., ndx, ndx) of ``diff`` with respect to ``x0`` and ``x1``.

        From the tangent spaces at the two points.
        """
        self._check_shapes(x0, x1, self.nx, ("x0", "x1"))
        by_x0, by_x1 = self._evaluate("Jdiff", x0, x1)
        return by_x0, by_x1

    @cached_property
    def _functions(self) -> dict[str, ca.Function]:
        x, x1, dx = (ca.SX.sym(name, size) for name, size in (("x", self.nx), ("x1", self.nx), ("dx", self.ndx)))
        written = {
            "integrate": ([x, dx], [self.integrate_symbolic(x, dx)]),
            "diff": ([x, x1], [self.diff_symbolic(x, x1)]),
            "Jintegrate": ([x, dx], self.Jintegrate_symbolic(x, dx)),
            "Jdiff": ([x, x1], self.Jdiff_symbolic(x, x1)),
        }
        return {name: ca.Function(name, inputs, [*map(ca.densify, found)]) for name, (inputs, found) in written.items()}

    def _evaluate(self, name: str, first: Array, second: Array) -> list[Array]:
        """Return a function's results (..., rows, columns) at points of any batch shape."""
        batch = first.shape[:-1]
        n = math.prod(batch)
        found = self._functions[name].map(n).call([a.reshape(n, -1).T for a in (first, second)])
        return [np.stack(np.hsplit(value.full(), n)).reshape(*batch, value.shape[0], -1) for value in found]

    def _slopes(self, *functions: Callable[[Any], Any]) -> tuple[Any, Any]:
        e = ca.SX.sym("e", self.ndx)
        first, second = (ca.substitute(ca.jacobian(f(e), e), e, ca.SX.zeros(self.ndx)) for f in functions)
        return first, second

    def _check_shapes(self, x: Array, other: Array, size: int, names: tuple[str, str]) -> None:
        for name, given in zip(names, (x, other), strict=True):
            if not isinstance(given, np.ndarray):
                raise InputError(name, f"{given!r:.80}", f"an array (..., {self.nx if given is x else size})")
        if x.shape[-1:] != (self.nx,):
            raise InputError(names[0], f"shape {x.shape}", f"shape (..., {self.nx})")
        if other.shape[-1:] != (size,) or other.shape[:-1] != x.shape[:-1]:
            raise InputError(names[1], f"shape {other.shape}", f"shape {(*x.shape[:-1], size)}")


class StateVector(State):
    """R^n: addition and subtraction.

    Args:
        n: dimension.

    Raises:
        InputError: ``n`` below 1.
    """

    def __init__(self, n: int) -> None:
        if not isinstance(n, Integral) or n < 1:
            raise InputError("n", n, "a whole number of at least 1")
        super().__init__(int(n), int(n))

    def neutral(self) -> Array:
        """Return zeros."""
        return np.zeros(self.nx)

    def integrate_symbolic(self, x: Any, dx: Any) -> Any:
        """Return ``x + dx``."""
        return x + dx

    def diff_symbolic(self, x0: Any, x1: Any) -> Any:
        """Return ``x1 - x0``."""
        return x1 - x0


class ProductState(State):
    """Product of states: points and tangents are concatenated in order, Jacobians are block-diagonal.

    Args:
        states: the factors, at least one; products are allowed.

    Attributes:
        states: the factors.
        x_slices: each factor's entries of a point.
        dx_slices: each factor's entries of a tangent vector.

    Raises:
        InputError: no factor.
    """

    def __init__(self, *states: State) -> None:
        if not states or not all(isinstance(state, State) for state in states):
            raise InputError("states", f"{states!r:.80}" if states else "none", "at least one State")
        super().__init__(sum(state.nx for state in states), sum(state.ndx for state in states))
        self.states = states
        self.x_slices = _consecutive([state.nx for state in states])
        self.dx_slices = _consecutive([state.ndx for state in states])

    def neutral(self) -> Array:
        """Return the factors' origins."""
        return np.concatenate([state.neutral() for state in self.states])

    def integrate_symbolic(self, x: Any, dx: Any) -> Any:
        """Return ``x (+) dx``, factor by factor."""
        factors = zip(self.states, self.x_slices, self.dx_slices, strict=True)
        return ca.vertcat(*(state.integrate_symbolic(x[i], dx[j]) for state, i, j in factors))

    def diff_symbolic(self, x0: Any, x1: Any) -> Any:
        """Return ``x1 (-) x0``, factor by factor."""
        factors = zip(self.states, self.x_slices, strict=True)
        return ca.vertcat(*(state.diff_symbolic(x0[i], x1[i]) for state, i in factors))

    def Jintegrate_symbolic(self, x: Any, dx: Any) -> tuple[Any, Any]:
        """Return the block-diagonal derivatives of ``integrate``."""
        factors = zip(self.states, self.x_slices, self.dx_slices, strict=True)
        return _block_diagonal(state.Jintegrate_symbolic(x[i], dx[j]) for state, i, j in factors)

    def Jdiff_symbolic(self, x0: Any, x1: Any) -> tuple[Any, Any]:
        """Return the block-diagonal derivatives of ``diff``."""
        factors = zip(self.states, self.x_slices, strict=True)
        return _block_diagonal(state.Jdiff_symbolic(x0[i], x1[i]) for state, i in factors)

    def project(self, x: Array) -> Array:
        """Return points moved onto the manifold, factor by factor."""
        parts = [state.project(x[..., i]) for state, i in zip(self.states, self.x_slices, strict=True)]
        return np.concatenate(parts, axis=-1)


def _block_diagonal(pairs: Iterable[tuple[Any, Any]]) -> tuple[Any, Any]:
    first, second = zip(*pairs, strict=True)
    return ca.diagcat(*first), ca.diagcat(*second)


def _consecutive(sizes: list[int]) -> tuple[slice, ...]:
    stops = np.cumsum(sizes).tolist()
    return tuple(slice(stop - size, stop) for stop, size in zip(stops, sizes, strict=True))
