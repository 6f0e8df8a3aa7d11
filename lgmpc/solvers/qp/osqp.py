"""OSQP: operator splitting, fast where it starts close to the solution (Stellato et al., Math. Prog. Comp. 2020).

Every setting that would depend on the clock is fixed: the same inputs give the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lgmpc.errors import MissingDependencyError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.assembly import GeneralQpSolver, SparseAssembly
from lgmpc.status import Status

__all__ = ["OsqpSettings", "OsqpSolver"]

_INFINITY = 1e30  # OSQP's
_STATUS = {
    "OSQP_SOLVED": Status.CONVERGED,
    "OSQP_SOLVED_INACCURATE": Status.ITERATION_LIMIT,
    "OSQP_MAX_ITER_REACHED": Status.ITERATION_LIMIT,
    "OSQP_PRIMAL_INFEASIBLE": Status.INFEASIBLE,
    "OSQP_PRIMAL_INFEASIBLE_INACCURATE": Status.INFEASIBLE,
    "OSQP_DUAL_INFEASIBLE": Status.UNBOUNDED,
    "OSQP_DUAL_INFEASIBLE_INACCURATE": Status.UNBOUNDED,
}


@dataclass(frozen=True)
class OsqpSettings:
    """Tolerance and limits of :class:`OsqpSolver`.

    Attributes:
        tolerance: absolute and relative residual at which it stops.
        max_iterations: of the splitting.
        rho: first step size; adapted to the ratio of the residuals.
        check_interval: iterations between two checks of the residuals.
        polish: solve once more with the active constraints as equalities, for full accuracy.
    """

    tolerance: float = 1e-5
    max_iterations: int = 400
    rho: float = 1.0
    check_interval: int = 5
    polish: bool = False


class OsqpSolver(GeneralQpSolver):
    """:class:`~lgmpc.solvers.qp.QpSolver` on OSQP; warm-started in z and y; factorises in :meth:`prepare`.

    Args:
        qp: the problem.
        settings: tolerance and iterations.

    Raises:
        MissingDependencyError: OSQP is not installed.
    """

    name = "osqp"
    warm_started = True

    def __init__(self, qp: OcpQp, settings: OsqpSettings | None = None) -> None:
        try:
            from osqp import ext_builtin
        except ImportError as error:
            raise MissingDependencyError("osqp", "the QP solver 'osqp'", 'pip install "osqp>=1.0,<2"') from error
        super().__init__(SparseAssembly(qp, triangular=True, stacked=True))
        self.settings = OsqpSettings() if settings is None else settings
        self._module: Any = ext_builtin
        self._zero = np.zeros(self._assembly.size)
        self._codes = {
            int(v): _STATUS.get(k, Status.FAILED) for k, v in ext_builtin.osqp_status_type.__members__.items()
        }

    def prepare(self) -> None:
        """Take over the matrices and factorise."""
        super().prepare()
        a = self._assembly
        if self._finite and self._solver is not None:
            self._solver.update_data_mat(a.hessian.matrix.data, None, a.constraints[0].matrix.data, None)

    def _run(self) -> Status:
        a = self._assembly
        np.maximum(a.lower, -_INFINITY, out=a.lower)
        np.minimum(a.upper, _INFINITY, out=a.upper)
        if self._solver is None:
            self._setup()
        else:
            self._solver.update_data_vec(a.gradient, a.lower, a.upper)
        self._solver.warm_start(self._zero, a.y)
        self._solver.solve()
        info = self._solver.info
        self.iterations = int(info.iter)
        status = self._codes[int(info.status_val)]
        if status.usable:
            a.z[:] = self._solver.solution.x
            a.y[:] = self._solver.solution.y
        return status

    def _setup(self) -> None:
        module, a, s = self._module, self._assembly, self.settings
        options = module.OSQPSettings()
        module.osqp_set_default_settings(options)
        values = {
            "verbose": 0,
            "eps_abs": s.tolerance,
            "eps_rel": s.tolerance,
            "max_iter": s.max_iterations,
            "rho": s.rho,
            "check_termination": s.check_interval,
            "polishing": int(s.polish),
            "warm_starting": 1,
            # OSQP's own choice of when to adapt rho reads the clock.
            "adaptive_rho": 1,
            "adaptive_rho_interval": 5 * s.check_interval,
        }
        for name, value in values.items():
            setattr(options, name, value)
        matrices = (module.CSC(a.hessian.matrix), module.CSC(a.constraints[0].matrix))
        rows = a.equalities + a.inequalities
        self._solver = module.OSQPSolver(matrices[0], a.gradient, matrices[1], a.lower, a.upper, rows, a.size, options)
