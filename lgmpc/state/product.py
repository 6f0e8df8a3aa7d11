"""Products of state spaces."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from lgmpc.errors import InputError
from lgmpc.state.base import Array, State

__all__ = ["ProductState"]


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
        super().__init__(
            sum(state.nx for state in states),
            sum(state.ndx for state in states),
            np.concatenate([state.lower for state in states]),
            np.concatenate([state.upper for state in states]),
        )
        self.states = states
        self.x_slices = _consecutive([state.nx for state in states])
        self.dx_slices = _consecutive([state.ndx for state in states])

    def neutral(self) -> Array:
        """Return the factors' origins."""
        return np.concatenate([state.neutral() for state in self.states])

    def integrate(self, x: Array, dx: Array) -> Array:
        """Return ``x (+) dx``, factor by factor."""
        self._check_shapes(x, dx, self.ndx, ("x", "dx"))
        factors = zip(self.states, self.x_slices, self.dx_slices, strict=True)
        return np.concatenate([state.integrate(x[..., i], dx[..., j]) for state, i, j in factors], axis=-1)

    def diff(self, x0: Array, x1: Array) -> Array:
        """Return ``x1 (-) x0``, factor by factor."""
        self._check_shapes(x0, x1, self.nx, ("x0", "x1"))
        factors = zip(self.states, self.x_slices, strict=True)
        return np.concatenate([state.diff(x0[..., i], x1[..., i]) for state, i in factors], axis=-1)

    def Jintegrate(self, x: Array, dx: Array) -> tuple[Array, Array]:
        """Return the block-diagonal derivatives of ``integrate``."""
        self._check_shapes(x, dx, self.ndx, ("x", "dx"))
        factors = zip(self.states, self.x_slices, self.dx_slices, strict=True)
        return self._assemble([state.Jintegrate(x[..., i], dx[..., j]) for state, i, j in factors])

    def Jdiff(self, x0: Array, x1: Array) -> tuple[Array, Array]:
        """Return the block-diagonal derivatives of ``diff``."""
        self._check_shapes(x0, x1, self.nx, ("x0", "x1"))
        factors = zip(self.states, self.x_slices, strict=True)
        return self._assemble([state.Jdiff(x0[..., i], x1[..., i]) for state, i in factors])

    def integrate_symbolic(self, x: Any, dx: Any) -> Any:
        """Return ``x (+) dx``, factor by factor."""
        factors = zip(self.states, self.x_slices, self.dx_slices, strict=True)
        return ca.vertcat(*(state.integrate_symbolic(x[i], dx[j]) for state, i, j in factors))

    def diff_symbolic(self, x0: Any, x1: Any) -> Any:
        """Return ``x1 (-) x0``, factor by factor."""
        factors = zip(self.states, self.x_slices, strict=True)
        return ca.vertcat(*(state.diff_symbolic(x0[i], x1[i]) for state, i in factors))

    def check(self, x: object, argument: str = "x") -> Array:
        """Return ``x`` as a float64 array after every factor has checked its own part."""
        array = super().check(x, argument)
        for state, i in zip(self.states, self.x_slices, strict=True):
            state.check(array[..., i], f"{argument}[{i.start}:{i.stop}]")
        return array

    def _sample(self, rng: np.random.Generator, lower: Array, upper: Array) -> Array:
        factors = zip(self.states, self.dx_slices, strict=True)
        return np.concatenate([state._sample(rng, lower[j], upper[j]) for state, j in factors])

    def _assemble(self, blocks: list[tuple[Array, Array]]) -> tuple[Array, Array]:
        shape = (*blocks[0][0].shape[:-2], self.ndx, self.ndx)
        first, second = np.zeros(shape), np.zeros(shape)
        for j, (a, b) in zip(self.dx_slices, blocks, strict=True):
            first[..., j, j], second[..., j, j] = a, b
        return first, second


def _consecutive(sizes: list[int]) -> tuple[slice, ...]:
    stops = np.cumsum(sizes).tolist()
    return tuple(slice(stop - size, stop) for stop, size in zip(stops, sizes, strict=True))
