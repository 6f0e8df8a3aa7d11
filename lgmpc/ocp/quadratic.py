"""The linear-quadratic problem of a solver's step: one buffer of values and the sparsity pattern of its blocks.

    minimise    sum_k  1/2 [dx_k; du_k]^T [Q_k S_k^T; S_k R_k] [dx_k; du_k] + q_k^T dx_k + r_k^T du_k
                + 1/2 dx_N^T Q_N dx_N + q_N^T dx_N
    subject to  dx_{k+1} = A_k dx_k + B_k du_k + b_k,     lower_k <= C_k dx_k + D_k du_k <= upper_k,    dx_0 given

Only entries that are not structurally zero are stored, all blocks of a stage in a row: a compiled function writes the
whole problem in one pass, and a solver selects its matrices' values with one index array.
"""

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from lgmpc.typing import Array, IntArray


@dataclass(frozen=True)
class StoredBlock:
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
    blocks: dict[str, StoredBlock]
    terminal_blocks: dict[str, StoredBlock]
    size: int
    terminal_size: int

    def matrices(self, values: ca.SX, last: bool = False) -> dict[str, ca.SX]:
        """Return the matrices of a stage, or of the last node, whose stored entries are the values."""
        blocks = self.terminal_blocks if last else self.blocks
        return {name: ca.SX(block.sparsity(), values[block.where]) for name, block in blocks.items()}


class OcpQp:
    """One linear-quadratic problem (see the module) on buffers written by the caller and read by solvers.

    Args:
        structure: sizes and patterns.

    Attributes:
        values: (N, size) of the stages, zeros at first.
        terminal_values: (terminal_size,) of the last node.
    """

    def __init__(self, structure: OcpQpStructure) -> None:
        self.structure = structure
        self.values: Array = np.zeros((structure.nodes, structure.size))
        self.terminal_values: Array = np.zeros(structure.terminal_size)

    def vector(self, name: str) -> Array:
        """Return a view (N, n) of a stage vector that has no structural zeros (b, q, r, lower, upper, cost)."""
        return self.values[:, self.structure.blocks[name].where]

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
