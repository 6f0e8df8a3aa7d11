"""A sparse factor of the mass matrix that follows the tree's branches."""

from __future__ import annotations

from typing import Any

import casadi as ca

__all__ = ["MassFactor"]


class MassFactor:
    """The factor ``M = L^T D L`` (Featherstone 2005), written as the L D L^T of M in reverse order.

    Eliminating the leaves first makes no entry that M does not have: the zeros between branches stay.

    Args:
        mass_matrix: (nv, nv), both triangles, with structural zeros.
    """

    def __init__(self, mass_matrix: Any) -> None:
        self._reversed = list(range(mass_matrix.shape[0]))[::-1]
        self._factor = ca.ldl(mass_matrix[self._reversed, self._reversed], False)

    def solve(self, right: Any) -> Any:
        """Return ``M^-1 right`` for (nv, n) right-hand sides."""
        return ca.ldl_solve(right[self._reversed, :], *self._factor)[self._reversed, :]
