"""Receding-horizon control of centre of mass and momenta by contact forces."""

from __future__ import annotations

import dataclasses
import logging
import math
import time
from collections.abc import Callable

import numpy as np

from lgmpc.actions import CentroidalAction
from lgmpc.errors import InputError
from lgmpc.mpc.plan import CentroidalPlan, MpcStatus
from lgmpc.mpc.settings import CentroidalMpcSettings
from lgmpc.ocp import KktResidual, ShootingProblem, Trajectory
from lgmpc.solvers import SqpResult, SqpSolver, SqpStatus
from lgmpc.typing import Array, BoolArray

__all__ = ["CentroidalMpc"]

_LOG = logging.getLogger(__name__)
_GRAVITY = (0.0, 0.0, -9.81)
# A loosely solved subproblem is followed if it breaks its constraints by less than this share of the weight (forces,
# N) and its dynamics by less than this (m, N.s, N.m.s).
_ACCEPTED_FORCE = 0.01
_ACCEPTED_GAP = 0.01


class CentroidalMpc:
    """Plans contact forces over a horizon, from wherever the robot is, many times a second.

    Each :meth:`update` shifts the last plan to the present, takes the configured number of SQP steps from there and
    returns the new plan. No numbers make it raise: when an update fails, the last valid plan goes on (its later part is
    for the present), with a status that says why; after several failures in a row the status is STALE. The forces alone
    are constrained, so every update has a feasible solution.

    Args:
        mass: of the robot, kg.
        contacts: number of contact points, nc.
        settings: horizon, weights, limits.
        gravity: (3,) world axes, m/s^2.
        progress: told what is being compiled, when something is.

    Attributes:
        settings: as given.
        mass: as given, kg.
        problem: the optimal control problem of the last update, for other solvers to look at.
        solver: the real-time iteration.
        failures: updates without a fresh plan so far.
        failures_in_a_row: since the last fresh plan.

    Raises:
        InputError: mass not positive, no contact, or gravity not three finite numbers.
        MissingDependencyError: the QP solver is not installed.
    """

    def __init__(
        self,
        mass: float,
        contacts: int,
        settings: CentroidalMpcSettings | None = None,
        *,
        gravity: tuple[float, float, float] | Array = _GRAVITY,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        if not (math.isfinite(mass) and mass > 0):
            raise InputError("mass", mass, "a positive number, kg")
        self.settings = CentroidalMpcSettings() if settings is None else settings
        s = self.settings
        self.problem = ShootingProblem(CentroidalAction(contacts, s.facets), s.nodes)
        self.problem.set("mass", mass)
        self.problem.set("gravity", gravity)
        self.problem.set("duration", s.node_duration)
        self.problem.set("friction", s.friction)
        self.problem.set("normal_force_min", s.normal_force_min)
        self.problem.set("normal_force_max", s.normal_force_max)
        self.problem.set("x_weight", s.weights.state())
        self.problem.view("x_weight")[-1] *= s.weights.terminal
        self.problem.set("u_weight", s.weights.forces(contacts))
        self.solver = SqpSolver(self.problem, s.qp_solver, progress)
        self.mass = float(mass)
        self._contacts = contacts
        self._weight = -float(mass) * np.asarray(gravity, dtype=np.float64)
        view = self.problem.view
        self._points = view("contact_points").reshape(s.nodes + 1, contacts, 3)
        self._flags = view("contact_flags")
        self._wrench = view("external_wrench")
        self._x_reference = view("x_reference")
        self._u_reference = view("u_reference").reshape(s.nodes + 1, contacts, 3)
        self.failures = 0
        self.failures_in_a_row = 0
        self._plan: CentroidalPlan | None = None  # the last fresh one
        self._guess_time: float | None = None

    @property
    def friction(self) -> float:
        """Friction coefficient that plans rely on; may be set between updates."""
        return float(self.problem.parameters[0, self.problem.action.parameters["friction"]][0])

    @friction.setter
    def friction(self, coefficient: float) -> None:
        self.problem.view("friction")[:] = coefficient

    def reset(self) -> None:
        """Forget the last plan and the failure counts: the next update begins as the first one did."""
        self.failures = 0
        self.failures_in_a_row = 0
        self._plan = None
        self._guess_time = None

    def update(
        self,
        t: float,
        com: Array,
        linear_momentum: Array,
        angular_momentum: Array,
        contact_points: Array,
        contact_flags: Array | BoolArray,
        x_reference: Array,
        external_wrench: Array | None = None,
    ) -> CentroidalPlan:
        """Plan from the measured state; world axes.

        Args:
            t: time of the state, s.
            com: (3,) centre of mass, m.
            linear_momentum: (3,) N.s.
            angular_momentum: (3,) about the centre of mass, N.m.s.
            contact_points: (nc, 3), or (N, nc, 3) an interval each, m.
            contact_flags: (nc,), or (N, nc): whether each foot is in contact.
            x_reference: (9,), or (N+1, 9) a node each: [centre of mass; linear momentum; angular momentum] to stay
                near.
            external_wrench: (6,), or (N, 6): [force; moment about the centre of mass] that acts on the robot besides
                the contacts, as far as it is known; none if omitted.

        Returns:
            The new plan, or after a failure the last valid one with the status that says why.

        Raises:
            InputError: an array of the wrong shape (values are never refused).
        """
        start = time.perf_counter()
        self._load(contact_points, contact_flags, x_reference, external_wrench)
        x0 = self.problem.x0
        try:
            x0[0:3], x0[3:6], x0[6:9] = com, linear_momentum, angular_momentum
        except ValueError as error:
            raise InputError("measured state", str(error), "com, linear and angular momentum of shape (3,)") from error
        # One sum over all numbers shows any NaN or infinity among them.
        if not math.isfinite(t + float(x0.sum()) + float(self.problem.parameters.sum())):
            return self._fall_back(MpcStatus.NOT_FINITE, t, 0, start)
        qp_iterations = 0
        with np.errstate(over="ignore", invalid="ignore"):  # absurd numbers end in a status, not in a warning
            self._warm_start(t, x0)
            for _ in range(self.settings.sqp_iterations):
                self.solver.prepare()
                result = self.solver.feedback(x0)
                qp_iterations += result.qp_iterations
                if not self._is_acceptable(result):
                    return self._fall_back(_FAILURES[result.status], t, qp_iterations, start)
        return self._accept(t, result, qp_iterations, start)

    def _load(self, points: Array, flags: Array | BoolArray, x_reference: Array, wrench: Array | None) -> None:
        try:
            _write(self._points, points)
            _write(self._flags, flags)
            _write(self._wrench, 0.0 if wrench is None else wrench)
            self._x_reference[...] = x_reference
        except ValueError as error:
            n, nc = self.settings.nodes, self._contacts
            expected = (
                f"contact_points ({nc}, 3) or ({n}, {nc}, 3), contact_flags ({nc},) or ({n}, {nc}), x_reference (9,) or"
                f" ({n + 1}, 9), external_wrench (6,) or ({n}, 6)"
            )
            raise InputError("inputs of the MPC", str(error), expected) from error
        in_contact = np.maximum(self._flags.sum(axis=1), 1.0)
        self._u_reference[...] = (self._weight / in_contact[:, None])[:, None, :]

    def _warm_start(self, t: float, x0: Array) -> None:
        """Shift the last trajectory to the present; without one, stand still."""
        h, nodes = self.settings.node_duration, self.settings.nodes
        ahead = math.inf if self._guess_time is None else (t - self._guess_time) / h
        if not 0.0 <= ahead <= nodes:
            n, nu = self.settings.nodes, self.problem.action.nu
            self.solver.set_guess(Trajectory(np.tile(x0, (n + 1, 1)), self._u_reference[:n].reshape(n, nu)))
        else:
            while ahead > 0.0:
                self.solver.shift(min(ahead, 1.0))
                ahead -= 1.0
        self._guess_time = t

    def _is_acceptable(self, result: SqpResult) -> bool:
        if result.status is not SqpStatus.INACCURATE:
            return result.status.usable
        limit = _ACCEPTED_FORCE * float(np.abs(self._weight).max())
        return result.kkt.constraint <= limit and result.kkt.dynamics <= _ACCEPTED_GAP

    def _accept(self, t: float, result: SqpResult, qp_iterations: int, start: float) -> CentroidalPlan:
        self.failures_in_a_row = 0
        n, nc = self.settings.nodes, self._contacts
        forces = result.trajectory.us.reshape(n, nc, 3) * self._flags[:n, :, None]
        status = MpcStatus.INACCURATE if result.status is SqpStatus.INACCURATE else MpcStatus.SOLVED
        elapsed = time.perf_counter() - start
        self._plan = self._make_plan(t, result.trajectory.xs, forces, status, qp_iterations, result.kkt, elapsed)
        return self._plan

    def _fall_back(self, status: MpcStatus, t: float, qp_iterations: int, start: float) -> CentroidalPlan:
        """Go on with the last valid plan, and let the next update start from it."""
        self.failures += 1
        self.failures_in_a_row += 1
        if self.failures_in_a_row == 1:
            _LOG.warning("MPC update at %.3f s: %s (%s)", t, status.name, status.value)
        if self.failures_in_a_row > self.settings.stale_after:
            status = MpcStatus.STALE
        plan = self._plan
        if plan is None:
            plan, self._guess_time = self._standing_plan(t), None
        elif status is MpcStatus.STALE:
            self._guess_time = None  # it may be the guess that is at fault: the next update begins without one
        else:
            self.solver.set_guess(Trajectory(plan.xs, plan.forces.reshape(self.settings.nodes, -1)))
            self._guess_time = plan.time
        elapsed = time.perf_counter() - start
        return dataclasses.replace(plan, status=status, qp_iterations=qp_iterations, update_time=elapsed)

    def _standing_plan(self, t: float) -> CentroidalPlan:
        """Rest at the reference, the weight shared by the feet in contact: for when no update has succeeded yet."""
        n = self.settings.nodes
        x = np.concatenate([self._x_reference[0, :3], np.zeros(6)])
        forces = self._u_reference[:n] * self._flags[:n, :, None]
        xs, forces = (np.where(np.isfinite(array), array, 0.0) for array in (np.tile(x, (n + 1, 1)), forces))
        begin = t if math.isfinite(t) else 0.0
        return self._make_plan(begin, xs, forces, MpcStatus.NOT_FINITE, 0, KktResidual.unknown(), 0.0)

    def _make_plan(
        self, t: float, xs: Array, forces: Array, status: MpcStatus, iterations: int, kkt: KktResidual, elapsed: float
    ) -> CentroidalPlan:
        xs.flags.writeable = forces.flags.writeable = False
        return CentroidalPlan(t, self.settings.node_duration, self.mass, xs, forces, status, iterations, kkt, elapsed)


_FAILURES = {
    SqpStatus.INACCURATE: MpcStatus.SOLVER_FAILED,
    SqpStatus.QP_FAILED: MpcStatus.SOLVER_FAILED,
    SqpStatus.NOT_FINITE: MpcStatus.NOT_FINITE,
}


def _write(target: Array, value: Array | BoolArray | float) -> None:
    """Write one value for all intervals, or one each (the terminal node, which reads none of them, keeps the last)."""
    if np.ndim(value) == target.ndim:
        target[:-1] = value
        target[-1] = target[-2]
    else:
        target[...] = value
