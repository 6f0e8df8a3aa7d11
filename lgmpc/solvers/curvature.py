"""The second-order condition at a stationary point, by a backward sweep."""

from __future__ import annotations

import numpy as np

from lgmpc.solvers.solution import Solution
from lgmpc.solvers.sweep import BackwardSweep, Expansion

__all__ = ["is_minimum"]

_ACTIVE = 1e-9  # multiplier of a row that is at its bound
_FLAT = 1e-9  # curvature that counts as none, relative to the largest
_HELD = 1e6  # penalty of active rows, relative to the largest curvature


def is_minimum(solution: Solution) -> bool:
    """Return whether the Gauss-Newton model at a stationary point has no negative curvature.

    Along the dynamics, and along the rows with multipliers, it can only have where a stage's Hessian is indefinite, as
    with a negative weight.
    """
    problem, (n, nu), ndx = solution.problem, solution.us.shape, solution.problem.state.ndx
    jacobian, hessian = np.zeros((n, ndx + nu, ndx)), np.tile(np.eye(ndx + nu), (n, 1, 1))
    last, held = solution.last_hessian(), np.zeros_like(hessian)
    for k, action in enumerate(problem.actions):
        m, own = solution.derivatives(k), ndx + action.nu
        jacobian[k, :own] = np.hstack([m["A"], m["B"]]).T
        hessian[k, :own, :own] = np.block([[m["Q"], m["S"].T], [m["S"], m["R"]]])
        rows = np.hstack([m["C"], m["D"]])
        active = (np.abs(solution.multipliers[k, : len(rows)]) > _ACTIVE) | (m["lower"] == m["upper"])[:, 0]
        rows = rows[active] / np.maximum(np.linalg.norm(rows[active], axis=1, keepdims=True), _ACTIVE)
        held[k, :own, :own] = rows.T @ rows
    scale = 1.0 + max(float(np.abs(hessian).max()), float(np.abs(last).max(initial=0.0)))
    stages = min(float(np.linalg.eigvalsh(hessian).min()), float(np.linalg.eigvalsh(last).min(initial=0.0)))
    if not stages < -_FLAT * scale:
        return True
    model = Expansion.of_curvature(jacobian, hessian + _HELD * scale * held, last)
    return BackwardSweep(model).run(_FLAT * scale, closed=True)
