"""ProxQP: a primal-dual augmented Lagrangian method (Bambade, El-Kazdadi, Taylor, Carpentier, RSS 2022)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lgmpc.errors import MissingDependencyError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.assembly import SparseAssembly
from lgmpc.solvers.qp.protocol import QpSolution, QpStatus
from lgmpc.typing import Array

__all__ = ["ProxqpSettings", "ProxqpSolver"]

_STATUS = {
    "PROXQP_SOLVED": QpStatus.SOLVED,
    "PROXQP_MAX_ITER_REACHED": QpStatus.MAX_ITERATIONS,
    "PROXQP_PRIMAL_INFEASIBLE": QpStatus.INFEASIBLE,
    "PROXQP_DUAL_INFEASIBLE": QpStatus.UNBOUNDED,
}


@dataclass(frozen=True)
class ProxqpSettings:
    """The settings of ProxQP that matter here.

    Attributes:
        tolerance: absolute residual at which it stops.
        max_iterations: outer iterations.
        max_inner_iterations: within each of them. Both are low: with hundreds of active rows the method may need
            thousands, and they take milliseconds each.
    """

    tolerance: float = 1e-6
    max_iterations: int = 20
    max_inner_iterations: int = 50


class ProxqpSolver:
    """:class:`~lgmpc.solvers.qp.QpSolver` on ProxQP's sparse backend, warm-started in z and y.

    Args:
        qp: the problem.
        settings: tolerance and iterations.

    Raises:
        MissingDependencyError: ProxSuite is not installed.
    """

    name = "proxqp"

    def __init__(self, qp: OcpQp, settings: ProxqpSettings | None = None) -> None:
        try:
            from lgmpc.proxqp import proxqp
        except ImportError as error:
            install = 'pip install "proxsuite>=0.7,<0.9"'
            raise MissingDependencyError("proxsuite", "the QP solver 'proxqp'", install) from error
        self.qp = qp
        self.settings = ProxqpSettings() if settings is None else settings
        self.iterations = 0
        self._module: Any = proxqp
        self._assembly = SparseAssembly(qp)
        self.solution: QpSolution = self._assembly.solution
        self._solver: Any = None
        self._finite = False
        self._zero = np.zeros(self._assembly.size)

    def reset(self) -> None:
        """Discard all state of earlier solves."""
        self._solver = None
        self._assembly.z[:] = 0.0
        self._assembly.y[:] = 0.0
        self._assembly.finish()

    def prepare(self) -> None:
        """Take over the matrices."""
        self._finite = self._assembly.load_matrices()

    def solve(self, dx0: Array) -> QpStatus:
        """Solve from the current point; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        a = self._assembly
        if not (a.load_vectors(dx0) and self._finite):
            self._solver = None
            return QpStatus.NOT_FINITE
        m = a.equalities
        equality, inequality = (c.matrix for c in a.constraints)
        data = (a.hessian.matrix, a.gradient, equality, a.lower[:m], inequality, a.lower[m:], a.upper[m:])
        if self._solver is None:
            self._solver = self._module.sparse.QP(a.size, m, a.inequalities)
            self._solver.settings.eps_abs = self.settings.tolerance
            self._solver.settings.eps_rel = 0.0
            self._solver.settings.max_iter = self.settings.max_iterations
            self._solver.settings.max_iter_in = self.settings.max_inner_iterations
            self._solver.settings.initial_guess = self._module.InitialGuess.WARM_START
            self._solver.init(*data)
        else:
            self._solver.update(*data, False)
        self._solver.solve(self._zero, a.y[:m], a.y[m:])
        results = self._solver.results
        self.iterations = int(results.info.iter)
        status = _STATUS.get(results.info.status.name, QpStatus.NUMERICAL)
        if status in (QpStatus.SOLVED, QpStatus.MAX_ITERATIONS):
            a.z[:] = results.x
            a.y[:m] = results.y
            a.y[m:] = results.z
            a.finish()
        else:
            self._solver = None
        return status
