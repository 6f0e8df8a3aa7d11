"""Sequential quadratic programming with the real-time iteration's split into preparation and feedback.

An iteration expands the problem around the current trajectory, solves the linear-quadratic problem and takes the full
step. Everything that does not need the measured state (expansion, matrices, factorisation) is the preparation; the
feedback embeds the measured state and solves. Diehl, Bock, Schloder, "A real-time iteration scheme for nonlinear
optimization in optimal feedback control", SIAM J. Control Optim. 43, 2005.

The Hessian is the Gauss-Newton one: near a solution the iterates approach it linearly, the faster the smaller the
dynamics' curvature times the costates; the limit satisfies the exact optimality conditions.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from lgmpc.compile import BatchKernel, StageKernel, cached
from lgmpc.errors import InputError
from lgmpc.ocp import KktConditions, KktResidual, OcpQp, ShootingProblem, SubproblemFunctions, Trajectory
from lgmpc.ocp.horizon import advance, difference
from lgmpc.solvers.qp import QpSolver, QpStatus, make_qp_solver
from lgmpc.state import State
from lgmpc.typing import Array

__all__ = ["RealTimeResult", "RealTimeSqp", "RealTimeStatus", "RealTimeTimings"]


class RealTimeStatus(Enum):
    """Outcome of the iterations; the value is the remedy."""

    CONVERGED = "nothing to do"
    STEPPED = "nothing to do: the requested iterations were taken"
    INACCURATE = "the last subproblem was solved loosely: give the QP solver more iterations or a looser tolerance"
    ITERATION_LIMIT = "raise the number of iterations, or start closer to the solution"
    QP_FAILED = "the subproblem has no solution: check bounds, weights and the first state"
    NOT_FINITE = "state, references or parameters hold NaN or infinity"

    @property
    def usable(self) -> bool:
        """Whether a step was taken."""
        return self not in (RealTimeStatus.QP_FAILED, RealTimeStatus.NOT_FINITE)


@dataclass(frozen=True)
class RealTimeTimings:
    """Computing times of the two phases, s.

    Attributes:
        preparation: expansion, matrices, factorisation.
        feedback: solution of the subproblem and the step.
    """

    preparation: float
    feedback: float

    @property
    def total(self) -> float:
        """Preparation and feedback."""
        return self.preparation + self.feedback


@dataclass(frozen=True)
class RealTimeResult:
    """The trajectory after the last step of :class:`RealTimeSqp`.

    Attributes:
        trajectory: states (N+1, nx) and controls (N, nu); arrays of its own.
        costates: (N, ndx) multipliers of the dynamics.
        multipliers: (N, ng) of the path constraint.
        status: outcome.
        iterations: subproblems solved.
        qp_iterations: of the QP solver, all subproblems together.
        kkt: residual of the optimality conditions; of the last subproblem (STEPPED, INACCURATE) or, from
            :meth:`RealTimeSqp.solve`, of the nonlinear problem.
        timings: of all iterations together.
    """

    trajectory: Trajectory
    costates: Array
    multipliers: Array
    status: RealTimeStatus
    iterations: int
    qp_iterations: int
    kkt: KktResidual
    timings: RealTimeTimings


class RealTimeSqp:
    """Real-time iterations, or iterations to convergence, on one :class:`~lgmpc.ocp.ShootingProblem`.

    The problem's parameters are read at every preparation. The current trajectory is in :attr:`xs` and :attr:`us`,
    which may be written.

    Args:
        problem: the problem.
        qp_solver: name of the solver of the subproblems, or a function that makes one.
        progress: called with a description of what is being compiled.

    Attributes:
        xs: (N+1, nx) current states.
        us: (N, nu) current controls.
        qp: the current subproblem.
        qp_solver: its solver.

    Raises:
        InputError: actions that differ, or no such QP solver.
        MissingDependencyError: its package is not installed.
    """

    def __init__(
        self,
        problem: ShootingProblem,
        qp_solver: str | Callable[[OcpQp], QpSolver] = "active_set",
        progress: Callable[[str], None] | None = None,
    ) -> None:
        self.problem = problem
        state = problem.action.state  # controls and multipliers are shifted: all nodes have the same
        f = self._functions = SubproblemFunctions(problem, progress)
        self.xs: Array = f.xs
        self.us: Array = f.us
        self.qp = f.qp
        self.qp_solver = (
            make_qp_solver(qp_solver, self.qp, progress) if isinstance(qp_solver, str) else qp_solver(self.qp)
        )
        self._kkt = KktConditions(self.qp, progress)
        move, subtract = cached(_compile, state, progress=progress)
        self._fraction, self._x0, self._dx0 = np.zeros(1), np.zeros(state.nx), np.zeros(state.ndx)
        self._move = move.bind(problem.nodes, x=f.xs_base, x_next=f.xs_base[1:], fraction=self._fraction, moved=self.xs)
        self._subtract = subtract.bind(1, x0=self.xs[0], x1=self._x0, dx=self._dx0)
        self._preparation = 0.0

    @property
    def compiled(self) -> bool:
        """Whether the horizon's functions are machine code."""
        return self._functions.compiled

    def set_guess(self, trajectory: Trajectory) -> None:
        """Start from a trajectory; multipliers start from zero.

        Raises:
            InputError: wrong shapes.
        """
        for name, mine, given in (("xs", self.xs, trajectory.xs), ("us", self.us, trajectory.us)):
            if np.shape(given) != mine.shape:
                raise InputError(name, f"shape {np.shape(given)}", f"shape {mine.shape}")
        self.xs[:] = trajectory.xs
        self.us[:] = trajectory.us
        self.qp_solver.reset()

    def shift(self, fraction: float) -> None:
        """Move trajectory and multipliers ahead in time by a fraction (0 to 1) of an interval.

        States are moved along the line from each node to the next; controls and multipliers likewise; the end stays.
        """
        self._functions.xs_base[...] = self.xs
        self._fraction[0] = fraction
        self._move()
        point = self.qp_solver.solution
        for array in (self.us, point.costates, point.multipliers):
            array[:-1] += fraction * (array[1:] - array[:-1])

    def prepare(self) -> None:
        """Expand the problem around the current trajectory and pass the matrices to the QP solver."""
        start = time.perf_counter()
        self._functions.linearize()
        self.qp_solver.prepare()
        self._preparation = time.perf_counter() - start

    def feedback(self, x0: Array) -> RealTimeResult:
        """Solve the prepared subproblem for the measured state x0 (nx,) and take the full step; never raises.

        When the subproblem has no usable solution the current trajectory stays as it was.
        """
        start = time.perf_counter()
        status = _AFTER_STEP[self._step(x0)]
        kkt = self._residual(at_step=True) if status.usable else KktResidual.unknown()
        return self._result(status, 1, self.qp_solver.iterations, kkt, start, self._preparation)

    def solve(self, max_iterations: int = 50, tolerance: float = 1e-8) -> RealTimeResult:
        """Iterate from the current trajectory until the nonlinear problem's optimality conditions hold.

        Args:
            max_iterations: most subproblems to solve, at least 0.
            tolerance: largest residual of the conditions; the QP solver has to be at least as accurate.

        Raises:
            InputError: a negative number of iterations.
        """
        if max_iterations < 0:
            raise InputError("max_iterations", max_iterations, "at least 0")
        start = time.perf_counter()
        preparation = 0.0
        inner = taken = 0
        while True:
            self.prepare()
            preparation += self._preparation
            start += self._preparation  # the rest is the feedback's share
            kkt = self._residual(at_step=False)
            if kkt.largest <= tolerance and taken > 0:  # the first step moves xs[0] to x0
                return self._result(RealTimeStatus.CONVERGED, taken, inner, kkt, start, preparation)
            if taken >= max_iterations:
                return self._result(RealTimeStatus.ITERATION_LIMIT, taken, inner, kkt, start, preparation)
            status = _AFTER_STEP[self._step(self.problem.x0)]
            inner += self.qp_solver.iterations
            if not status.usable:
                return self._result(status, taken, inner, kkt, start, preparation)
            taken += 1

    def _step(self, x0: Array) -> QpStatus:
        f, step = self._functions, self.qp_solver.solution
        self._x0[...] = x0
        self._subtract()
        status = self.qp_solver.solve(self._dx0)
        if _AFTER_STEP[status].usable:
            f.xs_base[...], f.dxs[...] = f.xs, step.dxs
            f.retract()
            self.us += step.dus
        return status

    def _residual(self, *, at_step: bool) -> KktResidual:
        """Return the residual of the subproblem at its solution, or of the nonlinear problem around it."""
        kkt, point = self._kkt, self.qp_solver.solution
        kkt.dxs[...] = point.dxs if at_step else 0.0
        kkt.dus[...] = point.dus if at_step else 0.0
        kkt.costates[...] = point.costates
        kkt.multipliers[...] = point.multipliers
        return kkt.residual()

    def _result(
        self, status: RealTimeStatus, iterations: int, inner: int, kkt: KktResidual, start: float, preparation: float
    ) -> RealTimeResult:
        point = self.qp_solver.solution
        trajectory = Trajectory(self.xs.copy(), self.us.copy())
        elapsed = time.perf_counter() - start
        timings = RealTimeTimings(preparation, elapsed)
        return RealTimeResult(
            trajectory, point.costates.copy(), point.multipliers.copy(), status, iterations, inner, kkt, timings
        )


def _compile(state: State, progress: Callable[[str], None] | None) -> tuple[BatchKernel, StageKernel]:
    """Return the shift of states in time, and their difference."""
    return BatchKernel(advance(state), progress), StageKernel(difference(state), progress)


_AFTER_STEP = {
    QpStatus.SOLVED: RealTimeStatus.STEPPED,
    QpStatus.MAX_ITERATIONS: RealTimeStatus.INACCURATE,
    QpStatus.INFEASIBLE: RealTimeStatus.QP_FAILED,
    QpStatus.UNBOUNDED: RealTimeStatus.QP_FAILED,
    QpStatus.NUMERICAL: RealTimeStatus.QP_FAILED,
    QpStatus.NOT_FINITE: RealTimeStatus.NOT_FINITE,
}
