"""PIQP: a proximal interior point method, accurate from any start (Schwan, Jiang, Kuhn, Jones, CDC 2023)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lgmpc.errors import InputError, MissingDependencyError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.assembly import SparseAssembly
from lgmpc.solvers.qp.general import GeneralQpSolver
from lgmpc.solvers.qp.protocol import QpStatus

__all__ = ["PiqpSettings", "PiqpSolver"]

KKT_SOLVERS = ("sparse_ldlt", "sparse_multistage")
_FAR = 1e3  # times the tolerance: a point that is further from feasible than this is no approximate solution
_NEAR = 1e-6  # a point that is nearer than this is one, whatever the tolerance
_STATUS = {
    "PIQP_SOLVED": QpStatus.SOLVED,
    "PIQP_MAX_ITER_REACHED": QpStatus.MAX_ITERATIONS,
    "PIQP_PRIMAL_INFEASIBLE": QpStatus.INFEASIBLE,
    "PIQP_DUAL_INFEASIBLE": QpStatus.UNBOUNDED,
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
        if self.kkt_solver not in KKT_SOLVERS:
            raise InputError("kkt_solver", self.kkt_solver, "a linear solver of PIQP", KKT_SOLVERS)


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

    def _run(self) -> QpStatus:
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
        status = _STATUS.get(code.name, QpStatus.NUMERICAL)
        far = not result.info.primal_res <= max(_FAR * self.settings.tolerance, _NEAR)
        if status is QpStatus.MAX_ITERATIONS and far:
            status = QpStatus.INFEASIBLE  # PIQP often runs out of iterations before it can prove infeasibility
        if status in (QpStatus.SOLVED, QpStatus.MAX_ITERATIONS):
            a.z[:] = result.x
            a.y[:m] = result.y
            np.subtract(result.z_u, result.z_l, out=a.y[m:])
        return status
