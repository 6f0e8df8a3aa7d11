"""Packages that solve general sparse quadratic programmes: PIQP and OSQP, on one assembly of the problem.

    minimise 1/2 z^T P z + c^T z    subject to    E z = e,    lower <= G z <= upper,
    z = [du_0, dx_1, du_1, dx_2, ..., du_{N-1}, dx_N]

The patterns never change. Values arrive by one gather a matrix, from positions that are computed once. Every setting
that would depend on the clock is fixed: the same inputs give the same bits.
"""

import math
from abc import ABC, abstractmethod
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
from scipy import sparse

from lgmpc.errors import InputError, MissingDependencyError
from lgmpc.ocp import OcpQp, StoredBlock
from lgmpc.solvers.qp.protocol import QpSolution, is_large
from lgmpc.solvers.sweep import all_finite
from lgmpc.status import Status
from lgmpc.typing import Array, IntArray

KKT_SOLVERS = ("sparse_ldlt", "sparse_multistage")
_FAR = 1e3  # times the tolerance: a point that is further from feasible than this is no approximate solution
_NEAR = 1e-6  # a point that is nearer than this is one, whatever the tolerance
_INFINITY = 1e30  # OSQP's


class _GatheredMatrix:
    """A sparse matrix of fixed pattern whose values are picked from a buffer.

    Args:
        shape: of the matrix.
        entries: (3, nnz) row, column and index in the buffer of each entry, in any order, no place twice.
    """

    def __init__(self, shape: tuple[int, int], entries: IntArray) -> None:
        rows, columns, self._sources = entries[:, np.lexsort((entries[0], entries[1]))]
        starts = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=shape[1]))])
        index = (rows.astype(np.int32), starts.astype(np.int32))
        self.matrix = sparse.csc_matrix((np.zeros(rows.size), *index), shape=shape)

    def fill(self, buffer: Array) -> bool:
        """Pick the values from the buffer (1-D); return whether all are finite."""
        np.take(buffer, self._sources, out=self.matrix.data, mode="clip")
        return all_finite(self.matrix.data)


class GeneralQpSolver(ABC):
    """:class:`~lgmpc.solvers.qp.QpSolver` on a package that takes the whole problem as sparse matrices.

    Args:
        qp: the problem.
        tolerance: absolute residual at which the package stops.
        max_iterations: of the package.

    Raises:
        MissingDependencyError: the package is not installed.
    """

    name: str
    may_use_fallbacks = True
    module: ClassVar[str]
    """Of the package."""
    package: ClassVar[str]
    """With its versions, as pip takes it."""
    stacked: ClassVar[bool] = False
    """True if it takes [E; G] as one matrix."""
    warm_started: ClassVar[bool] = True
    """True if a solve begins at the package's last iterates, which are discarded after a failure."""
    statuses: ClassVar[dict[str, Status]]
    """Of the names of its outcomes; others are failures."""

    def __init__(self, qp: OcpQp, tolerance: float, max_iterations: int) -> None:
        try:
            self._module: Any = import_module(self.module)
        except ImportError as error:
            name = self.package.partition(">")[0]
            raise MissingDependencyError(
                name, f"the QP solver '{self.name}'", f'pip install "{self.package}"'
            ) from error
        self.qp, self.tolerance, self.max_iterations, self.iterations = qp, tolerance, max_iterations, 0
        self._solver: Any = None  # the package's, from the first solve on
        self._finite = False
        self._assemble()

    @abstractmethod
    def _run(self) -> Status:
        """Solve the loaded problem; write :attr:`iterations`, and z and y if there is a solution."""

    def reset(self) -> None:
        """Discard all state of earlier solves."""
        self._solver = None
        self.solution.write(0.0, 0.0, 0.0, 0.0)

    def feedback(self, multipliers: Array) -> Array:
        """Return no gains."""
        return np.zeros((0, self.qp.structure.nu, self.qp.structure.ndx))

    def prepare(self) -> None:
        """Take over the matrices P, E and G."""
        split = self.qp.values.size
        self._flat[:split] = self.qp.values.ravel()
        self._flat[split:-1] = self.qp.terminal_values
        self._finite = all([matrix.fill(self._flat) for matrix in (self._hessian, *self._constraints)])

    def solve(self, dx0: Array) -> Status:
        """Solve from the current point; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        status = self._run() if self._load_vectors(dx0) and self._finite else Status.NOT_FINITE
        if status.usable:
            self._dxs[1:] = self._dxs_later
        elif self.warm_started:
            self._solver = None
        return status

    def _data(self) -> tuple[Any, ...]:
        """Return P, c, E, e, G, its lower and its upper bounds."""
        e, (equality, inequality) = self._equalities, (each.matrix for each in self._constraints)
        bounds = self._lower[:e], inequality, self._lower[e:], self._upper[e:]
        return (self._hessian.matrix, self._gradient, equality, *bounds)

    def _assemble(self) -> None:
        """Compute where the entries of all matrices come from, and make the buffers of the solution."""
        s = self.qp.structure
        n, ndx, nu, ng, blocks = s.nodes, s.ndx, s.nu, s.ng, s.blocks
        width = nu + ndx
        size, self._equalities, inequalities = n * width, n * ndx, n * ng
        self._flat = np.zeros(self.qp.values.size + self.qp.terminal_values.size + 1)
        self._flat[-1] = -1.0  # of the next states in the dynamics

        stages = np.arange(n)
        later = stages[1:]  # dx_0 is given: where it multiplies a matrix, the product goes to the right-hand sides
        u_at, x_at = stages * width, (stages - 1) * width + nu  # first column of du_k and (from k = 1 on) of dx_k

        def place(name: str, which: IntArray, rows: IntArray, columns: IntArray) -> IntArray:
            return _place(blocks[name], which * s.size, rows[which], columns[which])

        cross, last = place("S", later, u_at, x_at), np.array([size - ndx])
        parts = [place("Q", later, x_at, x_at), place("R", stages, u_at, u_at), cross, cross[[1, 0, 2]]]
        hessian = np.hstack([*parts, _place(s.terminal_blocks["Q"], np.array([n * s.size]), last, last)])
        hessian = hessian[:, hessian[0] <= hessian[1]]  # both packages take the upper triangle
        self._hessian = _GatheredMatrix((size, size), hessian)

        row = np.arange(self._equalities)
        successors = np.vstack([row, row // ndx * width + nu + row % ndx, np.full_like(row, self._flat.size - 1)])
        row_at = stages * ndx
        equality = np.hstack([place("A", later, row_at, x_at), place("B", stages, row_at, u_at), successors])
        row_at = stages * ng
        inequality = np.hstack([place("C", later, row_at, x_at), place("D", stages, row_at, u_at)])
        rows = self._equalities + inequalities
        self._constraints: tuple[_GatheredMatrix, ...]
        if self.stacked:
            inequality[0] += self._equalities
            self._constraints = (_GatheredMatrix((rows, size), np.hstack([equality, inequality])),)
        else:
            shapes = (self._equalities, size), (inequalities, size)
            self._constraints = _GatheredMatrix(shapes[0], equality), _GatheredMatrix(shapes[1], inequality)

        self._gradient, self._z = np.zeros(size), np.zeros(size)
        self._lower, self._upper, self._y = np.zeros(rows), np.zeros(rows), np.zeros(rows)
        steps, gradient = self._z.reshape(n, width), self._gradient.reshape(n, width)
        self._dxs = np.zeros((n + 1, ndx))
        self._dxs_later = steps[:, nu:]
        self._gradient_u, self._gradient_x = gradient[:, :nu], gradient[:, nu:]
        self._rhs = self._lower[: self._equalities].reshape(n, ndx)
        self._row_lower, self._row_upper, multipliers = (
            array[self._equalities :].reshape(n, ng) for array in (self._lower, self._upper, self._y)
        )
        costates = self._y[: self._equalities].reshape(n, ndx)
        self.solution = QpSolution(self.qp, self._dxs, steps[:, :nu], costates, multipliers)

    def _load_vectors(self, dx0: Array) -> bool:
        """Take c, e and the bounds from the problem for the first state dx0 (ndx,); False if they contain NaN."""
        if not all_finite(dx0):
            return False
        qp, last = self.qp, self.qp.structure.terminal_blocks["q"].where
        self._gradient_u[:] = qp.vector("r")
        self._gradient_x[:-1] = qp.vector("q")[1:]
        self._gradient_x[-1] = qp.terminal_values[last]
        np.negative(qp.vector("b"), out=self._rhs)
        self._row_lower[:] = qp.vector("lower")
        self._row_upper[:] = qp.vector("upper")
        if dx0.any():
            moved = {name: self._first(name) @ dx0 for name in "ASC"}
            self._rhs[0] -= moved["A"]
            self._gradient_u[0] += moved["S"]
            self._row_lower[0] -= moved["C"]
            self._row_upper[0] -= moved["C"]
        self._upper[: self._equalities] = self._lower[: self._equalities]
        self._dxs[0] = dx0
        # Bounds may be infinite, on their own side.
        bounds = self._lower.max() + self._upper.min()
        return all_finite(self._gradient) and bool(bounds < math.inf) and bool(bounds > -math.inf)

    def _first(self, name: str) -> Array:
        """Return the first interval's matrix."""
        block = self.qp.structure.blocks[name]
        matrix = np.zeros(block.shape)
        matrix[block.rows, block.columns] = self.qp.values[0, block.where]
        return matrix


class PiqpSolver(GeneralQpSolver):
    """PIQP: a proximal interior point method, accurate from any start (Schwan, Jiang, Kuhn, Jones, CDC 2023).

    Args:
        qp: the problem.
        tolerance: absolute residual at which it stops.
        max_iterations: of the interior point method.
        kkt_solver: ``sparse_ldlt``, or ``sparse_multistage``, which works in dense blocks; unless given the latter for
            large stages, for which it pays.

    Raises:
        InputError: no such ``kkt_solver``.
        MissingDependencyError: PIQP is not installed.
    """

    name, module, package = "piqp", "piqp", "piqp>=0.6,<0.7"
    warm_started = False
    statuses: ClassVar[dict[str, Status]] = {
        "PIQP_SOLVED": Status.CONVERGED,
        "PIQP_MAX_ITER_REACHED": Status.ITERATION_LIMIT,
        "PIQP_PRIMAL_INFEASIBLE": Status.INFEASIBLE,
        "PIQP_DUAL_INFEASIBLE": Status.UNBOUNDED,
    }

    def __init__(
        self, qp: OcpQp, tolerance: float = 1e-6, max_iterations: int = 50, kkt_solver: str | None = None
    ) -> None:
        kkt_solver = KKT_SOLVERS[is_large(qp)] if kkt_solver is None else kkt_solver
        if str(kkt_solver) not in KKT_SOLVERS:
            raise InputError("kkt_solver", str(kkt_solver), "a linear solver of PIQP", KKT_SOLVERS)
        super().__init__(qp, tolerance, max_iterations)
        self.kkt_solver = kkt_solver

    def _run(self) -> Status:
        m, data = self._equalities, self._data()
        *_, inequality, lower, upper = data
        free = np.isinf(lower) & np.isinf(upper)
        if free.any():  # PIQP does the same, and prints three lines about it
            inequality.data[free[inequality.indices]] = 0.0
            lower[free], upper[free] = -1.0, 1.0
        if self._solver is None:
            self._solver = self._module.SparseSolver()
            options = self._solver.settings
            options.kkt_solver = getattr(self._module.KKTSolver, self.kkt_solver)
            options.eps_abs = options.eps_duality_gap_abs = self.tolerance
            options.eps_rel = options.eps_duality_gap_rel = 0.0
            options.max_iter = self.max_iterations
            options.preconditioner_reuse_on_update = True
            self._solver.setup(*data)
        else:
            self._solver.update(*data)
        code = self._solver.solve()
        result = self._solver.result
        self.iterations = int(result.info.iter)
        status = self.statuses.get(code.name, Status.FAILED)
        far = not result.info.primal_res <= max(_FAR * self.tolerance, _NEAR)
        if status is Status.ITERATION_LIMIT and far:
            status = Status.INFEASIBLE  # PIQP often runs out of iterations before it can prove infeasibility
        if status.usable:
            self._z[:] = result.x
            self._y[:m] = result.y
            np.subtract(result.z_u, result.z_l, out=self._y[m:])
        return status


class OsqpSolver(GeneralQpSolver):
    """OSQP: operator splitting, fast where it starts close to the solution (Stellato et al., Math. Prog. Comp. 2020).

    It is warm-started in y, and factorises in :meth:`prepare`. Its tolerance is absolute and relative.
    """

    name, module, package = "osqp", "osqp.ext_builtin", "osqp>=1.0,<2"
    stacked = True
    statuses: ClassVar[dict[str, Status]] = {
        "OSQP_SOLVED": Status.CONVERGED,
        "OSQP_SOLVED_INACCURATE": Status.ITERATION_LIMIT,
        "OSQP_MAX_ITER_REACHED": Status.ITERATION_LIMIT,
        "OSQP_PRIMAL_INFEASIBLE": Status.INFEASIBLE,
        "OSQP_PRIMAL_INFEASIBLE_INACCURATE": Status.INFEASIBLE,
        "OSQP_DUAL_INFEASIBLE": Status.UNBOUNDED,
        "OSQP_DUAL_INFEASIBLE_INACCURATE": Status.UNBOUNDED,
    }

    def __init__(self, qp: OcpQp, tolerance: float = 1e-5, max_iterations: int = 400) -> None:
        super().__init__(qp, tolerance, max_iterations)
        names = self._module.osqp_status_type.__members__.items()
        self._codes = {int(code): self.statuses.get(name, Status.FAILED) for name, code in names}

    def prepare(self) -> None:
        """Take over the matrices and factorise."""
        super().prepare()
        if self._finite and self._solver is not None:
            self._solver.update_data_mat(self._hessian.matrix.data, None, self._constraints[0].matrix.data, None)

    def _run(self) -> Status:
        np.maximum(self._lower, -_INFINITY, out=self._lower)
        np.minimum(self._upper, _INFINITY, out=self._upper)
        if self._solver is None:
            self._setup()
        else:
            self._solver.update_data_vec(self._gradient, self._lower, self._upper)
        self._solver.warm_start(np.zeros_like(self._z), self._y)
        self._solver.solve()
        info = self._solver.info
        self.iterations = int(info.iter)
        status = self._codes[int(info.status_val)]
        if status.usable:
            self._z[:] = self._solver.solution.x
            self._y[:] = self._solver.solution.y
        return status

    def _setup(self) -> None:
        module, check_interval = self._module, 5
        options = module.OSQPSettings()
        module.osqp_set_default_settings(options)
        values = {
            "verbose": 0,
            "eps_abs": self.tolerance,
            "eps_rel": self.tolerance,
            "max_iter": self.max_iterations,
            "rho": 1.0,  # at first
            "check_termination": check_interval,
            "polishing": 0,
            "warm_starting": 1,
            # OSQP's own choice of when to adapt rho reads the clock.
            "adaptive_rho": 1,
            "adaptive_rho_interval": 5 * check_interval,
        }
        for name, value in values.items():
            setattr(options, name, value)
        hessian, constraint = (module.CSC(each.matrix) for each in (self._hessian, self._constraints[0]))
        sizes = self._y.size, self._z.size
        self._solver = module.OSQPSolver(hessian, self._gradient, constraint, self._lower, self._upper, *sizes, options)


def _place(block: StoredBlock, sources: IntArray, rows: IntArray, columns: IntArray) -> IntArray:
    """Return (3, m) row, column and source of a block's entries at several places."""
    triplet = (rows[:, None] + block.rows, columns[:, None] + block.columns, sources[:, None] + block.positions)
    return np.vstack([index.ravel() for index in triplet])
