r"""Linear-quadratic regulator of centre of mass and momenta by contact forces.

The centroidal dynamics (:mod:`lgmpc.actions.centroidal`), linearised at rest in c0 under forces f0 that carry the
weight: with x = [c - c0; l; k] and u = f - f0, forces at points p_i,

    c' = l / m,      l' = sum u_i + f_e,      k' = sum (p_i - c0) x u_i + (sum f0_i) x (c - c0) + tau_e,

integrated exactly over an interval in which u and the external wrench are constant (Van Loan, "Computing integrals
involving the matrix exponential", IEEE Trans. Automatic Control 23, 1978). The gain K that minimises
``sum x^T Q x + u^T R u`` over an infinite horizon comes from the discrete algebraic Riccati equation. Exercise H.3 of
the chapter on geometric mechanics; Anderson and Moore, "Optimal Control: Linear Quadratic Methods", 1990.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field
from scipy.linalg import LinAlgError, expm, solve_discrete_are

from lgmpc.errors import InputError
from lgmpc.lie import so3
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.base import GRAVITY, BaseMpc, input_error, weight_shares, write_intervals
from lgmpc.mpc.interface import MeasuredState
from lgmpc.mpc.plan import MpcStatus, Plan
from lgmpc.mpc.reference import CentroidalReference
from lgmpc.mpc.settings import MpcSettings, TrackingWeights
from lgmpc.ocp import KktResidual
from lgmpc.robot import Robot
from lgmpc.robot.feet import UP, in_surface_axes, in_world_axes
from lgmpc.settings import NonNegative
from lgmpc.typing import Array

__all__ = ["CentroidalLqr", "LinearCentroidal", "LqrSettings", "linearize_centroidal"]

_MOVED = 0.005
"""Displacement of contact points or reference, m, beyond which the gain is recomputed."""


@dataclass(frozen=True)
class LinearCentroidal:
    """``x+ = A x + B u + W w`` over one interval.

    Attributes:
        A: (9, 9) of the state's deviation [centre of mass; linear momentum; angular momentum].
        B: (9, 3 nc) of the forces' deviation, world axes.
        W: (9, 6) of the external [force; moment about the centre of mass].
    """

    A: Array
    B: Array
    W: Array


def linearize_centroidal(mass: float, weight: Array, arms: Array, flags: Array, duration: float) -> LinearCentroidal:
    """Linearise at rest and integrate over an interval.

    Args:
        mass: kg.
        weight: (3,) sum of the forces at rest, N.
        arms: (nc, 3) from the centre of mass to the contact points, m.
        flags: (nc,) 1 in contact, 0 in the air: no force.
        duration: of the interval, s.
    """
    nc = len(arms)
    a, b, w = np.zeros((9, 9)), np.zeros((9, 3 * nc)), np.zeros((9, 6))
    a[0:3, 3:6] = np.eye(3) / mass
    a[6:9, 0:3] = so3.hat(weight)
    for i in range(nc):
        b[3:6, 3 * i : 3 * i + 3] = flags[i] * np.eye(3)
        b[6:9, 3 * i : 3 * i + 3] = flags[i] * so3.hat(arms[i])
    w[3:9] = np.eye(6)
    whole = np.zeros((15 + 3 * nc, 15 + 3 * nc))
    whole[:9] = duration * np.hstack([a, b, w])
    exact = expm(whole)
    return LinearCentroidal(exact[:9, :9], exact[:9, 9 : 9 + 3 * nc], exact[:9, 9 + 3 * nc :])


class LqrSettings(MpcSettings):
    """Linear-quadratic regulation of the momenta by contact forces, linearised about standing."""

    model: Literal["lqr"] = Field(default="lqr", description="Predictive model.")
    uprighting_rate_hz: NonNegative = Field(
        default=3.0, description="Rate at which the plan turns a tilted base upright, 1/s."
    )
    weights: TrackingWeights = Field(default=TrackingWeights(), description="Weights of the cost per interval.")


class CentroidalLqr(BaseMpc):
    """Contact forces by linear feedback of centre of mass and momenta, with the interface of an MPC.

    Each :meth:`update` predicts the regulated motion over a horizon. A known external wrench is balanced by the contact
    forces of least norm; forces are clipped to their normal bounds and friction cones, so the prediction is that of the
    saturated regulator. Numerical failures are not raised: after a failed update the last valid plan remains in use.

    Args:
        mass: mass of the robot, kg.
        contacts: number of contact points, nc.
        settings: horizon, weights, limits.
        gravity: (3,) world axes, m/s^2.
        progress: called with a description of what is being compiled.

    Attributes:
        settings: as given.
        mass: as given, kg.
        gain: (3 nc, 9) K of the last update, ``u = -K x``.
        failures: updates without a fresh plan so far.
        failures_in_a_row: since the last fresh plan.

    Raises:
        InputError: mass not positive, no contact, or gravity not three finite numbers.
    """

    def __init__(
        self,
        mass: float,
        contacts: int,
        settings: LqrSettings | None = None,
        *,
        gravity: tuple[float, float, float] | Array = GRAVITY,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        if contacts < 1:
            raise InputError("contacts", contacts, "at least one contact point")
        s = LqrSettings() if settings is None else settings
        super().__init__(s, mass)
        self.settings: LqrSettings = s
        self._friction = np.full((s.nodes + 1, contacts), s.friction)
        self._normals = np.tile(np.array(UP), (s.nodes + 1, contacts, 1))
        self._normal_force = s.normal_force(self.mass)
        self.gain = np.zeros((3 * contacts, 9))
        self._weight: Array = -self.mass * np.asarray(gravity, dtype=np.float64)
        if self._weight.shape != (3,) or not np.isfinite(self._weight).all():
            raise InputError("gravity", gravity, "three finite numbers, m/s2")
        n = s.nodes
        self._flags = np.zeros((n + 1, contacts))
        self._wrench = np.zeros((n + 1, 6))
        self._reference = np.zeros((n + 1, 9))
        self._motion = CentroidalReference(self._reference, self.mass, s.uprighting_rate_hz, s.node_s, progress)
        self._model: LinearCentroidal | None = None
        self._meet = np.zeros((3 * contacts, 6))
        self._place: tuple[Array, Array] | None = None  # arms and flags of the gain

    def reset(self) -> None:
        """Discard the last plan, the gain and the failure counts."""
        super().reset()
        self._place = None

    @classmethod
    def of(cls, robot: Robot, settings: LqrSettings, progress: Callable[[str], None] | None = None) -> CentroidalLqr:
        """Return the regulator of a robot; arguments and errors as of the class."""
        return cls(robot.mass, robot.nc, settings, gravity=robot.gravity, progress=progress)

    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured momenta; see :meth:`lgmpc.mpc.interface.Mpc.update`.

        The gain is that of the first interval's contacts; those of later intervals only determine zero forces.
        """
        start = time.perf_counter()
        try:
            x = np.concatenate([state.com, state.momentum]).reshape(9)
            points = contacts.points[0].reshape(self._flags.shape[1], 3)
            write_intervals(self._flags, contacts.flags)
            write_intervals(self._friction, contacts.friction)
            write_intervals(self._normals, contacts.normals)
            write_intervals(self._wrench, wrench)
            self._motion.write(state, reference)
        except ValueError as error:
            raise input_error(error, self.settings.nodes, self._flags.shape[1]) from error
        t = state.time
        numbers = (x, points, self._flags, self._friction, self._normals, self._wrench, self._reference)
        if not math.isfinite(t + sum(float(array.sum()) for array in numbers)):
            return self._fall_back(MpcStatus.NOT_FINITE, t, 0, start)
        with np.errstate(over="ignore", invalid="ignore"):
            try:
                self._regulate(points - self._reference[0, :3], self._flags[0])
            except LinAlgError:
                return self._fall_back(MpcStatus.SOLVER_FAILED, t, 0, start)
            xs, forces = self._predict(x)
        if not math.isfinite(float(xs.sum()) + float(forces.sum())):
            return self._fall_back(MpcStatus.SOLVER_FAILED, t, 0, start)
        return self._keep(self._make_plan(t, xs, forces, KktResidual.unknown()), MpcStatus.SOLVED, 0, start)

    def _regulate(self, arms: Array, flags: Array) -> None:
        """Compute model and gain, unless the contacts have not changed."""
        if self._place is not None:
            known_arms, known_flags = self._place
            if np.array_equal(flags, known_flags) and np.abs(arms - known_arms).max() < _MOVED:
                return
        s = self.settings
        model = linearize_centroidal(self.mass, self._weight, arms, flags, s.node_s)
        q, r = np.diag(s.weights.state(self.mass)), np.diag(s.weights.forces(len(arms), self.mass))
        cost_to_go = solve_discrete_are(model.A, model.B, q, r)
        right = model.B.T @ cost_to_go
        self.gain = np.linalg.solve(r + right @ model.B, right @ model.A)
        moments = [flag * so3.hat(arm) for flag, arm in zip(flags, arms, strict=True)]
        grasp = np.vstack([np.hstack([flag * np.eye(3) for flag in flags]), np.hstack(moments)])
        self._meet = -np.linalg.pinv(grasp)
        self._model, self._place = model, (arms.copy(), flags.copy())

    def _predict(self, x: Array) -> tuple[Array, Array]:
        """Return states (N+1, 9) and forces (N, nc, 3) of the saturated regulator."""
        assert self._model is not None
        model, nodes, nc = self._model, self.settings.nodes, self._flags.shape[1]
        flags = self._flags[:, :, None]
        shares = weight_shares(self._flags, self._weight).reshape(nodes + 1, -1)
        meeting = self._wrench @ self._meet.T
        xs, forces = np.empty((nodes + 1, 9)), np.empty((nodes, nc, 3))
        xs[0] = x
        rest = np.zeros(9)
        rest[:3] = self._reference[0, :3]
        for k in range(nodes):
            desired = shares[k] + meeting[k] - self.gain @ (xs[k] - self._reference[k])
            local = in_surface_axes(desired.reshape(nc, 3), self._normals[k])
            forces[k] = in_world_axes(self._saturated(local, self._friction[k]), self._normals[k]) * flags[k]
            deviation = model.A @ (xs[k] - rest) + model.B @ (forces[k].ravel() - shares[k])
            xs[k + 1] = rest + deviation + model.W @ self._wrench[k]
        return xs, forces

    def _saturated(self, forces: Array, friction: Array) -> Array:
        """Clip forces (nc, 3), in the axes of their surfaces, to their normal bounds and friction cones."""
        out = forces.copy()
        np.clip(out[:, 2], *self._normal_force, out=out[:, 2])
        sideways = np.sqrt(out[:, 0] ** 2 + out[:, 1] ** 2)
        out[:, :2] *= np.minimum(1.0, friction * out[:, 2] / np.maximum(sideways, 1e-12))[:, None]
        return out

    def _fall_back(self, status: MpcStatus, t: float, qp_iterations: int, start: float) -> Plan:
        self._place = None  # the gain may be the cause of the failure
        return super()._fall_back(status, t, qp_iterations, start)

    def _standing_plan(self, t: float) -> Plan:
        n = self.settings.nodes
        x = np.concatenate([np.nan_to_num(self._reference[0, :3]), np.zeros(6)])
        shares = weight_shares(np.nan_to_num(self._flags[:n]), self._weight)
        return self._make_plan(t, np.tile(x, (n + 1, 1)), shares, KktResidual.unknown())
