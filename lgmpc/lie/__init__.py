"""Lie groups of rigid motion: SO(3), SE(3) and the extended poses SE_k(3).

* :mod:`lgmpc.lie.so3`, :mod:`lgmpc.lie.se3`, :mod:`lgmpc.lie.sek3`: numpy, single or batched over leading axes;
  :mod:`lgmpc.lie.quaternion`: the double cover of SO(3), x y z w; :mod:`lgmpc.lie.attitude`: angles.
* :mod:`lgmpc.lie.symbolic`: the same functions on CasADi expressions (``symbolic.so3``, ...); :class:`Poses` has the
  formulas of SE(3) and SE_k(3).

Conventions: SE(3) twists and wrenches linear first, SE_k(3) tangents rotation first. ``coadjoint(xi) = ad(xi)^T`` and
``force_cross(xi) = -ad(xi)^T``. Left Jacobian: ``exp(xi + e) = exp(J e) exp(xi)``; right: ``exp(xi) exp(J e)``.
Logarithms return rotation vectors of norm at most pi; at exactly pi, the one with positive first non-zero entry.
"""

from typing import Protocol

from lgmpc.lie import attitude, quaternion, se3, sek3, so3
from lgmpc.lie.checks import ArrayFunction
from lgmpc.lie.poses import Poses

__all__ = ["GROUPS", "Group", "Poses", "attitude", "quaternion", "se3", "sek3", "so3"]


class Group(Protocol):
    """A Lie group of matrices: pure functions on single elements or on batches over leading axes.

    Attributes:
        exp: the element of a tangent vector.
        log: the tangent vector of an element, rotation part of norm at most pi.
        compose: the product of two elements.
        inverse: the inverse element.
        act: the action of an element on a vector of the space that the group acts on.
        hat: the Lie algebra's matrix of a tangent vector.
        vee: the tangent vector of a matrix of the Lie algebra.
        adjoint: the matrix with ``hat(adjoint(g) x) = g hat(x) g^{-1}``.
        ad: the matrix with ``ad(x) y = vee(hat(x) hat(y) - hat(y) hat(x))``.
        coadjoint: ``ad(x)^T``.
        force_cross: ``-ad(x)^T``.
        left_jacobian: ``J`` with ``exp(x + e) = exp(J e) exp(x)`` to first order.
        right_jacobian: ``J`` with ``exp(x + e) = exp(x) exp(J e)`` to first order.
        left_jacobian_inverse: the inverse of the left Jacobian.
        right_jacobian_inverse: the inverse of the right Jacobian.
    """

    exp: ArrayFunction
    log: ArrayFunction
    compose: ArrayFunction
    inverse: ArrayFunction
    act: ArrayFunction
    hat: ArrayFunction
    vee: ArrayFunction
    adjoint: ArrayFunction
    ad: ArrayFunction
    coadjoint: ArrayFunction
    force_cross: ArrayFunction
    left_jacobian: ArrayFunction
    right_jacobian: ArrayFunction
    left_jacobian_inverse: ArrayFunction
    right_jacobian_inverse: ArrayFunction


GROUPS: tuple[Group, ...] = (so3, se3, sek3)
"""The matrix groups; the type checker verifies that each module satisfies the protocol."""
