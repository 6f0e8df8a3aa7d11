"""SE(3) and SE_k(3) over SO(3): the groups' formulas, written once for numpy and for CasADi.

An element ``X`` has a rotation ``R`` and columns ``p_j``, a tangent vector ``xi`` a rotation vector ``phi`` and a
3-vector ``rho_j`` a column. With SO(3)'s left Jacobian ``J = J(phi)`` and its derivative ``Q_j = D J(phi)[rho_j]``::

    X = [R  p_j; 0  I]      hat(xi) = [hat(phi)  rho_j; 0  0]
    exp(xi)  = [exp(phi)  J rho_j; 0  I]
    log(X)   = (phi, J^{-1} p_j),  phi = log(R)
    X^{-1}   = [R^T  -R^T p_j; 0  I]
    Ad(X)    = blocks(R, hat(p_j) R)
    ad(xi)   = blocks(hat(phi), hat(rho_j))
    J_left   = blocks(J, Q_j)

``blocks(D, C_j)`` has ``D`` on its diagonal and ``C_j`` where ``phi`` acts on ``rho_j``. The last line holds because
the power series of a Jacobian in ``blocks(Phi, P)`` has the derivative along ``P`` as its corner (Barfoot, *State
Estimation for Robotics*, 7.1.5, in another form); ``Q -> hat(rho) / 2`` as the angle tends to 0. Tangents of SE_k(3)
begin with ``phi``; SE(3) is SE_1(3) with the linear part first.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from lgmpc.lie import so3
from lgmpc.lie.coefficients import Array

__all__ = ["ArrayPoses", "Poses"]


class Poses(ABC):
    """The functions of a group of poses; how matrices are taken apart and assembled is the subclass's.

    Args:
        so3: functions of SO(3), by the names of :mod:`lgmpc.lie.so3`.
        linear_first: the order of SE(3)'s tangent vectors, for one column only.
    """

    def __init__(self, so3: Any, linear_first: bool = False) -> None:
        self.so3 = so3
        self.linear_first = linear_first

    def hat(self, xi: Any) -> Any:
        """Return the Lie algebra's matrix of a tangent vector."""
        phi, *linear = self._split(xi)
        return self._pack(self.so3.hat(phi), self._beside(linear), 0.0)

    def vee(self, algebra: Any) -> Any:
        """Return the tangent vector of a matrix of the Lie algebra: the inverse of :meth:`hat`."""
        turn, columns = self._unpack(algebra)
        return self._join([self.so3.vee(turn), *self._columns(columns)])

    def exp(self, xi: Any) -> Any:
        """Return the element of a tangent vector: each column is SO(3)'s left Jacobian times its part."""
        phi, *linear = self._split(xi)
        columns = [self.so3.left_jacobian_product(phi, rho) for rho in linear]
        return self._pack(self.so3.exp(phi), self._beside(columns), 1.0)

    def log(self, pose: Any) -> Any:
        """Return the tangent vector, rotation vector of norm at most pi; sign at pi as in :func:`lgmpc.lie.so3.log`."""
        rotation, columns = self._unpack(pose)
        phi = self.so3.log(rotation)
        return self._join([phi, *(self.so3.left_jacobian_inverse_product(phi, p) for p in self._columns(columns))])

    def compose(self, first: Any, second: Any) -> Any:
        """Return ``first second``."""
        (rotation, columns), (other, moved) = self._unpack(first), self._unpack(second)
        return self._pack(rotation @ other, columns + rotation @ moved, 1.0)

    def inverse(self, pose: Any) -> Any:
        """Return the inverse element."""
        rotation, columns = self._unpack(pose)
        back = self._transpose(rotation)
        return self._pack(back, -back @ columns, 1.0)

    def act(self, pose: Any, vector: Any) -> Any:
        """Return SE(3)'s moved point, m; for SE_k(3) ``pose vector`` with 3 + k entries, as invariant filters do."""
        if not self.linear_first:
            return self._times(pose, vector)
        rotation, columns = self._unpack(pose)
        return self._columns(columns)[0] + self._times(rotation, vector)

    def adjoint(self, pose: Any) -> Any:
        """Return the matrix with ``hat(adjoint(g) x) = g hat(x) g^{-1}``."""
        rotation, columns = self._unpack(pose)
        return self._blocks(rotation, [self.so3.hat(p) @ rotation for p in self._columns(columns)])

    def ad(self, xi: Any) -> Any:
        """Return the matrix of the bracket; of SE(3) Pinocchio's motion cross motion."""
        phi, *linear = self._split(xi)
        return self._blocks(self.so3.hat(phi), [self.so3.hat(rho) for rho in linear])

    def coadjoint(self, xi: Any) -> Any:
        """Return ``ad(xi)^T``: ``<coadjoint(x) m, y> = <m, [x, y]>``."""
        return self._transpose(self.ad(xi))

    def force_cross(self, xi: Any) -> Any:
        """Return ``-ad(xi)^T``; of SE(3) Pinocchio's motion cross force."""
        return -self.coadjoint(xi)

    def left_jacobian(self, xi: Any) -> Any:
        """Return ``J`` with ``exp(xi + e) = exp(J e) exp(xi)`` to first order."""
        phi, *linear = self._split(xi)
        return self._blocks(self.so3.left_jacobian(phi), [self.so3.left_jacobian_slope(phi, rho) for rho in linear])

    def right_jacobian(self, xi: Any) -> Any:
        """Return ``J`` with ``exp(xi + e) = exp(xi) exp(J e)`` to first order."""
        return self.left_jacobian(-xi)

    def left_jacobian_inverse(self, xi: Any) -> Any:
        """Return the inverse of :meth:`left_jacobian`; singular where the angle is a multiple of 2 pi other than 0."""
        phi, *linear = self._split(xi)
        corners = [self.so3.left_jacobian_inverse_slope(phi, rho) for rho in linear]
        return self._blocks(self.so3.left_jacobian_inverse(phi), corners)

    def right_jacobian_inverse(self, xi: Any) -> Any:
        """Return the inverse of :meth:`right_jacobian`."""
        return self.left_jacobian_inverse(-xi)

    @abstractmethod
    def _split(self, xi: Any) -> list[Any]:
        """Return the rotation vector, then the linear parts."""

    @abstractmethod
    def _join(self, vectors: list[Any]) -> Any:
        """Return the tangent vector of these: the inverse of :meth:`_split`."""

    @abstractmethod
    def _unpack(self, matrix: Any) -> tuple[Any, Any]:
        """Return the upper left block and the columns beside it, two matrices."""

    @abstractmethod
    def _pack(self, block: Any, columns: Any, diagonal: float) -> Any:
        """Return the matrix of an upper left block and columns, with a number on the rest of the diagonal."""

    @abstractmethod
    def _columns(self, matrix: Any) -> list[Any]:
        """Return the columns of a matrix, vectors."""

    @abstractmethod
    def _beside(self, columns: list[Any]) -> Any:
        """Return the matrix of these columns: the inverse of :meth:`_columns`."""

    @abstractmethod
    def _blocks(self, diagonal: Any, corners: list[Any]) -> Any:
        """Return the matrix on tangent vectors of these blocks."""

    @abstractmethod
    def _transpose(self, matrix: Any) -> Any:
        """Return the transpose, without memory of the argument's."""

    @abstractmethod
    def _times(self, matrix: Any, vector: Any) -> Any:
        """Return the product of a matrix and a vector."""


class ArrayPoses(Poses):
    """Poses as arrays, single or batched over leading axes; arguments are not checked."""

    def __init__(self, linear_first: bool = False) -> None:
        super().__init__(_Unchecked(), linear_first)

    def from_parts(self, rotation: Array, translation: Array) -> Array:
        """Return the placement of a rotation (..., 3, 3) and a translation (..., 3), m."""
        return self._pack(rotation, translation[..., None], 1.0)

    def _split(self, xi: Array) -> list[Array]:
        vectors = [xi[..., i : i + 3] for i in range(0, xi.shape[-1], 3)]
        return vectors[::-1] if self.linear_first else vectors

    def _join(self, vectors: list[Array]) -> Array:
        return np.concatenate(vectors[::-1] if self.linear_first else vectors, axis=-1)

    def _unpack(self, matrix: Array) -> tuple[Array, Array]:
        return matrix[..., :3, :3], matrix[..., :3, 3:]

    def _pack(self, block: Array, columns: Array, diagonal: float) -> Array:
        size = 3 + columns.shape[-1]
        result = np.zeros((*np.broadcast_shapes(block.shape[:-2], columns.shape[:-2]), size, size))
        result[..., :3, :3], result[..., :3, 3:] = block, columns
        for j in range(3, size):
            result[..., j, j] = diagonal
        return result

    def _columns(self, matrix: Array) -> list[Array]:
        return [matrix[..., j] for j in range(matrix.shape[-1])]

    def _beside(self, columns: list[Array]) -> Array:
        return np.stack(columns, axis=-1)

    def _blocks(self, diagonal: Array, corners: list[Array]) -> Array:
        size = 3 + 3 * len(corners)
        result = np.zeros((*diagonal.shape[:-2], size, size))
        result[..., :3, :3] = diagonal
        for i, corner in zip(range(3, size, 3), corners, strict=True):
            result[..., i : i + 3, i : i + 3] = diagonal
            if self.linear_first:
                result[..., :3, 3:] = corner
            else:
                result[..., i : i + 3, :3] = corner
        return result

    def _transpose(self, matrix: Array) -> Array:
        return np.swapaxes(matrix, -1, -2)

    def _times(self, matrix: Array, vector: Array) -> Array:
        product: Array = (matrix @ vector[..., None])[..., 0]
        return product


class _Unchecked:
    """The functions of SO(3) without their checks."""

    def __getattr__(self, name: str) -> Any:
        return getattr(so3, name).unchecked
