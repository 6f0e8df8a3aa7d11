"""SE_k(3), extended poses: matrices (..., 3 + k, 3 + k) of a rotation and k columns (k = 2: velocity and position).

Tangent (..., 3 + 3k): rotation vector first, then one 3-vector a column, as in the invariant-filtering literature
(Barrau and Bonnabel, IEEE TAC 2017; Hartley et al., IJRR 2020). ``k`` follows from the shapes. SE_1(3) is SE(3) with
the halves of the tangent swapped. Single or batched over leading axes. Every function validates its arguments
(InputError); ``f.unchecked`` does not, as in :mod:`lgmpc.lie.so3`.
"""

from __future__ import annotations

import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import checks, se3, so3
from lgmpc.lie.checks import checked
from lgmpc.lie.coefficients import Array
from lgmpc.lie.components import Entries, matrix, parts, vector

__all__ = [
    "act",
    "ad",
    "adjoint",
    "coadjoint",
    "compose",
    "exp",
    "force_cross",
    "hat",
    "identity",
    "inverse",
    "left_jacobian",
    "left_jacobian_inverse",
    "log",
    "right_jacobian",
    "right_jacobian_inverse",
    "vee",
]


def identity(k: int) -> Array:
    """Return the identity of SE_k(3).

    Raises:
        InputError: ``k`` below 1.
    """
    if k < 1:
        raise InputError("k", k, "a number of columns >= 1")
    return np.eye(3 + k)


@checked(checks.extended_tangent)
def hat(xi: Array) -> Array:
    """Return the matrix (..., 3 + k, 3 + k) of a tangent vector."""
    size = 2 + xi.shape[-1] // 3
    result = np.zeros((*xi.shape[:-1], size, size))
    result[..., :3, :3] = so3.hat.unchecked(xi[..., :3])
    for j in range(3, size):
        result[..., :3, j] = xi[..., 3 * j - 6 : 3 * j - 3]
    return result


@checked(checks.extended_twist_matrix)
def vee(algebra: Array) -> Array:
    """Return the tangent vector of a matrix: the inverse of :func:`hat`."""
    columns = (algebra[..., :3, j] for j in range(3, algebra.shape[-1]))
    return np.concatenate((so3.vee.unchecked(algebra[..., :3, :3]), *columns), axis=-1)


@checked(checks.extended_tangent)
def exp(xi: Array) -> Array:
    """Return the exponential: each column is SO(3)'s left Jacobian times its tangent."""
    phi, *columns = _threes(xi)
    moved = [vector(se3.translation_entries(column, phi)) for column in columns]
    return _pack(matrix(so3.rotation_entries(phi), 3), np.stack(moved, axis=-1))


@checked(checks.extended_pose)
def log(pose: Array) -> Array:
    """Return the tangent vector, rotation vector of norm at most pi; sign at pi as in :func:`lgmpc.lie.so3.log`."""
    phi = so3.log.unchecked(pose[..., :3, :3])
    turn = parts(phi)
    columns = (vector(se3.untranslation_entries(parts(pose[..., :3, j]), turn)) for j in range(3, pose.shape[-1]))
    return np.concatenate((phi, *columns), axis=-1)


@checked(checks.extended_pose, checks.extended_pose)
def compose(first: Array, second: Array) -> Array:
    """Return ``first second``."""
    product: Array = first @ second
    return product


@checked(checks.extended_pose)
def inverse(pose: Array) -> Array:
    """Return the inverse."""
    back = np.swapaxes(pose[..., :3, :3], -1, -2)
    return _pack(back, -(back @ pose[..., :3, 3:]))


@checked(checks.extended_pose, checks.ambient)
def act(pose: Array, ambient: Array) -> Array:
    """Return ``pose vector`` for vectors (..., 3 + k): the form in which invariant filters write their measurements."""
    moved: Array = (pose @ ambient[..., None])[..., 0]
    return moved


@checked(checks.extended_pose)
def adjoint(pose: Array) -> Array:
    """Return the matrix (..., 3 + 3k, 3 + 3k) with ``hat(adjoint(g) x) = g hat(x) g^{-1}``."""
    rotation = pose[..., :3, :3]
    corners = [so3.hat.unchecked(pose[..., :3, j]) @ rotation for j in range(3, pose.shape[-1])]
    return _lower([rotation, *corners])


@checked(checks.extended_tangent)
def ad(xi: Array) -> Array:
    """Return the matrix (..., 3 + 3k, 3 + 3k) of the bracket."""
    return _lower([so3.hat.unchecked(xi[..., i : i + 3]) for i in range(0, xi.shape[-1], 3)])


@checked(checks.extended_tangent)
def coadjoint(xi: Array) -> Array:
    """Return ``ad(xi)^T``: ``<coadjoint(x) m, y> = <m, [x, y]>``."""
    return np.swapaxes(ad.unchecked(xi), -1, -2)


@checked(checks.extended_tangent)
def force_cross(xi: Array) -> Array:
    """Return ``-ad(xi)^T``."""
    return -coadjoint.unchecked(xi)


@checked(checks.extended_tangent)
def left_jacobian(xi: Array) -> Array:
    """Return ``J`` with ``exp(xi + e) = exp(J e) exp(xi)`` to first order; (..., 3 + 3k, 3 + 3k)."""
    return _lower([matrix(block, 3) for block in so3.jacobian_entries(*_threes(xi))])


@checked(checks.extended_tangent)
def right_jacobian(xi: Array) -> Array:
    """Return ``J`` with ``exp(xi + e) = exp(xi) exp(J e)`` to first order."""
    return left_jacobian.unchecked(-xi)


@checked(checks.extended_tangent)
def left_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of :func:`left_jacobian`; singular where the angle is a multiple of 2 pi other than 0."""
    return _lower([matrix(block, 3) for block in so3.jacobian_inverse_entries(*_threes(xi))])


@checked(checks.extended_tangent)
def right_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of :func:`right_jacobian`."""
    return left_jacobian_inverse.unchecked(-xi)


def _threes(xi: Array) -> list[Entries]:
    entries = parts(xi)
    return [entries[i : i + 3] for i in range(0, len(entries), 3)]


def _pack(rotation: Array, columns: Array) -> Array:
    k = columns.shape[-1]
    result = np.zeros((*rotation.shape[:-2], 3 + k, 3 + k))
    result[..., :3, :3] = rotation
    result[..., :3, 3:] = columns
    for i in range(3, 3 + k):
        result[..., i, i] = 1.0
    return result


def _lower(blocks: list[Array]) -> Array:
    diagonal, *corners = blocks
    size = 3 * len(blocks)
    result = np.zeros((*diagonal.shape[:-2], size, size))
    result[..., :3, :3] = diagonal
    for i, corner in zip(range(3, size, 3), corners, strict=True):
        result[..., i : i + 3, :3] = corner
        result[..., i : i + 3, i : i + 3] = diagonal
    return result
