"""Euclidean state spaces."""

from __future__ import annotations

from numbers import Integral
from typing import Any

import numpy as np

from lgmpc.errors import InputError
from lgmpc.state.base import Array, State

__all__ = ["StateVector"]


class StateVector(State):
    """R^n: addition and subtraction.

    Args:
        n: dimension.
        lower: (n,) lower limits; none if omitted.
        upper: (n,) upper limits; none if omitted.

    Raises:
        InputError: ``n`` below 1, or limits of the wrong shape, NaN, or crossed.
    """

    def __init__(self, n: int, lower: Array | None = None, upper: Array | None = None) -> None:
        if not isinstance(n, Integral) or n < 1:
            raise InputError("n", n, "a whole number of at least 1")
        super().__init__(
            int(n),
            int(n),
            np.full(n, -np.inf) if lower is None else lower,
            np.full(n, np.inf) if upper is None else upper,
        )

    def neutral(self) -> Array:
        """Return zeros."""
        return np.zeros(self.nx)

    def integrate(self, x: Array, dx: Array) -> Array:
        """Return ``x + dx``."""
        self._check_shapes(x, dx, self.ndx, ("x", "dx"))
        return x + dx

    def diff(self, x0: Array, x1: Array) -> Array:
        """Return ``x1 - x0``."""
        self._check_shapes(x0, x1, self.nx, ("x0", "x1"))
        return x1 - x0

    def Jintegrate(self, x: Array, dx: Array) -> tuple[Array, Array]:
        """Return two identities."""
        self._check_shapes(x, dx, self.ndx, ("x", "dx"))
        return self._eye(x), self._eye(x)

    def Jdiff(self, x0: Array, x1: Array) -> tuple[Array, Array]:
        """Return minus and plus the identity."""
        self._check_shapes(x0, x1, self.nx, ("x0", "x1"))
        return -self._eye(x0), self._eye(x0)

    def integrate_symbolic(self, x: Any, dx: Any) -> Any:
        """Return ``x + dx``."""
        return x + dx

    def diff_symbolic(self, x0: Any, x1: Any) -> Any:
        """Return ``x1 - x0``."""
        return x1 - x0

    def _eye(self, x: Array) -> Array:
        return np.tile(np.eye(self.ndx), (*x.shape[:-1], 1, 1))
