"""SE(3): homogeneous matrices (..., 4, 4), tangent the twist (..., 6): linear first, then angular.

Single or batched over leading axes. Every function validates its arguments (InputError); ``f.unchecked`` does not, as
in :mod:`lgmpc.lie.so3`. Twists, adjoints and cross products are Pinocchio's (``Motion``, ``SE3.action``).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lgmpc.lie import checks, quaternion, so3
from lgmpc.lie.checks import checked
from lgmpc.lie.coefficients import Array, b_c, d_only
from lgmpc.lie.components import Entries, matrix, norm, parts, rows, vector

__all__ = [
    "act",
    "ad",
    "adjoint",
    "coadjoint",
    "compose",
    "exp",
    "force_cross",
    "from_parts",
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


def identity() -> Array:
    """Return the identity."""
    return np.eye(4)


@checked(checks.rotation, checks.tangent(3))
def from_parts(rotation: Array, translation: Array) -> Array:
    """Return the placement of a rotation (..., 3, 3) and a translation (..., 3), m."""
    result = np.zeros((*np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1]), 4, 4))
    result[..., :3, :3] = rotation
    result[..., :3, 3] = translation
    result[..., 3, 3] = 1.0
    return result


@checked(checks.tangent(6))
def hat(xi: Array) -> Array:
    """Return the matrix (..., 4, 4) of a twist."""
    result = np.zeros((*xi.shape[:-1], 4, 4))
    result[..., :3, :3] = so3.hat.unchecked(xi[..., 3:])
    result[..., :3, 3] = xi[..., :3]
    return result


@checked(checks.twist_matrix)
def vee(algebra: Array) -> Array:
    """Return the twist of a matrix (..., 4, 4): the inverse of :func:`hat`."""
    return np.concatenate((algebra[..., :3, 3], so3.vee.unchecked(algebra[..., :3, :3])), axis=-1)


@checked(checks.tangent(6))
def exp(xi: Array) -> Array:
    """Return the placement reached in unit time along the constant body twist ``xi``."""
    entries = parts(xi)
    r = so3.rotation_entries(entries[3:])
    x, y, z = translation_entries(entries[:3], entries[3:])
    return matrix((*r[:3], x, *r[3:6], y, *r[6:], z, 0.0, 0.0, 0.0, 1.0), 4)


@checked(checks.placement)
def log(placement: Array) -> Array:
    """Return the twist whose rotation vector has norm at most pi; sign at pi as in :func:`lgmpc.lie.so3.log`."""
    phi = quaternion.log.unchecked(quaternion.from_matrix.unchecked(placement[..., :3, :3]))
    turn = parts(phi)
    return vector((*untranslation_entries(parts(placement[..., :3, 3]), turn), *turn))


@checked(checks.placement, checks.placement)
def compose(first: Array, second: Array) -> Array:
    """Return ``first second``."""
    product: Array = first @ second
    return product


@checked(checks.placement)
def inverse(placement: Array) -> Array:
    """Return the inverse placement."""
    back = np.swapaxes(placement[..., :3, :3], -1, -2)
    return from_parts.unchecked(back, -so3.act.unchecked(back, placement[..., :3, 3]))


@checked(checks.placement, checks.tangent(3))
def act(placement: Array, point: Array) -> Array:
    """Return the moved points (..., 3), m."""
    return placement[..., :3, 3] + so3.act.unchecked(placement[..., :3, :3], point)


@checked(checks.placement)
def adjoint(placement: Array) -> Array:
    """Return the matrix (..., 6, 6) of the adjoint action on twists: ``hat(adjoint(g) x) = g hat(x) g^{-1}``."""
    rotation = placement[..., :3, :3]
    return _upper(rows(rotation), rows(so3.hat.unchecked(placement[..., :3, 3]) @ rotation))


@checked(checks.tangent(6))
def ad(xi: Array) -> Array:
    """Return the matrix (..., 6, 6) of the bracket: Pinocchio's motion cross motion."""
    a, b, c, x, y, z = parts(xi)
    zero = 0.0 * x
    return _upper((zero, -z, y, z, zero, -x, -y, x, zero), (zero, -c, b, c, zero, -a, -b, a, zero))


@checked(checks.tangent(6))
def coadjoint(xi: Array) -> Array:
    """Return ``ad(xi)^T``: ``<coadjoint(x) m, y> = <m, [x, y]>``."""
    return np.swapaxes(ad.unchecked(xi), -1, -2)


@checked(checks.tangent(6))
def force_cross(xi: Array) -> Array:
    """Return ``-ad(xi)^T``: Pinocchio's motion cross force."""
    return -coadjoint.unchecked(xi)


@checked(checks.tangent(6))
def left_jacobian(xi: Array) -> Array:
    """Return ``J`` with ``exp(xi + e) = exp(J e) exp(xi)`` to first order; (..., 6, 6).

    Blocks ``[[J, Q], [0, J]]`` with SO(3)'s ``J`` and its derivative ``Q`` along the linear part (Barfoot, *State
    Estimation for Robotics*, 7.1.5, in another form); ``Q -> hat(linear) / 2`` as the angle tends to 0.
    """
    entries = parts(xi)
    return _upper(*so3.jacobian_entries(entries[3:], entries[:3]))


@checked(checks.tangent(6))
def right_jacobian(xi: Array) -> Array:
    """Return ``J`` with ``exp(xi + e) = exp(xi) exp(J e)`` to first order; (..., 6, 6)."""
    return left_jacobian.unchecked(-xi)


@checked(checks.tangent(6))
def left_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of :func:`left_jacobian`; singular where the angle is a multiple of 2 pi other than 0."""
    entries = parts(xi)
    return _upper(*so3.jacobian_inverse_entries(entries[3:], entries[:3]))


@checked(checks.tangent(6))
def right_jacobian_inverse(xi: Array) -> Array:
    """Return the inverse of :func:`right_jacobian`."""
    return left_jacobian_inverse.unchecked(-xi)


def translation_entries(linear: Entries, phi: Entries) -> Entries:
    """Return SO(3)'s left Jacobian at ``phi`` times ``linear``: the translation of the exponential."""
    return _twice_crossed(linear, phi, *b_c(norm(*phi)))


def untranslation_entries(translation: Entries, phi: Entries) -> Entries:
    """Return the inverse of SO(3)'s left Jacobian times ``translation``: the linear part of the logarithm."""
    return _twice_crossed(translation, phi, -0.5, d_only(norm(*phi)))


def _twice_crossed(linear: Entries, phi: Entries, first: Any, second: Any) -> Entries:
    """Return ``linear + first phi x linear + second phi x (phi x linear)``."""
    a, b, c = linear
    x, y, z = phi
    u, v, w = y * c - z * b, z * a - x * c, x * b - y * a
    return (
        a + first * u + second * (y * w - z * v),
        b + first * v + second * (z * u - x * w),
        c + first * w + second * (x * v - y * u),
    )


def _upper(diagonal: Entries, corner: Entries) -> Array:
    """Return ``[[diagonal, corner], [0, diagonal]]`` from the 9 entries of each."""
    a, b, c, d, e, f, g, h, i = diagonal
    r, s, t, u, v, w, x, y, z = corner
    upper = (a, b, c, r, s, t, d, e, f, u, v, w, g, h, i, x, y, z)
    lower = (0.0, 0.0, 0.0, a, b, c, 0.0, 0.0, 0.0, d, e, f, 0.0, 0.0, 0.0, g, h, i)
    return matrix(upper + lower, 6)
