"""PIQP: a proximal interior point method, accurate from any start (Schwan, Jiang, Kuhn, Jones, CDC 2023).

Interior point methods fail on different problems: a cascade tries several in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lgmpc.errors import InputError, MissingDependencyError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.assembly import GeneralQpSolver, SparseAssembly
from lgmpc.solvers.qp.protocol import QpSolution, QpSolver
from lgmpc.status import Status
from lgmpc.typing import Array

__all__ = ["Cascade", "PiqpSettings", "PiqpSolver"]

KKT_SOLVERS = ("sparse_ldlt", "sparse_multistage")
_FAR = 1e3  # times the tolerance: a point that is further from feasible than this is no approximate solution
_NEAR = 1e-6  # a point that is nearer than this is one, whatever the tolerance
_STATUS = {
    "PIQP_SOLVED": Status.CONVERGED,
    "PIQP_MAX_ITER_REACHED": Status.ITERATION_LIMIT,
    "PIQP_PRIMAL_INFEASIBLE": Status.INFEASIBLE,
    "PIQP_DUAL_INFEASIBLE": Status.UNBOUNDED,
}


@dataclass(frozen=True)
class PiqpSettings:
    """Linear solver, tolerance and limits of :class:`PiqpSolver`.

    Attributes:
        kkt_solver: ``sparse_ldlt``, or ``sparse_multistage``, which works in dense blocks (pays for large stages).
        tolerance: absolute residual at which it stops.
        max_iterations: of the interior point method.

    Raises:
        InputError: no such ``kkt_solver``.
    """

    kkt_solver: str = "sparse_ldlt"
    tolerance: float = 1e-6
    max_iterations: int = 50

    def __post_init__(self) -> None:
        """Raise for an unknown linear solver."""
        if str(self.kkt_solver) not in KKT_SOLVERS:
            raise InputError("kkt_solver", str(self.kkt_solver), "a linear solver of PIQP", KKT_SOLVERS)


class PiqpSolver(GeneralQpSolver):
    """:class:`~lgmpc.solvers.qp.QpSolver` on PIQP. It has no warm start.

    Args:
        qp: the problem.
        settings: linear solver, tolerance and iterations.

    Raises:
        MissingDependencyError: PIQP is not installed.
    """

    warm_started = False

    def __init__(self, qp: OcpQp, settings: PiqpSettings | None = None) -> None:
        try:
            import piqp
        except ImportError as error:
            raise MissingDependencyError("piqp", "the QP solver 'piqp'", 'pip install "piqp>=0.6,<0.7"') from error
        super().__init__(SparseAssembly(qp, triangular=True))
        self.settings = PiqpSettings() if settings is None else settings
        self.name = "piqp" if self.settings.kkt_solver == "sparse_ldlt" else "piqp_multistage"
        self._module: Any = piqp

    def _run(self) -> Status:
        a, m = self._assembly, self._assembly.equalities
        equality, inequality = (c.matrix for c in a.constraints)
        free = np.isinf(a.lower[m:]) & np.isinf(a.upper[m:])
        if free.any():  # PIQP does the same, and prints three lines about it
            inequality.data[free[inequality.indices]] = 0.0
            a.lower[m:][free], a.upper[m:][free] = -1.0, 1.0
        data = (a.hessian.matrix, a.gradient, equality, a.lower[:m], inequality, a.lower[m:], a.upper[m:])
        if self._solver is None:
            self._solver = self._module.SparseSolver()
            options, s = self._solver.settings, self.settings
            options.kkt_solver = getattr(self._module.KKTSolver, s.kkt_solver)
            options.eps_abs = options.eps_duality_gap_abs = s.tolerance
            options.eps_rel = options.eps_duality_gap_rel = 0.0
            options.max_iter = s.max_iterations
            options.preconditioner_reuse_on_update = True
            self._solver.setup(*data)
        else:
            self._solver.update(*data)
        code = self._solver.solve()
        result = self._solver.result
        self.iterations = int(result.info.iter)
        status = _STATUS.get(code.name, Status.FAILED)
        far = not result.info.primal_res <= max(_FAR * self.settings.tolerance, _NEAR)
        if status is Status.ITERATION_LIMIT and far:
            status = Status.INFEASIBLE  # PIQP often runs out of iterations before it can prove infeasibility
        if status.usable:
            a.z[:] = result.x
            a.y[:m] = result.y
            np.subtract(result.z_u, result.z_l, out=a.y[m:])
        return status


class Cascade:
    """:class:`~lgmpc.solvers.qp.QpSolver` that tries the next one where one does not solve the problem.

    Where none does, the first approximate solution counts; without any, the last solver's status.

    Args:
        solvers: of the same :class:`~lgmpc.ocp.OcpQp`, in the order in which they are tried.

    Attributes:
        iterations: of all that were tried in the last solve.

    Raises:
        InputError: no solver, or solvers of different problems.
    """

    name = "cascade"
    takes_indefinite = False
    may_take_over = True

    def __init__(self, solvers: Sequence[QpSolver]) -> None:
        if not solvers or any(solver.qp is not solvers[0].qp for solver in solvers):
            raise InputError("solvers", f"{len(solvers)}", "at least one, all of the same problem")
        self.qp: OcpQp = solvers[0].qp
        self.iterations = 0
        self._solvers = tuple(solvers)
        self.solution = QpSolution.zeros(self.qp)

    def reset(self) -> None:
        """Discard all state of earlier solves."""
        self.solution.write(0.0, 0.0, 0.0, 0.0)
        for solver in self._solvers:
            solver.reset()

    def feedback(self, multipliers: Array) -> Array:
        """Return the gains of the first solver, if it has any."""
        return self._solvers[0].feedback(multipliers)

    def prepare(self) -> None:
        """Do nothing: :meth:`solve` prepares each solver that it tries."""

    def solve(self, dx0: Array) -> Status:
        """Solve; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        self.iterations = 0
        approximate = False
        for solver in self._solvers:
            solver.prepare()
            status = solver.solve(dx0)
            self.iterations += solver.iterations
            if status is Status.CONVERGED or (status is Status.ITERATION_LIMIT and not approximate):
                approximate = True
                self.solution.write(*solver.solution.arrays)
            if status in (Status.CONVERGED, Status.NOT_FINITE):
                return status
        return Status.ITERATION_LIMIT if approximate else status
