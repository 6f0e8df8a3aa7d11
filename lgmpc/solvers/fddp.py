"""Feasibility-driven differential dynamic programming, for problems without path constraints.

The guess may be infeasible. A step of length alpha keeps ``1 - alpha`` of each gap of the dynamics, as in multiple
shooting, and the states are those of a roll-out under the sweep's feedback, as in differential dynamic programming.
Mastalli et al., "Crocoddyl: an efficient and versatile framework for multi-contact optimal control", ICRA 2020.

Acceptance and regularisation are those of Crocoddyl 3, with the same settings and iteration counts, but for two points.
An increase of the cost, which closing gaps may require, is bounded by that of the model: the increase expected along a
trial's own states grows with a trial that diverges. A solution must also be stationary (see
:class:`~lgmpc.solvers.FddpSettings`) and a minimum of the model without regularisation, which may take an iteration or
two more.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from lgmpc.errors import InputError
from lgmpc.ocp import KktResidual, LagrangianHessians, ShootingFunctions, ShootingProblem, Trajectory
from lgmpc.solvers.box import BoxSweep
from lgmpc.solvers.curvature import CURVATURES
from lgmpc.solvers.fddp_settings import FddpSettings
from lgmpc.solvers.loop import Iterate, IterativeSolver, Progress
from lgmpc.solvers.solution import Solution, Timings
from lgmpc.solvers.sweep import BackwardSweep, all_finite, bilinear, products
from lgmpc.status import Status
from lgmpc.typing import Array

__all__ = ["Fddp", "check_unconstrained"]

_UNBOUNDED = 1e8  # times 1 + the guess's cost: a cost below minus that counts as unbounded
_PATIENCE = 5  # most steps of rounding's size that do not halve the gradient


class Fddp(IterativeSolver):
    """Feasibility-driven DDP for problems without path constraints (see the module).

    Args:
        problem: the problem; its data are read at every solve.
        settings: tolerances and schedules.
        progress: called with a description of what is being compiled.

    Attributes:
        functions: the compiled problem, with the current expansion.
        sweep: the last backward sweep.

    Raises:
        InputError: the problem has path constraints.
    """

    name = "FDDP"
    settings: FddpSettings

    def __init__(
        self,
        problem: ShootingProblem,
        settings: FddpSettings | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        self.problem = problem
        self.settings = FddpSettings() if settings is None else settings
        self._check_constraints()
        self.functions = ShootingFunctions(problem, progress)
        self.sweep = self._make_sweep(progress)
        f = self.functions
        self._exact = LagrangianHessians(problem, f.xs, f.us, progress) if self.settings.hessian == "exact" else None
        self._clock = [0.0, 0.0, 0.0]
        self._fresh = self._swept = False  # whether expansion and sweep are those of the current trajectory
        self._finite = self._curved = False  # whether the expansion is, and whether exact Hessians were tried in it
        self._last_xs, self._last_us = self.functions.xs.copy(), self.functions.us.copy()  # before the last step

    def _check_constraints(self) -> None:
        check_unconstrained(self.problem)

    def _make_sweep(self, progress: Callable[[str], None] | None) -> BackwardSweep | BoxSweep:
        return BackwardSweep(self.functions, progress)

    def _begin(self, guess: Trajectory) -> Status | None:
        f = self.functions
        f.xs[...] = guess.xs
        f.xs[0] = self.problem.x0
        f.us[...] = guess.us
        f.gaps[...] = 0.0
        f.feedback[...] = 0.0
        f.feedforward[...] = 0.0
        self._clock = [0.0, 0.0, 0.0]
        start = self.settings.initial_regularization
        self._regularization = self.settings.regularization[0] if start is None else start
        self._accepted, self._step_length, self._was_closed = False, 1.0, False
        self._cost = self._criterion = np.nan
        self._expand()
        self._closed = self._gap <= self.settings.rounding
        self._bottom = _UNBOUNDED * (1.0 + abs(self._cost))
        self._least, self._patience = np.inf, _PATIENCE
        self._finite = self._finite and self._all_finite()
        return None if self._finite else Status.NOT_FINITE

    def _iterate(self) -> Status | None:
        f, s = self.functions, self.settings
        if not self._fresh:
            self._expand()
        swept = self._sweep()
        while not self._finite:
            if not self._take_back():
                return Status.DIVERGED
            swept = self._sweep()
        if not swept:
            return Status.STALLED
        slope, curvature = self.sweep.expected(closed=self._closed)
        # A closed trajectory is that of a roll-out: its gaps are rounding errors.
        if self._closed and abs(slope + 0.5 * curvature) < s.tolerance:
            status = self._stationary_status()
            if status is not None:
                return status
            if not self._sweep():
                return Status.STALLED
            slope, curvature = self.sweep.expected(closed=True)
        self._accepted = False
        # The model is convex along the step: it rises by at most a step length's share of what the full step does.
        ascent = max(-(slope + 0.5 * curvature), 0.0)
        d0 = d1 = np.nan
        diverged = True
        for alpha in s.step_lengths:
            self._step_length = alpha
            cost = self._try(alpha)
            if not math.isfinite(cost):
                continue
            diverged = False
            correction = 0.0 if self._closed else self._expected_from_gaps()
            d0, d1 = slope + correction, curvature - 2.0 * correction
            expected = alpha * (d0 + 0.5 * alpha * d1)
            gained = self._cost - cost
            if expected >= 0.0:
                rounding = s.least_slope * (1.0 + abs(self._cost))
                flat = abs(d0) < s.least_slope and gained >= -rounding
                accept = flat or gained > s.acceptance * expected
            else:  # gaps are closed at this cost: without them the sweep's step decreases its model
                accept = gained > s.ascent_acceptance * max(expected, -alpha * ascent)
            if accept:
                self._last_xs[...], self._last_us[...], self._was_closed = f.xs, f.us, self._closed
                f.accept()
                self._cost = cost
                self._closed = self._closed or alpha == 1.0
                self._accepted, self._fresh = True, False
                break
        if self._cost < -self._bottom:
            return Status.UNBOUNDED
        self._swept = False
        if self._step_length > s.decrease_above:
            self._regularization = max(self._regularization / s.regularization_factor, s.regularization[0])
        if self._step_length <= s.increase_below:
            self._increase()
            if self._regularization >= s.regularization[1]:
                return Status.DIVERGED if diverged else Status.STALLED
        self._criterion = abs(d0 + 0.5 * d1)
        return None

    def _stationary_status(self) -> Status | None:
        """Return the status if the trajectory, whose expected reduction is small, is stationary or cannot become so."""
        lowest = self.settings.regularization[0]
        before = self._regularization
        if before > lowest:  # a large regularisation makes any step and its expected reduction small
            self._regularization, self._swept = lowest, False
            if not self._sweep():
                return Status.STALLED
        slope, curvature = self.sweep.expected(closed=True)
        self._criterion = abs(slope + 0.5 * curvature)
        costates, multipliers, rest = self._stationarity()
        largest = max(float(np.abs(costates).max()), float(np.abs(multipliers).max(initial=0.0)))
        residual = float(np.abs(rest).max()) / (1.0 + largest)
        minimum = self._regularization <= lowest and self._criterion < self.settings.tolerance
        if residual <= self.settings.stationarity and minimum:
            return Status.CONVERGED
        if before > self._regularization and not self._accepted:  # no step without it: the sweep was a test
            self._regularization, self._swept = before, False
        self._patience = _PATIENCE if residual < 0.5 * self._least else self._patience - 1
        self._least = min(self._least, residual)
        rounding = np.finfo(np.float64).eps * (1.0 + abs(self._cost))
        return Status.PRECISION_LIMIT if self._patience <= 0 and self._criterion < rounding else None

    def _progress(self, iteration: int, elapsed: float) -> Progress:
        return Progress(
            iteration, self._cost, self._criterion, self._gap, self._step_length, self._regularization,
            self._accepted, elapsed, Iterate.of(self.functions.xs, self.functions.us, self.functions.feedback),
        )  # fmt: skip

    def _finish(self, status: Status, iterations: int, start: float) -> Solution:
        f = self.functions
        if not self._fresh:
            self._expand()
        possible = status not in (Status.NOT_FINITE, Status.INFEASIBLE)
        swept = possible and self._sweep()
        if possible and not self._finite:
            status = Status.DIVERGED
            self._take_back()
            swept = self._sweep()
        if not swept:
            self.sweep.value_gradient[...] = 0.0  # no multipliers are known
        costates, multipliers, rest = self._stationarity()
        kkt = KktResidual(float(np.abs(rest).max(initial=0.0)), self._gap, 0.0, 0.0)
        expansion, backward, forward = self._clock
        return Solution(
            self.problem.copy(), f.xs.copy(), f.us.copy(), f.feedback.copy(), f.feedforward.copy(), costates.copy(),
            multipliers, status, iterations, self._cost, f.gaps.copy(), kkt,
            Timings(time.perf_counter() - start, expansion, backward, forward), self._criterion,
        )  # fmt: skip

    def _stationarity(self) -> tuple[Array, Array, Array]:
        """Return costates (N, ndx), multipliers (N, ng), and their Lagrangian's gradient (N+1, ndx + nu).

        The costates are the gradients of the sweep's cost-to-go, under feedback. With those of the adjoint equation the
        gradient by the states is zero, but they, and their rounding errors, grow along unstable dynamics.
        """
        f, ndx = self.functions, self.problem.state.ndx
        costates = self.sweep.value_gradient
        rest = np.zeros((len(costates), f.gradient.shape[1]))
        rest[:-1] = f.gradient + products(f.jacobian, costates[1:])
        rest[-1, :ndx] = f.last_gradient
        rest[:, :ndx] -= costates
        rest[0, :ndx] = 0.0  # the first state is given
        multipliers, rest[:-1, ndx:] = self._split(rest[:-1, ndx:])
        return costates[1:], multipliers, rest

    def _split(self, gradient: Array) -> tuple[Array, Array]:
        """Return multipliers (N, ng), and the rest of the Lagrangian's gradient in the controls (N, nu)."""
        return np.zeros((self.problem.nodes, 0)), gradient

    @property
    def _gap(self) -> float:
        return float(np.abs(self.functions.gaps).max())

    def _expand(self) -> None:
        start = time.perf_counter()
        f = self.functions
        f.expand()
        self._cost = _sum(f.costs)
        self._finite = math.isfinite(self._cost)  # of all else that is not finite, the sweep fails
        self._fresh, self._swept, self._curved = True, False, False
        self._clock[0] += time.perf_counter() - start

    def _sweep(self) -> bool:
        """Sweep, unless that is done, with as much regularisation as necessary; False if the highest is not enough."""
        if self._swept or not self._finite:
            return self._swept
        start = time.perf_counter()
        self._swept = self.sweep.run(self._regularization, closed=self._closed)
        if not self._swept:
            self._finite = self._all_finite()
        while self._finite and not self._swept and self._regularization < self.settings.regularization[1]:
            self._increase()
            self._swept = self.sweep.run(self._regularization, closed=self._closed)
        if self._swept and self._exact is not None and not self._curved:
            self._swept = self._curve(self._exact)
        self._clock[1] += time.perf_counter() - start
        return self._swept

    def _all_finite(self) -> bool:
        f = self.functions
        return all_finite(f.jacobian, f.hessian, f.gradient, f.gaps, f.last_hessian, f.last_gradient)

    def _curve(self, exact: LagrangianHessians) -> bool:
        """Sweep with exact Hessians of the last sweep's multipliers, or with the largest part tried that is convex."""
        f = self.functions
        exact.costates[...] = self.sweep.value_gradient[1:]
        exact.evaluate()
        self._curved = True
        convex, last = f.hessian.copy(), f.last_hessian.copy()
        for part in CURVATURES:
            f.hessian[...] = convex + part * (exact.hessian - convex)
            f.last_hessian[...] = last + part * (exact.last_hessian - last)
            if self.sweep.run(self._regularization, closed=self._closed):
                return True
        return False

    def _try(self, alpha: float) -> float:
        """Roll out with a step length and return the cost, NaN where it diverges."""
        start = time.perf_counter()
        f = self.functions
        f.step_length[0] = alpha
        if self._closed:
            f.gaps[...] = 0.0
        f.roll_out()
        cost = _sum(f.costs_try) if all_finite(f.xs_try, f.us_try) else np.nan
        self._clock[2] += time.perf_counter() - start
        return cost

    def _take_back(self) -> bool:
        """Return to the trajectory before the last step; return False if the regularisation cannot increase.

        The cost of the last step was finite, its derivatives are not.
        """
        f = self.functions
        f.xs[...], f.us[...], self._closed = self._last_xs, self._last_us, self._was_closed
        self._expand()
        self._increase()
        return self._regularization < self.settings.regularization[1]

    def _increase(self) -> None:
        s = self.settings
        self._regularization = min(self._regularization * s.regularization_factor, s.regularization[1])

    def _expected_from_gaps(self) -> float:
        """Return the gaps' part of the expected decrease along the last roll-out."""
        f = self.functions
        f.measure_move()
        return -bilinear(f.gaps, self.sweep.value_hessian, f.moved)


def check_unconstrained(problem: ShootingProblem) -> None:
    """Raise if a problem has path constraints.

    Raises:
        InputError: it names the first action that has.
    """
    for k, action in enumerate(problem.actions):
        if action.path_rows:
            expected = "an action without constraints (BoxFddp takes bounds on controls; the NLP and SQP take all)"
            raise InputError(f"actions[{k}]", f"'{action.name}', which has path constraints", expected)


def _sum(costs: Array) -> float:
    """Return the sum, NaN if it is not finite."""
    total = float(np.add.reduce(costs))  # costs.sum() takes twice as long
    return total if math.isfinite(total) else math.nan
