"""What every matrix group here offers; the modules :mod:`so3`, :mod:`se3` and :mod:`sek3` satisfy it."""

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
        """Tangent vector to element."""

    @property
    def log(self) -> Unary:
        """Element to tangent vector, rotation part of norm at most pi."""

    @property
    def compose(self) -> Binary:
        """Product of two elements."""

    @property
    def inverse(self) -> Unary:
        """Inverse element."""

    @property
    def act(self) -> Binary:
        """Element applied to a vector of the space the group acts on."""

    @property
    def hat(self) -> Unary:
        """Tangent vector to matrix of the Lie algebra."""

    @property
    def vee(self) -> Unary:
        """Inverse of hat."""

    @property
    def adjoint(self) -> Unary:
        """``hat(adjoint(g) x) = g hat(x) g^{-1}``."""

    @property
    def ad(self) -> Unary:
        """``ad(x) y = vee(hat(x) hat(y) - hat(y) hat(x))``."""

    @property
    def coadjoint(self) -> Unary:
        """``ad(x)^T``."""

    @property
    def force_cross(self) -> Unary:
        """``-ad(x)^T``."""

    @property
    def left_jacobian(self) -> Unary:
        """``exp(x + e) = exp(J e) exp(x)`` to first order."""

    @property
    def right_jacobian(self) -> Unary:
        """``exp(x + e) = exp(x) exp(J e)`` to first order."""

    @property
    def left_jacobian_inverse(self) -> Unary:
        """Inverse of the left Jacobian."""

    @property
    def right_jacobian_inverse(self) -> Unary:
        """Inverse of the right Jacobian."""
