"""The Riccati solver of small stages: sparse scalar code of a stage, compiled for any horizon.

With the cost-to-go ``1/2 dx^T P dx + p^T dx``, and tildes on the stage's cost with its penalties, the sweep is

    M = R~ + B^T P B = L L^T,   Y = L^-1 (S~ + B^T P A),   y = L^-1 (r~ + B^T (P b + p)),
    P <- Q~ + A^T P A - Y^T Y,   p <- q~ + A^T (P b + p) - Y^T y,

and the roll-out ``du = -L^-T (Y dx + y)``. Other targets change only p and y. Structural zeros cost nothing, and
symmetric matrices are computed once.
"""

from dataclasses import replace

import casadi as ca
import numpy as np

from lgmpc.compile import StageKernel, cached
from lgmpc.ocp import OcpQp, OcpQpStructure
from lgmpc.solvers.qp.protocol import RiccatiSolver


class SparseRiccati(RiccatiSolver):
    """:class:`~lgmpc.solvers.qp.protocol.RiccatiSolver` in scalar code, on the problem's own memory.

    Args:
        qp: the problem.
    """

    penalty = 1e4  # rounding is far below the tolerance, and is not corrected

    def __init__(self, qp: OcpQp) -> None:
        super().__init__(qp)
        s, n = qp.structure, qp.structure.nodes
        kernels = cached(_compile, replace(s, nodes=1))  # of any horizon
        last, backward, revise, forward, total = kernels
        self.available = backward.compiled
        self.dx0 = self.dxs[0]
        togo = np.zeros((n + 1, backward.output_sizes["togo"]))
        factors = np.zeros((n, backward.output_sizes["factor"]))
        costs = np.zeros((n + 2, 1))  # of the intervals before each node, and of all
        self._cost = costs[n + 1]
        given = {"values": qp.values[::-1], "weights": self.weights[::-1], "targets": self.targets[::-1]}
        factor = (
            last.bind(1, terminal_values=qp.terminal_values, togo=togo[n]),
            backward.bind(n, **given, togo_next=togo[:0:-1], togo=togo[-2::-1], factor=factors[::-1]),
        )
        revising = revise.bind(
            n, **given, togo_next=togo[:0:-1], factor=factors[::-1], gradient=togo[-2::-1, -s.ndx :],
            y=factors[::-1, -s.nu :],
        )  # fmt: skip
        roll_out = (
            forward.bind(
                n, dx=self.dxs, values=qp.values, factor=factors, togo_next=togo[1:], cost=costs, dx_next=self.dxs[1:],
                du=self.dus, costate=self.costates, rows=self.rows, cost_next=costs[1:],
            ),
            total.bind(1, terminal_values=qp.terminal_values, dx=self.dxs[n], cost=costs[n], total=self._cost),
        )  # fmt: skip
        self.factoring, self.solving = (*factor, *roll_out), (revising, *roll_out)


def _compile(s: OcpQpStructure) -> tuple[StageKernel, ...]:
    """Return the cost-to-go of the last node, the sweep, its part that targets change, the roll-out, the whole cost."""
    name = f"lqr_{s.ndx}_{s.nu}_{s.ng}"
    v, dx, cost = ca.SX.sym("v", s.terminal_size), ca.SX.sym("dx", s.ndx), ca.SX.sym("cost")
    m = s.matrices(v, last=True)
    triangle = ca.project(m["Q"], ca.Sparsity.lower(s.ndx)).nz[:]
    last = ca.Function(f"{name}_last", [v], [ca.densify(ca.vertcat(triangle, m["q"]))], ["terminal_values"], ["togo"])
    whole = cost + ca.dot(dx, m["Q"] @ dx) / 2 + ca.dot(m["q"], dx)
    total = ca.Function(f"{name}_total", [v, dx, cost], [whole], ["terminal_values", "dx", "cost"], ["total"])
    sweep = (_backward(s, f"{name}_backward"), _revise(s, f"{name}_revise"), _forward(s, f"{name}_forward"))
    return tuple(StageKernel(function) for function in (last, *sweep, total))


def _backward(s: OcpQpStructure, name: str) -> ca.Function:
    """Return ``(next cost-to-go, values, weights, targets) -> (cost-to-go, factor)``, both packed in columns."""
    togo, v = ca.SX.sym("togo", _togo_size(s.ndx)), ca.SX.sym("v", s.size)
    weights, targets = ca.SX.sym("weights", s.ng), ca.SX.sym("targets", s.ng)
    m = s.matrices(v)
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
    given = ["togo_next", "values", "weights", "targets"]
    return ca.Function(
        name, [togo, v, weights, targets], [ca.densify(out), ca.densify(factor)], given, ["togo", "factor"]
    )


def _revise(s: OcpQpStructure, name: str) -> ca.Function:
    """Return ``(next cost-to-go, values, weights, targets, factor) -> (p, y)``."""
    togo, v = ca.SX.sym("togo", _togo_size(s.ndx)), ca.SX.sym("v", s.size)
    weights, targets = ca.SX.sym("weights", s.ng), ca.SX.sym("targets", s.ng)
    m, factor = s.matrices(v), ca.SX.sym("factor", _factor_size(s))
    lower, inverse, y_matrix, _ = _unpacked(s, factor)
    big_p, p = _symmetric(togo, s.ndx)
    pd, pull = big_p @ m["b"] + p, weights * targets
    y = _solve_lower(lower, inverse, m["r"] - m["D"].T @ pull + m["B"].T @ pd)
    gradient = m["q"] - m["C"].T @ pull + m["A"].T @ pd - y_matrix.T @ y
    given, arguments = ["togo_next", "values", "weights", "targets", "factor"], [togo, v, weights, targets, factor]
    return ca.Function(name, arguments, [ca.densify(gradient), ca.densify(y)], given, ["gradient", "y"])


def _forward(s: OcpQpStructure, name: str) -> ca.Function:
    """Return ``(dx, values, factor, next cost-to-go, cost before) -> (dx+, du, costate, rows, cost after)``."""
    dx, v, togo = ca.SX.sym("dx", s.ndx), ca.SX.sym("v", s.size), ca.SX.sym("togo", _togo_size(s.ndx))
    before, factor = ca.SX.sym("cost"), ca.SX.sym("factor", _factor_size(s))
    lower, inverse, y_matrix, y = _unpacked(s, factor)
    m = s.matrices(v)
    du = -_solve_lower_transposed(lower, inverse, y_matrix @ dx + y)
    dx_next = m["A"] @ dx + m["B"] @ du + m["b"]
    big_p, p = _symmetric(togo, s.ndx)
    cost = ca.dot(dx, m["Q"] @ dx) / 2 + ca.dot(du, m["R"] @ du) / 2 + ca.dot(du, m["S"] @ dx)
    cost += ca.dot(m["q"], dx) + ca.dot(m["r"], du)
    outputs = [dx_next, du, big_p @ dx_next + p, m["C"] @ dx + m["D"] @ du, before + cost]
    return ca.Function(
        name,
        [dx, v, factor, togo, before],
        [ca.densify(e) for e in outputs],
        ["dx", "values", "factor", "togo_next", "cost"],
        ["dx_next", "du", "costate", "rows", "cost_next"],
    )


def _togo_size(ndx: int) -> int:
    return ndx * (ndx + 1) // 2 + ndx


def _factor_size(s: OcpQpStructure) -> int:
    return s.nu * (s.nu + 1) // 2 + s.nu * (s.ndx + 2)


def _unpacked(s: OcpQpStructure, factor: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return L, the inverses of its diagonal, Y and y of a packed factor."""
    triangle, nu = s.nu * (s.nu + 1) // 2, s.nu
    ends = [0, triangle, triangle + nu, triangle + nu + nu * s.ndx, _factor_size(s)]
    lower, inverse, y_matrix, y = ca.vertsplit(factor, ends)
    return ca.SX(ca.Sparsity.lower(nu), lower), inverse, ca.reshape(y_matrix, nu, s.ndx), y


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
