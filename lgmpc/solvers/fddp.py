"""Feasibility-driven differential dynamic programming, without path constraints or with bounds on controls.

The guess may be infeasible. A step of length alpha keeps ``1 - alpha`` of each gap of the dynamics, as in multiple
shooting, and the states are those of a roll-out under the sweep's feedback, as in differential dynamic programming.
Mastalli et al., "Crocoddyl: an efficient and versatile framework for multi-contact optimal control", ICRA 2020.

Acceptance and regularisation are those of Crocoddyl 3, with the same settings and iteration counts, but for two points.
An increase of the cost, which closing gaps may require, is bounded by that of the model: the increase expected along a
trial's own states grows with a trial that diverges. A solution must also be stationary (see
:class:`~lgmpc.solvers.FddpSettings`) and a minimum of the model without regularisation, which may take an iteration or
two more.

With bounds on the controls: Mastalli, Merkt, Marti-Saumell, Ferrolho, Sola, Mansard, Vijayakumar, "A feasibility-driven
approach to control-limited DDP", Autonomous Robots 46, 2022, with another sweep: see
:class:`~lgmpc.solvers.box.BoxSweep`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.ocp import KktResidual, ShootingFunctions, ShootingProblem, Trajectory
from lgmpc.solvers.box import BoxSweep, ControlBounds, bounded_rows
from lgmpc.solvers.fddp_settings import FddpSettings
from lgmpc.solvers.loop import Iterate, IterativeSolver, Progress, settings_of
from lgmpc.solvers.solution import Solution, Timings
from lgmpc.solvers.sweep import BackwardSweep, all_finite, bilinear, products
from lgmpc.status import Status
from lgmpc.typing import Array

__all__ = ["BoxFddp", "Fddp", "check_unconstrained"]

# Crocoddyl's: share of an increase of the cost by closing gaps, slope of a flat cost, largest gap of a feasible guess.
_ASCENT, _FLAT, _CLOSED = 2.0, 1e-12, 1e-12
# Crocoddyl's: factor of the regularisation, which falls after steps longer than the first length, and grows up to the
# second.
_FACTOR, _LONG, _SHORT = 10.0, 0.5, 0.01
_UNBOUNDED = 1e8  # times 1 + the guess's cost: a cost below minus that counts as unbounded
_PATIENCE = 5  # most steps of rounding's size that do not halve the gradient


@dataclass(frozen=True)
class _Decrease:
    """The decrease of the cost that a model expects of a step: ``alpha (slope + alpha / 2 curvature)``."""

    slope: float
    curvature: float

    def of_step(self, alpha: float) -> float:
        """Return that of a step of length alpha."""
        return alpha * (self.slope + 0.5 * alpha * self.curvature)

    def along(self, gaps: float) -> _Decrease:
        """Return that along the states of a roll-out, of which the gaps have a part."""
        return _Decrease(self.slope + gaps, self.curvature - 2.0 * gaps)


class _Regularization:
    """A multiple of the identity in the sweeps, which grows where steps fail and falls where they are long."""

    def __init__(self, settings: FddpSettings) -> None:
        self.lowest, self.highest = settings.regularization
        self.value = self.lowest

    @property
    def exhausted(self) -> bool:
        """True if it cannot grow."""
        return self.value >= self.highest

    def increase(self) -> None:
        """Multiply it by the factor."""
        self.value = min(self.value * _FACTOR, self.highest)

    def decrease(self) -> None:
        """Divide it by the factor."""
        self.value = max(self.value / _FACTOR, self.lowest)


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
        self.settings = settings_of(problem, settings, FddpSettings)
        self._check_constraints()
        self.functions = ShootingFunctions(problem, progress)
        self.sweep = self._make_sweep(progress)
        self._clock, self._regularization = [0.0, 0.0, 0.0], _Regularization(self.settings)
        self._fresh = self._swept = False  # whether expansion and sweep are those of the current trajectory
        self._finite = False  # whether the expansion is
        self._last_xs, self._last_us = self.functions.xs.copy(), self.functions.us.copy()  # before the last step

    def _check_constraints(self) -> None:
        check_unconstrained(self.problem)

    def _make_sweep(self, progress: Callable[[str], None] | None) -> BackwardSweep | BoxSweep:
        return BackwardSweep(self.functions, progress)

    def _begin(self, guess: Trajectory) -> Status | None:
        f, start = self.functions, self.settings.initial_regularization
        f.xs[...] = guess.xs
        f.xs[0] = self.problem.x0
        f.us[...] = guess.us
        f.gaps[...] = 0.0
        f.feedback[...] = 0.0
        f.feedforward[...] = 0.0
        self._clock = [0.0, 0.0, 0.0]
        self._regularization.value = self._regularization.lowest if start is None else start
        self._accepted, self._step_length, self._was_closed = False, 1.0, False
        self._cost = self._criterion = np.nan
        self._expand()
        self._closed = self._gap <= _CLOSED
        self._bottom = _UNBOUNDED * (1.0 + abs(self._cost))
        self._least, self._patience = np.inf, _PATIENCE
        self._finite = self._finite and self._all_finite()
        return None if self._finite else Status.NOT_FINITE

    def _iterate(self) -> Status | None:
        status = self._compute_direction()
        if status is not None:
            return status
        model = self._model()
        # A closed trajectory is that of a roll-out: its gaps are rounding errors.
        if self._closed and abs(model.of_step(1.0)) < self.settings.tolerance:
            status = self._test_convergence()
            if status is not None:
                return status
            if not self._sweep():
                return Status.STALLED
            model = self._model()
        expected, diverged = self._search(model)
        if self._cost < -self._bottom:
            return Status.UNBOUNDED
        status = self._regulate(diverged)
        if status is None:
            self._criterion = abs(expected.of_step(1.0))
        return status

    def _compute_direction(self) -> Status | None:
        """Expand and sweep; return to the last trajectory, regularised, where derivatives are not finite."""
        if not self._fresh:
            self._expand()
        swept = self._sweep()
        while not self._finite:
            if not self._take_back():
                return Status.DIVERGED
            swept = self._sweep()
        return None if swept else Status.STALLED

    def _model(self) -> _Decrease:
        return _Decrease(*self.sweep.expected(closed=self._closed))

    def _search(self, model: _Decrease) -> tuple[_Decrease, bool]:
        """Take the first step length whose roll-out is accepted, if any.

        Returns:
            The decrease expected along the last roll-out that did not diverge, and whether all diverged.
        """
        expected, diverged = _Decrease(math.nan, math.nan), True
        # The model is convex along the step: it rises by at most a step length's share of what the full step does.
        ascent, self._accepted = max(-model.of_step(1.0), 0.0), False
        for alpha in self.settings.step_lengths:
            self._step_length = alpha
            cost = self._try(alpha)
            if not math.isfinite(cost):
                continue
            diverged = False
            expected = model if self._closed else model.along(self._expected_from_gaps())
            if self._accepts(alpha, self._cost - cost, expected, ascent):
                self._take_step(alpha, cost)
                break
        return expected, diverged

    def _accepts(self, alpha: float, gained: float, expected: _Decrease, ascent: float) -> bool:
        """Return whether a decrease ``gained`` is enough of the expected one, or an increase not too much of it."""
        decrease = expected.of_step(alpha)
        if decrease >= 0.0:
            rounding = _FLAT * (1.0 + abs(self._cost))
            flat = abs(expected.slope) < _FLAT and gained >= -rounding
            return flat or gained > self.settings.acceptance * decrease
        # Gaps are closed at this cost: without them the sweep's step decreases its model.
        return gained > _ASCENT * max(decrease, -alpha * ascent)

    def _take_step(self, alpha: float, cost: float) -> None:
        f = self.functions
        self._last_xs[...], self._last_us[...], self._was_closed = f.xs, f.us, self._closed
        f.accept()
        self._cost, self._closed = cost, self._closed or alpha == 1.0
        self._accepted, self._fresh = True, False

    def _regulate(self, diverged: bool) -> Status | None:
        """Decrease the regularisation after a long step, increase it after a short one or none."""
        self._swept = False
        if self._step_length > _LONG:
            self._regularization.decrease()
        if self._step_length > _SHORT:
            return None
        self._regularization.increase()
        if not self._regularization.exhausted:
            return None
        return Status.DIVERGED if diverged else Status.STALLED

    def _begin_again(self) -> None:
        """Continue from the current trajectory, where the cost has changed."""
        self._fresh, self._regularization.value, self._least = False, self._regularization.lowest, np.inf

    def _test_convergence(self) -> Status | None:
        """Return the status if the trajectory, whose expected reduction is small, is stationary or cannot become so."""
        regularization, before = self._regularization, self._regularization.value
        if before > regularization.lowest:  # a large one makes any step and its expected reduction small
            regularization.value, self._swept = regularization.lowest, False
            if not self._sweep():
                return Status.STALLED
        self._criterion = abs(self._model().of_step(1.0))
        costates, multipliers, rest = self._stationarity()
        largest = max(float(np.abs(costates).max()), float(np.abs(multipliers).max(initial=0.0)))
        residual = float(np.abs(rest).max()) / (1.0 + largest)
        convex, stationary = regularization.value <= regularization.lowest, residual <= self.settings.stationarity
        if stationary and convex and self._criterion < self.settings.tolerance:
            return Status.CONVERGED
        if before > regularization.value and not self._accepted:  # no step without it: the sweep was a test
            regularization.value, self._swept = before, False
        self._patience = _PATIENCE if residual < 0.5 * self._least else self._patience - 1
        self._least = min(self._least, residual)
        rounding = np.finfo(np.float64).eps * (1.0 + abs(self._cost))
        if self._patience > 0 or not self._criterion < rounding:
            return None
        return Status.SADDLE if stationary and not convex else Status.PRECISION_LIMIT

    def _progress(self, iteration: int, elapsed: float) -> Progress:
        return Progress(
            iteration, self._cost, self._criterion, self._gap, self._step_length, self._regularization.value,
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
        self._fresh, self._swept = True, False
        self._clock[0] += time.perf_counter() - start

    def _sweep(self) -> bool:
        """Sweep, unless that is done, with as much regularisation as necessary; False if the highest is not enough."""
        if self._swept or not self._finite:
            return self._swept
        start = time.perf_counter()
        self._swept = self.sweep.run(self._regularization.value, closed=self._closed)
        if not self._swept:
            self._finite = self._all_finite()
        while self._finite and not self._swept and not self._regularization.exhausted:
            self._regularization.increase()
            self._swept = self.sweep.run(self._regularization.value, closed=self._closed)
        self._clock[1] += time.perf_counter() - start
        return self._swept

    def _all_finite(self) -> bool:
        f = self.functions
        return all_finite(f.jacobian, f.hessian, f.gradient, f.gaps, f.last_hessian, f.last_gradient)

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
        self._regularization.increase()
        return not self._regularization.exhausted

    def _expected_from_gaps(self) -> float:
        """Return the gaps' part of the expected decrease along the last roll-out."""
        f = self.functions
        f.measure_move()
        return -bilinear(f.gaps, self.sweep.value_hessian, f.moved)


class BoxFddp(Fddp):
    """Feasibility-driven DDP whose controls stay within bounds: every constraint row bounds one control.

    The bounds are those of the actions' path constraints and may depend on parameters. The sweep minimises over the
    boxes of all nodes together (:class:`~lgmpc.solvers.box.BoxSweep`), with and without gaps, and the roll-out clips
    to them.

    Raises:
        InputError: a path constraint that is not a bound on a control.
    """

    name = "box FDDP"

    def _check_constraints(self) -> None:
        self._rows = bounded_rows(self.problem)

    def _make_sweep(self, progress: Callable[[str], None] | None) -> BoxSweep:
        self._bounds = ControlBounds(self.problem, self._rows, progress)
        self._box = BoxSweep(self.functions, progress)
        return self._box

    def _begin(self, guess: Trajectory) -> Status | None:
        f = self.functions
        self._bounds.write(f.u_lower, f.u_upper)
        self._box.held[...] = 0
        if not (f.u_lower <= f.u_upper).all():
            super()._begin(guess)
            nan = np.isnan(f.u_lower).any() or np.isnan(f.u_upper).any()
            return Status.NOT_FINITE if nan else Status.INFEASIBLE
        return super()._begin(Trajectory(guess.xs, np.clip(guess.us, f.u_lower, f.u_upper)))

    def _split(self, gradient: Array) -> tuple[Array, Array]:
        f = self.functions
        held = ((f.us <= f.u_lower) & (gradient > 0.0)) | ((f.us >= f.u_upper) & (gradient < 0.0))
        return self._bounds.multipliers(np.where(held, -gradient, 0.0)), np.where(held, 0.0, gradient)

    def _expected_from_gaps(self) -> float:
        return 0.0  # the sweep's own roll-out has accounted for them


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
