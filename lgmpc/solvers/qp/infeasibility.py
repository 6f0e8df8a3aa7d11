"""A certificate that a linear-quadratic problem has no feasible point (Farkas' lemma, through the dynamics)."""

from __future__ import annotations

import numpy as np

from lgmpc.ocp import OcpQp
from lgmpc.typing import Array

__all__ = ["is_certificate"]

_LEAST = 1e-9  # relative margin beyond rounding


def is_certificate(qp: OcpQp, dx0: Array, multipliers: Array, reach: float) -> bool:
    """Return whether multipliers prove that the problem's bounds contradict its dynamics.

    With the adjoint ``lambda_k = C_k^T y_k + A_k^T lambda_{k+1}``, ``lambda_N = 0``, every step that satisfies the
    dynamics has

        sum_k y_k^T (C_k dx_k + D_k du_k) = lambda_0^T dx_0 + sum_k lambda_{k+1}^T b_k + sum_k g_k^T du_k,
        g_k = D_k^T y_k + B_k^T lambda_{k+1}.

    Within bounds the left side is at most ``sum upper y+ + lower y-``. If the right side exceeds that for all controls
    of some size, no such step is feasible.

    Args:
        qp: the problem.
        dx0: (ndx,) first state.
        multipliers: (N, ng) y, for example those of the least violation.
        reach: absolute value up to which controls are considered.
    """
    scale = float(np.abs(multipliers).max(initial=0.0))
    if not (scale > 0.0 and np.isfinite(scale)):
        return False
    y = multipliers / scale
    m = {name: qp.dense(name) for name in "ABCD"}
    gaps, lower, upper = qp.vector("b"), qp.vector("lower"), qp.vector("upper")
    adjoint, total, size = np.zeros(qp.structure.ndx), 0.0, 0.0
    slopes = np.empty((qp.structure.nodes, qp.structure.nu))
    for k in range(qp.structure.nodes - 1, -1, -1):
        total += float(adjoint @ gaps[k])
        size += float(np.abs(adjoint) @ np.abs(gaps[k]))
        slopes[k] = m["D"][k].T @ y[k] + m["B"][k].T @ adjoint
        adjoint = m["C"][k].T @ y[k] + m["A"][k].T @ adjoint
    total += float(adjoint @ dx0)
    within = float((upper[y > 0.0] * y[y > 0.0]).sum() + (lower[y < 0.0] * y[y < 0.0]).sum())
    margin = total - within - reach * float(np.abs(slopes).sum())
    return margin > _LEAST * (1.0 + size + abs(within))
