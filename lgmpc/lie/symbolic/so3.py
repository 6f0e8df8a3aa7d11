""":mod:`lgmpc.lie.so3` on CasADi expressions: rotation matrices (3, 3), rotation vectors (3), rad."""

from typing import Any

import casadi as ca

from lgmpc.lie import coefficients
from lgmpc.lie.symbolic import quaternion


def hat(phi: Any) -> Any:
    """Return the skew matrix with ``hat(phi) y = phi x y``."""
    return ca.skew(phi)


def vee(matrix: Any) -> Any:
    """Return the vector of a skew matrix: the inverse of :func:`hat`."""
    return ca.inv_skew(matrix)


def exp(phi: Any) -> Any:
    """Return the rotation by ``|phi|`` about ``phi``."""
    t, skew = ca.dot(phi, phi), hat(phi)
    return ca.DM.eye(3) + coefficients.a.symbolic(t) * skew + coefficients.b.symbolic(t) * _square(phi, t)


def log(rotation: Any) -> Any:
    """Return the rotation vector of norm at most pi; sign at pi as in :func:`lgmpc.lie.so3.log`."""
    return quaternion.log(quaternion.from_matrix(rotation))


def compose(first: Any, second: Any) -> Any:
    """Return ``first second``."""
    return first @ second


def inverse(rotation: Any) -> Any:
    """Return the transpose."""
    return rotation.T


def act(rotation: Any, point: Any) -> Any:
    """Return the rotated 3-vector."""
    return rotation @ point


def adjoint(rotation: Any) -> Any:
    """Return the adjoint matrix: the rotation itself."""
    return rotation


def ad(phi: Any) -> Any:
    """Return the matrix of the bracket, ``ad(x) y = x x y``."""
    return hat(phi)


def coadjoint(phi: Any) -> Any:
    """Return ``ad(phi)^T``."""
    return ad(phi).T


def force_cross(phi: Any) -> Any:
    """Return ``-ad(phi)^T``."""
    return -ad(phi).T


def left_jacobian(phi: Any) -> Any:
    """Return ``J`` with ``exp(phi + e) = exp(J e) exp(phi)`` to first order."""
    t = ca.dot(phi, phi)
    return ca.DM.eye(3) + coefficients.b.symbolic(t) * hat(phi) + coefficients.c.symbolic(t) * _square(phi, t)


def right_jacobian(phi: Any) -> Any:
    """Return ``J`` with ``exp(phi + e) = exp(phi) exp(J e)`` to first order."""
    return left_jacobian(-phi)


def left_jacobian_inverse(phi: Any) -> Any:
    """Return the inverse of :func:`left_jacobian`."""
    t = ca.dot(phi, phi)
    return ca.DM.eye(3) - 0.5 * hat(phi) + coefficients.d.symbolic(t) * _square(phi, t)


def right_jacobian_inverse(phi: Any) -> Any:
    """Return the inverse of :func:`right_jacobian`."""
    return left_jacobian_inverse(-phi)


def left_jacobian_product(phi: Any, vector: Any) -> Any:
    """Return ``left_jacobian(phi) vector``: the translation of SE(3)'s exponential."""
    t, turned = ca.dot(phi, phi), ca.cross(phi, vector)
    return vector + coefficients.b.symbolic(t) * turned + coefficients.c.symbolic(t) * ca.cross(phi, turned)


def left_jacobian_inverse_product(phi: Any, vector: Any) -> Any:
    """Return ``left_jacobian_inverse(phi) vector``: the linear part of SE(3)'s logarithm."""
    turned = ca.cross(phi, vector)
    return vector - 0.5 * turned + coefficients.d.symbolic(ca.dot(phi, phi)) * ca.cross(phi, turned)


def _square(phi: Any, t: Any) -> Any:
    return phi @ phi.T - t * ca.DM.eye(3)


def left_jacobian_slope(phi: Any, rho: Any) -> Any:
    """Return the derivative of :func:`left_jacobian` along ``rho``: the coupling block of SE(3) and SE_k(3)."""
    t, skew = ca.dot(phi, phi), hat(phi)
    along = ca.dot(phi, rho)
    return (
        coefficients.b.symbolic(t) * hat(rho)
        + coefficients.c.symbolic(t) * _anticommutator(phi, rho)
        + along * (coefficients.beta.symbolic(t) * skew + coefficients.gamma.symbolic(t) * _square(phi, t))
    )


def left_jacobian_inverse_slope(phi: Any, rho: Any) -> Any:
    """Return the derivative of :func:`left_jacobian_inverse` along ``rho``."""
    t = ca.dot(phi, phi)
    return (
        -0.5 * hat(rho)
        + coefficients.d.symbolic(t) * _anticommutator(phi, rho)
        + ca.dot(phi, rho) * coefficients.delta.symbolic(t) * _square(phi, t)
    )


def _anticommutator(phi: Any, rho: Any) -> Any:
    outer = phi @ rho.T
    return outer + outer.T - 2.0 * ca.dot(phi, rho) * ca.DM.eye(3)
