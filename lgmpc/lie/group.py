"""The protocol of the matrix groups, which the modules :mod:`so3`, :mod:`se3` and :mod:`sek3` satisfy."""

from __future__ import annotations

from typing import Protocol

from lgmpc.lie.checks import Checked
from lgmpc.lie.coefficients import Array

__all__ = ["Group"]

Unary = Checked[[Array], Array]
Binary = Checked[[Array, Array], Array]


class Group(Protocol):
    """A Lie group of matrices: pure functions on single elements or on batches over leading axes."""

    @property
    def exp(self) -> Unary:
        """Return the element of a tangent vector."""

    @property
    def log(self) -> Unary:
        """Return the tangent vector of an element, rotation part of norm at most pi."""

    @property
    def compose(self) -> Binary:
        """Return the product of two elements."""

    @property
    def inverse(self) -> Unary:
        """Return the inverse element."""

    @property
    def act(self) -> Binary:
        """Return the action of an element on a vector of the space that the group acts on."""

    @property
    def hat(self) -> Unary:
        """Return the Lie algebra's matrix of a tangent vector."""

    @property
    def vee(self) -> Unary:
        """Return the tangent vector of a matrix of the Lie algebra."""

    @property
    def adjoint(self) -> Unary:
        """Return the matrix with ``hat(adjoint(g) x) = g hat(x) g^{-1}``."""

    @property
    def ad(self) -> Unary:
        """Return the matrix with ``ad(x) y = vee(hat(x) hat(y) - hat(y) hat(x))``."""

    @property
    def coadjoint(self) -> Unary:
        """Return ``ad(x)^T``."""

    @property
    def force_cross(self) -> Unary:
        """Return ``-ad(x)^T``."""

    @property
    def left_jacobian(self) -> Unary:
        """Return ``J`` with ``exp(x + e) = exp(J e) exp(x)`` to first order."""

    @property
    def right_jacobian(self) -> Unary:
        """Return ``J`` with ``exp(x + e) = exp(x) exp(J e)`` to first order."""

    @property
    def left_jacobian_inverse(self) -> Unary:
        """Return the inverse of the left Jacobian."""

    @property
    def right_jacobian_inverse(self) -> Unary:
        """Return the inverse of the right Jacobian."""
