""":mod:`lgmpc.lie.sek3` on CasADi expressions: matrices (3 + k, 3 + k), tangents (rotation 3, 3 a column)."""

from __future__ import annotations

from typing import Any

import casadi as ca

from lgmpc.lie.symbolic import se3, so3


def hat(xi: Any) -> Any:
    """Return the (3 + k, 3 + k) matrix of a tangent vector."""
    columns = _columns(xi)
    return ca.vertcat(ca.horzcat(so3.hat(xi[:3]), *columns), ca.DM.zeros(len(columns), 3 + len(columns)))


def vee(matrix: Any) -> Any:
    """Return the tangent vector of a matrix: the inverse of :func:`hat`."""
    return ca.vertcat(so3.vee(matrix[:3, :3]), ca.vec(matrix[:3, 3:]))


def exp(xi: Any) -> Any:
    """Return the exponential."""
    return _pack(so3.exp(xi[:3]), ca.horzcat(*(se3.translation(rho, xi[:3]) for rho in _columns(xi))))


def log(pose: Any) -> Any:
    """Return the tangent vector with rotation vector of norm at most pi."""
    phi = so3.log(pose[:3, :3])
    return ca.vertcat(phi, *(se3.untranslation(pose[:3, j], phi) for j in range(3, pose.shape[1])))


def compose(first: Any, second: Any) -> Any:
    """Return ``first second``."""
    rotation = first[:3, :3]
    return _pack(rotation @ second[:3, :3], first[:3, 3:] + rotation @ second[:3, 3:])


def inverse(pose: Any) -> Any:
    """Return the inverse."""
    back = pose[:3, :3].T
    return _pack(back, -back @ pose[:3, 3:])


def act(pose: Any, vector: Any) -> Any:
    """Return ``pose vector`` for a vector of length 3 + k."""
    return pose @ vector


def adjoint(pose: Any) -> Any:
    """Return the (3 + 3k, 3 + 3k) matrix with ``hat(adjoint(g) x) = g hat(x) g^{-1}``."""
    rotation = pose[:3, :3]
    return _lower(rotation, [so3.hat(pose[:3, j]) @ rotation for j in range(3, pose.shape[1])])


def ad(xi: Any) -> Any:
    """Return the matrix of the bracket."""
    return _lower(so3.hat(xi[:3]), [so3.hat(rho) for rho in _columns(xi)])


def coadjoint(xi: Any) -> Any:
    """Return ``ad(xi)^T``."""
    return ad(xi).T


def force_cross(xi: Any) -> Any:
    """Return ``-ad(xi)^T``."""
    return -ad(xi).T


def left_jacobian(xi: Any) -> Any:
    """Return ``J`` with ``exp(xi + e) = exp(J e) exp(xi)`` to first order."""
    return _lower(so3.left_jacobian(xi[:3]), [so3.left_jacobian_slope(xi[:3], rho) for rho in _columns(xi)])


def right_jacobian(xi: Any) -> Any:
    """Return ``J`` with ``exp(xi + e) = exp(xi) exp(J e)`` to first order."""
    return left_jacobian(-xi)


def left_jacobian_inverse(xi: Any) -> Any:
    """Return the inverse of :func:`left_jacobian`."""
    corners = [so3.left_jacobian_inverse_slope(xi[:3], rho) for rho in _columns(xi)]
    return _lower(so3.left_jacobian_inverse(xi[:3]), corners)


def right_jacobian_inverse(xi: Any) -> Any:
    """Return the inverse of :func:`right_jacobian`."""
    return left_jacobian_inverse(-xi)


def _columns(xi: Any) -> list[Any]:
    return [xi[i : i + 3] for i in range(3, xi.shape[0], 3)]


def _pack(rotation: Any, columns: Any) -> Any:
    k = columns.shape[1]
    return ca.vertcat(ca.horzcat(rotation, columns), ca.horzcat(ca.DM.zeros(k, 3), ca.DM.eye(k)))


def _lower(diagonal: Any, corners: list[Any]) -> Any:
    k = len(corners)
    first = ca.vertcat(diagonal, *corners)
    rest = ca.vertcat(ca.DM(3, 3 * k), ca.kron(ca.DM.eye(k), diagonal))
    return ca.horzcat(first, rest)
