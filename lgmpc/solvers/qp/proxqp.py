"""ProxQP: a primal-dual augmented Lagrangian method (Bambade, El-Kazdadi, Taylor, Carpentier, RSS 2022)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lgmpc.errors import MissingDependencyError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.assembly import GeneralQpSolver, SparseAssembly
from lgmpc.status import Status

__all__ = ["ProxqpSettings", "ProxqpSolver"]

_STATUS = {
    "PROXQP_SOLVED": Status.CONVERGED,
    "PROXQP_MAX_ITER_REACHED": Status.ITERATION_LIMIT,
    "PROXQP_PRIMAL_INFEASIBLE": Status.INFEASIBLE,
    "PROXQP_DUAL_INFEASIBLE": Status.UNBOUNDED,
}


@dataclass(frozen=True)
class ProxqpSettings:
    """Tolerance and limits of :class:`ProxqpSolver`.

    Attributes:
        tolerance: absolute residual at which it stops.
        max_iterations: outer iterations.
        max_inner_iterations: within each of them. Both are low: with hundreds of active rows the method may need
            thousands, and they take milliseconds each.
    """

    tolerance: float = 1e-6
    max_iterations: int = 20
    max_inner_iterations: int = 50


class ProxqpSolver(GeneralQpSolver):
    """:class:`~lgmpc.solvers.qp.QpSolver` on ProxQP's sparse backend, warm-started in z and y.

    Args:
        qp: the problem.
        settings: tolerance and iterations.

    Raises:
        MissingDependencyError: ProxSuite is not installed.
    """

    name = "proxqp"
    warm_started = True

    def __init__(self, qp: OcpQp, settings: ProxqpSettings | None = None) -> None:
        try:
            from lgmpc.proxqp import proxqp
        except ImportError as error:
            install = 'pip install "proxsuite>=0.7,<0.9"'
            raise MissingDependencyError("proxsuite", "the QP solver 'proxqp'", install) from error
        super().__init__(SparseAssembly(qp))
        self.settings = ProxqpSettings() if settings is None else settings
        self._module: Any = proxqp
        self._zero = np.zeros(self._assembly.size)

    def _run(self) -> Status:
        a, m = self._assembly, self._assembly.equalities
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
        status = _STATUS.get(results.info.status.name, Status.FAILED)
        if status.usable:
            a.z[:] = results.x
            a.y[:m] = results.y
            a.y[m:] = results.z
        return status
