"""Feasibility-driven differential dynamic programming, without path constraints.

The guess may be infeasible. A step of length alpha keeps ``1 - alpha`` of each gap of the dynamics, as in multiple
shooting, and the states are those of a roll-out under the sweep's feedback, as in differential dynamic programming.
Mastalli et al., "Crocoddyl: an efficient and versatile framework for multi-contact optimal control", ICRA 2020.

Acceptance and regularisation are those of Crocoddyl 3, with the same constants and iteration counts, but for two
points. An increase of the cost, which closing gaps may require, is bounded by that of the model: the increase expected
along a trial's own states grows with a trial that diverges. A solution must also be stationary (see
:class:`FddpSettings`) and a minimum of the model without regularisation, which may take an iteration or two more.
"""

import math
import time
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from lgmpc.errors import InputError
from lgmpc.ocp import KktResidual, ShootingFunctions, ShootingProblem, Trajectory
from lgmpc.settings import Positive, key
from lgmpc.solvers.loop import Iterate, IterativeSolver, Progress, SolverSettings, settings_of
from lgmpc.solvers.solution import Solution, Timings
from lgmpc.solvers.sweep import BackwardSweep, all_finite, bilinear, products
from lgmpc.status import Status
from lgmpc.typing import Array

# Crocoddyl's: step lengths in the order of their trials, least share of the expected decrease of an accepted step, the
# same of an increase by closing gaps, slope of a flat cost, largest gap of a feasible guess.
_STEP_LENGTHS = tuple(2.0**-i for i in range(10))
_DESCENT, _ASCENT, _FLAT, _CLOSED = 0.1, 2.0, 1e-12, 1e-12
# Crocoddyl's: range of the regularisation and its factor; it falls after steps longer than the first length, and grows
# up to the second.
_LOWEST, _HIGHEST, _FACTOR, _LONG, _SHORT = 1e-9, 1e9, 10.0, 0.5, 0.01
_UNBOUNDED = 1e8  # times 1 + the guess's cost: a cost below minus that counts as unbounded
_PATIENCE = 5  # most steps of rounding's size that do not halve the gradient


@dataclass(frozen=True)
class _Decrease:
    """The decrease of the cost that a model expects of a step: ``alpha (slope + alpha / 2 curvature)``.

    It is minus Mastalli's ``Delta J(alpha) = alpha Delta_1 + alpha^2 / 2 Delta_2``, of which the gaps are a part.
    """

    slope: float
    curvature: float

    def of_step(self, alpha: float) -> float:
        """Return that of a step of length alpha."""
        return alpha * (self.slope + 0.5 * alpha * self.curvature)

    def along(self, gaps: float) -> "_Decrease":
        """Return that along the states of a roll-out, of which the gaps have a part."""
        return _Decrease(self.slope + gaps, self.curvature - 2.0 * gaps)


class _Regularization:
    """A multiple of the identity in the sweeps, which grows where steps fail and falls where they are long.

    Tassa, Erez, Todorov, "Synthesis and stabilization of complex behaviors through online trajectory optimization",
    IROS 2012, sec. II-F; here of Quu and of V, as in Crocoddyl.
    """

    def __init__(self) -> None:
        self.reset()

    @property
    def exhausted(self) -> bool:
        """True if it cannot grow."""
        return self.value >= _HIGHEST

    def reset(self) -> None:
        """Set it to its least value."""
        self.value = _LOWEST

    def increase(self) -> None:
        """Multiply it by the factor."""
        self.value = min(self.value * _FACTOR, _HIGHEST)

    def decrease(self) -> None:
        """Divide it by the factor."""
        self.value = max(self.value / _FACTOR, _LOWEST)


class FddpSettings(SolverSettings):
    """Tolerances of FDDP and box FDDP.

    A feasible trajectory is a solution when two measures are small. The expected reduction of the cost by a full step
    is independent of the scaling of states and controls, but insensitive to directions in which the cost hardly varies.
    The Lagrangian's gradient is relative to the multipliers, as in SNOPT (Gill, Murray, Saunders, SIAM Review 47,
    2005), since it is a difference of them.
    """

    method: Literal["fddp", "box_fddp"] = key("fddp", "fddp: no constraints; box_fddp: bounds on controls.")
    tolerance: Positive = key(1e-9, "Largest expected reduction of the cost of a solution.")
    stationarity: Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=True)] = key(
        1e-6,
        "Largest entry of the Lagrangian's gradient of a solution, per 1 + the largest multiplier; "
        ".inf: of any size, as in Crocoddyl.",
    )


class Fddp(IterativeSolver):
    """Feasibility-driven DDP for problems without path constraints (see the module).

    Args:
        problem: the problem; its data are read at every solve.
        settings: tolerances and schedules.

    Attributes:
        functions: the compiled problem, with the current expansion.
        sweep: the last backward sweep.

    Raises:
        InputError: the problem has path constraints.
    """

    name = "FDDP"
    settings: FddpSettings

    def __init__(self, problem: ShootingProblem, settings: FddpSettings | None = None) -> None:
        self.problem = problem
        self.settings = settings_of(problem, settings, FddpSettings)
        self._check_constraints()
        self.functions = ShootingFunctions(problem)
        self.sweep = self._make_sweep()
        self._clock, self._regularization = [0.0, 0.0, 0.0], _Regularization()
        self._fresh = self._swept = False  # whether expansion and sweep are those of the current trajectory
        self._finite = False  # whether the expansion is
        self._last_xs, self._last_us = self.functions.xs.copy(), self.functions.us.copy()  # before the last step

    def _check_constraints(self) -> None:
        check_unconstrained(self.problem)

    def _make_sweep(self) -> Any:
        return BackwardSweep(self.functions)

    def _begin(self, guess: Trajectory) -> Status | None:
        f = self.functions
        f.xs[...] = guess.xs
        f.xs[0] = self.problem.x0
        f.us[...] = guess.us
        f.gaps[...] = 0.0
        f.feedback[...] = 0.0
        f.feedforward[...] = 0.0
        self._clock = [0.0, 0.0, 0.0]
        self._regularization.reset()
        self._accepted, self._step_length, self._was_closed = False, 1.0, False
        self._cost = self._criterion = np.nan
        self._expand()
        self._closed = self._gap <= _CLOSED
        self._bottom = _UNBOUNDED * (1.0 + abs(self._cost))
        self._least, self._patience = np.inf, _PATIENCE
        self._finite = self._finite and self._all_finite()
        return None if self._finite else Status.NOT_FINITE

    def _iterate(self) -> Status | None:
        """Take one step: direction, test of convergence, line search, regularisation."""
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
        for alpha in _STEP_LENGTHS:
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
            return flat or gained > _DESCENT * decrease
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
        self._fresh, self._least = False, np.inf
        self._regularization.reset()

    def _test_convergence(self) -> Status | None:
        """Return the status if the trajectory, whose expected reduction is small, is stationary or cannot become so."""
        regularization, before = self._regularization, self._regularization.value
        if before > _LOWEST:  # a large one makes any step and its expected reduction small
            self._swept = False
            regularization.reset()
            if not self._sweep():
                return Status.STALLED
        self._criterion = abs(self._model().of_step(1.0))
        costates, multipliers, rest = self._stationarity()
        largest = max(float(np.abs(costates).max()), float(np.abs(multipliers).max(initial=0.0)))
        residual = float(np.abs(rest).max()) / (1.0 + largest)
        convex, stationary = regularization.value <= _LOWEST, residual <= self.settings.stationarity
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
