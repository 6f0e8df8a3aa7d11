"""SE(3) and SE_k(3) over SO(3).

An element ``X`` has a rotation ``R`` and columns ``p_j``, a tangent vector ``xi`` a rotation vector ``phi`` and a
3-vector ``rho_j`` a column. With SO(3)'s left Jacobian ``J = J(phi)`` and its derivative ``Q_j = D J(phi)[rho_j]``::

    X = [R  p_j; 0  I]      hat(xi) = [hat(phi)  rho_j; 0  0]
    exp(xi)  = [exp(phi)  J rho_j; 0  I]
    log(X)   = (phi, J^{-1} p_j),  phi = log(R)
    X^{-1}   = [R^T  -R^T p_j; 0  I]
    Ad(X)    = blocks(R, hat(p_j) R)
    ad(xi)   = blocks(hat(phi), hat(rho_j))
    J_left   = blocks(J, Q_j)

``blocks(D, C_j)`` has ``D`` on its diagonal and ``C_j`` where ``phi`` acts on ``rho_j``. The last line holds because
the power series of a Jacobian in ``blocks(Phi, P)`` has the derivative along ``P`` as its corner (Barfoot, *State
Estimation for Robotics*, 7.1.5, in another form); ``Q -> hat(rho) / 2`` as the angle tends to 0. Tangents of SE_k(3)
begin with ``phi``; SE(3) is SE_1(3) with the linear part first.
"""

from typing import Any

import casadi as ca

from lgmpc.lie.symbolic import so3


class Poses:
    """A group of poses: functions of CasADi matrices, one element a call.

    Args:
        linear_first: the order of SE(3)'s tangent vectors, for one column only.
    """

    def __init__(self, linear_first: bool = False) -> None:
        self.linear_first = linear_first

    def hat(self, xi: Any) -> Any:
        """Return the Lie algebra's matrix of a tangent vector."""
        phi, *linear = self._split(xi)
        return _pack(so3.hat(phi), ca.horzcat(*linear), 0.0)

    def vee(self, algebra: Any) -> Any:
        """Return the tangent vector of a matrix of the Lie algebra: the inverse of :meth:`hat`."""
        return self._join(so3.vee(algebra[:3, :3]), *ca.horzsplit(algebra[:3, 3:]))

    def exp(self, xi: Any) -> Any:
        """Return the element of a tangent vector: each column is SO(3)'s left Jacobian times its part."""
        phi, *linear = self._split(xi)
        columns = [so3.left_jacobian_product(phi, rho) for rho in linear]
        return _pack(so3.exp(phi), ca.horzcat(*columns), 1.0)

    def log(self, pose: Any) -> Any:
        """Return the tangent vector, rotation vector of norm at most pi; sign at pi as in :func:`lgmpc.lie.so3.log`."""
        phi = so3.log(pose[:3, :3])
        return self._join(phi, *(so3.left_jacobian_inverse_product(phi, p) for p in ca.horzsplit(pose[:3, 3:])))

    def compose(self, first: Any, second: Any) -> Any:
        """Return ``first second``."""
        rotation = first[:3, :3]
        return _pack(rotation @ second[:3, :3], first[:3, 3:] + rotation @ second[:3, 3:], 1.0)

    def inverse(self, pose: Any) -> Any:
        """Return the inverse element."""
        back = pose[:3, :3].T
        return _pack(back, -back @ pose[:3, 3:], 1.0)

    def act(self, pose: Any, vector: Any) -> Any:
        """Return SE(3)'s moved point, m; for SE_k(3) ``pose vector`` with 3 + k entries, as invariant filters do."""
        return pose[:3, 3] + pose[:3, :3] @ vector if self.linear_first else pose @ vector

    def adjoint(self, pose: Any) -> Any:
        """Return the matrix with ``hat(adjoint(g) x) = g hat(x) g^{-1}``."""
        rotation = pose[:3, :3]
        return self._blocks(rotation, [so3.hat(p) @ rotation for p in ca.horzsplit(pose[:3, 3:])])

    def ad(self, xi: Any) -> Any:
        """Return the matrix of the bracket; of SE(3) Pinocchio's motion cross motion."""
        phi, *linear = self._split(xi)
        return self._blocks(so3.hat(phi), [so3.hat(rho) for rho in linear])

    def coadjoint(self, xi: Any) -> Any:
        """Return ``ad(xi)^T``: ``<coadjoint(x) m, y> = <m, [x, y]>``."""
        return self.ad(xi).T

    def force_cross(self, xi: Any) -> Any:
        """Return ``-ad(xi)^T``; of SE(3) Pinocchio's motion cross force."""
        return -self.coadjoint(xi)

    def left_jacobian(self, xi: Any) -> Any:
        """Return ``J`` with ``exp(xi + e) = exp(J e) exp(xi)`` to first order."""
        phi, *linear = self._split(xi)
        return self._blocks(so3.left_jacobian(phi), [so3.left_jacobian_slope(phi, rho) for rho in linear])

    def right_jacobian(self, xi: Any) -> Any:
        """Return ``J`` with ``exp(xi + e) = exp(xi) exp(J e)`` to first order."""
        return self.left_jacobian(-xi)

    def left_jacobian_inverse(self, xi: Any) -> Any:
        """Return the inverse of :meth:`left_jacobian`; singular where the angle is a multiple of 2 pi other than 0."""
        phi, *linear = self._split(xi)
        corners = [so3.left_jacobian_inverse_slope(phi, rho) for rho in linear]
        return self._blocks(so3.left_jacobian_inverse(phi), corners)

    def right_jacobian_inverse(self, xi: Any) -> Any:
        """Return the inverse of :meth:`right_jacobian`."""
        return self.left_jacobian_inverse(-xi)

    def _split(self, xi: Any) -> list[Any]:
        """Return the rotation vector, then the linear parts."""
        vectors = [xi[i : i + 3] for i in range(0, xi.shape[0], 3)]
        return vectors[::-1] if self.linear_first else vectors

    def _join(self, *vectors: Any) -> Any:
        """Return the tangent vector of these: the inverse of :meth:`_split`."""
        return ca.vertcat(*(vectors[::-1] if self.linear_first else vectors))

    def _blocks(self, diagonal: Any, corners: list[Any]) -> Any:
        """Return the matrix on tangent vectors of these blocks."""
        k = len(corners)
        if self.linear_first:
            return ca.vertcat(ca.horzcat(diagonal, *corners), ca.horzcat(ca.DM(3, 3), diagonal))
        rest = ca.vertcat(ca.DM(3, 3 * k), ca.kron(ca.DM.eye(k), diagonal))
        return ca.horzcat(ca.vertcat(diagonal, *corners), rest)


def _pack(block: Any, columns: Any, diagonal: float) -> Any:
    """Return the matrix of an upper left block and columns, with a number on the rest of the diagonal."""
    k = columns.shape[1]
    corner = diagonal * ca.DM.eye(k) if diagonal else ca.DM.zeros(k, k)
    return ca.vertcat(ca.horzcat(block, columns), ca.horzcat(ca.DM.zeros(k, 3), corner))
