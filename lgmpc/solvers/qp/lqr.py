"""The linear-quadratic regulator with penalised rows: a Riccati sweep and a roll-out in one compiled call.

It minimises the cost of an :class:`~lgmpc.ocp.OcpQp` plus

    sum_k sum_i  1/2 weight_ki (row_ki - target_ki)^2,        row_k = C_k dx_k + D_k du_k,

subject to the dynamics only. With the cost-to-go ``1/2 dx^T P dx + p^T dx``, and tildes on the stage's cost with its
penalties, the sweep is

    M = R~ + B^T P B = L L^T,   Y = L^-1 (S~ + B^T P A),   y = L^-1 (r~ + B^T (P b + p)),
    P <- Q~ + A^T P A - Y^T Y,   p <- q~ + A^T (P b + p) - Y^T y,

and the roll-out ``du = -L^-T (Y dx + y)``. Structural zeros cost nothing, and symmetric matrices are computed once.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from lgmpc.ocp import OcpQpStructure

__all__ = ["lqr_function"]


def lqr_function(structure: OcpQpStructure, name: str) -> ca.Function:
    """Return the regulator for problems of one structure.

    Args:
        structure: of the problems; R + D^T diag(weights) D has to be positive definite.
        name: begins the function's name.

    Returns:
        ``(values (size, N), terminal_values, dx0 (ndx,), weights (ng, N), targets (ng, N)) ->
        (dxs (ndx, N+1), dus (nu, N), costates (ndx, N), rows (ng, N), cost)``: the minimiser, the multipliers of the
        dynamics (signed as in :func:`lgmpc.ocp.quadratic.kkt_function`), the rows' values, and the cost without the
        penalties.
    """
    n, s = structure.nodes, structure
    backward, forward = _backward(s, f"{name}_lqr_backward"), _forward(s, f"{name}_lqr_forward")
    values, terminal_values = ca.MX.sym("values", s.size, n), ca.MX.sym("terminal_values", s.terminal_size)
    dx0, weights, targets = ca.MX.sym("dx0", s.ndx), ca.MX.sym("weights", s.ng, n), ca.MX.sym("targets", s.ng, n)
    blocks = s.terminal_blocks
    last, gradient = (ca.MX(blocks[key].sparsity(), terminal_values[blocks[key].where]) for key in ("Q", "q"))
    triangle = ca.project(last, ca.Sparsity.lower(s.ndx)).nz[:]
    togo = [ca.vertcat(triangle, gradient)]
    factors: list[ca.MX] = []
    for k in reversed(range(n)):
        cost, factor = backward(togo[0], values[:, k], weights[:, k], targets[:, k])
        togo.insert(0, cost)
        factors.insert(0, factor)
    stages: list[Any] = []
    dx = dx0
    for k in range(n):
        stages.append(forward(dx, values[:, k], factors[k], togo[k + 1]))
        dx = stages[-1][0]
    dxs, dus, costates, rows, costs = (ca.horzcat(*column) for column in zip(*stages, strict=True))
    total = ca.sum2(costs) + ca.dot(dx, last @ dx) / 2 + ca.dot(gradient, dx)
    return ca.Function(
        f"{name}_lqr_{n}",
        [values, terminal_values, dx0, weights, targets],
        [ca.horzcat(dx0, dxs), dus, costates, rows, total],
        ["values", "terminal_values", "dx0", "weights", "targets"],
        ["dxs", "dus", "costates", "rows", "cost"],
    )


def _backward(s: OcpQpStructure, name: str) -> ca.Function:
    """``(cost-to-go behind, values, weights, targets) -> (cost-to-go, factor)``, both packed in columns."""
    togo, v = ca.SX.sym("togo", _togo_size(s.ndx)), ca.SX.sym("v", s.size)
    weights, targets = ca.SX.sym("weights", s.ng), ca.SX.sym("targets", s.ng)
    m = _unpack(s, v)
    big_p, p = _symmetric(togo, s.ndx)
    wc, wd = ca.diag(weights) @ m["C"], ca.diag(weights) @ m["D"]
    q = m["q"] - wc.T @ targets
    r = m["r"] - wd.T @ targets
    pa, pb, pd = big_p @ m["A"], big_p @ m["B"], big_p @ m["b"] + p
    lower, inverse = _cholesky(_gram(m["R"], (m["D"], wd), (m["B"], pb)))
    cross = m["S"] + m["D"].T @ wc + m["B"].T @ pa
    y_matrix = _solve_lower(lower, inverse, cross)
    y = _solve_lower(lower, inverse, r + m["B"].T @ pd)
    new_p = _gram(m["Q"], (m["C"], wc), (m["A"], pa), (y_matrix, -y_matrix))
    new_gradient = q + m["A"].T @ pd - y_matrix.T @ y
    factor = ca.vertcat(lower.nz[:], inverse, ca.vec(ca.densify(y_matrix)), y)
    out = ca.vertcat(new_p.nz[:], new_gradient)
    return ca.Function(name, [togo, v, weights, targets], [ca.densify(out), ca.densify(factor)])


def _forward(s: OcpQpStructure, name: str) -> ca.Function:
    """``(dx, values, factor, cost-to-go behind) -> (dx+, du, costate, rows, cost)``."""
    nu, ndx = s.nu, s.ndx
    dx, v, togo = ca.SX.sym("dx", ndx), ca.SX.sym("v", s.size), ca.SX.sym("togo", _togo_size(ndx))
    triangle = nu * (nu + 1) // 2
    factor = ca.SX.sym("factor", triangle + nu + nu * ndx + nu)
    lower_packed, inverse, y_flat, y = ca.vertsplit(
        factor, [0, triangle, triangle + nu, triangle + nu + nu * ndx, triangle + nu + nu * ndx + nu]
    )
    lower = ca.SX(ca.Sparsity.lower(nu), lower_packed)
    m = _unpack(s, v)
    du = -_solve_lower_transposed(lower, inverse, ca.reshape(y_flat, nu, ndx) @ dx + y)
    dx_next = m["A"] @ dx + m["B"] @ du + m["b"]
    big_p, p = _symmetric(togo, ndx)
    cost = ca.dot(dx, m["Q"] @ dx) / 2 + ca.dot(du, m["R"] @ du) / 2 + ca.dot(du, m["S"] @ dx)
    cost += ca.dot(m["q"], dx) + ca.dot(m["r"], du)
    outputs = [dx_next, du, big_p @ dx_next + p, m["C"] @ dx + m["D"] @ du, cost]
    return ca.Function(name, [dx, v, factor, togo], [ca.densify(e) for e in outputs])


def _unpack(s: OcpQpStructure, v: ca.SX) -> dict[str, ca.SX]:
    return {key: ca.SX(block.sparsity(), v[block.where]) for key, block in s.blocks.items()}


def _togo_size(ndx: int) -> int:
    return ndx * (ndx + 1) // 2 + ndx


def _symmetric(togo: ca.SX, n: int) -> tuple[ca.SX, ca.SX]:
    """Return the dense P and p of a packed cost-to-go."""
    size = n * (n + 1) // 2
    return ca.tril2symm(ca.SX(ca.Sparsity.lower(n), togo[:size])), togo[size:]


def _gram(start: ca.SX, *factors: tuple[ca.SX, ca.SX]) -> ca.SX:
    """Return the lower triangle of the symmetric ``start + sum left^T right``."""
    n = start.shape[1]
    out = ca.SX.zeros(ca.Sparsity.lower(n))
    columns = [(ca.horzsplit(left), ca.horzsplit(right)) for left, right in factors]
    for j in range(n):
        for i in range(j, n):
            out[i, j] = start[i, j] + sum(ca.dot(left[i], right[j]) for left, right in columns)
    return out


def _cholesky(matrix: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return L with ``L L^T = matrix``, of which the lower triangle is given, and the inverses of L's diagonal."""
    n = matrix.shape[0]
    lower, inverse = ca.SX.zeros(ca.Sparsity.lower(n)), ca.SX.zeros(n)
    for j in range(n):
        pivot = matrix[j, j] - sum(lower[j, k] ** 2 for k in range(j))
        lower[j, j] = ca.sqrt(pivot)
        inverse[j] = 1 / lower[j, j]
        for i in range(j + 1, n):
            lower[i, j] = (matrix[i, j] - sum(lower[i, k] * lower[j, k] for k in range(j))) * inverse[j]
    return lower, inverse


def _solve_lower(lower: ca.SX, inverse: ca.SX, right: ca.SX) -> ca.SX:
    rows: list[ca.SX] = []
    for i in range(lower.shape[0]):
        rows.append((right[i, :] - sum(lower[i, k] * rows[k] for k in range(i))) * inverse[i])
    return ca.vertcat(*rows)


def _solve_lower_transposed(lower: ca.SX, inverse: ca.SX, right: ca.SX) -> ca.SX:
    n = lower.shape[0]
    rows: list[ca.SX] = [ca.SX()] * n
    for i in reversed(range(n)):
        rows[i] = (right[i] - sum(lower[k, i] * rows[k] for k in range(i + 1, n))) * inverse[i]
    return ca.vertcat(*rows)
