"""Predicted motions: the result of a predictive controller, stamped and sampled by time."""

import functools
from dataclasses import dataclass, fields
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.compile import StageKernel
from lgmpc.status import Status
from lgmpc.typing import Array


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


_MOTION = [item.name for item in fields(MotionSample) if item.name != "forces"]


@dataclass(frozen=True)
class PostureSample:
    """The predicted joints, with one row for each of several times.

    Attributes:
        position: (n, nu) rad.
        velocity: (n, nu) rad/s.
    """

    position: Array
    velocity: Array


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
        """Return the predicted joints at ``times`` (n,) s, linear in time between nodes.

        Before the first node they are those of the first, after the last those of the last.
        """
        last = len(self.qs) - 2
        share = np.minimum(np.maximum((times - self.time) / self.node_duration, 0.0), last + 1.0)
        k = np.minimum(share.astype(np.intp), last)
        s, q, v = (share - k)[:, None], self.qs[:, 7:], self.vs[:, 6:]
        return PostureSample(q[k] + s * (q[k + 1] - q[k]), v[k] + s * (v[k + 1] - v[k]))


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
        status: of the update that returned it; unless that is usable, the plan is the last one, or standing.
        qp_iterations: of the QP solver in the update that returned this plan.
        update_time: computing time of the whole update, s.
        posture: of base and joints, None if the model has none.
    """

    time: float
    node_duration: float
    mass: float
    xs: Array
    forces: Array
    status: Status
    qp_iterations: int
    update_time: float
    posture: PosturePlan | None = None

    @property
    def first_forces(self) -> Array:
        """(nc, 3) forces of the first interval, N."""
        return self.forces[0]

    @property
    def end(self) -> float:
        """Time of the last node, s."""
        return self.time + self.node_duration * len(self.forces)

    def stamped(self, status: Status, qp_iterations: int, update_time: float) -> "Plan":
        """Return the same motion as the result of an update (dataclasses.replace takes four times as long)."""
        return Plan(
            self.time, self.node_duration, self.mass, self.xs, self.forces, status, qp_iterations, update_time,
            self.posture,
        )  # fmt: skip

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
        return MotionSampler(len(times), self.forces.shape[1]).sample(self, times)


class MotionSampler:
    """Samples predicted motions at a number of times, in one compiled call and in buffers of its own.

    Args:
        count: of the times, n.
        contacts: number of contact points, nc.

    Attributes:
        motion: the last samples, with n rows.
        com: (n, 9) of them, centre of mass, its velocity and acceleration.
        angular_momentum: (n, 6) of them, angular momentum and its rate.

    Raises:
        CompileError: the compiler failed.
    """

    def __init__(self, count: int, contacts: int) -> None:
        self._forces = np.zeros((count, 3 * contacts))
        table = np.zeros((count, 18))
        rows = dict(zip(_MOTION, np.split(table, 6, axis=1), strict=True))
        self.com, self.angular_momentum = table[:, :9], table[:, 12:]
        self.motion = MotionSample(**rows, forces=self._forces.reshape(count, contacts, 3))
        self._start, self._end = np.zeros((2, count, 9))
        self._since, self._plan = np.zeros((count, 1)), np.zeros(2)
        self._run = _motion_kernel(contacts).bind(
            count, start=self._start, end=self._end, forces=self._forces, since=self._since, plan=self._plan,
            **rows,
        )  # fmt: skip

    def sample(self, plan: Plan, times: Array) -> MotionSample:
        """Return the motion at increasing ``times`` (n,) s, as :meth:`Plan.sample_at`; overwritten by the next call."""
        h, last = plan.node_duration, len(plan.forces) - 1
        first, until = float(times[0]) - plan.time, float(times[-1]) - plan.time
        if 0.0 <= first and until / h < 1.0:  # as mostly: all in the first interval
            self._start[...], self._end[...], self._forces[...] = plan.xs[0], plan.xs[1], plan.forces[0].reshape(-1)
            np.subtract(times, plan.time, out=self._since[:, 0])
            self._plan[:] = h, plan.mass
            self._run()
            return self.motion
        elapsed = np.minimum(np.maximum(times - plan.time, 0.0), h * (last + 1))
        k = np.minimum((elapsed / h).astype(np.intp), last)
        plan.xs.take(k, axis=0, out=self._start, mode="clip")
        plan.xs.take(k + 1, axis=0, out=self._end, mode="clip")
        plan.forces.reshape(last + 1, -1).take(k, axis=0, out=self._forces, mode="clip")
        np.subtract(elapsed, k * h, out=self._since[:, 0])
        self._plan[:] = h, plan.mass
        self._run()
        return self.motion


@functools.lru_cache(maxsize=8)
def _motion_kernel(contacts: int) -> StageKernel:
    return StageKernel.of(_motion, contacts)


def _motion(contacts: int) -> ca.Function:
    """Return the motion at a time since the beginning of an interval, from both of its ends and the forces."""
    start, end, forces = ca.SX.sym("start", 9), ca.SX.sym("end", 9), ca.SX.sym("forces", 3 * contacts)
    since, plan = ca.SX.sym("since"), ca.SX.sym("plan", 2)
    h, m = plan[0], plan[1]
    (com, linear, angular), (_, linear_end, angular_end) = (ca.vertsplit(x, 3) for x in (start, end))
    total = ca.sum2(ca.reshape(forces, 3, contacts))
    resultant = (linear_end - linear) / h
    momentum = linear + since * resultant

    def com_integral(t: Any) -> Any:
        return t * com + t**2 / (2.0 * m) * (linear + t / 3.0 * resultant)

    com_now = com + since / m * (linear + 0.5 * since * resultant)
    # k' = moment - c(t) x total, where the moment about the origin is constant: the end of the interval gives it.
    moment = (angular_end - angular + ca.cross(com_integral(h), total)) / h
    turning = angular + since * moment - ca.cross(com_integral(since), total)
    rate = moment - ca.cross(com_now, total)
    outputs = [com_now, momentum / m, resultant / m, momentum, turning, rate]
    inputs = {"start": start, "end": end, "forces": forces, "since": since, "plan": plan}
    return ca.Function(f"plan_motion_{contacts}", list(inputs.values()), outputs, list(inputs), _MOTION)
