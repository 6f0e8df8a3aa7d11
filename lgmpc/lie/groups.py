"""SE(3) and SE_k(3) on arrays, with their arguments checked.

Products, inverses and actions are numpy's; all other functions are evaluated expressions of :mod:`lgmpc.lie.symbolic`.
"""

import functools
import math
from typing import Any

import numpy as np

from lgmpc.errors import InputError
from lgmpc.lie import checks, so3
from lgmpc.lie.checks import ArrayFunction, Check, checked
from lgmpc.lie.coefficients import Array

_OF_MATRICES = ("vee", "log", "adjoint")


class ArrayPoses:
    """A group of poses, single or batched over leading axes; formulas in :class:`lgmpc.lie.symbolic.Poses`.

    Every function validates its arguments (InputError); ``f.unchecked`` does not, as in :mod:`lgmpc.lie.so3`.

    Args:
        linear_first: the order of SE(3)'s tangent vectors.
        tangent: check of tangent vectors.
        pose: check of elements.
        algebra: check of matrices of the Lie algebra.
        vector: check of vectors that the group acts on.
    """

    def __init__(self, linear_first: bool, tangent: Check, pose: Check, algebra: Check, vector: Check) -> None:
        self._linear_first = linear_first

        def of_tangent(name: str) -> ArrayFunction:
            def function(xi: Array) -> Array:
                return self._evaluate(name, xi)

            return checked(tangent)(function)

        def of_pose(name: str) -> ArrayFunction:
            def function(pose: Array) -> Array:
                return self._evaluate(name, pose)

            return checked(pose)(function)

        def of_algebra(name: str) -> ArrayFunction:
            def function(algebra: Array) -> Array:
                return self._evaluate(name, algebra)

            return checked(algebra)(function)

        self.hat = of_tangent("hat")
        self.vee = of_algebra("vee")
        self.exp = of_tangent("exp")
        self.log = of_pose("log")
        self.compose: ArrayFunction = checked(pose, pose)(so3.compose.unchecked)
        self.inverse: ArrayFunction = checked(pose)(_inverse)
        self.act: ArrayFunction = checked(pose, vector)(self._act)
        self.adjoint = of_pose("adjoint")
        self.ad = of_tangent("ad")
        self.coadjoint = of_tangent("coadjoint")
        self.force_cross = of_tangent("force_cross")
        self.left_jacobian = of_tangent("left_jacobian")
        self.right_jacobian = of_tangent("right_jacobian")
        self.left_jacobian_inverse = of_tangent("left_jacobian_inverse")
        self.right_jacobian_inverse = of_tangent("right_jacobian_inverse")
        self.from_parts: ArrayFunction = checked(checks.rotation, checks.tangent(3))(_from_parts)

    def identity(self, k: int = 1) -> Array:
        """Return the identity with k columns.

        Raises:
            InputError: ``k`` is no whole number, or below 1.
        """
        if not isinstance(k, int) or k < 1:
            raise InputError("k", k, "a whole number of columns, at least 1")
        return np.eye(3 + k)

    def _evaluate(self, name: str, value: Array) -> Array:
        """Return the values of one of the group's functions at vectors, or at matrices."""
        sides = value.shape[-2:] if name in _OF_MATRICES else value.shape[-1:]
        batch, n = value.shape[: -len(sides)], math.prod(value.shape[: -len(sides)])
        rows, columns = self._function(name, sides).size_out(0)
        # CasADi's memory: column after column.
        entries = np.ascontiguousarray(np.swapaxes(value, -1, -2) if len(sides) > 1 else value)
        result = np.empty((n, columns, rows))
        if n:
            memory, call = self._mapped(name, sides, n).buffer()
            memory.set_arg(0, entries.reshape(-1).data)
            memory.set_res(0, result.reshape(-1).data)
            call()
        found = np.ascontiguousarray(result.swapaxes(1, 2))
        return found.reshape(*batch, rows, *([columns] if columns > 1 else []))

    @functools.lru_cache(maxsize=256)  # noqa: B019 - the two groups are not collected
    def _mapped(self, name: str, sides: tuple[int, ...], n: int) -> Any:
        """Return :meth:`_function` at n columns."""
        return self._function(name, sides).map(n)

    @functools.cache  # noqa: B019
    def _function(self, name: str, sides: tuple[int, ...]) -> Any:
        """Return a function of a column: a tangent vector, or the columns of a matrix."""
        import casadi as ca

        from lgmpc.lie import symbolic

        group, x = symbolic.se3 if self._linear_first else symbolic.sek3, ca.SX.sym("x", *sides)
        return ca.Function(name, [ca.vec(x)], [ca.densify(getattr(group, name)(x))])

    def _act(self, pose: Array, vector: Array) -> Array:
        if self._linear_first:
            return pose[..., :3, 3] + so3.act.unchecked(pose[..., :3, :3], vector)
        return so3.act.unchecked(pose, vector)


def _inverse(pose: Array) -> Array:
    back, result = np.swapaxes(pose[..., :3, :3], -1, -2), pose.copy()
    result[..., :3, :3], result[..., :3, 3:] = back, -back @ pose[..., :3, 3:]
    return result


def _from_parts(rotation: Array, translation: Array) -> Array:
    """Return the placement of a rotation (..., 3, 3) and a translation (..., 3), m."""
    result = np.zeros((*np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1]), 4, 4))
    result[..., :3, :3], result[..., :3, 3], result[..., 3, 3] = rotation, translation, 1.0
    return result


se3 = ArrayPoses(True, checks.tangent(6), checks.placement, checks.twist_matrix, checks.tangent(3))
"""SE(3): homogeneous matrices (..., 4, 4), tangent the twist (..., 6): linear first, then angular.

Twists, adjoints and cross products are Pinocchio's (``Motion``, ``SE3.action``).
"""

sek3 = ArrayPoses(False, checks.extended_tangent, checks.extended_pose, checks.extended_twist_matrix, checks.ambient)
"""SE_k(3), extended poses: matrices (..., 3 + k, 3 + k) of a rotation and k columns (k = 2: velocity and position).

Tangent (..., 3 + 3k): rotation vector first, then one 3-vector a column, as in the invariant-filtering literature
(Barrau and Bonnabel, IEEE TAC 2017; Hartley et al., IJRR 2020). ``k`` follows from the shapes. SE_1(3) is SE(3) with
the halves of the tangent swapped.
"""
