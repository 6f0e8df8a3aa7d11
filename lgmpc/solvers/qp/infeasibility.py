"""A certificate that a linear-quadratic problem has no feasible point (Farkas' lemma, through the dynamics)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.central_path import exact_line_search, nearest_in
from lgmpc.solvers.qp.protocol import RiccatiSolver
from lgmpc.typing import Array, BoolArray

__all__ = ["is_certificate", "is_infeasible"]

_LEAST = 1e-9  # relative margin beyond rounding
_PENALTIES = (1e1, 1e3, 1e5, 1e7, 1e9, 1e11)  # of violations, in control weights
_SWEEPS = 8  # with each of them
_FAR = 1e2  # times the controls of a step with a small penalty: larger ones count as none


def is_infeasible(riccati: RiccatiSolver, scale: float, factor: Callable[[], bool]) -> bool:
    """Return whether the multipliers of the least violation prove that every step violates a bound.

    The penalised violation is minimised by Newton's method, with penalties that grow.

    Args:
        riccati: of the problem, loaded, with its first state.
        scale: the median control weight.
        factor: calls the Riccati solver; returns whether there is a finite minimiser.
    """
    r, qp = riccati, riccati.qp
    lower, upper = qp.vector("lower").copy(), qp.vector("upper").copy()
    r.weights[...], r.targets[...] = scale, nearest_in(np.zeros_like(lower), lower, upper)
    if not factor():
        return False
    rows, cost = r.rows.copy(), r.cost
    reach = _FAR * float(np.abs(r.dus).max(initial=0.0))
    for rho in scale * np.array(_PENALTIES):
        for _ in range(_SWEEPS):
            nearest = nearest_in(rows, lower, upper)
            active = rows != nearest
            np.multiply(active, rho, out=r.weights)
            r.targets[...] = nearest
            if not factor():
                return False
            np.multiply(r.weights, r.rows - r.targets, out=r.multipliers)
            if np.array_equal(active, r.rows != nearest_in(r.rows, lower, upper)):
                rows, cost = r.rows.copy(), r.cost
                break
            end = -float(np.vdot(r.multipliers, r.rows - rows))
            rows, cost, _ = exact_line_search(rows, r.rows - rows, cost, r.cost, end, rho, lower, upper)
        reach = max(reach, 2.0 * float(np.abs(r.dus).max(initial=0.0)))
        if is_certificate(qp, r.dx0, r.multipliers, reach):
            return True
    return False


def is_certificate(qp: OcpQp, dx0: Array, multipliers: Array, reach: float) -> bool:
    """Return whether multipliers prove that the problem's bounds contradict its dynamics.

    With the adjoint ``lambda_k = C_k^T y_k + A_k^T lambda_{k+1}``, ``lambda_N = 0``, every step that satisfies the
    dynamics has

        sum_k y_k^T (C_k dx_k + D_k du_k) = lambda_0^T dx_0 + sum_k lambda_{k+1}^T b_k + sum_k g_k^T du_k,
        g_k = D_k^T y_k + B_k^T lambda_{k+1}.

    Within bounds the left side is at most ``sum upper y+ + lower y-``. If the right side exceeds that for all controls
    of some size, no such step is feasible. Rows that bound a single control take part by limiting that control instead.

    Args:
        qp: the problem.
        dx0: (ndx,) first state.
        multipliers: (N, ng) y, for example those of the least violation.
        reach: absolute value up to which controls without bounds of their own are considered.
    """
    m = {name: qp.dense(name) for name in "ABCD"}
    gaps, lower, upper = qp.vector("b"), qp.vector("lower"), qp.vector("upper")
    least, most, rest = _control_bounds(m["C"], m["D"], lower, upper, reach)
    y = np.where(rest & (np.where(multipliers > 0.0, upper, -lower) < np.inf), multipliers, 0.0)
    scale = float(np.abs(y).max(initial=0.0))
    if not (scale > 0.0 and np.isfinite(scale)):
        return False
    y /= scale
    adjoint, total, size = np.zeros(qp.structure.ndx), 0.0, 0.0
    slopes = np.empty((qp.structure.nodes, qp.structure.nu))
    for k in range(qp.structure.nodes - 1, -1, -1):
        total += float(adjoint @ gaps[k])
        size += float(np.abs(adjoint) @ np.abs(gaps[k]))
        slopes[k] = m["D"][k].T @ y[k] + m["B"][k].T @ adjoint
        adjoint = m["C"][k].T @ y[k] + m["A"][k].T @ adjoint
    total += float(adjoint @ dx0)
    within = float((upper[y > 0.0] * y[y > 0.0]).sum() + (lower[y < 0.0] * y[y < 0.0]).sum())
    margin = total - within + float(np.minimum(slopes * least, slopes * most).sum())
    return margin > _LEAST * (1.0 + size + abs(within))


def _control_bounds(c: Array, d: Array, lower: Array, upper: Array, reach: float) -> tuple[Array, Array, BoolArray]:
    """Return bounds (N, nu) on the controls, at most ``reach``, and which rows (N, ng) bound more than one control."""
    single = ~c.any(axis=2) & (np.count_nonzero(d, axis=2) == 1)
    most = np.full((len(d), d.shape[2]), reach)
    least = -most
    node, row = np.nonzero(single)
    control = np.argmax(d[node, row] != 0.0, axis=1)
    slope = d[node, row, control]
    ends = np.sort([lower[node, row] / slope, upper[node, row] / slope], axis=0)
    np.maximum.at(least, (node, control), ends[0])
    np.minimum.at(most, (node, control), ends[1])
    return least, most, ~single
