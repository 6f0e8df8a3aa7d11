"""SE(3): homogeneous matrices (..., 4, 4), tangent the twist (..., 6): linear first, then angular.

Single or batched over leading axes; the formulas are in :mod:`lgmpc.lie.poses`. Every function validates its arguments
(InputError); ``f.unchecked`` does not, as in :mod:`lgmpc.lie.so3`. Twists, adjoints and cross products are Pinocchio's
(``Motion``, ``SE3.action``).
"""

from __future__ import annotations

import numpy as np

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
    "from_parts",
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

_group = ArrayPoses(linear_first=True)
_of_twist, _of_placement = checked(checks.tangent(6)), checked(checks.placement)

hat: ArrayFunction = _of_twist(_group.hat)
vee: ArrayFunction = checked(checks.twist_matrix)(_group.vee)
exp: ArrayFunction = _of_twist(_group.exp)
log: ArrayFunction = _of_placement(_group.log)
compose: ArrayFunction = checked(checks.placement, checks.placement)(_group.compose)
inverse: ArrayFunction = _of_placement(_group.inverse)
act: ArrayFunction = checked(checks.placement, checks.tangent(3))(_group.act)
adjoint: ArrayFunction = _of_placement(_group.adjoint)
ad: ArrayFunction = _of_twist(_group.ad)
coadjoint: ArrayFunction = _of_twist(_group.coadjoint)
force_cross: ArrayFunction = _of_twist(_group.force_cross)
left_jacobian: ArrayFunction = _of_twist(_group.left_jacobian)
right_jacobian: ArrayFunction = _of_twist(_group.right_jacobian)
left_jacobian_inverse: ArrayFunction = _of_twist(_group.left_jacobian_inverse)
right_jacobian_inverse: ArrayFunction = _of_twist(_group.right_jacobian_inverse)


def identity() -> Array:
    """Return the identity."""
    return np.eye(4)


@checked(checks.rotation, checks.tangent(3))
def from_parts(rotation: Array, translation: Array) -> Array:
    """Return the placement of a rotation (..., 3, 3) and a translation (..., 3), m."""
    return _group._pack(rotation, translation[..., None], 1.0)
