"""Sequential quadratic programming with a line search: hard path constraints, globalised for poor guesses.

Each iteration solves the linear-quadratic problem with its constraints and searches along its step for a decrease of
the exact penalty function

    cost + penalty (sum |gaps| + sum of the constraints' violations),

whose penalty stays above the largest multiplier (Nocedal and Wright, "Numerical optimization", 2nd ed., ch. 18). The
decrease is relative to the worst of the last few points (Grippo, Lampariello, Lucidi, SIAM J. Numer. Anal. 23, 1986),
so that full steps along curved constraints are accepted. After a few steps that have not halved the residual of the
optimality conditions, steps that increase the penalty function must decrease that residual: Gauss-Newton steps are too
long where the curvature of the cost's residuals is positive, and the search must shorten them. Where the linearised
constraints are inconsistent, a step removes a part of the gaps and violations only (Powell, "A fast algorithm for
nonlinearly constrained optimization calculations", Lecture Notes in Mathematics 630, 1978).

Where this fails, far from a solution, or makes no progress for long, an augmented Lagrangian takes over once a solve
(:class:`~lgmpc.solvers.AugmentedLagrangianFddp`), whose roll-outs follow the dynamics but which converges slowly. Its
trajectory and multipliers are where the SQP continues: as an attempt whenever they violate the constraints ten times
less than at the last attempt, and when it has ended. If it finds a stationary point of the violation, the problem is
infeasible.
"""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lgmpc.ocp import KktResidual, OcpQp, ShootingProblem, SubproblemFunctions, Trajectory, kkt_residual
from lgmpc.settings import key
from lgmpc.solvers.augmented_lagrangian import AugmentedLagrangianFddp, AugmentedLagrangianSettings
from lgmpc.solvers.loop import Iterate, IterativeSolver, Progress, SolverSettings, settings_of
from lgmpc.solvers.qp import ActiveSetSolver, DenseRiccati, QpSolver, make_qp_solver
from lgmpc.solvers.solution import Solution, Timings
from lgmpc.solvers.sweep import all_finite
from lgmpc.status import Status
from lgmpc.typing import Array

_KEPT = (0.0, 0.5, 0.9, 0.99)  # fractions of gaps and violations kept by relaxed subproblems, tried in this order
_LEAST_TOLERANCE = 1e-13  # smallest decrease that exceeds rounding errors
_ROUNDING = 1e-13  # of the penalty function
_IDLE = 30  # steps that do not halve the least residual, after which the augmented Lagrangian takes over
_ATTEMPT = 8  # the same after a return from it to steps, before it has ended
_ATTEMPT_BELOW = 1e-2  # largest violation of its minima from which steps are attempted
_NEARER = 0.1  # factor of the violation until the next attempt
_PATIENCE = 6  # most steps that do not halve the residual
_ACCEPTANCE = 1e-4  # least fraction of the expected decrease of an accepted step
_MEMORY = 4  # last points, of which the worst is compared with
_LEAST_STEP = 1e-4  # length below which the search ends without a step
_MARGIN = 1.5  # least ratio of the penalty to the largest multiplier


class LineSearchSqpSettings(SolverSettings):
    """Tolerances of :class:`LineSearchSqp` and of its search."""

    method: Literal["sqp"] = key("sqp", "SQP with a line search; any constraints.")
    max_iterations: Annotated[int, Field(strict=True, ge=0, le=100_000)] = key(
        2000, "Largest number of iterations, those of the augmented Lagrangian included."
    )
    tolerance: Annotated[float, Field(strict=True, ge=_LEAST_TOLERANCE, le=1e9, allow_inf_nan=False)] = key(
        1e-6, "Largest residual of the optimality conditions of a solution."
    )


class LineSearchSqp(IterativeSolver):
    """SQP with a line search, for any :class:`~lgmpc.ocp.ShootingProblem` (see the module).

    For control loops see :class:`~lgmpc.solvers.RealTimeSqp`: one full step a call.

    Args:
        problem: the problem; its data are read at every solve.
        settings: tolerances.
        qp_solver: solver of the subproblems: a name, or a function that returns one. It must be more accurate than the
            tolerance; lgmpc's own unless given.

    Raises:
        InputError: no such QP solver.
        MissingDependencyError: its package is not installed.
    """

    name = "SQP"
    settings: LineSearchSqpSettings

    def __init__(
        self,
        problem: ShootingProblem,
        settings: LineSearchSqpSettings | None = None,
        qp_solver: str | Callable[[OcpQp], QpSolver] | None = None,
    ) -> None:
        self.problem = problem
        self.settings = settings_of(problem, settings, LineSearchSqpSettings)
        self.functions = SubproblemFunctions(problem)
        self._globaliser: AugmentedLagrangianFddp | None = None  # made when it is first needed
        self._global = self._was_global = False  # whether it is working, and whether it has been in this solve
        qp = self.functions.qp
        if qp_solver is not None:
            self.qp_solver = make_qp_solver(qp_solver, qp)
        else:
            riccati = DenseRiccati(qp)
            self.qp_solver = ActiveSetSolver(qp, 1e-2 * self.settings.tolerance, riccati=riccati)

    def _begin(self, guess: Trajectory) -> Status | None:
        f, s = self.functions, self.qp.structure
        f.xs[...] = guess.xs
        f.xs[0] = self.problem.x0
        f.us[...] = guess.us
        for k, action in enumerate(self.problem.actions):
            f.us[k, action.nu :] = 0.0
        self.qp_solver.reset()
        self._costates, self._multipliers = np.zeros((s.nodes, s.ndx)), np.zeros((s.nodes, s.ng))
        self._penalty, self._step_length, self._accepted = 0.0, 1.0, True
        self._last: deque[tuple[float, float]] = deque(maxlen=_MEMORY)
        self._least, self._patience, self._nonmonotone = np.inf, _PATIENCE, True
        self._clock = [0.0, 0.0, 0.0]
        self._global = self._was_global = self._near = self._attempted = False
        self._attempt_below = _ATTEMPT_BELOW
        self._best, self._idle = np.inf, 0
        self.qp_solver.may_use_fallbacks = False  # as long as steps can still be left to the augmented Lagrangian
        self._start = Trajectory(f.xs.copy(), f.us.copy())
        self._linearize(0)
        self._kkt = KktResidual.unknown()
        if not self._finite:
            return Status.NOT_FINITE
        return self._take_multipliers(self._known) if self._known is not None else None

    def _take_multipliers(self, known: Solution) -> Status | None:
        """Start from the multipliers of a solution of a problem of the same size, which may be one of this problem."""
        shapes = self._costates.shape, self._multipliers.shape
        if (known.costates.shape, known.multipliers.shape) != shapes:
            return None
        if not all_finite(known.costates, known.multipliers):
            return None
        self._costates, self._multipliers = known.costates.copy(), known.multipliers.copy()
        self.qp_solver.solution.write(0.0, 0.0, known.costates, known.multipliers)
        self._kkt = self._residual()
        return Status.CONVERGED if self._kkt.largest <= self.settings.tolerance else None

    def _iterate(self) -> Status | None:
        if self._global:
            return self._global_iteration()
        status = self._step()
        lost = status in (Status.STALLED, Status.INFEASIBLE, Status.FAILED, Status.UNBOUNDED)
        better = self._kkt.largest < 0.5 * self._best
        self._best, self._idle = (self._kkt.largest, 0) if better else (self._best, self._idle + 1)
        if self._attempted and (lost or (status is None and self._idle >= _ATTEMPT)):
            self._global, self._attempted = True, False  # it continues where it was
            return None
        if (lost or (status is None and self._idle >= _IDLE)) and not self._was_global:
            if self._start_globaliser():
                return None
            return self._step() if status is Status.FAILED else status
        if status is Status.STALLED and self._was_global and self._near:
            return Status.ACCEPTABLE
        return status

    def _global_iteration(self) -> Status | None:
        """Take one iteration of the augmented Lagrangian, and return to steps where it has ended or come near."""
        inner = self._globaliser
        assert inner is not None
        updates = inner.updates
        status = inner._iterate()
        if status is not None:
            return self._return_to_steps(status)
        if inner.updates > updates and inner.violation <= self._attempt_below:
            self._attempt_below = _NEARER * inner.violation
            status, self._attempted = self._return_to_steps(Status.STOPPED, attempt=True), True
        return status

    def _start_globaliser(self) -> bool:
        """Start the augmented Lagrangian from the current point; False if it does not take the problem."""
        self._was_global = True
        self.qp_solver.may_use_fallbacks = True
        if self._globaliser is None:
            tolerance = max(self.settings.tolerance, 1e-9)
            settings = AugmentedLagrangianSettings(tolerance=tolerance)
            self._globaliser = AugmentedLagrangianFddp(self.problem, settings)
        self._globaliser._known = None
        self._global = self._globaliser._begin(self._start) is None
        return self._global

    def _return_to_steps(self, status: Status, attempt: bool = False) -> Status | None:
        """Continue with steps of the SQP where the augmented Lagrangian has ended with a status, or has not yet."""
        self._take_global_point(attempt)
        if not self._finite or status in (Status.INFEASIBLE, Status.UNBOUNDED):
            return status if self._finite else Status.NOT_FINITE
        self._near, self._best, self._idle = status.solved, np.inf, 0
        self._penalty, self._step_length, self._accepted = 0.0, 1.0, True
        self._last.clear()
        self._least, self._patience, self._nonmonotone = np.inf, _PATIENCE, True
        return Status.CONVERGED if self._kkt.largest <= self.settings.tolerance else None

    def _take_global_point(self, attempt: bool = False) -> None:
        """Take trajectory and multipliers of the augmented Lagrangian."""
        assert self._globaliser is not None
        self._global, f, now = False, self.functions, time.perf_counter()
        found = self._globaliser.current() if attempt else self._globaliser._finish(Status.STOPPED, 0, now)
        f.xs[...], f.us[...] = found.xs, found.us
        self._costates, self._multipliers = found.costates.copy(), found.multipliers.copy()
        self._linearize(0)
        self._kkt = self._residual() if self._finite else KktResidual.unknown()
        self.qp_solver.reset()
        if all_finite(self._costates, self._multipliers):
            self.qp_solver.solution.write(0.0, 0.0, self._costates, self._multipliers)

    def _step(self) -> Status | None:
        """Take one step of the SQP; return a status if it was the last."""
        f, s = self.functions, self.settings
        status, kept = self._subproblem()
        if not status.usable:
            return status
        step = self.qp_solver.solution
        largest = max(float(np.abs(step.costates).max()), float(np.abs(step.multipliers).max(initial=0.0)))
        if self._penalty < _MARGIN * largest:
            self._penalty = 2.0 * _MARGIN * largest
        self._last.append((self._cost, self._infeasibility))
        slope = self._slope(step.dxs, step.dus) - (1.0 - kept) * self._penalty * self._infeasibility
        merits = [cost + self._penalty * outside for cost, outside in self._last]
        worst = max(merits)
        rounding = _ROUNDING * (abs(worst) + self._penalty)  # a change of the penalty alone is no increase
        f.xs_base[...] = f.xs
        us, dxs, dus = f.us.copy(), step.dxs.copy(), step.dus.copy()
        alpha, self._accepted = 1.0, False
        costates, multipliers = self._costates, self._multipliers
        while alpha >= _LEAST_STEP:
            np.multiply(dxs, alpha, out=f.dxs)
            f.retract()
            f.us[...] = us + alpha * dus
            self._linearize(2)
            merit = self._cost + self._penalty * self._infeasibility
            least = _ACCEPTANCE * alpha * min(slope, 0.0) + rounding
            # Multipliers change with the step, so that a trial point's residual is that of its own multipliers.
            self._costates = costates + alpha * (step.costates - costates)
            self._multipliers = multipliers + alpha * (step.multipliers - multipliers)
            if self._finite and merit <= worst + least:
                kkt = self._residual()
                falls = merit <= merits[-1] + least or kkt.largest < self._kkt.largest
                self._accepted = falls or self._nonmonotone
            if self._accepted:
                break
            alpha *= 0.5
        self._step_length = alpha
        if not self._accepted:
            f.xs[...], f.us[...] = f.xs_base, us
            self._costates, self._multipliers = costates, multipliers
            self._linearize(0)
            return Status.STALLED
        self._kkt = kkt
        if self._kkt.largest <= s.tolerance:
            return Status.CONVERGED
        self._patience = _PATIENCE if self._kkt.largest < 0.5 * self._least else self._patience - 1
        self._least = min(self._least, self._kkt.largest)
        self._nonmonotone = self._nonmonotone and self._patience > 0
        return Status.PRECISION_LIMIT if self._patience <= 0 and -slope < rounding else None

    @property
    def qp(self) -> OcpQp:
        """The current subproblem."""
        return self.functions.qp

    def _progress(self, iteration: int, elapsed: float) -> Progress:
        if self._global:
            assert self._globaliser is not None
            return self._globaliser._progress(iteration, elapsed)
        f, s = self.functions, self.qp.structure
        iterate = Iterate.of(f.xs, f.us, np.zeros((0, s.nu, s.ndx)))
        criterion, length = self._kkt.largest, self._step_length
        return Progress(iteration, self._cost, criterion, self._gap, length, 0.0, self._accepted, elapsed, iterate)

    def _finish(self, status: Status, iterations: int, start: float) -> Solution:
        if self._global:
            self._take_global_point()
        f, s = self.functions, self.qp.structure
        if not self._finite:
            status = Status.NOT_FINITE
        expansion, backward, forward = self._clock
        gaps = np.vstack([np.zeros(s.ndx), self.qp.vector("b")])
        kkt = self._residual() if status is not Status.NOT_FINITE else KktResidual.unknown()
        feedback = np.zeros((0, s.nu, s.ndx))
        if status is not Status.NOT_FINITE:
            feedback = self.qp_solver.feedback(self._multipliers)
        solution = Solution(
            self.problem.copy(), f.xs.copy(), f.us.copy(), feedback, np.zeros((0, s.nu)),
            self._costates.copy(), self._multipliers.copy(), status, iterations, self._cost, gaps, kkt,
            Timings(time.perf_counter() - start, expansion, backward, forward), kkt.largest,
        )  # fmt: skip
        # Gains exist where the model is convex along the active rows.
        minimum = not status.solved or len(feedback) > 0 or solution.is_minimum()
        return solution if minimum else replace(solution, status=Status.SADDLE)

    def _subproblem(self) -> tuple[Status, float]:
        """Solve the subproblem, relaxed by a fraction of gaps and violations where it is infeasible."""
        start = time.perf_counter()
        qp = self.qp
        gaps, lower, upper = qp.vector("b"), qp.vector("lower"), qp.vector("upper")
        whole = gaps.copy(), lower.copy(), upper.copy()
        for kept in _KEPT:
            gaps[...] = (1.0 - kept) * whole[0]
            lower[...] = whole[1] - kept * np.maximum(whole[1], 0.0)
            upper[...] = whole[2] - kept * np.minimum(whole[2], 0.0)
            self.qp_solver.prepare()
            status = self.qp_solver.solve(np.zeros(qp.structure.ndx))
            if status not in (Status.INFEASIBLE, Status.FAILED):  # of a failed one it is not known whether it is
                break
        gaps[...], lower[...], upper[...] = whole  # a failed subproblem is not followed by another expansion
        self._clock[1] += time.perf_counter() - start
        return status, kept

    def _linearize(self, clock: int) -> None:
        """Expand around the functions' point, and evaluate its gaps and violations."""
        start = time.perf_counter()
        self.functions.linearize()
        qp = self.qp
        self._finite = qp.is_finite()
        lower, upper = qp.vector("lower"), qp.vector("upper")
        self._finite = self._finite and not (np.isnan(lower).any() or np.isnan(upper).any())
        self._outside = np.maximum(np.maximum(lower, -upper), 0.0)
        gaps = np.abs(qp.vector("b"))
        self._gap = float(gaps.max())
        self._infeasibility = float(gaps.sum() + self._outside.sum())
        last = qp.terminal_values[qp.structure.terminal_blocks["cost"].where]
        self._cost = float(qp.vector("cost").sum() + last[0]) if self._finite else np.nan
        self._clock[clock] += time.perf_counter() - start

    def _slope(self, dxs: Array, dus: Array) -> float:
        """Return the slope of the cost along a step."""
        qp = self.qp
        last = qp.terminal_values[qp.structure.terminal_blocks["q"].where]
        inner = np.vdot(qp.vector("q"), dxs[:-1]) + np.vdot(qp.vector("r"), dus)
        return float(inner + np.vdot(last, dxs[-1]))

    def _residual(self) -> KktResidual:
        """Return the residual of the nonlinear problem's conditions at the point of expansion."""
        return kkt_residual(self.qp, self._costates, self._multipliers)
