"""Momentum maps of translations on the cotangent bundle of a group.

A covector at g is represented by its body momentum ``mu`` (pulled back along left translation) or its spatial momentum
``nu`` (along right translation), ``nu = Ad*_{g^-1} mu``, that is ``adjoint(g)^T nu = mu``. They are the momentum maps
of (chapter 4.13.2 exchanges the two):

    left translation  h g:  J = T_e* R_g p = nu, the spatial momentum, conserved for left-invariant H
    right translation g h:  J = T_e* L_g p = mu, the body momentum, conserved for right-invariant H

Marsden and Ratiu, "Introduction to mechanics and symmetry" (1999), 11.4 and 12.2; chapter 4.13.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import checks
from lgmpc.lie.checks import typed
from lgmpc.mechanics.reduction.groups import LieGroup
from lgmpc.typing import Array

__all__ = ["body_momentum", "conserved_dimension", "spatial_momentum"]

CONSERVED = 1e-9
"""Tolerance of conserved components, relative to the largest momentum along the motion."""


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


def conserved_dimension(momenta: Sequence[Array], tolerance: float = CONSERVED) -> int:
    """Return the number of independent directions along which a momentum is constant in several motions.

    One motion is not enough: a falling body conserves a fourth component of its spatial momentum, in a direction that
    depends on the motion, because its centre of mass stays in a vertical plane.

    Args:
        momenta: for each motion, (n, dim) momentum along it.
        tolerance: largest change of a constant component, relative to the largest momentum.

    Raises:
        InputError: not tables of finite numbers, or none.
    """
    if not isinstance(momenta, Sequence):
        raise InputError("momenta", f"{momenta!r:.80}", "one table (n, dim) a motion, n at least 2")
    tables = [checks.finite("momenta", table) for table in momenta]
    if not tables or any(t.ndim != 2 or len(t) < 2 or t.shape[1] != tables[0].shape[1] for t in tables):
        raise InputError("momenta", [t.shape for t in tables], "one table (n, dim) a motion, n at least 2")
    scale = max(float(np.abs(table).max()) for table in tables) or 1.0
    moved = np.vstack([table - table[0] for table in tables])
    sizes = np.linalg.svd(moved, compute_uv=False) / np.sqrt(len(moved))
    broken = np.count_nonzero(sizes > tolerance * scale)
    return int(moved.shape[1] - broken)


def _transposed(matrix: Array, covector: Array) -> Array:
    product: Array = np.einsum("...ji,...j->...i", matrix, covector)
    return product
