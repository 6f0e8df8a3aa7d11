"""The whole-body QP's solver: active sets in machine code, and ProxQP where they do not solve it.

The first is a dual active-set method that begins from the last tick's active limits.
With the Hessian's Cholesky factor the variables are whitened, ``y = L^T x``, so that the cost is the distance from
``y0 = -L^-1 g`` and every step a projection onto the active constraints' normals, of which a thin QR factorisation is
updated from one active set to the next. The limits that were active at the last tick are tried first. Those whose
multipliers have the wrong sign are left out, which gives the minimiser under some of the limits; from there the dual
method of Goldfarb and Idnani adds one violated limit after the other ("A numerically stable dual method for solving
strictly convex quadratic programs", Math. Prog. 27, 1983). Limits that depend on the active ones (many facets meet at
the tip of a friction pyramid) replace one of them. Variables with equal bounds, such as the forces of feet in the air,
are left out of the problem.
"""

import ctypes
from collections.abc import Callable
from importlib.resources import files
from typing import Any, ClassVar, Literal

import numpy as np

from lgmpc.compile import compile_source
from lgmpc.proxqp import proxqp
from lgmpc.status import Status
from lgmpc.typing import Array

MOST_STEPS = 200
"""Limits that a solve may add or remove."""
_INFEASIBILITY_TOLERANCE = 1e-10
_NEWTON_STEPS = 10
_MU_EQUALITIES, _MU_INEQUALITIES = 1e-5, 1e-3


class WholeBodySolver:
    """The QP's memory, and two solvers of it with a status instead of an exception.

    :class:`DualActiveSet` solves the QP exactly, starting with the limits that were active at the last tick. ProxQP,
    which is slower, takes the remaining cases: a Hessian that is only positive semidefinite, limits that contradict
    each other, and a machine without a C compiler.

    The data is written directly into ProxQP's own memory. Rows and bounds that are never written have no effect.

    Args:
        variables: n.
        equalities: rows of the equalities.
        inequalities: m, rows of the inequalities.
        tolerance: largest absolute residual of the optimality conditions.
        max_iterations: ProxQP's outer iterations, each of at most 10 Newton steps.
        method: ``active_set``, or ``proxqp`` for ProxQP alone.

    Attributes:
        size: n.
        hessian: (n, n).
        gradient: (n,).
        equality: (e, n), with equality_rhs (e,).
        inequality: (m, n), with lower (m,) and upper (m,).
        box_lower: (n,).
        box_upper: (n,).
        solution: (n,) variables of the last solve.
        values: (m,) ``inequality solution``.
        took_over: whether ProxQP did the last solve.

    Raises:
        CompileError: the compiler failed.
    """

    UNBOUNDED: ClassVar[float] = 1e20
    """ProxQP's infinity."""

    def __init__(
        self, variables: int, equalities: int, inequalities: int, tolerance: float = 1e-6, max_iterations: int = 50,
        method: Literal["active_set", "proxqp"] = "active_set",
    ) -> None:  # fmt: skip
        self.size = variables
        self._qp = qp = proxqp.dense.QP(variables, equalities, inequalities, True)
        settings = qp.settings
        settings.eps_abs = tolerance
        settings.eps_rel = 0.0
        settings.max_iter = max_iterations
        # With the default, 1500, a distant target could delay a tick by seconds.
        settings.max_iter_in = _NEWTON_STEPS
        # In SI units this problem is scaled well enough: equilibrated, it takes more iterations.
        settings.compute_preconditioner = False
        # Penalties 100 times the default ones shorten the slowest ticks of a push; larger ones lengthen cold starts
        # with many active limits.
        settings.default_mu_eq, settings.default_mu_in = _MU_EQUALITIES, _MU_INEQUALITIES
        # With the default, 1e-4, ProxQP reports feasible QPs as infeasible when the active set changes abruptly.
        settings.eps_primal_inf = settings.eps_dual_inf = _INFEASIBILITY_TOLERANCE
        model = qp.model
        self.hessian: Array = model.H
        self.gradient: Array = model.g
        self.equality: Array = model.A
        self.equality_rhs: Array = model.b
        self.inequality: Array = model.C
        self.lower: Array = model.l
        self.upper: Array = model.u
        self.box_lower: Array = model.l_box
        self.box_upper: Array = model.u_box
        for bound, value in ((self.lower, -1), (self.upper, 1), (self.box_lower, -1), (self.box_upper, 1)):
            bound[:] = value * self.UNBOUNDED
        self._active_set = DualActiveSet(
            self.hessian, self.gradient, self.equality, self.equality_rhs, self.inequality, self.lower, self.upper,
            self.box_lower, self.box_upper, tolerance,
        )  # fmt: skip
        self.solution: Array = self._active_set.solution
        self.values: Array = self._active_set.values
        self._try_active_set = self._active_set.solve if method == "active_set" else _not_tried
        self.took_over, self._fresh = False, True

    def reset(self) -> None:
        """Discard the warm start: the next solve begins as the first one did."""
        self._active_set.reset()
        self._fresh = True

    def solve(self) -> Status:
        """Solve the QP in memory; the result is in :attr:`solution`."""
        self.took_over = not self._try_active_set()
        if self.took_over:
            return self._solve_by_proxqp()
        self._fresh = True  # ProxQP's multipliers are of an earlier tick
        return Status.CONVERGED

    def _solve_by_proxqp(self) -> Status:
        """Solve; a warm start that fails is followed by one cold start on the same problem."""
        status = self._cold_start() if self._fresh else self._warm_start()
        if status is not Status.CONVERGED and not self._fresh:
            status = self._cold_start()
        self._fresh = status is not Status.CONVERGED
        self.solution[:] = self._qp.results.x
        np.dot(self.inequality, self.solution, out=self.values)
        return status

    def _cold_start(self) -> Status:
        qp, model = self._qp, self._qp.model
        qp.settings.initial_guess = proxqp.InitialGuess.EQUALITY_CONSTRAINED_INITIAL_GUESS
        qp.init(model.H, model.g, model.A, model.b, model.C, model.l, model.u, model.l_box, model.u_box, False)
        qp.solve()
        return self._read_status()

    def _warm_start(self) -> Status:
        self._qp.settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        # The data is in place already; naming one matrix makes ProxQP factorise it anew.
        self._qp.update(A=self.equality)
        self._qp.solve()
        return self._read_status()

    @property
    def active(self) -> int:
        """Limits that the next solve begins with."""
        return self._active_set.active

    @property
    def iterations(self) -> int:
        """Limits added and removed in the last solve; ProxQP's inner iterations if it took over."""
        return int(self._qp.results.info.iter) if self.took_over else self._active_set.steps

    def _read_status(self) -> Status:
        code = self._qp.results.info.status
        if code == proxqp.QPSolverOutput.PROXQP_SOLVED:
            return Status.CONVERGED
        if code == proxqp.QPSolverOutput.PROXQP_MAX_ITER_REACHED:
            return Status.ITERATION_LIMIT
        return Status.INFEASIBLE


def _not_tried() -> bool:
    return False


class DualActiveSet:
    """Solves one QP after another in memory that the caller writes to (see the module).

    ::

        minimise    1/2 x^T hessian x + gradient^T x
        subject to  equality x = equality_rhs,  lower <= inequality x <= upper,  box_lower <= x <= box_upper

    Args:
        hessian: (n, n), symmetric; it has to be positive definite where the variables are not fixed.
        gradient: (n,).
        equality: (e, n).
        equality_rhs: (e,).
        inequality: (m, n).
        lower: (m,).
        upper: (m,).
        box_lower: (n,).
        box_upper: (n,).
        tolerance: largest residual of the optimality conditions.

    Attributes:
        available: whether there is machine code; without a compiler nothing is ever solved.
        solution: (n,) minimiser of the last solve.
        values: (m,) ``inequality x`` there.

    Raises:
        CompileError: the compiler failed.
    """

    def __init__(
        self, hessian: Array, gradient: Array, equality: Array, equality_rhs: Array, inequality: Array, lower: Array,
        upper: Array, box_lower: Array, box_upper: Array, tolerance: float,
    ) -> None:  # fmt: skip
        (m, n), e = inequality.shape, len(equality)
        self.solution: Array = np.zeros(n)
        self.values: Array = np.zeros(m)
        self._plan = np.array([n, e, m, MOST_STEPS, 0, 0], dtype=np.int64)
        # The rest of the integers' memory holds flags of variables and limits, a byte each.
        integers = np.zeros(3 * n + (2 * n + m) // 4 + 1, dtype=np.int32)
        self._memory = (
            self._plan, np.array([tolerance]), hessian, gradient, equality, equality_rhs, inequality, lower, upper,
            box_lower, box_upper, self.solution, self.values, np.zeros(3 * n * n + 11 * n), integers,
        )  # fmt: skip
        assert all(array.flags.c_contiguous for array in self._memory)
        self._frame = (ctypes.c_void_p * len(self._memory))(*(array.ctypes.data for array in self._memory))
        library = compile_source("lgmpc_active_set", (files("lgmpc.wbc") / "active_set.c").read_text())
        self.available = library is not None
        self._call: Callable[[Any], int] = _unavailable if library is None else library.lgmpc_active_set

    @property
    def steps(self) -> int:
        """Limits that the last solve added to the active ones of the one before, or removed."""
        return int(self._plan[5])

    @property
    def active(self) -> int:
        """Number of limits that are active at the solution, without the equalities and the fixed variables."""
        return int(self._plan[4])

    def reset(self) -> None:
        """Discard the active limits: the next solve begins as the first one did."""
        self._plan[4] = 0

    def solve(self) -> bool:
        """Solve; return False, with an undefined solution, if the conditions do not hold to the tolerance."""
        return self._call(self._frame) == 0


def _unavailable(_: Any) -> int:
    return 1
