"""SE_k(3), extended poses: matrices (..., 3 + k, 3 + k) of a rotation and k columns (k = 2: velocity and position).

Tangent (..., 3 + 3k): rotation vector first, then one 3-vector a column, as in the invariant-filtering literature
(Barrau and Bonnabel, IEEE TAC 2017; Hartley et al., IJRR 2020). ``k`` follows from the shapes. SE_1(3) is SE(3) with
the halves of the tangent swapped. Single or batched over leading axes; the formulas are in :mod:`lgmpc.lie.poses`.
Every function validates its arguments (InputError); ``f.unchecked`` does not, as in :mod:`lgmpc.lie.so3`.
"""

from __future__ import annotations

import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import checks
from lgmpc.lie.checks import ArrayFunction, checked
from lgmpc.lie.coefficients import Array
from lgmpc.lie.poses import ArrayPoses

__all__ = [
    "act",
    "ad",
    "adjoint",
    "coadjoint",
    "compose",
    "exp",
    "force_cross",
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

_group = ArrayPoses()
_of_tangent, _of_pose = checked(checks.extended_tangent), checked(checks.extended_pose)

hat: ArrayFunction = _of_tangent(_group.hat)
vee: ArrayFunction = checked(checks.extended_twist_matrix)(_group.vee)
exp: ArrayFunction = _of_tangent(_group.exp)
log: ArrayFunction = _of_pose(_group.log)
compose: ArrayFunction = checked(checks.extended_pose, checks.extended_pose)(_group.compose)
inverse: ArrayFunction = _of_pose(_group.inverse)
act: ArrayFunction = checked(checks.extended_pose, checks.ambient)(_group.act)
adjoint: ArrayFunction = _of_pose(_group.adjoint)
ad: ArrayFunction = _of_tangent(_group.ad)
coadjoint: ArrayFunction = _of_tangent(_group.coadjoint)
force_cross: ArrayFunction = _of_tangent(_group.force_cross)
left_jacobian: ArrayFunction = _of_tangent(_group.left_jacobian)
right_jacobian: ArrayFunction = _of_tangent(_group.right_jacobian)
left_jacobian_inverse: ArrayFunction = _of_tangent(_group.left_jacobian_inverse)
right_jacobian_inverse: ArrayFunction = _of_tangent(_group.right_jacobian_inverse)


def identity(k: int) -> Array:
    """Return the identity of SE_k(3).

    Raises:
        InputError: ``k`` is no whole number, or below 1.
    """
    if not isinstance(k, int) or k < 1:
        raise InputError("k", k, "a whole number of columns, at least 1")
    return np.eye(3 + k)
