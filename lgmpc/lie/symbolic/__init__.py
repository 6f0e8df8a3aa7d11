"""The groups on CasADi expressions (SX, MX, DM), one element a call; names and conventions of :mod:`lgmpc.lie`.

Arguments are not validated. Branches are guarded, so that derivatives of any order are exact at the identity.
"""

from typing import Any

import casadi as ca

from lgmpc.lie.poses import Poses
from lgmpc.lie.symbolic import quaternion, so3

__all__ = ["quaternion", "se3", "sek3", "so3"]


class _SymbolicPoses(Poses):
    """Poses as CasADi matrices, one a call."""

    def __init__(self, linear_first: bool = False) -> None:
        super().__init__(so3, linear_first)

    def _split(self, xi: Any) -> list[Any]:
        vectors = [xi[i : i + 3] for i in range(0, xi.shape[0], 3)]
        return vectors[::-1] if self.linear_first else vectors

    def _join(self, vectors: list[Any]) -> Any:
        return ca.vertcat(*(vectors[::-1] if self.linear_first else vectors))

    def _unpack(self, matrix: Any) -> tuple[Any, Any]:
        return matrix[:3, :3], matrix[:3, 3:]

    def _pack(self, block: Any, columns: Any, diagonal: float) -> Any:
        k = columns.shape[1]
        corner = diagonal * ca.DM.eye(k) if diagonal else ca.DM.zeros(k, k)
        return ca.vertcat(ca.horzcat(block, columns), ca.horzcat(ca.DM.zeros(k, 3), corner))

    def _columns(self, matrix: Any) -> list[Any]:
        return list(ca.horzsplit(matrix))

    def _beside(self, columns: list[Any]) -> Any:
        return ca.horzcat(*columns)

    def _blocks(self, diagonal: Any, corners: list[Any]) -> Any:
        k = len(corners)
        if self.linear_first:
            return ca.vertcat(ca.horzcat(diagonal, *corners), ca.horzcat(ca.DM(3, 3), diagonal))
        rest = ca.vertcat(ca.DM(3, 3 * k), ca.kron(ca.DM.eye(k), diagonal))
        return ca.horzcat(ca.vertcat(diagonal, *corners), rest)

    def _transpose(self, matrix: Any) -> Any:
        return matrix.T

    def _times(self, matrix: Any, vector: Any) -> Any:
        return matrix @ vector


se3 = _SymbolicPoses(linear_first=True)
"""SE(3): homogeneous matrices (4, 4), twists (6) linear first."""
sek3 = _SymbolicPoses()
"""SE_k(3): matrices (3 + k, 3 + k), tangents (3 + 3k) rotation first."""
