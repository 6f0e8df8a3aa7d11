"""Predictive control by sequential quadratic programming: warm start, real-time iterations, acceptance, failures."""

import logging
import math
import time
from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from lgmpc.errors import InputError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.interface import MeasuredState
from lgmpc.mpc.plan import Plan
from lgmpc.mpc.settings import MpcSettings
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.solvers import RealTimeSqp, Solution, Status
from lgmpc.typing import Array, BoolArray, IntArray

_LOG = logging.getLogger(__name__)

# An inexactly solved subproblem is accepted if it violates its constraints by less than this share of the weight
# (forces, N) and its dynamics by less than this (m, N.s, N.m.s).
_ACCEPTED_FORCE = 0.01
_ACCEPTED_GAP = 0.01


class SqpMpc(ABC):
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

    def __init__(self, problem: ShootingProblem, settings: MpcSettings, mass: float, weight: Array) -> None:
        self.settings: MpcSettings = settings
        self.mass = checked_mass(mass)
        self.failures, self.failures_in_a_row = 0, 0
        self._plan: Plan | None = None  # the last fresh one
        self.problem = problem
        self.solver = RealTimeSqp(problem, settings.qp_solver)
        self._weight = weight
        self._flags = problem.view("contact_flags")
        self._bounded = _columns_without_bounds(problem)
        self._trajectory: Trajectory | None = None  # solution of the last fresh plan
        self._guess_time: float | None = None

    def reset(self) -> None:
        """Discard the last plan and the failure counts: the next update starts as the first one."""
        self.failures = 0
        self.failures_in_a_row = 0
        self._plan = self._trajectory = None
        self.reset_guess()

    def state(self) -> tuple[Any, ...]:
        """Return the guess of the next update, the last fresh plan and the failure counts; see :meth:`set_state`."""
        solver = self.solver
        arrays = (solver.xs, solver.us, *solver.qp_solver.solution.arrays)
        known = self._plan, self._trajectory, self._guess_time, self.failures, self.failures_in_a_row
        return *known, tuple(array.copy() for array in arrays)

    def set_state(self, state: tuple[Any, ...]) -> None:
        """Continue from a result of :meth:`state`."""
        *known, arrays = state
        self._plan, self._trajectory, self._guess_time, self.failures, self.failures_in_a_row = known
        solver = self.solver
        for mine, given in zip((solver.xs, solver.us, *solver.qp_solver.solution.arrays), arrays, strict=True):
            mine[...] = given

    def reset_guess(self) -> None:
        """Start the next update without a guess, at rest; the last plan remains the fall-back."""
        self._guess_time = None

    @abstractmethod
    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured state; see :meth:`lgmpc.mpc.interface.Mpc.update`."""

    @abstractmethod
    def _rest(self) -> Trajectory:
        """Return the guess without a last solution: rest in the measured state."""

    @abstractmethod
    def _describe(self, t: float, trajectory: Trajectory, result: Solution) -> Plan:
        """Return the plan of a solution that starts at time ``t``; status and timing are filled in later."""

    @abstractmethod
    def _standing_plan(self, t: float) -> Plan:
        """Return the plan of rest at the reference, all numbers finite: used before any update has succeeded."""

    def _advance(self, t: float, start: float) -> Plan:
        """Plan from ``problem.x0`` at time ``t``; ``start`` is when the update began, by the performance counter."""
        x0 = self.problem.x0
        # One sum over all numbers shows any NaN or infinity among them.
        if not math.isfinite(t + float(x0.sum()) + float(self.problem.parameters[:, self._bounded].sum())):
            return self._fall_back(Status.NOT_FINITE, t, 0, start)
        qp_iterations = 0
        with np.errstate(over="ignore", invalid="ignore"):  # overflows are reported by the status, not by a warning
            self._warm_start(t)
            for _ in range(self.settings.sqp_iterations):
                self.solver.prepare()
                result = self.solver.feedback(x0)
                qp_iterations += result.qp_iterations
                if not self._is_acceptable(result):
                    failure = Status.FAILED if result.status.usable else result.status
                    return self._fall_back(failure, t, qp_iterations, start)
            plan = self._describe(t, result.trajectory, result)
            if not math.isfinite(float(plan.xs.sum()) + float(plan.forces.sum())):
                return self._fall_back(Status.FAILED, t, qp_iterations, start)
        self._trajectory = result.trajectory
        return self._keep(plan, result.status, qp_iterations, start)

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

    def _keep(self, plan: Plan, status: Status, qp_iterations: int, start: float) -> Plan:
        """Store and return a fresh plan; ``start`` is the beginning of the update by the performance counter."""
        self.failures_in_a_row = 0
        self._plan = plan.stamped(status, qp_iterations, time.perf_counter() - start)
        return self._plan

    def _fall_back(self, status: Status, t: float, qp_iterations: int, start: float) -> Plan:
        """Return the last fresh plan with the status of the failure; STALE after too many consecutive failures.

        The next update starts from that plan, unless it may have caused this failure.
        """
        self.failures += 1
        self.failures_in_a_row += 1
        if self.failures_in_a_row == 1:
            words = "%s update at %.3f s: %s; the last plan remains in use (%s)"
            _LOG.warning(words, type(self).__name__, t, status.name, status.remedy)
        if self.failures_in_a_row > self.settings.stale_after:
            status = Status.STALE
        if self._plan is None or self._trajectory is None or status is not Status.NOT_FINITE:
            self.reset_guess()  # the guess may be the cause of the failure
        else:
            self.solver.set_guess(self._trajectory)
            self._guess_time = self._plan.time
        plan = self._standing_plan(t if math.isfinite(t) else 0.0) if self._plan is None else self._plan
        return plan.stamped(status, qp_iterations, time.perf_counter() - start)

    def _shares(self) -> Array:
        """Return (N+1, nc, 3) forces that hold the weight, an even share for each foot in contact."""
        return weight_shares(self._flags, self._weight)

    def _make_plan(self, t: float, xs: Array, forces: Array) -> Plan:
        """Return a plan whose status and timing are filled in later."""
        xs.flags.writeable = forces.flags.writeable = False
        return Plan(t, self.settings.node_s, self.mass, xs, forces, Status.NOT_FINITE, 0, 0.0)


def checked_mass(mass: float) -> float:
    """Return the mass, kg.

    Raises:
        InputError: it is not positive.
    """
    if not (math.isfinite(mass) and mass > 0):
        raise InputError("mass", mass, "a positive number, kg")
    return float(mass)


def weight_shares(flags: Array, weight: Array) -> Array:
    """Return (N, nc, 3) forces that hold the weight (3,), an even share for each foot whose flag (N, nc) is 1."""
    share = weight / np.maximum(np.add.reduce(flags, axis=1), 1.0)[:, None]
    return flags[:, :, None] * share[:, None, :]


def write_intervals(target: Array, values: Array | BoolArray) -> None:
    """Write the values of N intervals into the rows of N + 1 nodes; the last node has those of the last interval.

    Raises:
        ValueError: the shapes differ.
    """
    if values.shape[1:] != target.shape[1:]:
        raise ValueError(f"shape {values.shape} instead of {(len(target) - 1, *target.shape[1:])}")
    target[:-1] = values
    target[-1] = target[-2]


def input_error(error: ValueError, nodes: int, contacts: int) -> InputError:
    """Return the error of an update whose arrays have wrong shapes."""
    expected = (
        f"points and normals ({nodes}, {contacts}, 3), flags and friction ({nodes}, {contacts}), com and com_velocity"
        f" ({nodes + 1}, 3), q ({nodes + 1}, nq), wrench ({nodes}, 6)"
    )
    return InputError("inputs of the MPC", str(error), expected)


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
