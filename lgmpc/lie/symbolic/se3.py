""":mod:`lgmpc.lie.se3` on CasADi expressions: homogeneous matrices (4, 4), twists (linear 3, angular 3)."""

from __future__ import annotations

from typing import Any

import casadi as ca

from lgmpc.lie.symbolic import coefficients, so3


def hat(xi: Any) -> Any:
    """Return the 4 by 4 matrix of a twist."""
    return ca.vertcat(ca.horzcat(so3.hat(xi[3:]), xi[:3]), ca.DM.zeros(1, 4))


def vee(matrix: Any) -> Any:
    """Return the twist of a matrix: the inverse of :func:`hat`."""
    return ca.vertcat(matrix[:3, 3], so3.vee(matrix[:3, :3]))


def exp(xi: Any) -> Any:
    """Return the placement reached in unit time along the constant body twist ``xi``."""
    rho, phi = xi[:3], xi[3:]
    return _pack(so3.exp(phi), translation(rho, phi))


def translation(rho: Any, phi: Any) -> Any:
    """Return ``left_jacobian(phi) rho`` of SO(3), the translation of the exponential."""
    t = ca.dot(phi, phi)
    turned = ca.cross(phi, rho)
    return rho + coefficients.b(t) * turned + coefficients.c(t) * ca.cross(phi, turned)


def untranslation(point: Any, phi: Any) -> Any:
    """Return ``left_jacobian_inverse(phi) point`` of SO(3), the linear part of the logarithm."""
    turned = ca.cross(phi, point)
    return point - 0.5 * turned + coefficients.d(ca.dot(phi, phi)) * ca.cross(phi, turned)


def log(placement: Any) -> Any:
    """Return the twist with rotation vector of norm at most pi."""
    phi = so3.log(placement[:3, :3])
    return ca.vertcat(untranslation(placement[:3, 3], phi), phi)


def compose(first: Any, second: Any) -> Any:
    """Return ``first second``."""
    return _pack(first[:3, :3] @ second[:3, :3], first[:3, 3] + first[:3, :3] @ second[:3, 3])


def inverse(placement: Any) -> Any:
    """Return the inverse placement."""
    back = placement[:3, :3].T
    return _pack(back, -back @ placement[:3, 3])


def act(placement: Any, point: Any) -> Any:
    """Return the moved point (3)."""
    return placement[:3, 3] + placement[:3, :3] @ point


def adjoint(placement: Any) -> Any:
    """Return the 6 by 6 matrix of the adjoint action on twists, ``hat(adjoint(g) x) = g hat(x) g^{-1}``."""
    rotation = placement[:3, :3]
    return _upper(rotation, so3.hat(placement[:3, 3]) @ rotation)


def ad(xi: Any) -> Any:
    """Return the matrix of the bracket of twists (Pinocchio's motion cross motion)."""
    return _upper(so3.hat(xi[3:]), so3.hat(xi[:3]))


def coadjoint(xi: Any) -> Any:
    """Return ``ad(xi)^T``."""
    return ad(xi).T


def force_cross(xi: Any) -> Any:
    """Return ``-ad(xi)^T`` (Pinocchio's motion cross force)."""
    return -ad(xi).T


def left_jacobian(xi: Any) -> Any:
    """Return ``J`` with ``exp(xi + e) = exp(J e) exp(xi)`` to first order."""
    return _upper(so3.left_jacobian(xi[3:]), so3.left_jacobian_slope(xi[3:], xi[:3]))


def right_jacobian(xi: Any) -> Any:
    """Return ``J`` with ``exp(xi + e) = exp(xi) exp(J e)`` to first order."""
    return left_jacobian(-xi)


def left_jacobian_inverse(xi: Any) -> Any:
    """Return the inverse of :func:`left_jacobian`."""
    return _upper(so3.left_jacobian_inverse(xi[3:]), so3.left_jacobian_inverse_slope(xi[3:], xi[:3]))


def right_jacobian_inverse(xi: Any) -> Any:
    """Return the inverse of :func:`right_jacobian`."""
    return left_jacobian_inverse(-xi)


def _pack(rotation: Any, point: Any) -> Any:
    return ca.vertcat(ca.horzcat(rotation, point), ca.DM([[0.0, 0.0, 0.0, 1.0]]))


def _upper(diagonal: Any, corner: Any) -> Any:
    return ca.vertcat(ca.horzcat(diagonal, corner), ca.horzcat(ca.DM(3, 3), diagonal))
