"""Exact line search on an augmented Lagrangian, where a step of Newton's method on it is too long."""

from __future__ import annotations

import numpy as np

from lgmpc.solvers.qp.central_path import nearest_in
from lgmpc.typing import Array

__all__ = ["exact_line_search"]

_BISECTIONS = 10  # of a step's length: phi is flat where it is least


def exact_line_search(
    rows: Array, step: Array, cost: float, cost_after: float, slope_after: float, rho: float, lower: Array, upper: Array
) -> tuple[Array, float, float]:
    """Return the point of a step where ``phi = cost + rho/2 dist(rows, [lower, upper])^2`` is least.

    The cost on the way is quadratic; the slope of phi is monotone, its zero is found by bisection.

    Args:
        rows: (N, ng) at the beginning.
        step: (N, ng) to the end.
        cost: at the beginning.
        cost_after: at the end.
        slope_after: of the cost, at the end.
        rho: penalty.
        lower: (N, ng) bounds of the rows.
        upper: (N, ng).

    Returns:
        The rows (N, ng) there, the cost, and phi.
    """
    curvature = 2.0 * (slope_after - (cost_after - cost))
    slope = slope_after - curvature
    shortest, longest = 0.0, 1.0
    for _ in range(_BISECTIONS):
        length = 0.5 * (shortest + longest)
        there = rows + length * step
        outside = there - nearest_in(there, lower, upper)
        if slope + length * curvature + rho * float(np.vdot(outside, step)) > 0.0:
            longest = length
        else:
            shortest = length
    cost_there = cost + length * (slope + 0.5 * length * curvature)
    return there, cost_there, cost_there + 0.5 * rho * float(np.vdot(outside, outside))
