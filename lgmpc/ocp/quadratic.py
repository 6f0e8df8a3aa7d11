"""The linear-quadratic problem of a solver's step: one buffer of values and the sparsity pattern of its blocks.

    minimise    sum_k  1/2 [dx_k; du_k]^T [Q_k S_k^T; S_k R_k] [dx_k; du_k] + q_k^T dx_k + r_k^T du_k
                + 1/2 dx_N^T Q_N dx_N + q_N^T dx_N
    subject to  dx_{k+1} = A_k dx_k + B_k du_k + b_k,     lower_k <= C_k dx_k + D_k du_k <= upper_k,    dx_0 given

Only entries that are not structurally zero are stored, all blocks of a stage in a row: a compiled function writes the
whole problem in one pass, and a solver selects its matrices' values with one index array.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from lgmpc.typing import Array, IntArray

__all__ = ["Block", "KktResidual", "OcpQp", "OcpQpStructure", "kkt_function"]


@dataclass(frozen=True)
class Block:
    """The places where a matrix's entries are stored.

    Attributes:
        shape: of the matrix (vectors have one column).
        rows: (nnz,) row of each stored entry.
        columns: (nnz,) its column.
        where: slice of the stage's row of values.
    """

    shape: tuple[int, int]
    rows: IntArray
    columns: IntArray
    where: slice

    @property
    def positions(self) -> IntArray:
        """(nnz,) index of each entry in the stage's row of values."""
        return np.arange(self.where.start, self.where.stop)

    def sparsity(self) -> ca.Sparsity:
        """The pattern as a CasADi sparsity."""
        return ca.Sparsity.triplet(*self.shape, self.rows.tolist(), self.columns.tolist())


@dataclass(frozen=True)
class OcpQpStructure:
    """Sizes and patterns of the linear-quadratic problems of one action over one horizon.

    Attributes:
        nodes: N.
        ndx: dimension of a state's tangent space.
        nu: dimension of the control.
        ng: rows of the path constraint.
        blocks: of a stage: A B b Q S R q r C D lower upper cost.
        terminal_blocks: of the last node: Q q cost.
        size: stored values a stage.
        terminal_size: stored values of the last node.
    """

    nodes: int
    ndx: int
    nu: int
    ng: int
    blocks: dict[str, Block]
    terminal_blocks: dict[str, Block]
    size: int
    terminal_size: int


class OcpQp:
    """One linear-quadratic problem (see the module) on buffers written by the caller and read by solvers.

    Args:
        structure: sizes and patterns.
        values: (N, size) of the stages; zeros unless given.
        terminal_values: (terminal_size,) of the last node.
    """

    def __init__(
        self, structure: OcpQpStructure, values: Array | None = None, terminal_values: Array | None = None
    ) -> None:
        self.structure = structure
        self.values: Array = np.zeros((structure.nodes, structure.size)) if values is None else values
        self.terminal_values: Array = np.zeros(structure.terminal_size) if terminal_values is None else terminal_values

    def vector(self, name: str) -> Array:
        """Return a view (N, n) of a stage vector that has no structural zeros (b, q, r, lower, upper, cost)."""
        view: Array = self.values[:, self.structure.blocks[name].where]
        return view

    def is_finite(self) -> bool:
        """Return whether all numbers but the bounds are finite."""
        bounds = self.structure.blocks["lower"].where.start, self.structure.blocks["upper"].where.stop
        sums = np.add.reduce(self.values, axis=0)  # whole rows: slices of them take three times as long
        parts = sums[: bounds[0]].sum(), sums[bounds[1] :].sum(), self.terminal_values.sum()
        return all(math.isfinite(part) for part in parts)

    def dense(self, name: str) -> Array:
        """Return a copy (N, rows, columns) of a stage matrix or vector with its zeros."""
        block = self.structure.blocks[name]
        rows, columns = block.shape
        if block.rows.size == rows * columns and (block.columns[:-1] <= block.columns[1:]).all():  # column after column
            full = self.values[:, block.where].reshape(self.structure.nodes, columns, rows)
            return np.ascontiguousarray(np.swapaxes(full, 1, 2))
        out = np.zeros((self.structure.nodes, rows * columns))
        out[:, block.rows * columns + block.columns] = self.values[:, block.where]
        return out.reshape(self.structure.nodes, rows, columns)

    def dense_terminal(self, name: str) -> Array:
        """Return a copy (rows, columns) of a matrix or vector of the last node."""
        block = self.structure.terminal_blocks[name]
        out = np.zeros(block.shape)
        out[block.rows, block.columns] = self.terminal_values[block.where]
        return out


@dataclass(frozen=True)
class KktResidual:
    """Residuals of the optimality conditions at a point, each the largest absolute value of its rows.

    Attributes:
        stationarity: gradient of the Lagrangian.
        dynamics: gaps between the stages.
        constraint: violation of the path constraint.
        complementarity: smaller of a row's multiplier and its distance from the multiplier's bound.
    """

    stationarity: float
    dynamics: float
    constraint: float
    complementarity: float

    @classmethod
    def of(cls, output: Array) -> KktResidual:
        """Return the residual from the output of a :func:`kkt_function`; all NaN if the point was not finite."""
        *residuals, total = output.tolist()
        return cls(*residuals) if math.isfinite(total) else cls.unknown()

    @classmethod
    def unknown(cls) -> KktResidual:
        """Return an unknown residual: NaN."""
        return cls(math.nan, math.nan, math.nan, math.nan)

    @property
    def largest(self) -> float:
        """The largest of the four; NaN if any is."""
        return float(np.max([self.stationarity, self.dynamics, self.constraint, self.complementarity]))


def kkt_function(structure: OcpQpStructure, name: str) -> ca.Function:
    """Return the function of the residual of an :class:`OcpQp`'s optimality conditions at a point.

    With costates lambda_1 .. lambda_N of the dynamics ``A dx + B du + b - dx+ = 0`` and multipliers mu of the path
    constraint (positive at an active upper bound, negative at a lower one) the Lagrangian is stationary in
    dx_1 .. dx_N and du_0 .. du_{N-1}. dx_0 is given: it has no condition.

    Returns:
        ``(values (size, N), terminal_values, dxs (ndx, N+1), dus (nu, N), costates (ndx, N), multipliers (ng, N)) ->
        residual (5,)``: the attributes of :class:`KktResidual`, and the sum of the point's entries, which is finite
        only if they are. :meth:`KktResidual.of` converts it.
    """
    n, ndx, nu, ng = structure.nodes, structure.ndx, structure.nu, structure.ng
    v, dx, dx_next = ca.SX.sym("v", structure.size), ca.SX.sym("dx", ndx), ca.SX.sym("dx_next", ndx)
    du, co, mu = ca.SX.sym("du", nu), ca.SX.sym("co", ndx), ca.SX.sym("mu", ng)
    m = {key: ca.SX(block.sparsity(), v[block.where]) for key, block in structure.blocks.items()}
    # The costate's own -lambda_k is added outside, where neighbouring stages meet.
    gradient_x = m["Q"] @ dx + m["S"].T @ du + m["q"] + m["A"].T @ co + m["C"].T @ mu
    gradient_u = m["S"] @ dx + m["R"] @ du + m["r"] + m["B"].T @ co + m["D"].T @ mu
    gap = m["A"] @ dx + m["B"] @ du + m["b"] - dx_next
    row = m["C"] @ dx + m["D"] @ du
    above, below = m["upper"] - row, row - m["lower"]
    outside = _larger(_larger(-above, -below), ca.SX.zeros(ng))
    loose = _larger(_smaller(_larger(mu, ca.SX.zeros(ng)), above), _smaller(_larger(-mu, ca.SX.zeros(ng)), below))
    columns = (gradient_u, gap, outside, loose)
    stage = ca.Function(
        f"{name}_kkt_stage", [v, dx, dx_next, du, co, mu], [gradient_x, *(_largest(column) for column in columns)]
    )
    vs, vt = ca.MX.sym("values", structure.size, n), ca.MX.sym("terminal_values", structure.terminal_size)
    dxs, dus = ca.MX.sym("dxs", ndx, n + 1), ca.MX.sym("dus", nu, n)
    cos, mus = ca.MX.sym("costates", ndx, n), ca.MX.sym("multipliers", ng, n)
    gx, gu, gaps, outsides, looses = stage.map(n)(vs, dxs[:, :n], dxs[:, 1:], dus, cos, mus)
    t = {key: ca.MX(block.sparsity(), vt[block.where]) for key, block in structure.terminal_blocks.items()}
    gx_last = t["Q"] @ dxs[:, n] + t["q"]
    gx_inner = ca.horzcat(gx[:, 1:], gx_last) - cos
    stationarity = ca.fmax(ca.norm_inf(ca.vec(gx_inner)), ca.mmax(gu))
    # Comparisons and maxima ignore NaN; a sum does not.
    total = sum((ca.sum1(ca.vec(point)) for point in (dxs, dus, cos, mus)), ca.MX(0))
    residual = ca.vertcat(stationarity, *(ca.mmax(e) for e in (gaps, outsides, looses)), total)
    inputs = [vs, vt, dxs, dus, cos, mus]
    names = ["values", "terminal_values", "dxs", "dus", "costates", "multipliers"]
    return ca.Function(f"{name}_kkt_{n}", inputs, [residual], names, ["residual"])


def _larger(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the elementwise maximum (by comparison: the C library's fmax is a call for each element)."""
    return ca.if_else(a > b, a, b)


def _smaller(a: ca.SX, b: ca.SX) -> ca.SX:
    return ca.if_else(a < b, a, b)


def _largest(column: ca.SX) -> ca.SX:
    """Return the largest absolute value; 0 for an empty column."""
    largest = ca.SX(0)
    for entry in ca.vertsplit(column) if column.numel() else ():
        largest = _larger(ca.fabs(entry), largest)
    return largest
