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
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, expm, solve_discrete_are

from lgmpc.errors import InputError
from lgmpc.mpc.keeping import PlanKeeper, weight_shares, write_intervals
from lgmpc.mpc.plan import CentroidalPlan, MpcStatus
from lgmpc.mpc.settings import LqrSettings
from lgmpc.ocp import KktResidual
from lgmpc.typing import Array, BoolArray

__all__ = ["CentroidalLqr", "LinearCentroidal", "linearize_centroidal"]

_MOVED = 0.005
"""m. Where contact points or reference are further than this from where the gain was computed, it is computed anew."""


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
    a[6:9, 0:3] = _skew(weight)
    for i in range(nc):
        b[3:6, 3 * i : 3 * i + 3] = flags[i] * np.eye(3)
        b[6:9, 3 * i : 3 * i + 3] = flags[i] * _skew(arms[i])
    w[3:9] = np.eye(6)
    whole = np.zeros((15 + 3 * nc, 15 + 3 * nc))
    whole[:9] = duration * np.hstack([a, b, w])
    exact = expm(whole)
    return LinearCentroidal(exact[:9, :9], exact[:9, 9 : 9 + 3 * nc], exact[:9, 9 + 3 * nc :])


class CentroidalLqr(PlanKeeper):
    """Contact forces by linear feedback of centre of mass and momenta, called as :class:`~lgmpc.mpc.CentroidalMpc` is.

    Each :meth:`update` predicts the regulated motion over a horizon. A known external wrench is met by the smallest
    forces that do; what of a force is outside its friction cone or its normal bounds is cut off, so the prediction is
    that of the saturated regulator. No numbers make it raise: when an update fails, the last valid plan goes on.

    Args:
        mass: of the robot, kg.
        contacts: number of contact points, nc.
        settings: horizon, weights, limits.
        gravity: (3,) world axes, m/s^2.

    Attributes:
        settings: as given.
        mass: as given, kg.
        friction: coefficient to which planned forces are cut; may be set between updates.
        gain: (3 nc, 9) K of the last update, ``u = -K x``.
        failures: updates without a fresh plan so far.
        failures_in_a_row: since the last fresh plan.

    Raises:
        InputError: mass not positive, or no contact.
    """

    def __init__(
        self,
        mass: float,
        contacts: int,
        settings: LqrSettings | None = None,
        *,
        gravity: tuple[float, float, float] | Array = (0.0, 0.0, -9.81),
    ) -> None:
        if contacts < 1:
            raise InputError("contacts", contacts, "at least one contact point")
        s = LqrSettings() if settings is None else settings
        super().__init__(s, mass)
        self.friction = s.friction
        self.gain = np.zeros((3 * contacts, 9))
        self._weights = s.weights
        self._weight: Array = -self.mass * np.asarray(gravity, dtype=np.float64)
        n = s.nodes
        self._flags = np.zeros((n + 1, contacts))
        self._wrench = np.zeros((n + 1, 6))
        self._reference = np.zeros((n + 1, 9))
        self._model: LinearCentroidal | None = None
        self._meet = np.zeros((3 * contacts, 6))
        self._place: tuple[Array, Array] | None = None  # arms and flags of the gain

    def reset(self) -> None:
        """Forget the last plan, the gain and the failure counts."""
        super().reset()
        self._place = None

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
        """Plan from the measured state; arguments, result and errors as :meth:`lgmpc.mpc.CentroidalMpc.update`.

        The gain is that of the first interval's contacts; later ones decide which forces are zero.
        """
        start = time.perf_counter()
        try:
            x = np.concatenate([com, linear_momentum, angular_momentum]).reshape(9)
            points = np.broadcast_to(contact_points, (self.settings.nodes, self._flags.shape[1], 3))[0]
            write_intervals(self._flags, contact_flags)
            write_intervals(self._wrench, 0.0 if external_wrench is None else external_wrench)
            self._reference[...] = x_reference
        except ValueError as error:
            n, nc = self.settings.nodes, self._flags.shape[1]
            expected = (
                f"state (3,) each, contact_points ({nc}, 3) or ({n}, {nc}, 3), contact_flags ({nc},) or ({n}, {nc}),"
                f" x_reference (9,) or ({n + 1}, 9), external_wrench (6,) or ({n}, 6)"
            )
            raise InputError("inputs of the LQR", str(error), expected) from error
        numbers = (x, points, self._flags, self._wrench, self._reference)
        if not math.isfinite(t + sum(float(array.sum()) for array in numbers) + self.friction):
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
        """Compute model and gain, unless those at hand are of the same contacts."""
        if self._place is not None:
            known_arms, known_flags = self._place
            if np.array_equal(flags, known_flags) and np.abs(arms - known_arms).max() < _MOVED:
                return
        s = self.settings
        model = linearize_centroidal(self.mass, self._weight, arms, flags, s.node_duration)
        q, r = np.diag(self._weights.state()), np.diag(self._weights.forces(len(arms)))
        cost_to_go = solve_discrete_are(model.A, model.B, q, r)
        right = model.B.T @ cost_to_go
        self.gain = np.linalg.solve(r + right @ model.B, right @ model.A)
        grasp = np.vstack([np.hstack([f * np.eye(3) for f in flags]), np.hstack(list(map(_scaled_skew, flags, arms)))])
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
            wanted = shares[k] + meeting[k] - self.gain @ (xs[k] - self._reference[k])
            forces[k] = self._saturated(wanted.reshape(nc, 3)) * flags[k]
            deviation = model.A @ (xs[k] - rest) + model.B @ (forces[k].ravel() - shares[k])
            xs[k + 1] = rest + deviation + model.W @ self._wrench[k]
        return xs, forces

    def _saturated(self, forces: Array) -> Array:
        """Cut forces (nc, 3) to their normal bounds and friction cones."""
        s = self.settings
        out = forces.copy()
        np.clip(out[:, 2], s.normal_force_min, s.normal_force_max, out=out[:, 2])
        sideways = np.sqrt(out[:, 0] ** 2 + out[:, 1] ** 2)
        out[:, :2] *= np.minimum(1.0, self.friction * out[:, 2] / np.maximum(sideways, 1e-12))[:, None]
        return out

    def _fall_back(self, status: MpcStatus, t: float, qp_iterations: int, start: float) -> CentroidalPlan:
        self._place = None  # the gain may be what is at fault
        return super()._fall_back(status, t, qp_iterations, start)

    def _standing_plan(self, t: float) -> CentroidalPlan:
        n = self.settings.nodes
        x = np.concatenate([np.nan_to_num(self._reference[0, :3]), np.zeros(6)])
        shares = weight_shares(np.nan_to_num(self._flags[:n]), self._weight)
        return self._make_plan(t, np.tile(x, (n + 1, 1)), shares, KktResidual.unknown())


def _skew(v: Array) -> Array:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _scaled_skew(factor: float, v: Array) -> Array:
    return factor * _skew(v)
