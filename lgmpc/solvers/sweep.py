"""The backward sweep of differential dynamic programming, on arrays allocated once.

With the cost-to-go ``1/2 dx^T V dx + v^T dx`` at the end of an interval, ``F = [A B]``, the stage's Hessian H and
gradient h,

    [Qxx Qxu; Qux Quu] = H + F^T V F,      [Qx; Qu] = h + F^T v,
    K = Quu^-1 Qux,   k = Quu^-1 Qu,   V <- Qxx - Qxu K,   v <- Qx - K^T Qu,

with a multiple of the identity added to Quu and to V. v is the gradient with the gap of the node closed:
``v <- v + V gap``. Mastalli et al., "Crocoddyl: an efficient and versatile framework for multi-contact optimal
control", ICRA 2020.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from lgmpc.ocp import ShootingFunctions
from lgmpc.typing import Array

__all__ = ["BackwardSweep", "Expansion", "all_finite", "bilinear", "products"]


@dataclass
class Expansion:
    """Arrays that a sweep reads, and the gains that it writes, as in :class:`~lgmpc.ocp.ShootingFunctions`.

    Attributes:
        jacobian: (N, ndx + nu, ndx) ``[A B]^T``.
        hessian: (N, ndx + nu, ndx + nu).
        gradient: (N, ndx + nu).
        gaps: (N+1, ndx).
        last_hessian: (ndx, ndx).
        last_gradient: (ndx,).
        feedback: (N, nu, ndx) K.
        feedforward: (N, nu) k.
        compiled: whether the sweep is to be machine code.
    """

    jacobian: Array
    hessian: Array
    gradient: Array
    gaps: Array
    last_hessian: Array
    last_gradient: Array
    feedback: Array
    feedforward: Array
    compiled: bool


def all_finite(*arrays: Array) -> bool:
    """Return whether no entry is NaN or infinite (or too large to square), in one pass."""
    # The dot product would copy rows that are not contiguous. A loop takes half the time of all() of a generator.
    for array in arrays:
        if not math.isfinite(np.vdot(array, array) if array.flags.c_contiguous else array.sum()):
            return False
    return True


def products(matrices: Array, vectors: Array) -> Array:
    """Return (N, m) each stage's product of a matrix (N, m, n) and a vector (N, n); einsum takes twice as long."""
    out: Array = (matrices @ vectors[..., None])[..., 0]
    return out


def bilinear(left: Array, matrices: Array, right: Array) -> float:
    """Return the sum of ``left_k^T M_k right_k`` over all stages; einsum takes five times as long."""
    return float(np.vdot(left, products(matrices, right)))


class BackwardSweep:
    """The backward sweep over an expansion.

    Args:
        functions: expansion (read) and gains (written).

    Attributes:
        value_hessian: (N+1, ndx, ndx) V.
        value_gradient: (N+1, ndx) v.
        control_gradient: (N, nu) Qu.
    """

    def __init__(self, functions: Expansion | ShootingFunctions) -> None:
        n, width, ndx = functions.jacobian.shape
        nu = width - ndx
        self._functions = functions
        self._ndx = ndx
        self.value_hessian: Array = np.zeros((n + 1, ndx, ndx))
        self.value_gradient: Array = np.zeros((n + 1, ndx))
        self.control_gradient: Array = np.zeros((n, nu))
        self._product: Array = np.zeros((width, ndx))
        self._q: Array = np.zeros((width, width))
        self._right: Array = np.zeros((nu, ndx + 1), order="F")
        self._drop: Array = np.zeros((ndx, ndx))
        f = functions
        self._stages = tuple(
            (f.jacobian[t], f.jacobian[t].T, f.hessian[t], f.gradient[t], f.feedback[t], f.feedforward[t],
             self.value_hessian[t], self.value_gradient[t], f.gaps[t],
             self.value_hessian[t].reshape(-1)[:: ndx + 1], self.control_gradient[t])
            for t in reversed(range(n))
        )  # fmt: skip

    def run(self, regularization: float, *, closed: bool) -> bool:
        """Sweep once; return False if some Quu is not positive definite or a value is not finite.

        Args:
            regularization: added to the diagonals of Quu and V.
            closed: whether all gaps are zero.
        """
        f, ndx = self._functions, self._ndx
        v_next, g_next = self.value_hessian[-1], self.value_gradient[-1]
        v_next[...] = f.last_hessian
        v_next.reshape(-1)[:: ndx + 1] += regularization
        g_next[...] = f.last_gradient
        if not closed:
            g_next += v_next @ f.gaps[-1]
        product, q, drop = self._product, self._q, self._drop
        qxx, qux, quu = q[:ndx, :ndx], q[ndx:, :ndx], q[ndx:, ndx:]
        quu_diagonal = q.reshape(-1)[ndx * (q.shape[0] + 1) :: q.shape[0] + 1]
        matmul, dot, add, subtract = np.matmul, np.dot, np.add, np.subtract
        for jacobian_t, jacobian, hessian, gradient, feedback, feedforward, v, g, gap, diagonal, qu in self._stages:
            dot(jacobian_t, v_next, out=product)
            dot(product, jacobian, out=q)
            add(q, hessian, out=q)
            both = jacobian_t.dot(g_next)
            both += gradient
            qu[...] = both[ndx:]
            quu_diagonal += regularization
            if not self._gains(quu, qux, qu, feedback, feedforward):
                return False
            matmul(qux.T, feedback, out=drop)
            subtract(qxx, drop, out=drop)
            add(drop, drop.T, out=v)
            v *= 0.5
            diagonal += regularization
            g[...] = both[:ndx]
            g -= qu.dot(feedback)
            if not closed:
                g += v.dot(gap)
            v_next, g_next = v, g
        return all_finite(self.value_gradient, v_next)

    def expected(self, *, closed: bool) -> tuple[float, float]:
        """Return slope and curvature of the model's decrease along its step, without the part of the roll-out's states.

        Args:
            closed: whether all gaps are zero.
        """
        f = self._functions
        slope = float(np.vdot(self.control_gradient, f.feedforward))
        curvature = -slope
        if not closed:
            slope -= float(np.vdot(self.value_gradient, f.gaps))
            curvature += bilinear(f.gaps, self.value_hessian, f.gaps)
        return slope, curvature

    def _gains(self, quu: Array, qux: Array, qu: Array, feedback: Array, feedforward: Array) -> bool:
        """Write K and k of one interval."""
        if quu.size == 0:
            return True
        factor, failed = lapack.dpotrf(quu, 1, 0)
        if failed:
            return False
        right = self._right
        right[:, :-1] = qux
        right[:, -1] = qu
        solved, _ = lapack.dpotrs(factor, right, 1)
        feedback[...] = solved[:, :-1]
        feedforward[...] = solved[:, -1]
        return True
