"""Gains of a linear-quadratic problem whose rows are penalised in place of its bounds."""

from __future__ import annotations

import numpy as np

from lgmpc.ocp import OcpQp
from lgmpc.solvers.sweep import BackwardSweep, Expansion
from lgmpc.typing import Array

__all__ = ["penalised_feedback"]


def penalised_feedback(qp: OcpQp, weights: Array | float = 0.0) -> Array:
    """Return the gains (N, nu, ndx) K of ``du = -K dx`` with the cost of each row ``weight / 2 row^2``.

    Args:
        qp: the problem; its bounds are not used.
        weights: (N, ng) of the rows.

    Returns:
        The gains; of length 0 where the cost is not strictly convex along the dynamics.
    """
    s = qp.structure
    m = {name: qp.dense(name) for name in "ABQSRCD"}
    jacobian = np.concatenate([m["A"], m["B"]], axis=2).swapaxes(1, 2).copy()
    rows = np.concatenate([m["C"], m["D"]], axis=2)
    hessian = np.block([[m["Q"], m["S"].swapaxes(1, 2)], [m["S"], m["R"]]])
    hessian += rows.swapaxes(1, 2) @ (np.broadcast_to(weights, rows.shape[:2])[..., None] * rows)
    gradient, gaps = np.zeros((s.nodes, s.ndx + s.nu)), np.zeros((s.nodes + 1, s.ndx))
    gains = np.zeros((s.nodes, s.nu, s.ndx)), np.zeros((s.nodes, s.nu))
    last = qp.dense_terminal("Q"), np.zeros(s.ndx)
    model = Expansion(jacobian, hessian, gradient, gaps, *last, *gains, compiled=False)
    return gains[0] if BackwardSweep(model).run(0.0, closed=True) else gains[0][:0]
