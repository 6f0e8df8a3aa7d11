"""Lie groups of mechanical systems, each with its numeric and its symbolic functions.

A :class:`LieGroup` combines a module of :mod:`lgmpc.lie` with its CasADi counterpart, the dimension and the shape of an
element. The translations of R^n, the Abelian case, are defined here: their equations of motion are Newton's.

``ad(x) y`` is the bracket, ``coadjoint(x) = ad(x)^T`` (chapter 4.4.4), ``adjoint(g) x = g x g^{-1}``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import Group, checks, se3, sek3, so3
from lgmpc.lie.checks import checked, typed
from lgmpc.lie.symbolic import se3 as symbolic_se3
from lgmpc.lie.symbolic import sek3 as symbolic_sek3
from lgmpc.lie.symbolic import so3 as symbolic_so3
from lgmpc.typing import Array

__all__ = ["SE3", "SEMIDIRECT", "SO3", "LieGroup", "SymbolicGroup", "extended_poses", "translations"]


class SymbolicGroup(Protocol):
    """The protocol of a group on CasADi expressions, with the names of :class:`lgmpc.lie.Group`."""

    def hat(self, xi: Any, /) -> Any:
        """Tangent vector to matrix of the algebra."""

    def exp(self, xi: Any, /) -> Any:
        """Tangent vector to element."""

    def log(self, g: Any, /) -> Any:
        """Element to tangent vector."""

    def compose(self, g: Any, h: Any, /) -> Any:
        """Product of two elements."""

    def inverse(self, g: Any, /) -> Any:
        """Inverse element."""

    def adjoint(self, g: Any, /) -> Any:
        """``hat(adjoint(g) x) = g hat(x) g^{-1}``."""

    def ad(self, xi: Any, /) -> Any:
        """Matrix of the bracket."""

    def coadjoint(self, xi: Any, /) -> Any:
        """``ad(xi)^T``."""

    def left_jacobian_inverse(self, xi: Any, /) -> Any:
        """Inverse of J with ``exp(xi + e) = exp(J e) exp(xi)`` to first order."""

    def right_jacobian_inverse(self, xi: Any, /) -> Any:
        """Inverse of J with ``exp(xi + e) = exp(xi) exp(J e)`` to first order."""


@dataclass(frozen=True)
class LieGroup:
    """A matrix group with its Lie algebra in coordinates.

    Attributes:
        name: a C identifier.
        dim: of the algebra.
        size: rows (and columns) of an element.
        numeric: its functions on arrays.
        symbolic: its functions on CasADi expressions.
        check: converts an element, or raises InputError naming the argument.
    """

    name: str
    dim: int
    size: int
    numeric: Group
    symbolic: SymbolicGroup
    check: Callable[[str, object], Array]

    def check_element(self, name: str, value: object) -> Array:
        """Convert one element.

        Raises:
            InputError: another shape, not finite, or not in the group.
        """
        array = self.check(name, value)
        if array.shape != (self.size, self.size):
            raise InputError(name, f"shape {array.shape}", f"shape {(self.size, self.size)}")
        return array

    def check_tangent(self, name: str, value: object) -> Array:
        """Convert one vector of the algebra or of its dual.

        Raises:
            InputError: another shape, or not finite.
        """
        array = checks.finite(name, value)
        if array.shape != (self.dim,):
            raise InputError(name, f"shape {array.shape}", f"shape {(self.dim,)}")
        return array


SO3 = LieGroup("so3", 3, 3, so3, symbolic_so3, checks.rotation)
"""Rotations; algebra: angular velocity (rad/s), dual: angular momentum (N.m.s)."""

SE3 = LieGroup("se3", 6, 4, se3, symbolic_se3, checks.placement)
"""Placements; algebra: twist, linear first; dual: [linear; angular] momentum."""


@typed
def extended_poses(k: int) -> LieGroup:
    """SE_k(3): a rotation and k columns; tangent (rotation, then one 3-vector a column).

    Raises:
        InputError: ``k`` is not positive.
    """
    if k < 1:
        raise InputError("k", k, "a number of columns >= 1")
    return LieGroup(f"se{k}3", 3 + 3 * k, 3 + k, sek3, symbolic_sek3, checks.extended_pose)


SEMIDIRECT = extended_poses(1)
"""SO(3) x R^3, semidirect, rotation first; elements of its dual are (body angular momentum, advected direction).

Marsden, Ratiu, Weinstein, "Semidirect products and reduction in mechanics", Trans. AMS 281 (1984); chapter 4.17.
"""


@typed
def translations(n: int) -> LieGroup:
    """R^n as the matrices ``[[I, x], [0, 1]]``, (n + 1, n + 1): every bracket is zero.

    Raises:
        InputError: ``n`` is not positive.
    """
    if n < 1:
        raise InputError("n", n, "a dimension >= 1")
    return LieGroup(f"r{n}", n, n + 1, _Translations(n), _SymbolicTranslations(n), _translation_matrix(n))


def _translation_matrix(n: int) -> Callable[[str, object], Array]:
    square = checks.matrix(n + 1)

    def check(name: str, value: object) -> Array:
        array = square(name, value)
        rest = array - np.eye(n + 1)
        rest[..., :n, n] = 0.0
        if np.abs(rest).max(initial=0.0) > checks.TOLERANCE:
            raise InputError(name, "a matrix with other entries off the last column", "[[I, x], [0, 1]]")
        return array

    return check


class _Translations:
    """R^n as a :class:`lgmpc.lie.Group`."""

    def __init__(self, n: int) -> None:
        vector, element = checks.tangent(n), _translation_matrix(n)

        @checked(vector)
        def exp(x: Array) -> Array:
            return np.eye(n + 1) + self.hat.unchecked(x)

        @checked(vector)
        def hat(x: Array) -> Array:
            result = np.zeros((*x.shape[:-1], n + 1, n + 1))
            result[..., :n, n] = x
            return result

        @checked(checks.matrix(n + 1))
        def log(g: Array) -> Array:
            return g[..., :n, n].copy()

        @checked(element, element)
        def compose(g: Array, h: Array) -> Array:
            product: Array = g @ h
            return product

        @checked(element)
        def inverse(g: Array) -> Array:
            return 2.0 * np.eye(n + 1) - g

        @checked(element, vector)
        def act(g: Array, point: Array) -> Array:
            moved: Array = g[..., :n, n] + point
            return moved

        @checked(element)
        def adjoint(g: Array) -> Array:
            return np.broadcast_to(np.eye(n), (*g.shape[:-2], n, n)).copy()

        @checked(vector)
        def zero(x: Array) -> Array:
            return np.zeros((*x.shape, n))

        @checked(vector)
        def one(x: Array) -> Array:
            return np.broadcast_to(np.eye(n), (*x.shape, n)).copy()

        self.exp, self.log, self.hat, self.vee = exp, log, hat, log
        self.compose, self.inverse, self.act, self.adjoint = compose, inverse, act, adjoint
        self.ad = self.coadjoint = self.force_cross = zero
        self.left_jacobian = self.right_jacobian = one
        self.left_jacobian_inverse = self.right_jacobian_inverse = one


class _SymbolicTranslations:
    """R^n on expressions."""

    def __init__(self, n: int) -> None:
        self.n = n

    def hat(self, x: Any, /) -> Any:
        return ca.vertcat(ca.horzcat(ca.DM(self.n, self.n), x), ca.DM(1, self.n + 1))

    def exp(self, x: Any, /) -> Any:
        return ca.DM.eye(self.n + 1) + self.hat(x)

    def log(self, g: Any, /) -> Any:
        return g[: self.n, self.n]

    def compose(self, g: Any, h: Any, /) -> Any:
        return g @ h

    def inverse(self, g: Any, /) -> Any:
        return self.exp(-self.log(g))

    def adjoint(self, g: Any, /) -> Any:
        return ca.DM.eye(self.n)

    def ad(self, x: Any, /) -> Any:
        return ca.DM(self.n, self.n)

    def coadjoint(self, x: Any, /) -> Any:
        return ca.DM(self.n, self.n)

    def left_jacobian_inverse(self, x: Any, /) -> Any:
        return ca.DM.eye(self.n)

    def right_jacobian_inverse(self, x: Any, /) -> Any:
        return ca.DM.eye(self.n)
