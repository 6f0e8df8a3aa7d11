"""Factors of the mass matrix and of symmetric systems, with the sparsity of the tree's branches."""

from copy import copy
from typing import Any, TypeVar

import casadi as ca

_Self = TypeVar("_Self", bound="Factored")


class Factored:
    """A linear system that has been factorised, once for many right-hand sides.

    Attributes:
        matrices: all that a solution requires, in a fixed order.
    """

    matrices: tuple[Any, ...]

    def solve(self, right: Any) -> Any:
        """Return the solution (n, m) for right-hand sides (n, m)."""
        raise NotImplementedError

    @property
    def entries(self) -> Any:
        """Stored entries of all matrices in one column."""
        return ca.vertcat(*(ca.vec(ca.SX(matrix).nz[:]) for matrix in self.matrices))

    def with_entries(self: _Self, entries: Any) -> _Self:
        """Return the same system with other stored entries."""
        start, matrices = 0, []
        for matrix in self.matrices:
            pattern = matrix.sparsity()
            matrices.append(ca.SX(pattern, entries[start : start + pattern.nnz()]))
            start += pattern.nnz()
        return self.with_matrices(*matrices)

    def with_matrices(self: _Self, *matrices: Any) -> _Self:
        """Return the same system with other matrices of the same sparsity."""
        result = copy(self)
        result.matrices = matrices
        return result


class LdlFactor(Factored):
    """The factor ``A = L D L^T`` of a symmetric matrix, in its given order; the reciprocals of D are stored.

    Args:
        matrix: (n, n), both triangles, with structural zeros.
    """

    def __init__(self, matrix: Any) -> None:
        pivots, upper, _ = ca.ldl(matrix, False)
        self.matrices = (upper, 1 / ca.SX(pivots))

    def solve(self, right: Any) -> Any:
        """Return ``A^-1 right``."""
        return self.back(self.scale(self.forward(right)))

    def forward(self, right: Any) -> Any:
        """Return ``L^-1 right``."""
        x = ca.SX(right)
        for i in range(x.shape[0]):
            for k, entry in self._entries(i):
                x[i, :] -= entry * x[k, :]
        return x

    def scale(self, half: Any) -> Any:
        """Return ``D^-1 half``."""
        return ca.diag(self.matrices[1]) @ half

    def back(self, right: Any) -> Any:
        """Return ``L^-T right``."""
        x = ca.SX(right)
        for i in reversed(range(x.shape[0])):
            for k, entry in self._entries(i):
                x[k, :] -= entry * x[i, :]
        return x

    def _entries(self, column: int) -> list[tuple[int, Any]]:
        """Return rows and values of the entries of one column of L^T above its diagonal."""
        upper = self.matrices[0]
        pattern = upper.sparsity()
        start, stop = pattern.colind()[column], pattern.colind()[column + 1]
        return [(row, upper[row, column]) for row in pattern.row()[start:stop] if row < column]


class MassFactor(LdlFactor):
    """The factor ``M = L^T D L`` (Featherstone 2005), written as the L D L^T of M in reverse order.

    Eliminating the leaves first causes no fill-in: the zeros between branches remain. What :meth:`forward` returns and
    :meth:`back` takes has its rows in order of elimination.

    Args:
        mass_matrix: (nv, nv), both triangles, with structural zeros.
    """

    def __init__(self, mass_matrix: Any) -> None:
        self._reversed = list(range(mass_matrix.shape[0]))[::-1]
        super().__init__(mass_matrix[self._reversed, self._reversed])

    def forward(self, right: Any) -> Any:
        """Return ``L^-1 right``."""
        return super().forward(right[self._reversed, :])

    def back(self, right: Any) -> Any:
        """Return ``L^-T right``."""
        return super().back(right)[self._reversed, :]
