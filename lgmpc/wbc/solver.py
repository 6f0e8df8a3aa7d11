"""ProxQP for the whole-body QP: dense, warm-started, with a status instead of an exception."""

from __future__ import annotations

import math
from enum import Enum

from lgmpc.proxqp import proxqp
from lgmpc.typing import Array
from lgmpc.wbc.assembly import QpAssembly

__all__ = ["QpStatus", "WholeBodySolver"]

_INFEASIBILITY_TOLERANCE = 1e-10
_NEWTON_STEPS = 10


class QpStatus(Enum):
    """How a tick's QP ended; the value says what to do about it."""

    SOLVED = "nothing to do"
    MAX_ITERATIONS = "the limits may contradict each other or the state; else raise wbc.max_iterations or wbc.tolerance"
    INFEASIBLE = "the limits contradict each other: check torque, friction and normal-force limits"
    NOT_FINITE = "the state or the reference holds NaN or infinity"


class WholeBodySolver:
    """One ProxQP instance that keeps its factorisation and multipliers from tick to tick.

    Args:
        assembly: the QP whose buffers are solved.
        tolerance: absolute residual at which ProxQP stops.
        max_iterations: outer iterations, each of at most 10 Newton steps.
    """

    def __init__(self, assembly: QpAssembly, tolerance: float = 1e-6, max_iterations: int = 50) -> None:
        self._assembly = assembly
        n, ne, ni = assembly.gradient.size, assembly.equality_rhs.size, assembly.lower.size
        self._qp = proxqp.dense.QP(n, ne, ni, True)
        settings = self._qp.settings
        settings.eps_abs = tolerance
        settings.eps_rel = 0.0
        settings.max_iter = max_iterations
        # Rarely more than 3 are of use; at the default 1500, a wild reference could stall a tick for seconds.
        settings.max_iter_in = _NEWTON_STEPS
        # In SI units this problem is scaled well enough: equilibrated, it takes more iterations.
        settings.compute_preconditioner = False
        # At the default 1e-4, ProxQP takes feasible ticks for infeasible ones when the active set changes abruptly.
        settings.eps_primal_inf = settings.eps_dual_inf = _INFEASIBILITY_TOLERANCE
        a = assembly
        self._data = (
            a.hessian,
            a.gradient,
            a.equality,
            a.equality_rhs,
            a.inequality,
            a.lower,
            a.upper,
            a.box_lower,
            a.box_upper,
        )
        self._fresh = True

    def reset(self) -> None:
        """Forget the warm start: the next solve begins as the first one did."""
        self._fresh = True

    def solve(self) -> QpStatus:
        """Solve the assembly's current QP; the result is in :attr:`solution`.

        A warm start that leads nowhere (the active set changed too much since the last tick) is followed by one cold
        start on the same problem.
        """
        a = self._assembly
        # These vectors depend on every input: NaN or infinity anywhere shows in the sum of their squares.
        if not math.isfinite(a.gradient @ a.gradient + a.lower @ a.lower + a.equality_rhs @ a.equality_rhs):
            self._fresh = True
            return QpStatus.NOT_FINITE
        status = self._cold_start() if self._fresh else self._warm_start()
        if status is not QpStatus.SOLVED and not self._fresh:
            status = self._cold_start()
        self._fresh = status is not QpStatus.SOLVED
        return status

    def _cold_start(self) -> QpStatus:
        self._qp.settings.initial_guess = proxqp.InitialGuess.EQUALITY_CONSTRAINED_INITIAL_GUESS
        self._qp.init(*self._data, False)
        self._qp.solve()
        return self._read_status()

    def _warm_start(self) -> QpStatus:
        self._qp.settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self._qp.update(*self._data, False)
        self._qp.solve()
        return self._read_status()

    @property
    def solution(self) -> Array:
        """(n,) variables of the last solve."""
        x: Array = self._qp.results.x
        return x

    @property
    def iterations(self) -> int:
        """ProxQP's inner iterations of the last solve."""
        return int(self._qp.results.info.iter)

    def _read_status(self) -> QpStatus:
        code = self._qp.results.info.status
        if code == proxqp.QPSolverOutput.PROXQP_SOLVED:
            return QpStatus.SOLVED
        if code == proxqp.QPSolverOutput.PROXQP_MAX_ITER_REACHED:
            return QpStatus.MAX_ITERATIONS
        return QpStatus.INFEASIBLE
