"""Exact Hessians in solvers whose steps need a convex model: as much of the exact curvature as keeps it convex.

The difference between the Lagrangian's Hessian and Gauss-Newton's is added whole near a solution that satisfies the
second-order conditions, for quadratic convergence, and in part, or not at all, where the model would not be convex.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lgmpc.ocp import LagrangianHessians, OcpQp, SubproblemFunctions
from lgmpc.solvers.qp import QpSolver
from lgmpc.solvers.solution import Solution
from lgmpc.solvers.sweep import BackwardSweep, Expansion, penalised_feedback
from lgmpc.status import Status
from lgmpc.typing import Array

__all__ = ["CURVATURES", "Hessians", "is_convex", "is_minimum", "solve_curved"]

Hessians = Annotated[
    Literal["gauss_newton", "exact"],
    Field(
        description="Second derivatives: gauss_newton, without those of residuals, dynamics and constraints, convex; "
        "exact, with them: converges quadratically. More is compiled, once."
    ),
]
"""Second derivatives of a solver's quadratic model."""

CURVATURES = (1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125, 0.0)
"""Parts of the difference between exact and Gauss-Newton Hessians, tried in this order until the model is convex."""

_ACTIVE = 1e-9  # multiplier of a row that is at its bound
_FLAT = 1e-9  # curvature that counts as none, relative to the largest
_HELD = 1e6  # penalty of active rows, relative to the largest curvature

Solve = Callable[[], tuple[Status, float]]


def solve_curved(
    functions: SubproblemFunctions, solver: QpSolver, costates: Array, multipliers: Array, solve: Solve
) -> tuple[Status, float]:
    """Solve a subproblem with exact Hessians, or with the largest part tried that is convex.

    lgmpc's own QP solver takes any model whose solution satisfies the optimality conditions: one that is convex along
    the active rows. Other solvers, and its fallback without a compiler, receive models that are convex without any row,
    which may omit curvature where rows are active.

    Args:
        functions: with the subproblem around the current point.
        solver: of the subproblem.
        costates: (N, ndx) of the dynamics at the current point.
        multipliers: (N, ng) of the path constraints.
        solve: solves the subproblem as it is; returns the status, and the kept fraction of gaps and violations.
    """
    qp, allowed = functions.qp, solver.may_take_over
    arrays = qp.values, qp.terminal_values
    convex, known = [array.copy() for array in arrays], [array.copy() for array in solver.solution.arrays]
    functions.set_exact_hessians(costates, multipliers)
    # Bounds may be infinite, and are the same.
    extra = [np.where(array == flat, 0.0, array - flat) for array, flat in zip(arrays, convex, strict=True)]
    status, kept = Status.FAILED, 1.0
    for part in CURVATURES:
        for array, flat, more in zip(arrays, convex, extra, strict=True):
            array[...] = flat + part * more
        if solver.takes_indefinite:
            solver.may_take_over = allowed and part == 0.0
        elif part > 0.0 and not is_convex(qp):
            continue
        status, kept = solve()
        if status is Status.CONVERGED and kept == 0.0:
            break
        solver.solution.write(*known)
    solver.may_take_over = allowed
    return status, kept


def is_convex(qp: OcpQp) -> bool:
    """Return whether the cost is strictly convex along the dynamics, by a backward sweep."""
    return len(penalised_feedback(qp)) > 0


def is_minimum(solution: Solution) -> bool:
    """Return whether the second-order necessary conditions hold at a stationary point.

    They can only fail where a stage's Gauss-Newton Hessian is indefinite, as with a negative weight. There the
    Lagrangian's exact Hessian (Gauss-Newton's, with actions of Python) must have no negative curvature along the
    dynamics and the rows with multipliers.
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
    if all(action.smooth for action in (*problem.actions, problem.terminal)):
        exact = LagrangianHessians(problem, solution.xs.copy(), solution.us.copy())
        exact.costates[...], exact.multipliers[...] = solution.costates, solution.multipliers
        exact.evaluate()
        hessian, last = exact.hessian, exact.last_hessian
    hessian = hessian + _HELD * scale * held
    model = Expansion.of_curvature(jacobian, hessian, last)
    return BackwardSweep(model).run(_FLAT * scale, closed=True)
