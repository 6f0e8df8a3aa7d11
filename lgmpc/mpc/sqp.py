"""Predictive control by sequential quadratic programming: warm start, real-time iterations, their acceptance."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable

import numpy as np

from lgmpc.mpc.base import BaseMpc, weight_shares
from lgmpc.mpc.plan import MpcStatus, Plan
from lgmpc.mpc.settings import SqpMpcSettings
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.solvers import RealTimeSqp, Solution, Status
from lgmpc.typing import Array, IntArray

__all__ = ["SqpMpc"]

# An inexactly solved subproblem is accepted if it violates its constraints by less than this share of the weight
# (forces, N) and its dynamics by less than this (m, N.s, N.m.s).
_ACCEPTED_FORCE = 0.01
_ACCEPTED_GAP = 0.01


class SqpMpc(BaseMpc):
    """Solves a problem repeatedly over a receding horizon, warm-started from the shifted last solution.

    Each update shifts the last trajectory to the present, takes the configured number of SQP steps from there and
    returns the new plan. Numerical failures are not raised: after a failed update the last valid plan remains in use,
    with the status of the failure; after several consecutive failures the status is STALE.

    A subclass writes measured state, references and parameters into :attr:`problem` and calls :meth:`_advance`.

    Args:
        problem: the optimal control problem.
        settings: horizon, limits, solver.
        mass: mass of the robot, kg.
        weight: (3,) force that balances gravity, world axes, N.
        progress: called with a description of what is being compiled.

    Attributes:
        settings: as given.
        mass: as given, kg.
        problem: as given, with the data of the last update.
        solver: the real-time iteration.
        failures: updates without a fresh plan so far.
        failures_in_a_row: since the last fresh plan.

    Raises:
        InputError: mass not positive.
        MissingDependencyError: the QP solver is not installed.
    """

    def __init__(
        self,
        problem: ShootingProblem,
        settings: SqpMpcSettings,
        mass: float,
        weight: Array,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        super().__init__(settings, mass)
        self.settings: SqpMpcSettings = settings
        self.problem = problem
        self.solver = RealTimeSqp(problem, settings.qp_solver, progress)
        self._weight = weight
        self._flags = problem.view("contact_flags")
        self._bounded = _columns_without_bounds(problem)
        self._trajectory: Trajectory | None = None  # solution of the last fresh plan
        self._guess_time: float | None = None

    def reset(self) -> None:
        """Discard the last plan and the failure counts: the next update starts as the first one."""
        super().reset()
        self._trajectory = None
        self.reset_guess()

    def reset_guess(self) -> None:
        """Start the next update without a guess, at rest; the last plan remains the fall-back."""
        self._guess_time = None

    @abstractmethod
    def _rest(self) -> Trajectory:
        """Return the guess without a last solution: rest in the measured state."""

    @abstractmethod
    def _describe(self, t: float, trajectory: Trajectory, result: Solution) -> Plan:
        """Return the plan of a solution that starts at time ``t``; status and timing are filled in later."""

    def _advance(self, t: float, start: float) -> Plan:
        """Plan from ``problem.x0`` at time ``t``; ``start`` is when the update began, by the performance counter."""
        x0 = self.problem.x0
        # One sum over all numbers shows any NaN or infinity among them.
        if not math.isfinite(t + float(x0.sum()) + float(self.problem.parameters[:, self._bounded].sum())):
            return self._fall_back(MpcStatus.NOT_FINITE, t, 0, start)
        qp_iterations = 0
        with np.errstate(over="ignore", invalid="ignore"):  # overflows are reported by the status, not by a warning
            self._warm_start(t)
            for _ in range(self.settings.sqp_iterations):
                self.solver.prepare()
                result = self.solver.feedback(x0)
                qp_iterations += result.qp_iterations
                if not self._is_acceptable(result):
                    not_finite = result.status is Status.NOT_FINITE
                    failure = MpcStatus.NOT_FINITE if not_finite else MpcStatus.SOLVER_FAILED
                    return self._fall_back(failure, t, qp_iterations, start)
            plan = self._describe(t, result.trajectory, result)
            if not math.isfinite(float(plan.xs.sum()) + float(plan.forces.sum())):
                return self._fall_back(MpcStatus.SOLVER_FAILED, t, qp_iterations, start)
        self._trajectory = result.trajectory
        status = MpcStatus.INACCURATE if result.status is Status.ACCEPTABLE else MpcStatus.SOLVED
        return self._keep(plan, status, qp_iterations, start)

    def _warm_start(self, t: float) -> None:
        """Shift the last trajectory to the present; without one, start from rest."""
        h, nodes = self.settings.node_s, self.settings.nodes
        ahead = math.inf if self._guess_time is None else (t - self._guess_time) / h
        if not 0.0 <= ahead <= nodes:
            self.solver.set_guess(self._rest())
        else:
            while ahead > 0.0:
                self.solver.shift(min(ahead, 1.0))
                ahead -= 1.0
        self._guess_time = t

    def _is_acceptable(self, result: Solution) -> bool:
        if result.status is not Status.ACCEPTABLE:
            return result.status.usable
        limit = _ACCEPTED_FORCE * float(np.abs(self._weight).max())
        return result.kkt.constraint <= limit and result.kkt.dynamics <= _ACCEPTED_GAP

    def _fall_back(self, status: MpcStatus, t: float, qp_iterations: int, start: float) -> Plan:
        """Return the last valid plan; the next update starts from it, unless it may have caused this failure."""
        plan = super()._fall_back(status, t, qp_iterations, start)
        if self._plan is None or self._trajectory is None or plan.status is not MpcStatus.NOT_FINITE:
            self.reset_guess()  # the guess may be the cause of the failure
        else:
            self.solver.set_guess(self._trajectory)
            self._guess_time = plan.time
        return plan

    def _shares(self) -> Array:
        """Return (N+1, nc, 3) forces that hold the weight, an even share for each foot in contact."""
        return weight_shares(self._flags, self._weight)


def _columns_without_bounds(problem: ShootingProblem) -> slice | IntArray:
    """Return the columns of the parameters that have to be finite: all but those of bounds."""
    layout = problem.action.parameters
    bounds = [where for name, where in layout.items() if name.endswith(("_lower", "_upper"))]
    if not bounds:
        return slice(None)
    rest = np.ones(layout.size, dtype=np.bool_)
    for where in bounds:
        rest[where] = False
    return np.flatnonzero(rest)
