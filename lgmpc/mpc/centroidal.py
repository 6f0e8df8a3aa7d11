"""Receding-horizon control of centre of mass and momenta by contact forces."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Literal

import numpy as np
from pydantic import Field

from lgmpc.actions import CentroidalAction
from lgmpc.lie import quaternion, so3
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.base import checked_mass, input_error, write_intervals
from lgmpc.mpc.interface import MeasuredState
from lgmpc.mpc.plan import Plan
from lgmpc.mpc.settings import CentroidalWeights, SqpMpcSettings
from lgmpc.mpc.sqp import SqpMpc
from lgmpc.ocp import KktResidual, ShootingProblem, Trajectory
from lgmpc.robot import Robot
from lgmpc.settings import NonNegative
from lgmpc.solvers import RealTimeResult
from lgmpc.typing import Array

__all__ = ["CentroidalMpc", "CentroidalMpcSettings", "write_centroidal_reference"]

_GRAVITY = (0.0, 0.0, -9.81)


class CentroidalMpcSettings(SqpMpcSettings):
    """Model-predictive control of the momenta by contact forces over a receding horizon."""

    model: Literal["centroidal"] = Field(default="centroidal", description="Model that predicts.")
    uprighting_rate_hz: NonNegative = Field(
        default=3.0, description="Rate at which the plan turns a tilted base upright, 1/s."
    )
    weights: CentroidalWeights = Field(default=CentroidalWeights(), description="Weights of the cost.")


class CentroidalMpc(SqpMpc):
    """Plans contact forces over a horizon, from wherever the robot is, many times a second.

    See :class:`~lgmpc.mpc.sqp.SqpMpc` for what each :meth:`update` does, and what happens when one fails. The forces
    alone are constrained, so every update has a feasible solution. Of base and joints the model has nothing; a tilted
    base is turned upright by the angular momentum of :func:`write_centroidal_reference`.

    Args:
        mass: of the robot, kg.
        contacts: number of contact points, nc.
        settings: horizon, weights, limits.
        gravity: (3,) world axes, m/s^2.
        progress: called with a description of what is being compiled.

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
        mass = checked_mass(mass)
        problem = ShootingProblem(CentroidalAction(contacts, s.friction_facets), s.nodes)
        problem.set("mass", mass)
        problem.set("gravity", gravity)
        problem.set("duration", s.node_s)
        lowest, highest = s.normal_force(mass)
        problem.set("normal_force_min", lowest)
        problem.set("normal_force_max", highest)
        problem.set("x_weight", s.weights.state(mass))
        problem.view("x_weight")[-1] *= s.weights.terminal
        problem.set("u_weight", s.weights.forces(contacts, mass))
        super().__init__(problem, s, mass, -mass * np.asarray(gravity, dtype=np.float64), progress)
        self.settings: CentroidalMpcSettings = s
        self._contacts = contacts
        view = problem.view
        self._points = view("contact_points").reshape(s.nodes + 1, contacts, 3)
        self._friction = view("friction")[:, 0]
        self._wrench = view("external_wrench")
        self._x_reference = view("x_reference")
        self._u_reference = view("u_reference").reshape(s.nodes + 1, contacts, 3)

    @classmethod
    def of(
        cls, robot: Robot, settings: CentroidalMpcSettings, progress: Callable[[str], None] | None = None
    ) -> CentroidalMpc:
        """Return the controller of a robot; arguments and errors as of the class."""
        return cls(robot.mass, robot.nc, settings, gravity=robot.gravity, progress=progress)

    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured momenta; see :meth:`lgmpc.mpc.interface.Mpc.update`."""
        start = time.perf_counter()
        problem = self.problem
        try:
            write_intervals(self._points, contacts.points)
            write_intervals(self._flags, contacts.flags)
            write_intervals(self._friction, contacts.friction)
            write_intervals(self._wrench, wrench)
            write_centroidal_reference(
                self._x_reference, self.mass, state, reference, self.settings.uprighting_rate_hz, self.settings.node_s
            )
            problem.x0[0:3], problem.x0[3:9] = state.com, state.momentum
        except ValueError as error:
            raise input_error(error, self.settings.nodes, self._contacts) from error
        self._u_reference[...] = self._shares()
        return self._advance(state.time, start)

    def _rest(self) -> Trajectory:
        n, nu = self.settings.nodes, self.problem.nu
        return Trajectory(np.tile(self.problem.x0, (n + 1, 1)), self._u_reference[:n].reshape(n, nu))

    def _describe(self, t: float, trajectory: Trajectory, result: RealTimeResult) -> Plan:
        n, nc = self.settings.nodes, self._contacts
        forces = trajectory.us.reshape(n, nc, 3) * self._flags[:n, :, None]
        return self._make_plan(t, trajectory.xs, forces, result.kkt)

    def _standing_plan(self, t: float) -> Plan:
        n = self.settings.nodes
        x = np.concatenate([np.nan_to_num(self._x_reference[0, :3]), np.zeros(6)])
        forces = np.nan_to_num(self._shares()[:n])
        return self._make_plan(t, np.tile(x, (n + 1, 1)), forces, KktResidual.unknown())


def write_centroidal_reference(
    target: Array, mass: float, state: MeasuredState, reference: MotionReference, uprighting_rate: float, node_s: float
) -> None:
    """Write the reference of a model that has neither base nor joints.

    A base turned from its reference by the angle ``theta`` (body axes) is turned back with the angular momentum
    ``I rate exp(-rate t) theta``, besides that of the reference's own angular velocity.

    Args:
        target: (N+1, 9) [centre of mass; linear momentum; angular momentum], written.
        mass: of the robot, kg.
        state: measured state.
        reference: desired motion.
        uprighting_rate: 1/s.
        node_s: between nodes, s.

    Raises:
        ValueError: an array of the wrong shape.
    """
    fading = uprighting_rate * np.exp(-uprighting_rate * node_s * np.arange(len(target)))[:, None]
    upright = quaternion.to_matrix.unchecked(reference.q[0, 3:7])
    turn = so3.log.unchecked(state.rotation.T @ upright)
    if reference.com.shape != (len(target), 3):
        raise ValueError(f"shape {reference.com.shape} of the reference instead of {(len(target), 3)}")
    target[:, :3] = reference.com
    np.multiply(reference.com_velocity, mass, out=target[:, 3:6])
    target[:, 6:9] = fading * (state.inertia @ turn)
    target[:, 6:9] += state.angular_momentum(reference.angular_velocity)
