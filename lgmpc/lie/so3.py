"""SO(3): rotation matrices (..., 3, 3), tangent the rotation vector (..., 3) in rad.

Single or batched over leading axes. Every function validates its arguments (InputError: shape, non-finite, not a
rotation); its attribute ``unchecked``, as in ``so3.exp.unchecked(phi)``, does not: for hot loops on float64 arrays
known to be valid. The series of the coefficients and their accuracy are in :mod:`lgmpc.lie.coefficients`.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import checks, quaternion
from lgmpc.lie.checks import checked
from lgmpc.lie.coefficients import Array, a_b, b_c, d
from lgmpc.lie.components import matrix, norm, parts

from_quaternion = quaternion.to_matrix
to_quaternion = quaternion.from_matrix


def identity() -> Array:
    """Return the identity."""
    return np.eye(3)


@checked(checks.tangent(3))
def hat(phi: Array) -> Array:
    """Return the skew matrix with ``hat(phi) y = phi x y``."""
    x, y, z = parts(phi)
    if isinstance(x, float):
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    result = np.zeros((*phi.shape, 3))
    result[..., 2, 1], result[..., 0, 2], result[..., 1, 0] = x, y, z
    result[..., 1, 2], result[..., 2, 0], result[..., 0, 1] = -x, -y, -z
    return result


ad = hat
"""The matrix of the bracket, ``ad(x) y = x x y``."""
force_cross = hat
"""``-ad(phi)^T``, as in the rate of a moment expressed in a rotating frame."""


@checked(checks.skew)
def vee(skew: Array) -> Array:
    """Return the vector of a skew matrix: the inverse of :func:`hat`."""
    return np.stack((skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]), axis=-1)


@checked(checks.tangent(3))
def exp(phi: Array) -> Array:
    """Return the rotation by ``|phi|`` about ``phi`` (Rodrigues)."""
    return _polynomial(phi, a_b)


@checked(checks.rotation)
def log(rotation: Array) -> Array:
    """Return the rotation vector of norm at most pi, by way of the quaternion: accurate at 0 and at pi alike.

    At exactly pi, that is for a symmetric matrix, ``+-pi u`` are equally near: the one whose first non-zero entry is
    positive is returned.
    """
    return quaternion.log.unchecked(quaternion.from_matrix.unchecked(rotation))


@checked(checks.rotation, checks.rotation)
def compose(first: Array, second: Array) -> Array:
    """Return ``first second``."""
    return first @ second


@checked(checks.rotation)
def inverse(rotation: Array) -> Array:
    """Return the transpose."""
    return np.swapaxes(rotation, -1, -2).copy()


@checked(checks.rotation, checks.tangent(3))
def act(rotation: Array, point: Array) -> Array:
    """Return the rotated 3-vectors (..., 3)."""
    return (rotation @ point[..., None])[..., 0]


@checked(checks.rotation)
def adjoint(rotation: Array) -> Array:
    """Return the matrix of ``x -> vee(R hat(x) R^T)``: the rotation itself."""
    return rotation.copy()


@checked(checks.tangent(3))
def coadjoint(phi: Array) -> Array:
    """Return ``ad(phi)^T``: ``<coadjoint(x) m, y> = <m, [x, y]>``."""
    return hat.unchecked(-phi)


@checked(checks.tangent(3))
def left_jacobian(phi: Array) -> Array:
    """Return ``J`` with ``exp(phi + e) = exp(J e) exp(phi)`` to first order; (..., 3, 3)."""
    return _polynomial(phi, b_c)


@checked(checks.tangent(3))
def right_jacobian(phi: Array) -> Array:
    """Return ``J`` with ``exp(phi + e) = exp(phi) exp(J e)`` to first order; (..., 3, 3)."""
    return left_jacobian.unchecked(-phi)


@checked(checks.tangent(3))
def left_jacobian_inverse(phi: Array) -> Array:
    """Return the inverse of :func:`left_jacobian`; singular where ``|phi|`` is a multiple of 2 pi other than 0."""
    return _polynomial(phi, lambda angle: (-0.5, d(angle)))


@checked(checks.tangent(3))
def right_jacobian_inverse(phi: Array) -> Array:
    """Return the inverse of :func:`right_jacobian`."""
    return left_jacobian_inverse.unchecked(-phi)


def project(approximate: Array) -> Array:
    """Return the rotation nearest to a matrix (..., 3, 3) in the Frobenius norm, by singular values.

    Raises:
        InputError: wrong shape, non-finite, or so far from a rotation (determinant not positive) that none is nearest.
    """
    array = checks.matrix(3)("approximate", approximate)
    determinant = np.linalg.det(array)
    if np.any(determinant <= 0.0):
        raise InputError("approximate", f"determinant {np.min(determinant):.3g}", "a positive determinant")
    left, _, right = np.linalg.svd(array)
    return left @ right


def _polynomial(phi: Array, coefficients: Callable[[Any], tuple[Any, Any]]) -> Array:
    """Return ``I + first Phi + second Phi^2`` with two coefficients of the angle."""
    x, y, z = parts(phi)
    first, second = coefficients(norm(x, y, z))
    u, v, w = first * x, first * y, first * z
    xy, xz, yz = second * x * y, second * x * z, second * y * z
    xx, yy, zz = second * x * x, second * y * y, second * z * z
    return matrix(
        (1.0 - (yy + zz), xy - w, xz + v, xy + w, 1.0 - (xx + zz), yz - u, xz - v, yz + u, 1.0 - (xx + yy)), 3
    )
