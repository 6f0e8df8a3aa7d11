"""The linear-quadratic problem as the sparse matrices of a general QP, filled without a loop; the base of its solvers.

    minimise 1/2 z^T P z + c^T z    subject to    E z = e,    lower <= G z <= upper,
    z = [du_0, dx_1, du_1, dx_2, ..., du_{N-1}, dx_N]

The patterns never change. Values arrive by one gather a matrix, from positions that are computed once.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
from scipy import sparse

from lgmpc.ocp import Block, OcpQp
from lgmpc.solvers.qp.protocol import QpSolution
from lgmpc.solvers.sweep import all_finite
from lgmpc.status import Status
from lgmpc.typing import Array, IntArray

__all__ = ["GatheredMatrix", "GeneralQpSolver", "SparseAssembly"]


class GatheredMatrix:
    """A sparse matrix of fixed pattern whose values are picked from a buffer.

    Args:
        shape: of the matrix.
        entries: (3, nnz) row, column and source of each entry, in any order, no place twice. The source is the index of
            the value in the buffer, or -1 for a value that stays -1.

    Attributes:
        matrix: compressed columns, indices sorted; :meth:`fill` writes its values in place.
    """

    def __init__(self, shape: tuple[int, int], entries: IntArray) -> None:
        rows, columns, sources = entries[:, np.lexsort((entries[0], entries[1]))]
        starts = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=shape[1]))])
        index = (rows.astype(np.int32), starts.astype(np.int32))
        self.matrix = sparse.csc_matrix((np.full(rows.size, -1.0), *index), shape=shape)
        self._filled = np.flatnonzero(sources >= 0)
        self._sources = sources[self._filled]
        self._whole = self._filled.size == sources.size

    def fill(self, buffer: Array) -> None:
        """Pick the values from the buffer (1-D)."""
        if self._whole:
            np.take(buffer, self._sources, out=self.matrix.data, mode="clip")
        else:
            self.matrix.data[self._filled] = buffer[self._sources]


class SparseAssembly:
    """The general QP of an :class:`~lgmpc.ocp.OcpQp`, and the buffers of its solution.

    Args:
        qp: the problem; its buffers are read by :meth:`load_matrices` and :meth:`load_vectors`.
        triangular: keep only the upper triangle of P.
        stacked: make [E; G] one matrix.

    Attributes:
        qp: the problem.
        size: number of variables, N (nu + ndx).
        equalities: number of rows of E, N ndx.
        inequalities: number of rows of G, N ng.
        hessian: P.
        constraints: (E, G), or ([E; G],) when stacked.
        gradient: (size,) c.
        lower: (equalities + inequalities,) [e; lower].
        upper: (equalities + inequalities,) [e; upper].
        z: (size,) the point.
        y: (equalities + inequalities,) the multipliers of [E; G].
        solution: z and y, by stage.
    """

    def __init__(self, qp: OcpQp, *, triangular: bool = False, stacked: bool = False) -> None:
        s = qp.structure
        n, ndx, nu, ng = s.nodes, s.ndx, s.nu, s.ng
        width = nu + ndx
        self.qp = qp
        self.size, self.equalities, self.inequalities = n * width, n * ndx, n * ng
        self._flat = np.zeros(qp.values.size + qp.terminal_values.size)

        stages = np.arange(n)
        later = stages[1:]  # dx_0 is given: where it multiplies a matrix, the product goes to the right-hand sides
        u_at, x_at = stages * width, (stages - 1) * width + nu  # first column of du_k and (from k = 1 on) of dx_k
        blocks = s.blocks

        def place(name: str, which: IntArray, rows: IntArray, columns: IntArray) -> IntArray:
            return _place(blocks[name], which * s.size, rows[which], columns[which])

        cross = place("S", later, u_at, x_at)
        terminal = s.terminal_blocks["Q"]
        last = np.array([(n - 1) * width + nu])
        hessian = np.hstack(
            [
                place("Q", later, x_at, x_at),
                place("R", stages, u_at, u_at),
                cross,
                cross[[1, 0, 2]],
                _place(terminal, np.array([n * s.size]), last, last),
            ]
        )
        if triangular:
            hessian = hessian[:, hessian[0] <= hessian[1]]
        self.hessian = GatheredMatrix((self.size, self.size), hessian)

        row = np.arange(self.equalities)
        successors = np.vstack([row, row // ndx * width + nu + row % ndx, np.full_like(row, -1)])
        row_at = stages * ndx
        equality = np.hstack([place("A", later, row_at, x_at), place("B", stages, row_at, u_at), successors])
        row_at = stages * ng
        inequality = np.hstack([place("C", later, row_at, x_at), place("D", stages, row_at, u_at)])
        self.constraints: tuple[GatheredMatrix, ...]
        if stacked:
            inequality[0] += self.equalities
            shape = (self.equalities + self.inequalities, self.size)
            self.constraints = (GatheredMatrix(shape, np.hstack([equality, inequality])),)
        else:
            self.constraints = (
                GatheredMatrix((self.equalities, self.size), equality),
                GatheredMatrix((self.inequalities, self.size), inequality),
            )

        rows = self.equalities + self.inequalities
        self.gradient, self.z = np.zeros(self.size), np.zeros(self.size)
        self.lower, self.upper, self.y = np.zeros(rows), np.zeros(rows), np.zeros(rows)
        steps, gradient = self.z.reshape(n, width), self.gradient.reshape(n, width)
        self._dxs = np.zeros((n + 1, ndx))
        self._dxs_later = steps[:, nu:]
        self._gradient_u, self._gradient_x = gradient[:, :nu], gradient[:, nu:]
        self._rhs = self.lower[: self.equalities].reshape(n, ndx)
        self._row_lower = self.lower[self.equalities :].reshape(n, ng)
        self._row_upper = self.upper[self.equalities :].reshape(n, ng)
        self._first = {name: np.zeros(blocks[name].shape) for name in "ASC" if blocks[name].rows.size}
        costates, multipliers = self.y[: self.equalities].reshape(n, ndx), self.y[self.equalities :].reshape(n, ng)
        self.solution = QpSolution(qp, self._dxs, steps[:, :nu], costates, multipliers)

    def load_matrices(self) -> bool:
        """Take P, E and G from the problem; return False if they contain NaN or infinity."""
        split = self.qp.values.size
        self._flat[:split] = self.qp.values.ravel()
        self._flat[split:] = self.qp.terminal_values
        self.hessian.fill(self._flat)
        finite = all_finite(self.hessian.matrix.data)
        for constraint in self.constraints:
            constraint.fill(self._flat)
            finite = finite and all_finite(constraint.matrix.data)
        return finite

    def load_vectors(self, dx0: Array) -> bool:
        """Take c, e and the bounds from the problem for the first state dx0 (ndx,); False if they contain NaN."""
        if not all_finite(dx0):
            return False
        qp, blocks = self.qp, self.qp.structure.blocks
        self._gradient_u[:] = qp.vector("r")
        self._gradient_x[:-1] = qp.vector("q")[1:]
        self._gradient_x[-1] = qp.terminal_values[qp.structure.terminal_blocks["q"].where]
        np.negative(qp.vector("b"), out=self._rhs)
        self._row_lower[:] = qp.vector("lower")
        self._row_upper[:] = qp.vector("upper")
        if dx0.any():
            for name, matrix in self._first.items():
                matrix[blocks[name].rows, blocks[name].columns] = qp.values[0, blocks[name].where]
                product = matrix @ dx0
                if name == "A":
                    self._rhs[0] -= product
                elif name == "S":
                    self._gradient_u[0] += product
                else:
                    self._row_lower[0] -= product
                    self._row_upper[0] -= product
        self.upper[: self.equalities] = self.lower[: self.equalities]
        self._dxs[0] = dx0
        # Bounds may be infinite, on their own side.
        bounds = self.lower.max() + self.upper.min()
        return all_finite(self.gradient) and bool(bounds < math.inf) and bool(bounds > -math.inf)

    def finish(self) -> None:
        """Complete :attr:`solution` after a new point was written into z and y."""
        self._dxs[1:] = self._dxs_later


class GeneralQpSolver(ABC):
    """:class:`~lgmpc.solvers.qp.QpSolver` on a package that takes the whole problem as sparse matrices.

    Args:
        assembly: of the problem, in the package's form.
    """

    name: str
    takes_indefinite = False
    may_take_over = True
    warm_started: ClassVar[bool]
    """True if a solve begins at the package's last iterates, which are discarded after a failure."""

    def __init__(self, assembly: SparseAssembly) -> None:
        self.qp: OcpQp = assembly.qp
        self.iterations = 0
        self.solution: QpSolution = assembly.solution
        self._assembly = assembly
        self._solver: Any = None  # the package's, from the first solve on
        self._finite = False

    @abstractmethod
    def _run(self) -> Status:
        """Solve the loaded problem; write :attr:`iterations`, and z and y of the assembly if there is a solution."""

    def reset(self) -> None:
        """Discard all state of earlier solves."""
        self._solver = None
        self._assembly.z[:] = 0.0
        self._assembly.y[:] = 0.0
        self._assembly.finish()

    def feedback(self, multipliers: Array) -> Array:
        """Return no gains."""
        return np.zeros((0, self.qp.structure.nu, self.qp.structure.ndx))

    def prepare(self) -> None:
        """Take over the matrices."""
        self._finite = self._assembly.load_matrices()

    def solve(self, dx0: Array) -> Status:
        """Solve from the current point; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        loaded = self._assembly.load_vectors(dx0) and self._finite
        status = self._run() if loaded else Status.NOT_FINITE
        if status.usable:
            self._assembly.finish()
        elif self.warm_started:
            self._solver = None
        return status


def _place(block: Block, sources: IntArray, rows: IntArray, columns: IntArray) -> IntArray:
    """Return (3, m) row, column and source of a block's entries at several places."""
    positions = np.arange(block.where.start, block.where.stop)
    triplet = (rows[:, None] + block.rows, columns[:, None] + block.columns, sources[:, None] + positions)
    return np.vstack([index.ravel() for index in triplet])
