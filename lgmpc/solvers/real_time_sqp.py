"""Sequential quadratic programming with the real-time iteration's split into preparation and feedback.

An iteration expands the problem around the current trajectory, solves the linear-quadratic problem and takes the full
step. Everything that does not need the measured state (expansion, matrices, factorisation) is the preparation; the
feedback embeds the measured state and solves. Diehl, Bock, Schloder, "A real-time iteration scheme for nonlinear
optimization in optimal feedback control", SIAM J. Control Optim. 43, 2005.

The Hessian is the Gauss-Newton one: near a solution the iterates approach it linearly, the faster the smaller the
dynamics' curvature times the costates; the limit satisfies the exact optimality conditions.
"""

import math
import time
from collections.abc import Callable

import casadi as ca
import numpy as np

from lgmpc.compile import BatchKernel, StageKernel, cached
from lgmpc.ocp import KktResidual, OcpQp, ShootingProblem, SubproblemFunctions, Trajectory
from lgmpc.ocp.horizon import advance, difference
from lgmpc.solvers.qp import QpSolver, make_qp_solver
from lgmpc.solvers.solution import Solution, Timings
from lgmpc.state import State
from lgmpc.status import Status
from lgmpc.typing import Array, instance, numbers


class RealTimeSqp:
    """Real-time iterations on one :class:`~lgmpc.ocp.ShootingProblem`.

    The problem's parameters are read at every preparation. The current trajectory is in :attr:`xs` and :attr:`us`,
    which may be written.

    Args:
        problem: the problem.
        qp_solver: name of the solver of the subproblems, or a function that makes one.

    Attributes:
        xs: (N+1, nx) current states.
        us: (N, nu) current controls.
        qp: the current subproblem.
        qp_solver: its solver.

    Raises:
        InputError: actions that differ, or no such QP solver.
        MissingDependencyError: its package is not installed.
    """

    def __init__(self, problem: ShootingProblem, qp_solver: str | Callable[[OcpQp], QpSolver] = "active_set") -> None:
        instance("problem", problem, ShootingProblem, "a ShootingProblem")
        self.problem = problem
        state = problem.action.state  # controls and multipliers are shifted: all nodes have the same
        f = self._functions = SubproblemFunctions(problem)
        self.xs: Array = f.xs
        self.us: Array = f.us
        self.qp = f.qp
        self.qp_solver = make_qp_solver(qp_solver, self.qp)
        move, subtract = cached(_compile, state)
        self._fraction, self._x0, self._dx0 = np.zeros(1), np.zeros(state.nx), np.zeros(state.ndx)
        self._move = move.bind(problem.nodes, x=f.xs_base, x_next=f.xs_base[1:], fraction=self._fraction, moved=self.xs)
        self._subtract = subtract.bind(1, x0=self.xs[0], x1=self._x0, dx=self._dx0)
        point = self.qp_solver.solution
        self._shifts = [
            StageKernel.of(_shift, array.shape[1]).bind(
                problem.nodes - 1, row=array, row_next=array[1:], fraction=self._fraction, moved=array
            )
            for array in (self.us, point.costates, point.multipliers)
            if array.size
        ]
        self._preparation, self._none = 0.0, np.zeros((0, problem.nu, state.ndx))

    @property
    def compiled(self) -> bool:
        """True if the horizon's functions are machine code."""
        return self._functions.compiled

    def set_guess(self, trajectory: Trajectory) -> None:
        """Start from a trajectory; multipliers start from zero.

        Raises:
            InputError: wrong shapes.
        """
        instance("trajectory", trajectory, Trajectory, "a Trajectory(xs, us)")
        self.xs[:] = numbers("xs", trajectory.xs, self.xs.shape)
        self.us[:] = numbers("us", trajectory.us, self.us.shape)
        self.qp_solver.reset()

    def shift(self, fraction: float) -> None:
        """Move trajectory and multipliers ahead in time by a fraction (0 to 1) of an interval.

        States are moved along the line from each node to the next; controls and multipliers likewise; the end stays.
        """
        self._functions.xs_base[...] = self.xs
        self._fraction[0] = fraction if type(fraction) is float else numbers("fraction", fraction, ())
        self._move()
        for shift in self._shifts:
            shift()

    def prepare(self) -> None:
        """Expand the problem around the current trajectory and pass the matrices to the QP solver."""
        start = time.perf_counter()
        self._functions.linearize()
        self.qp_solver.prepare()
        self._preparation = time.perf_counter() - start

    def feedback(self, x0: Array) -> Solution:
        """Solve the prepared subproblem for the measured state x0 (nx,) and take the full step; never raises.

        The status is STEPPED, or ACCEPTABLE after a subproblem that was solved roughly, whose solution has the residual
        of the optimality conditions (that of all is :meth:`residual`). When the subproblem has no usable solution the
        status is the QP solver's, and the current trajectory stays as it was.
        """
        start = time.perf_counter()
        status, point = self._step(x0), self.qp_solver.solution
        kkt = self.residual() if status is Status.ACCEPTABLE else KktResidual.unknown()
        elapsed = time.perf_counter() - start
        return Solution(
            self.problem, self.xs.copy(), self.us.copy(), self._none, self._none[:, 0], point.costates.copy(),
            point.multipliers.copy(), status, 1, math.nan, self._none[:, 0], kkt,
            Timings(self._preparation + elapsed, self._preparation, elapsed), qp_iterations=self.qp_solver.iterations,
        )  # fmt: skip

    def residual(self) -> KktResidual:
        """Return the residual of the last subproblem's optimality conditions at its solution."""
        return self.qp_solver.solution.residual()

    def _step(self, x0: Array) -> Status:
        f, step = self._functions, self.qp_solver.solution
        self._x0[...] = x0
        self._subtract()
        status = self.qp_solver.solve(self._dx0)
        if not status.usable:
            return status
        f.xs_base[...], f.dxs[...] = f.xs, step.dxs
        f.retract()
        self.us += step.dus
        return Status.STEPPED if status is Status.CONVERGED else Status.ACCEPTABLE


def _compile(state: State) -> tuple[BatchKernel, StageKernel]:
    """Return the shift of states in time, and their difference."""
    return BatchKernel(advance(state)), StageKernel(difference(state))


def _shift(size: int) -> ca.Function:
    """Return a row of numbers, moved by a fraction of the way towards the next one."""
    row, row_next, fraction = ca.SX.sym("row", size), ca.SX.sym("row_next", size), ca.SX.sym("fraction")
    moved = row + fraction * (row_next - row)
    return ca.Function(f"shift_{size}", [row, row_next, fraction], [moved], ["row", "row_next", "fraction"], ["moved"])
