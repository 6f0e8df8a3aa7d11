"""The contract of a state space: a manifold of points ``x`` (nx,) with tangent vectors ``dx`` (ndx,)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lgmpc.errors import InputError

__all__ = ["Array", "State"]

Array = NDArray[np.float64]


class State(ABC):
    """A manifold with ``x (+) dx`` and ``x1 (-) x0``: the space of the points of a trajectory.

    Points, tangents and Jacobians may carry leading batch axes, the same for all arguments of a call. ``integrate``,
    ``diff`` and their Jacobians are called in inner loops: they check shapes and nothing else. :meth:`check` and
    :meth:`check_tangent` validate user input.

    Args:
        nx: number of coordinates of a point.
        ndx: dimension of the manifold.
        lower: (ndx,) limits of ``diff(neutral(), x)``; minus infinity where there is none.
        upper: (ndx,) upper limits of the same; infinity where there is none.

    Attributes:
        nx: number of coordinates of a point.
        ndx: dimension of the manifold.
        lower: (ndx,) lower limits, read-only.
        upper: (ndx,) upper limits, read-only.

    Raises:
        InputError: limits of the wrong shape, NaN, or crossed.
    """

    def __init__(self, nx: int, ndx: int, lower: Array, upper: Array) -> None:
        self.nx = nx
        self.ndx = ndx
        self.lower, self.upper = _frozen_bounds(ndx, lower, upper)

    @abstractmethod
    def neutral(self) -> Array:
        """Return the origin (nx,), about which limits and random bounds are stated."""

    @abstractmethod
    def integrate(self, x: Array, dx: Array) -> Array:
        """Return ``x (+) dx`` (..., nx).

        Raises:
            InputError: an argument of the wrong shape.
        """

    @abstractmethod
    def diff(self, x0: Array, x1: Array) -> Array:
        """Return ``x1 (-) x0`` (..., ndx): the shortest ``dx`` with ``integrate(x0, dx) = x1``.

        Raises:
            InputError: an argument of the wrong shape.
        """

    @abstractmethod
    def Jintegrate(self, x: Array, dx: Array) -> tuple[Array, Array]:
        """Return the derivatives (..., ndx, ndx) of ``integrate`` with respect to ``x`` and to ``dx``.

        Between tangent spaces: that of ``x`` (or ``dx``'s own) to that of the result.
        """

    @abstractmethod
    def Jdiff(self, x0: Array, x1: Array) -> tuple[Array, Array]:
        """Return the derivatives (..., ndx, ndx) of ``diff`` with respect to ``x0`` and ``x1``.

        From the tangent spaces at the two points.
        """

    @abstractmethod
    def integrate_symbolic(self, x: Any, dx: Any) -> Any:
        """Return ``x (+) dx`` as a CasADi column (SX, MX or DM); its derivatives at ``dx = 0`` are exact."""

    @abstractmethod
    def diff_symbolic(self, x0: Any, x1: Any) -> Any:
        """Return ``x1 (-) x0`` as a CasADi column (SX, MX or DM); its derivatives at ``x0 = x1`` are exact."""

    def random(self, rng: np.random.Generator, bounds: tuple[Array, Array] | None = None) -> Array:
        """Return a random point ``x`` (nx,) with ``lower <= diff(neutral(), x) <= upper``.

        Args:
            rng: random number generator.
            bounds: lower and upper (ndx,) in the tangent space at ``neutral()``; the state's own limits if omitted.

        Raises:
            InputError: bounds of the wrong shape, crossed, or infinite where the space is unbounded.
        """
        if not isinstance(rng, np.random.Generator):
            raise InputError("rng", f"{rng!r:.80}", "a numpy.random.Generator")
        if bounds is not None and not (isinstance(bounds, (tuple, list)) and len(bounds) == 2):
            raise InputError("bounds", f"{bounds!r:.80}", f"two arrays ({self.ndx},)")
        lower, upper = (self.lower, self.upper) if bounds is None else _frozen_bounds(self.ndx, *bounds)
        return self.integrate(self.neutral(), self._sample(rng, lower, upper))

    def check(self, x: object, argument: str = "x") -> Array:
        """Return ``x`` as a float64 array after full validation.

        Raises:
            InputError: wrong shape, not numeric, non-finite, or (for spaces that have them) not of unit norm.
        """
        return _real(argument, x, self.nx)

    def check_tangent(self, dx: object, argument: str = "dx") -> Array:
        """Return ``dx`` as a float64 array after full validation.

        Raises:
            InputError: wrong shape, not numeric, or non-finite.
        """
        return _real(argument, dx, self.ndx)

    def _sample(self, rng: np.random.Generator, lower: Array, upper: Array) -> Array:
        """Return a tangent vector at ``neutral()`` within bounds."""
        open_ended = np.flatnonzero(~np.isfinite(lower) | ~np.isfinite(upper))
        if open_ended.size:
            raise InputError("bounds", f"infinite at indices {open_ended.tolist()}", "finite bounds to sample within")
        return rng.uniform(lower, upper)

    def _check_shapes(self, x: Array, other: Array, size: int, names: tuple[str, str]) -> None:
        for name, given in zip(names, (x, other), strict=True):
            if not isinstance(given, np.ndarray):
                raise InputError(name, f"{given!r:.80}", f"an array (..., {self.nx if given is x else size})")
        if x.shape[-1:] != (self.nx,):
            raise InputError(names[0], f"shape {x.shape}", f"shape (..., {self.nx})")
        if other.shape[-1:] != (size,) or other.shape[:-1] != x.shape[:-1]:
            raise InputError(names[1], f"shape {other.shape}", f"shape {(*x.shape[:-1], size)}")


def _real(name: str, value: object, size: int) -> Array:
    array = _numeric(value)
    if array is None:
        raise InputError(name, value, f"{size} real numbers")
    if array.shape[-1:] != (size,):
        raise InputError(name, f"shape {array.shape}", f"shape (..., {size})")
    if not np.isfinite(array).all():
        index = np.argwhere(~np.isfinite(array))[0].tolist()
        raise InputError(name, f"{array[tuple(index)]} at index {index}", "finite entries")
    return array


def _numeric(value: object) -> Array | None:
    """Convert to float64; return None for text, complex numbers and ragged lists."""
    try:
        raw = np.asarray(value)
    except ValueError:
        return None
    return raw.astype(np.float64) if raw.dtype.kind in "fiu" else None


def _frozen_bounds(ndx: int, lower: object, upper: object) -> tuple[Array, Array]:
    result = []
    for name, bound in (("lower", lower), ("upper", upper)):
        array = _numeric(bound)
        if array is None:
            raise InputError(name, bound, f"{ndx} numbers, none of them NaN")
        if array.shape != (ndx,) or np.isnan(array).any():
            raise InputError(name, f"{array if array.size < 9 else array.shape}", f"{ndx} numbers, none of them NaN")
        array.setflags(write=False)
        result.append(array)
    crossed = np.flatnonzero(result[0] > result[1])
    if crossed.size:
        i = int(crossed[0])
        raise InputError("lower", f"{result[0][i]:g} at index {i}", f"at most the upper bound, {result[1][i]:g}")
    return result[0], result[1]
