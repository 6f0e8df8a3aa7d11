"""Feasibility-driven differential dynamic programming, without constraints and with bounds on the controls.

It starts from any trajectory, feasible or not, and opens or closes the dynamics' gaps together: a step of length alpha
keeps ``1 - alpha`` of each gap, as multiple shooting does, and the states in between come from a roll-out under the
sweep's feedback, as in differential dynamic programming. Mastalli et al., "Crocoddyl: an efficient and versatile
framework for multi-contact optimal control", ICRA 2020; with bounds: Mastalli, Merkt, Marti-Saumell, Ferrolho, Sola,
Mansard, Vijayakumar, "A feasibility-driven approach to control-limited DDP", Autonomous Robots 46, 2022.

Acceptance, regularisation and stopping are those of Crocoddyl 3, so that its settings and iteration counts carry over.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.ocp import KktResidual, ShootingFunctions, ShootingProblem, Trajectory
from lgmpc.solvers.box import BoxSweep, control_bounds
from lgmpc.solvers.compiled_sweep import make_sweep
from lgmpc.solvers.loop import IterativeSolver, Progress
from lgmpc.solvers.solution import Solution, Status, Timings
from lgmpc.solvers.sweep import BackwardSweep, all_finite
from lgmpc.typing import Array

__all__ = ["BoxFddp", "Fddp", "FddpSettings"]


@dataclass(frozen=True)
class FddpSettings:
    """Tolerances and schedules; the standard values are Crocoddyl's.

    Attributes:
        tolerance: the expected reduction of the cost at which a feasible trajectory is a solution.
        step_lengths: tried in this order, beginning with 1.
        acceptance: least fraction of the expected reduction that a step has to bring.
        ascent_acceptance: most multiples of an expected increase (a price of closing gaps) that a step may bring.
        least_slope: of the cost below which any step is accepted.
        rounding: largest gap of a guess that counts as feasible.
        regularization: (least, most); it starts from the least.
        regularization_factor: by which it changes.
        decrease_above: step length above which it falls.
        increase_below: step length up to which it rises.
    """

    tolerance: float = 1e-9
    step_lengths: tuple[float, ...] = tuple(2.0**-i for i in range(10))
    acceptance: float = 0.1
    ascent_acceptance: float = 2.0
    least_slope: float = 1e-12
    rounding: float = 1e-12
    regularization: tuple[float, float] = (1e-9, 1e9)
    regularization_factor: float = 10.0
    decrease_above: float = 0.5
    increase_below: float = 0.01

    def __post_init__(self) -> None:
        """Refuse what cannot work."""
        low, high = self.regularization
        if not 0.0 < low <= high:
            raise InputError("regularization", self.regularization, "0 < least <= most")
        if not self.regularization_factor > 1.0:
            raise InputError("regularization_factor", self.regularization_factor, "above 1")
        if not self.step_lengths or not all(0.0 < a <= 1.0 for a in self.step_lengths):
            raise InputError("step_lengths", self.step_lengths, "numbers above 0, at most 1")
        if not self.tolerance > 0.0:
            raise InputError("tolerance", self.tolerance, "above 0")


class Fddp(IterativeSolver):
    """Feasibility-driven DDP for problems without path constraints (see the module).

    Args:
        problem: the problem; its data are read at every solve.
        settings: tolerances and schedules.
        progress: told what is being compiled.

    Attributes:
        functions: the compiled problem, with the current expansion.
        sweep: the last backward sweep.

    Raises:
        InputError: the problem has path constraints.
    """

    name = "FDDP"

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
        self._clock = [0.0, 0.0, 0.0]

    def _check_constraints(self) -> None:
        for k, action in enumerate(self.problem.actions):
            if action.value_function.size1_out("constraint"):
                expected = "an action without constraints (BoxFddp takes bounds on controls; the NLP and SQP take all)"
                raise InputError(f"actions[{k}]", f"'{action.name}', which has path constraints", expected)

    def _make_sweep(self, progress: Callable[[str], None] | None) -> BackwardSweep:
        return make_sweep(self.functions, progress)

    def _begin(self, guess: Trajectory) -> Status | None:
        f = self.functions
        f.xs[...] = guess.xs
        f.xs[0] = self.problem.x0
        f.us[...] = guess.us
        f.gaps[...] = 0.0
        f.feedback[...] = 0.0
        f.feedforward[...] = 0.0
        self._clock = [0.0, 0.0, 0.0]
        self._regularization = self.settings.regularization[0]
        self._accepted, self._step_length = False, 1.0
        self._cost = self._criterion = self._gap = np.nan
        self._expand()
        self._closed = self._was_closed = self._gap <= self.settings.rounding
        self._fresh = True  # whether the expansion is that of the current trajectory
        return None if self._finite() else Status.NOT_FINITE

    def _iterate(self) -> Status | None:
        f, s = self.functions, self.settings
        if not self._fresh:
            self._expand()
            if not self._finite():
                return Status.NOT_FINITE
            self._fresh = True
        # A closed trajectory is one that a roll-out made: what is left in its gaps is rounding.
        self._was_closed = self._closed
        while True:
            swept = self._sweep()
            if swept:
                break
            self._increase()
            if self._regularization >= s.regularization[1]:
                self._accepted = False
                return Status.STALLED
        slope, curvature = self._expected_from_sweep()
        self._accepted = False
        d0 = d1 = np.nan
        for alpha in s.step_lengths:
            self._step_length = alpha
            cost = self._try(alpha)
            if not np.isfinite(cost):
                continue
            correction = 0.0 if self._closed else self._expected_from_gaps()
            d0, d1 = slope + correction, curvature - 2.0 * correction
            expected = alpha * (d0 + 0.5 * alpha * d1)
            gained = self._cost - cost
            if expected >= 0.0:
                accept = abs(d0) < s.least_slope or gained > s.acceptance * expected
            else:
                accept = not self._closed and gained > s.ascent_acceptance * expected
            if accept:
                f.accept()
                self._cost = cost
                self._closed = self._closed or alpha == 1.0
                self._accepted, self._fresh = True, False
                break
        if self._step_length > s.decrease_above:
            self._regularization = max(self._regularization / s.regularization_factor, s.regularization[0])
        if self._step_length <= s.increase_below:
            self._increase()
            if self._regularization >= s.regularization[1]:
                return Status.STALLED
        self._criterion = abs(d0 + 0.5 * d1)
        # Two different conditions: the trajectory was feasible before the step, and had little left to gain.
        return Status.CONVERGED if self._was_closed and self._criterion < s.tolerance else None

    def _progress(self, iteration: int, elapsed: float) -> Progress:
        return Progress(
            iteration, self._cost, self._criterion, self._gap, self._step_length, self._regularization,
            self._accepted, elapsed,
        )  # fmt: skip

    def _finish(self, status: Status, iterations: int, start: float) -> Solution:
        f, n, ndx = self.functions, self.problem.nodes, self.problem.state.ndx
        if not self._fresh:
            self._expand()
            if not self._finite():
                status = Status.NOT_FINITE
            self._fresh = True
        costates, gradient = np.empty((n, ndx)), np.empty((n, self.problem.nu))
        costate = f.last_gradient
        for k in reversed(range(n)):
            costates[k] = costate
            both = f.gradient[k] + f.jacobian[k].dot(costate)
            costate, gradient[k] = both[:ndx], both[ndx:]
        multipliers, rest = self._split(gradient)
        gap = float(np.abs(f.gaps).max())
        kkt = KktResidual(float(np.abs(rest).max(initial=0.0)), gap, 0.0, 0.0)
        expansion, backward, forward = self._clock
        return Solution(
            self.problem.copy(), f.xs.copy(), f.us.copy(), f.feedback.copy(), f.feedforward.copy(), costates,
            multipliers, status, iterations, self._cost, f.gaps.copy(), kkt,
            Timings(time.perf_counter() - start, expansion, backward, forward), self._criterion,
        )  # fmt: skip

    def _split(self, gradient: Array) -> tuple[Array, Array]:
        """Return multipliers (N, ng), and what they leave of the Lagrangian's gradient in the controls (N, nu)."""
        return np.zeros((self.problem.nodes, 0)), gradient

    def _expand(self) -> None:
        start = time.perf_counter()
        self.functions.expand()
        finite = all_finite(self.functions.costs)
        self._cost = float(self.functions.costs.sum()) if finite else np.nan
        self._gap = float(np.abs(self.functions.gaps).max())
        self._clock[0] += time.perf_counter() - start

    def _sweep(self) -> bool:
        start = time.perf_counter()
        done = self.sweep.run(self._regularization, closed=self._closed)
        self._clock[1] += time.perf_counter() - start
        return done

    def _try(self, alpha: float) -> float:
        """Roll out with a step length; its cost, NaN where it diverges."""
        start = time.perf_counter()
        f = self.functions
        f.step_length[0] = alpha
        if self._closed:
            f.gaps[...] = 0.0
        f.roll_out()
        cost = float(f.costs_try.sum()) if all_finite(f.xs_try, f.us_try, f.costs_try) else np.nan
        self._clock[2] += time.perf_counter() - start
        return cost

    def _finite(self) -> bool:
        f = self.functions
        parts = (f.jacobian, f.hessian, f.gradient, f.gaps, f.costs, f.last_hessian, f.last_gradient)
        return all_finite(*parts)

    def _increase(self) -> None:
        s = self.settings
        self._regularization = min(self._regularization * s.regularization_factor, s.regularization[1])

    def _expected_from_sweep(self) -> tuple[float, float]:
        """Slope and curvature of the expected reduction along the step, as far as the sweep knows them."""
        f, sweep = self.functions, self.sweep
        slope = float(np.vdot(sweep.control_gradient, f.feedforward))
        curvature = -float(np.vdot(f.feedforward, sweep.control_product))
        if not self._closed:
            slope -= float(np.vdot(sweep.value_gradient, f.gaps))
            curvature += float(np.einsum("ki,kij,kj->", f.gaps, sweep.value_hessian, f.gaps))
        return slope, curvature

    def _expected_from_gaps(self) -> float:
        """What the gaps add along the last roll-out."""
        f = self.functions
        f.measure_move()
        return -float(np.einsum("ki,kij,kj->", f.gaps, self.sweep.value_hessian, f.moved))


class BoxFddp(Fddp):
    """Feasibility-driven DDP whose controls stay within bounds: every constraint row bounds one control.

    The bounds are those of the actions' path constraints and may depend on parameters. The roll-out keeps to them, and
    the sweep minimises over each node's box (Tassa, Mansard, Todorov, "Control-limited differential dynamic
    programming", ICRA 2014) once the trajectory is feasible.

    Raises:
        InputError: a path constraint that is not a bound on a control.
    """

    name = "box FDDP"

    def _check_constraints(self) -> None:
        self._bounds = control_bounds(self.problem)

    def _make_sweep(self, progress: Callable[[str], None] | None) -> BackwardSweep:
        return BoxSweep(self.functions)

    def _begin(self, guess: Trajectory) -> Status | None:
        f = self.functions
        self._bounds.write(self.problem.parameters, f.u_lower, f.u_upper)
        if not (f.u_lower <= f.u_upper).all():
            super()._begin(guess)
            nan = np.isnan(f.u_lower).any() or np.isnan(f.u_upper).any()
            return Status.NOT_FINITE if nan else Status.INFEASIBLE
        return super()._begin(Trajectory(guess.xs, np.clip(guess.us, f.u_lower, f.u_upper)))

    def _split(self, gradient: Array) -> tuple[Array, Array]:
        f = self.functions
        held = ((f.us <= f.u_lower) & (gradient > 0.0)) | ((f.us >= f.u_upper) & (gradient < 0.0))
        return self._bounds.multipliers(np.where(held, -gradient, 0.0)), np.where(held, 0.0, gradient)
