"""Predicted motions: the result of a predictive controller, stamped and sampled by time."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import Enum

import numpy as np

from lgmpc.lie import quaternion, so3
from lgmpc.ocp import KktResidual
from lgmpc.typing import Array

__all__ = ["MotionSample", "MpcStatus", "Plan", "PlanSampler", "PosturePlan", "PostureSample"]


class MpcStatus(Enum):
    """Where a plan comes from; the value states the remedy."""

    SOLVED = "nothing to do"
    INACCURATE = "usable; if it happens often, raise the QP solver's iterations or bring the weights closer together"
    SOLVER_FAILED = "the last valid plan goes on; check bounds and weights if it happens often"
    NOT_FINITE = "the last valid plan goes on; the measured state, the wrench or a reference held NaN or infinity"
    STALE = "several updates in a row failed: do not follow this plan, balance without it"

    @property
    def fresh(self) -> bool:
        """Whether the plan was made for the update's own state."""
        return self in (MpcStatus.SOLVED, MpcStatus.INACCURATE)


@dataclass(frozen=True)
class MotionSample:
    """The predicted motion at one time, or with one row for each of several; world axes.

    Attributes:
        com: (3,) centre of mass, m.
        com_velocity: (3,) m/s.
        com_acceleration: (3,) m/s^2.
        linear_momentum: (3,) N.s.
        angular_momentum: (3,) about the centre of mass, N.m.s.
        angular_momentum_rate: (3,) N.m.
        forces: (nc, 3) contact forces on the robot, N.
    """

    com: Array
    com_velocity: Array
    com_acceleration: Array
    linear_momentum: Array
    angular_momentum: Array
    angular_momentum_rate: Array
    forces: Array


@dataclass(frozen=True)
class PostureSample:
    """The predicted base and joints, with one row for each of several times.

    Attributes:
        base_rotation: (n, 3, 3) body to world.
        base_angular_velocity: (n, 3) body axes, rad/s.
        joint_position: (n, nu) rad.
        joint_velocity: (n, nu) rad/s.
    """

    base_rotation: Array
    base_angular_velocity: Array
    joint_position: Array
    joint_velocity: Array


@dataclass(frozen=True)
class PosturePlan:
    """A predicted motion of base and joints, by models that have both.

    Attributes:
        time: of the first node, s.
        node_duration: between nodes, s.
        qs: (N+1, nq) configurations at the nodes.
        vs: (N+1, nv) velocities at the nodes.
    """

    time: float
    node_duration: float
    qs: Array
    vs: Array

    def sample_at(self, times: Array) -> PostureSample:
        """Return the predicted posture at ``times`` (n,) s: geodesic between nodes, velocities linear in time.

        Before the first node it is that of the first, after the last that of the last.
        """
        last = len(self.qs) - 2
        share = np.minimum(np.maximum((times - self.time) / self.node_duration, 0.0), last + 1.0)
        k = np.minimum(share.astype(np.intp), last)
        s = (share - k)[:, None]
        start, end = (quaternion.to_matrix(self.qs[i, 3:7]) for i in (k, k + 1))
        turned = start @ so3.exp(s * so3.log(np.swapaxes(start, -1, -2) @ end))
        joints = self.qs[k, 7:] + s * (self.qs[k + 1, 7:] - self.qs[k, 7:])
        speeds = self.vs[k] + s * (self.vs[k + 1] - self.vs[k])
        return PostureSample(turned, speeds[:, 3:6], joints, speeds[:, 6:])


@dataclass(frozen=True)
class Plan:
    """A predicted trajectory of centre of mass, momenta and contact forces; arrays of its own.

    Every model's prediction has this part; where it has base and joints too, ``posture`` holds them.

    Attributes:
        time: of the first node, s.
        node_duration: between nodes, s.
        mass: of the model, kg.
        xs: (N+1, 9) [centre of mass; linear momentum; angular momentum] at the nodes.
        forces: (N, nc, 3) contact forces, each constant from its node to the next; exactly zero for feet in the air.
        status: where the plan comes from.
        qp_iterations: of the QP solver in the update that returned this plan.
        kkt: residual of the last subproblem's optimality conditions, when the plan was made.
        update_time: what the update took, everything included, s.
        posture: of base and joints, None if the model has none.
    """

    time: float
    node_duration: float
    mass: float
    xs: Array
    forces: Array
    status: MpcStatus
    qp_iterations: int
    kkt: KktResidual
    update_time: float
    posture: PosturePlan | None = None

    @property
    def first_forces(self) -> Array:
        """(nc, 3) forces of the first interval, N."""
        first: Array = self.forces[0]
        return first

    @property
    def end(self) -> float:
        """Time of the last node, s."""
        return self.time + self.node_duration * len(self.forces)

    def sample(self, t: float) -> MotionSample:
        """Return the predicted motion at time ``t`` (s); see :meth:`sample_at`."""
        rows = self.sample_at(np.array([t]))
        return MotionSample(*(getattr(rows, item.name)[0] for item in fields(rows)))

    def sample_at(self, times: Array) -> MotionSample:
        """Return the predicted motion at ``times`` (n,) s, every array with n rows.

        Before the first node it is that of the first, after the last that of the last; between nodes it is the motion
        under the interval's constant forces (:mod:`lgmpc.actions.centroidal`): linear momentum linear in time, centre
        of mass quadratic, angular momentum cubic.
        """
        h, m, last = self.node_duration, self.mass, len(self.forces) - 1
        elapsed = np.minimum(np.maximum(times - self.time, 0.0), h * (last + 1))
        k = np.minimum((elapsed / h).astype(np.intp), last)
        s = (elapsed - k * h)[:, None]
        x, x_next, forces = self.xs[k], self.xs[k + 1], self.forces[k]
        c, l, l_next = x[:, 0:3], x[:, 3:6], x_next[:, 3:6]  # noqa: E741 - the momentum's usual name
        total = forces.sum(axis=1)
        resultant = (l_next - l) / h
        momentum = l + s * resultant
        com = c + (s / m) * (l + (0.5 * s) * resultant)
        # k' = moment - c(t) x total, where the moment about the origin is constant: the end of the interval gives it.
        moment = (x_next[:, 6:9] - x[:, 6:9] + _cross(_com_integral(c, l, resultant, h, m), total)) / h
        angular = x[:, 6:9] + s * moment - _cross(_com_integral(c, l, resultant, s, m), total)
        return MotionSample(com, momentum / m, resultant / m, momentum, angular, moment - _cross(com, total), forces)


class PlanSampler:
    """The latest plan, sampled by time at the ticks of the controller below.

    Ticks are sampled many at once, because NumPy's cost of one call is that of a hundred rows; a time between ticks
    reads the nearest one.

    Args:
        period: of the ticks, s.
        ticks: sampled in one call; the number of ticks between two plans.

    Attributes:
        plan: the latest plan, None before the first.
        start: time of the first row, s.
        motion: samples of its motion, a row a tick.
        posture: samples of its posture, None where the plan has none.
    """

    def __init__(self, period: float, ticks: int) -> None:
        self._period = period
        self._offsets: Array = period * np.arange(ticks, dtype=np.float64)
        self.start = 0.0
        self.plan: Plan | None = None
        self.motion: MotionSample | None = None
        self.posture: PostureSample | None = None

    def clear(self) -> None:
        """Forget the plan."""
        self.plan = self.motion = self.posture = None

    def load(self, plan: Plan, time: float) -> None:
        """Sample ``plan`` from ``time`` (s) on."""
        self.plan, self.start = plan, time
        times = time + self._offsets
        self.motion = plan.sample_at(times)
        self.posture = None if plan.posture is None else plan.posture.sample_at(times)

    def row(self, time: float) -> int:
        """Return the row of the samples that belongs to ``time`` (s); samples on where it lies outside of them.

        Raises:
            ValueError: there is no plan.
        """
        if self.plan is None:
            raise ValueError("no plan was loaded")
        row = round((time - self.start) / self._period)
        if not 0 <= row < len(self._offsets):
            self.load(self.plan, time)
            return 0
        return row


def _com_integral(c: Array, l: Array, resultant: Array, t: Array | float, m: float) -> Array:  # noqa: E741
    integral: Array = t * c + (t * t / (2.0 * m)) * (l + (t / 3.0) * resultant)
    return integral


def _cross(a: Array, b: Array) -> Array:
    """Cross products of rows (n, 3), in a fraction of the time that np.cross takes for few rows."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    product = np.empty_like(a)
    product[:, 0] = ay * bz - az * by
    product[:, 1] = az * bx - ax * bz
    product[:, 2] = ax * by - ay * bx
    return product
