"""Lie groups of mechanical systems, each with its numeric and its symbolic functions, and their momentum maps.

A :class:`LieGroup` combines a module of :mod:`lgmpc.lie` with its CasADi counterpart, the dimension and the shape of an
element. ``ad(x) y`` is the bracket, ``coadjoint(x) = ad(x)^T`` (chapter 4.4.4), ``adjoint(g) x = g x g^{-1}``.

A covector at g is represented by its body momentum ``mu`` (pulled back along left translation) or its spatial momentum
``nu`` (along right translation), ``nu = Ad*_{g^-1} mu``, that is ``adjoint(g)^T nu = mu``. They are the momentum maps
of (chapter 4.13.2 exchanges the two):

    left translation  h g:  J = T_e* R_g p = nu, the spatial momentum, conserved for left-invariant H
    right translation g h:  J = T_e* L_g p = mu, the body momentum, conserved for right-invariant H

Marsden and Ratiu, "Introduction to mechanics and symmetry" (1999), 11.4 and 12.2; chapter 4.13.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lgmpc.errors import InputError
from lgmpc.lie import checks, se3, sek3, so3
from lgmpc.lie.symbolic import se3 as symbolic_se3, sek3 as symbolic_sek3, so3 as symbolic_so3
from lgmpc.typing import Array, numbers, typed


@dataclass(frozen=True)
class LieGroup:
    """A matrix group with its Lie algebra in coordinates.

    Attributes:
        name: a C identifier.
        dim: of the algebra.
        size: rows (and columns) of an element.
        numeric: its functions on arrays.
        symbolic: functions of the same names on CasADi expressions.
        check: converts an element, or raises InputError naming the argument.
    """

    name: str
    dim: int
    size: int
    numeric: Any
    symbolic: Any
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

    def check_tangent(self, name: str, value: ArrayLike) -> Array:
        """Convert one vector of the algebra or of its dual.

        Raises:
            InputError: another shape, or not finite.
        """
        return numbers(name, value, (self.dim,), finite=True)


SO3 = LieGroup("so3", 3, 3, so3, symbolic_so3, checks.rotation)
"""Rotations; algebra: angular velocity (rad/s), dual: angular momentum (N.m.s)."""

SE3 = LieGroup("se3", 6, 4, se3, symbolic_se3, checks.placement)
"""Placements; algebra: twist, linear first; dual: [linear; angular] momentum."""

SEMIDIRECT = LieGroup("se13", 6, 4, sek3, symbolic_sek3, checks.extended_pose)
"""SO(3) x R^3, semidirect, rotation first; elements of its dual are (body angular momentum, advected direction).

Marsden, Ratiu, Weinstein, "Semidirect products and reduction in mechanics", Trans. AMS 281 (1984); chapter 4.17.
"""


@typed
def spatial_momentum(group: LieGroup, pose: Array, body: Array) -> Array:
    """Return the momentum map of left translation, ``Ad*_{g^-1} mu`` (..., dim): on SE(3), [p; L] about the origin.

    Args:
        group: acts on its own cotangent bundle.
        pose: (..., size, size) elements g.
        body: (..., dim) body momenta mu.

    Raises:
        InputError: not elements of the group, or momenta of another shape.
    """
    back = group.numeric.adjoint(group.numeric.inverse(group.check("pose", pose)))
    return _transposed(back, checks.tangent(group.dim)("body", body))


@typed
def body_momentum(group: LieGroup, pose: Array, spatial: Array) -> Array:
    """Return the momentum map of right translation, ``Ad*_g nu`` (..., dim): the inverse of :func:`spatial_momentum`.

    Args:
        group: acts on its own cotangent bundle.
        pose: (..., size, size) elements g.
        spatial: (..., dim) spatial momenta nu.

    Raises:
        InputError: not elements of the group, or momenta of another shape.
    """
    return _transposed(group.numeric.adjoint(group.check("pose", pose)), checks.tangent(group.dim)("spatial", spatial))


def _transposed(matrix: Array, covector: Array) -> Array:
    return np.einsum("...ji,...j->...i", matrix, covector)
