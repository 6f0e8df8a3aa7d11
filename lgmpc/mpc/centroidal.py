"""Receding-horizon control of centre of mass and momenta by contact forces."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from lgmpc.actions import CentroidalAction
from lgmpc.errors import InputError
from lgmpc.mpc.keeping import checked_mass, write_intervals
from lgmpc.mpc.plan import CentroidalPlan
from lgmpc.mpc.receding import RecedingHorizon
from lgmpc.mpc.settings import CentroidalMpcSettings
from lgmpc.ocp import KktResidual, ShootingProblem, Trajectory
from lgmpc.solvers import RealTimeResult
from lgmpc.typing import Array, BoolArray

__all__ = ["CentroidalMpc"]

_GRAVITY = (0.0, 0.0, -9.81)


class CentroidalMpc(RecedingHorizon):
    """Plans contact forces over a horizon, from wherever the robot is, many times a second.

    See :class:`~lgmpc.mpc.receding.RecedingHorizon` for what each :meth:`update` does, and what happens when one fails.
    The forces alone are constrained, so every update has a feasible solution.

    Args:
        mass: of the robot, kg.
        contacts: number of contact points, nc.
        settings: horizon, weights, limits.
        gravity: (3,) world axes, m/s^2.
        progress: told what is being compiled, when something is.

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
        s = CentroidalMpcSettings() if settings is None else settings
        problem = ShootingProblem(CentroidalAction(contacts, s.facets), s.nodes)
        problem.set("mass", checked_mass(mass))
        problem.set("gravity", gravity)
        problem.set("duration", s.node_duration)
        problem.set("friction", s.friction)
        problem.set("normal_force_min", s.normal_force_min)
        problem.set("normal_force_max", s.normal_force_max)
        problem.set("x_weight", s.weights.state())
        problem.view("x_weight")[-1] *= s.weights.terminal
        problem.set("u_weight", s.weights.forces(contacts))
        super().__init__(problem, s, mass, -float(mass) * np.asarray(gravity, dtype=np.float64), progress)
        self._contacts = contacts
        view = problem.view
        self._points = view("contact_points").reshape(s.nodes + 1, contacts, 3)
        self._wrench = view("external_wrench")
        self._x_reference = view("x_reference")
        self._u_reference = view("u_reference").reshape(s.nodes + 1, contacts, 3)

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
        return self._advance(t, start)

    @property
    def _friction_names(self) -> tuple[str, ...]:
        return ("friction",)

    def _load(self, points: Array, flags: Array | BoolArray, x_reference: Array, wrench: Array | None) -> None:
        try:
            write_intervals(self._points, points)
            write_intervals(self._flags, flags)
            write_intervals(self._wrench, 0.0 if wrench is None else wrench)
            self._x_reference[...] = x_reference
        except ValueError as error:
            n, nc = self.settings.nodes, self._contacts
            expected = (
                f"contact_points ({nc}, 3) or ({n}, {nc}, 3), contact_flags ({nc},) or ({n}, {nc}), x_reference (9,) or"
                f" ({n + 1}, 9), external_wrench (6,) or ({n}, 6)"
            )
            raise InputError("inputs of the MPC", str(error), expected) from error
        self._u_reference[...] = self._shares()

    def _rest(self) -> Trajectory:
        n, nu = self.settings.nodes, self.problem.nu
        return Trajectory(np.tile(self.problem.x0, (n + 1, 1)), self._u_reference[:n].reshape(n, nu))

    def _describe(self, t: float, trajectory: Trajectory, result: RealTimeResult) -> CentroidalPlan:
        n, nc = self.settings.nodes, self._contacts
        forces = trajectory.us.reshape(n, nc, 3) * self._flags[:n, :, None]
        return self._make_plan(t, trajectory.xs, forces, result.kkt)

    def _standing_plan(self, t: float) -> CentroidalPlan:
        n = self.settings.nodes
        x = np.concatenate([self._x_reference[0, :3], np.zeros(6)])
        xs, forces = np.tile(x, (n + 1, 1)), self._u_reference[:n]
        xs, forces = (np.where(np.isfinite(array), array, 0.0) for array in (xs, forces))
        return self._make_plan(t, xs, forces, KktResidual.unknown())
