"""An augmented-Lagrangian method on FDDP: any path constraints, from poor guesses.

The path constraints are terms of the cost (:class:`~lgmpc.actions.PenalizedAction`). FDDP minimises it more and more
accurately; in between the multipliers take the values with which the minimum is stationary, and the penalty grows where
this does not reduce the violation to a quarter (Birgin and Martinez, "Practical augmented Lagrangian methods for
constrained optimization", SIAM 2014; on trajectories: Howell, Jackson, Manchester, "ALTRO", IROS 2019; Jallet et al.,
"ProxDDP", IEEE T-RO 2025). No subproblem can be infeasible, and the states follow the dynamics under feedback.

The first penalty weighs violation and cost of the guess equally. For a guess without violation it weighs those of the
minimum with the lowest first penalty. With a penalty much larger than the cost's curvature the line search would
shorten every step that reaches another bound.

Where no point satisfies the constraints the minima approach a stationary point of the violation c: ``|J^T c|`` is the
cost's gradient over the penalty, which grows, while c stays. This is the status INFEASIBLE.
"""

import time
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lgmpc.actions import Action, penalize
from lgmpc.ocp import KktResidual, PathFunctions, ShootingProblem, Trajectory
from lgmpc.ocp.kkt import complementarity
from lgmpc.settings import Positive, key
from lgmpc.solvers.fddp import Fddp, FddpSettings
from lgmpc.solvers.loop import IterativeSolver, Progress, SolverSettings, settings_of
from lgmpc.solvers.solution import Solution
from lgmpc.status import Status

_FACTOR, _HIGHEST = 10.0, 1e9  # growth of the penalty, and where the problem counts as infeasible
_ENOUGH = 0.25  # fraction of the last violation that counts as progress
_FIRST = (1e-3, 1e3)  # range of the first penalty
_DOMINANT = 1e2  # ratio of penalties to costs from which minima are those of the violation
_STAYS = 1e-2  # relative decrease of the violation up to which a larger penalty has not lowered it
_STIFF = 1e6  # penalty of the rows in the gains of a solution
_ENDED = (Status.CONVERGED, Status.STALLED, Status.PRECISION_LIMIT)  # FDDP cannot minimise further


class AugmentedLagrangianSettings(SolverSettings):
    """Tolerance and penalties of :class:`AugmentedLagrangianFddp`."""

    method: Literal["al_fddp"] = key("al_fddp", "FDDP on an augmented Lagrangian; any constraints, from poor guesses.")
    max_iterations: Annotated[int, Field(strict=True, ge=0, le=100_000)] = key(3000, "Most iterations of FDDP.")
    tolerance: Positive = key(
        1e-6,
        "Largest residual of the constraints and their multipliers' signs, and of the Lagrangian's "
        "gradient per 1 + the largest multiplier, of a solution.",
    )


class AugmentedLagrangianFddp(IterativeSolver):
    """FDDP on an augmented Lagrangian (see the module); its solutions have feedback gains.

    Args:
        problem: the problem; its data are read at every solve.
        settings: tolerance and penalties.

    Attributes:
        updates: how often the multipliers were updated in this solve.
    """

    name = "augmented-Lagrangian FDDP"
    settings: AugmentedLagrangianSettings

    def __init__(self, problem: ShootingProblem, settings: AugmentedLagrangianSettings | None = None) -> None:
        self.problem = problem
        self.settings = settings_of(problem, settings, AugmentedLagrangianSettings)
        made: dict[int, Action] = {}
        for action in problem.actions:
            if id(action) not in made:
                made[id(action)] = penalize(action) if action.path_rows else action
        self._penalized = ShootingProblem([made[id(action)] for action in problem.actions], terminal=problem.terminal)
        least = FddpSettings(stationarity=self.settings.tolerance)
        self._fddp = Fddp(self._penalized, least)
        f = self._fddp.functions
        self._path = PathFunctions(problem, f.xs, f.us)

    def _begin(self, guess: Trajectory) -> Status | None:
        inner, own = self._penalized, self.problem.parameters
        inner.parameters[:, : own.shape[1]] = own
        inner.x0[...] = self.problem.x0
        self._multipliers = np.zeros_like(self._path.values)
        if self._known is not None and self._known.multipliers.shape == self._multipliers.shape:
            self._multipliers[...] = np.nan_to_num(self._known.multipliers)
        self._violation, self._accuracy, self._measured = np.inf, np.inf, np.inf
        self._penalty, self._before, self._stayed, self.updates = 1.0, np.inf, 0, 0
        self._write()
        status = self._fddp._begin(guess)
        self._measure()
        if np.isnan(self._path.lower).any() or np.isnan(self._path.upper).any():
            return Status.NOT_FINITE
        if status is not None:
            return status
        if not (self._path.lower <= self._path.upper).all():
            return Status.INFEASIBLE
        self._penalty, self._guess = self._balance(), guess
        self._undecided = self._penalty == _FIRST[1] and not self._multipliers.any()
        if self._undecided:
            self._penalty = _FIRST[0]
        self._accuracy = 1e-2
        self._restart()
        return None

    def _iterate(self) -> Status | None:
        inner = self._fddp
        status = inner._iterate()
        if status is not None and status not in _ENDED:
            return self._begin_within() if self._undecided else status
        scale = 1.0 + abs(inner._cost)
        near = inner._accepted and inner._criterion < self._accuracy * scale
        if status is None and not near:
            return None
        self._measure()
        tolerance = self.settings.tolerance
        if self._measured <= tolerance and status is not None:
            return status
        progress = self._measured <= _ENOUGH * self._violation
        if self._undecided:
            self._penalty, self._undecided = self._balance(), False
        elif not progress and self._measured > tolerance:
            if self._violation_is_least():
                return Status.INFEASIBLE
            if self._penalty >= _HIGHEST:
                return Status.INFEASIBLE if self._violated > tolerance else Status.STALLED
            self._penalty = min(self._penalty * _FACTOR, _HIGHEST)
        self._multipliers[...] = self._estimate
        self._violation = self._measured
        self._accuracy = max(0.1 * self._accuracy, 1e-12) if self._measured > tolerance else 0.0
        self.updates += 1
        self._restart()
        return None

    @property
    def violation(self) -> float:
        """Largest violation of the constraints, when the multipliers were last updated."""
        return self._violated

    def current(self) -> Solution:
        """Return trajectory and multipliers between two iterations, which can continue."""
        found = self._fddp._finish(Status.STOPPED, 0, time.perf_counter())
        return replace(found, multipliers=self._multipliers.copy())

    def _measure(self) -> None:
        """Evaluate the constraints at the current trajectory, and the multipliers with which it is stationary."""
        path, mu = self._path, self._multipliers
        path.evaluate()
        self._outside = path.values - np.clip(path.values, path.lower, path.upper)
        self._violated = float(np.abs(self._outside).max(initial=0.0))
        shifted = path.values + mu / self._penalty
        self._apart = shifted - np.clip(shifted, path.lower, path.upper)
        self._estimate = self._penalty * self._apart
        # What violates a bound, and what keeps a row with a multiplier away from it, both change the multiplier.
        self._measured = float(np.abs(self._estimate - mu).max(initial=0.0)) / self._penalty

    def _begin_within(self) -> Status | None:
        """Begin again with the highest first penalty: without constraints the cost has no minimum."""
        self._penalty, self._undecided = _FIRST[1], False
        self._write()
        return self._fddp._begin(self._guess)

    def _balance(self) -> float:
        """Return the penalty at which the last measurement's violation weighs as much as its cost."""
        outside = float(np.vdot(self._outside, self._outside))
        return float(np.clip(2.0 * max(abs(self._cost()), 1.0) / max(outside, 1e-12), *_FIRST))

    def _hold_rows(self) -> None:
        """Raise the penalty and shift the multipliers so that the gradient stays: gains then hold rows at bounds."""
        self._measure()
        if np.isfinite(self._estimate).all():
            apart, stiff = self._apart - self._multipliers / self._penalty, max(self._penalty, _STIFF)
            self._multipliers[...] = np.where(self._estimate == 0.0, 0.0, self._estimate - stiff * apart)
            self._penalty = stiff
            self._write()
            self._fddp._fresh = False

    def _violation_is_least(self) -> bool:
        """Return whether penalties that outweigh the cost have not lowered the violation twice in a row."""
        violation = float(np.linalg.norm(self._outside))
        dominates = self._penalty * violation**2 > _DOMINANT * (1.0 + abs(self._cost()))
        stays = dominates and violation > (1.0 - _STAYS) * self._before
        self._stayed, self._before = self._stayed + 1 if stays else 0, violation
        return self._stayed >= 2

    def _write(self) -> None:
        for k, (own, action) in enumerate(zip(self.problem.actions, self._penalized.actions, strict=True)):
            if own.path_rows:
                row = self._penalized.parameters[k]
                row[action.parameters["constraint_multipliers"]] = self._multipliers[k, : own.path_rows]
                row[action.parameters["constraint_penalty"]] = self._penalty

    def _restart(self) -> None:
        """Continue FDDP from the current trajectory with the current multipliers and penalty."""
        self._write()
        self._fddp._begin_again()

    def _cost(self) -> float:
        """Return the cost without the penalties of the last measurement."""
        return float(self._fddp._cost - 0.5 * self._penalty * np.vdot(self._apart, self._apart))

    def _progress(self, iteration: int, elapsed: float) -> Progress:
        return self._fddp._progress(iteration, elapsed)

    def _finish(self, status: Status, iterations: int, start: float) -> Solution:
        self._hold_rows()
        found = self._fddp._finish(status, iterations, start)
        self._measure()
        mu, path = self._estimate, self._path
        loose = float(complementarity(mu, path.values, path.lower, path.upper).max(initial=0.0))
        kkt = KktResidual(found.kkt.stationarity, found.kkt.dynamics, self._violated, loose)
        return replace(
            found, problem=self.problem.copy(), multipliers=mu.copy(), cost=self._cost(), kkt=kkt,
            criterion=kkt.largest, timings=replace(found.timings, total=time.perf_counter() - start),
        )  # fmt: skip
