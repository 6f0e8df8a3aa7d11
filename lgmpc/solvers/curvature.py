"""Exact Hessians in solvers whose steps need a convex model: as much of the exact curvature as keeps it convex.

The difference between the Lagrangian's Hessian and Gauss-Newton's is added whole near a solution that satisfies the
second-order conditions, for quadratic convergence, and in part, or not at all, where the model would not be convex.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lgmpc.ocp import OcpQp, SubproblemFunctions
from lgmpc.solvers.qp import ActiveSetSolver, QpSolver
from lgmpc.solvers.sweep import penalised_feedback
from lgmpc.status import Status
from lgmpc.typing import Array

__all__ = ["CURVATURES", "Hessians", "is_convex", "solve_curved"]

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
    qp, own = functions.qp, solver if isinstance(solver, ActiveSetSolver) and solver.available else None
    allowed = own is not None and own.may_take_over
    arrays = qp.values, qp.terminal_values
    convex, known = [array.copy() for array in arrays], [array.copy() for array in solver.solution.arrays]
    functions.set_exact_hessians(costates, multipliers)
    # Bounds may be infinite, and are the same.
    extra = [np.where(array == flat, 0.0, array - flat) for array, flat in zip(arrays, convex, strict=True)]
    status, kept = Status.FAILED, 1.0
    for part in CURVATURES:
        for array, flat, more in zip(arrays, convex, extra, strict=True):
            array[...] = flat + part * more
        if own is not None:
            own.may_take_over = allowed and part == 0.0
        elif part > 0.0 and not is_convex(qp):
            continue
        status, kept = solve()
        if status is Status.CONVERGED and kept == 0.0:
            break
        solver.solution.write(*known)
    if own is not None:
        own.may_take_over = allowed
    return status, kept


def is_convex(qp: OcpQp) -> bool:
    """Return whether the cost is strictly convex along the dynamics, by a backward sweep."""
    return len(penalised_feedback(qp)) > 0
