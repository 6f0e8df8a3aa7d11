"""SE(3) and SE_k(3) on arrays, with their arguments checked."""

from __future__ import annotations

import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import checks
from lgmpc.lie.checks import ArrayFunction, Check, checked
from lgmpc.lie.coefficients import Array
from lgmpc.lie.poses import ArrayPoses

__all__ = ["CheckedPoses", "se3", "sek3"]


class CheckedPoses:
    """A group of poses, single or batched over leading axes; the formulas are those of :class:`ArrayPoses`.

    Every function validates its arguments (InputError); ``f.unchecked`` does not, as in :mod:`lgmpc.lie.so3`.

    Args:
        poses: the group.
        tangent: check of tangent vectors.
        pose: check of elements.
        algebra: check of matrices of the Lie algebra.
        vector: check of vectors that the group acts on.
    """

    def __init__(self, poses: ArrayPoses, tangent: Check, pose: Check, algebra: Check, vector: Check) -> None:
        of_tangent, of_pose = checked(tangent), checked(pose)
        self.hat: ArrayFunction = of_tangent(poses.hat)
        self.vee: ArrayFunction = checked(algebra)(poses.vee)
        self.exp: ArrayFunction = of_tangent(poses.exp)
        self.log: ArrayFunction = of_pose(poses.log)
        self.compose: ArrayFunction = checked(pose, pose)(poses.compose)
        self.inverse: ArrayFunction = of_pose(poses.inverse)
        self.act: ArrayFunction = checked(pose, vector)(poses.act)
        self.adjoint: ArrayFunction = of_pose(poses.adjoint)
        self.ad: ArrayFunction = of_tangent(poses.ad)
        self.coadjoint: ArrayFunction = of_tangent(poses.coadjoint)
        self.force_cross: ArrayFunction = of_tangent(poses.force_cross)
        self.left_jacobian: ArrayFunction = of_tangent(poses.left_jacobian)
        self.right_jacobian: ArrayFunction = of_tangent(poses.right_jacobian)
        self.left_jacobian_inverse: ArrayFunction = of_tangent(poses.left_jacobian_inverse)
        self.right_jacobian_inverse: ArrayFunction = of_tangent(poses.right_jacobian_inverse)
        self.from_parts: ArrayFunction = checked(checks.rotation, checks.tangent(3))(poses.from_parts)

    def identity(self, k: int = 1) -> Array:
        """Return the identity with k columns.

        Raises:
            InputError: ``k`` is no whole number, or below 1.
        """
        if not isinstance(k, int) or k < 1:
            raise InputError("k", k, "a whole number of columns, at least 1")
        return np.eye(3 + k)


se3 = CheckedPoses(
    ArrayPoses(linear_first=True), checks.tangent(6), checks.placement, checks.twist_matrix, checks.tangent(3)
)
"""SE(3): homogeneous matrices (..., 4, 4), tangent the twist (..., 6): linear first, then angular.

Twists, adjoints and cross products are Pinocchio's (``Motion``, ``SE3.action``).
"""

sek3 = CheckedPoses(
    ArrayPoses(), checks.extended_tangent, checks.extended_pose, checks.extended_twist_matrix, checks.ambient
)
"""SE_k(3), extended poses: matrices (..., 3 + k, 3 + k) of a rotation and k columns (k = 2: velocity and position).

Tangent (..., 3 + 3k): rotation vector first, then one 3-vector a column, as in the invariant-filtering literature
(Barrau and Bonnabel, IEEE TAC 2017; Hartley et al., IJRR 2020). ``k`` follows from the shapes. SE_1(3) is SE(3) with
the halves of the tangent swapped.
"""
