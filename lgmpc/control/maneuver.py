"""Manoeuvres: planned motions, also through the air, performed by the controller that stands and walks.

A manoeuvre is the solution of an optimal control problem, sampled at the controller's ticks. Its motion is the
reference of the MPC and of the whole-body QP, its contacts are their schedule; its torques and the solver's gains are
not used: those of the plan's model do not stop what the plan's model does not have. Two things follow the robot:

- the clock. A foot that touches the ground in the second half of a flight ends it; a flight that the plan has ended
  goes on until a foot touches the ground, or the manoeuvre has failed;
- the place. It begins where the feet stand, along the robot's heading, and goes on from where they land.

In the air the whole-body QP holds the planned joint motion, stiffly: momenta cannot be changed there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from lgmpc.control.reference import MotionTasks
from lgmpc.errors import InputError
from lgmpc.lie import quaternion
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.robot import Robot
from lgmpc.typing import Array, BoolArray
from lgmpc.wbc import WholeBodyController, WholeBodyTerms

__all__ = ["Maneuver", "Performance"]

_POSTURE_ERROR = 0.25
"""rad; a manoeuvre begins and ends within this of the reference posture."""

_SPEED = 0.1
"""rad/s, m/s; a manoeuvre begins and ends slower than this."""

_LATE = 0.15
"""s; longest wait for a touchdown."""

_SETTLING = 0.08
"""s after a touchdown in which feet carry only once they touch the ground."""

_SURE = 2
"""Ticks of contact that end a flight early."""

_WEIGHTS = {"base_orientation": 10.0 / 3.0, "angular_momentum": 10.0}
"""Weights on the ground, in units of those while feet swing."""

_GAINS = {"stance": 400.0, "flight": 2500.0}
"""1/s2; stiffness of the joints, critically damped; that of the centre of mass is as on the ground."""

_POSTURE_WEIGHT = {"stance": 1.0, "flight": 10.0}
"""Weights of the joints' accelerations: in the air they are all that can be controlled."""


@dataclass(frozen=True, eq=False)
class Maneuver:
    """A planned motion at n ticks, world axes.

    Attributes:
        name: by which commands call it.
        period: between two ticks, s.
        q: (n, nq) configurations.
        v: (n, nv) velocities.
        acceleration: (n, nv) rates of the velocities.
        rotation: (n, 3, 3) of the base, body to world.
        com: (n, 3) centre of mass, m.
        momentum: (n, 6) centroidal momentum [linear; angular].
        momentum_rate: (n, 6) its rate.
        forces: (n, nc, 3) contact forces, N.
        stance: (n, nc) which feet carry.
        points: (n, nc, 3) contact points, m.
    """

    name: str
    period: float
    q: Array
    v: Array
    acceleration: Array
    rotation: Array
    com: Array
    momentum: Array
    momentum_rate: Array
    forces: Array
    stance: BoolArray
    points: Array

    @classmethod
    def of(
        cls, name: str, robot: Robot, times: Array, xs: Array, flags: BoolArray, forces: Array, period: float
    ) -> Maneuver:
        """Sample a trajectory of N intervals; those without length, impacts, are steps of the velocity.

        Args:
            name: by which commands call it.
            robot: whose configuration and velocity are the states.
            times: (N+1,) of the nodes, s.
            xs: (N+1, nq + nv) states.
            flags: (N, nc) contacts of each interval.
            forces: (N, nc, 3) contact forces, world axes, N.
            period: between two ticks, s.

        Raises:
            InputError: states of another robot, a motion that begins or ends in the air, in motion, or far from the
                reference posture.
        """
        if xs.shape[1] != robot.nq + robot.nv or flags.shape[1] != robot.nc:
            got = f"{xs.shape[1]} entries of the state and {flags.shape[1]} contacts"
            raise InputError("trajectory", got, f"{robot.nq + robot.nv} and {robot.nc}, those of {robot.name}")
        _check_ends(robot, xs, flags)
        q, v, terms = xs[:, : robot.nq], xs[:, robot.nq :], WholeBodyTerms(robot)
        momenta = np.array([_updated(terms, *each).momentum.copy() for each in zip(q, v, strict=True)])
        lengths = np.diff(times)
        intervals = np.flatnonzero(lengths > 0.0)
        rows = period * np.arange(1 + math.floor(times[-1] / period + 1e-9))
        of = intervals[np.searchsorted(times[intervals], rows + 1e-9, side="right") - 1]
        shares = np.clip((rows - times[of]) / lengths[of], 0.0, 1.0)
        sampled_q = np.array([pin.interpolate(robot.model, q[k], q[k + 1], s) for k, s in zip(of, shares, strict=True)])
        sampled_v = v[of] + shares[:, None] * (v[of + 1] - v[of])
        bases, coms, points = [], [], []
        for each in zip(sampled_q, sampled_v, strict=True):
            _updated(terms, *each)
            bases.append(terms.rotation.copy())
            coms.append(terms.com.copy())
            points.append(terms.contact_points.copy())
        return cls(
            name=name,
            period=period,
            q=sampled_q,
            v=sampled_v,
            acceleration=(v[of + 1] - v[of]) / lengths[of, None],
            rotation=np.array(bases),
            com=np.array(coms),
            momentum=momenta[of] + shares[:, None] * (momenta[of + 1] - momenta[of]),
            momentum_rate=(momenta[of + 1] - momenta[of]) / lengths[of, None],
            forces=forces[of],
            stance=flags[of],
            points=np.array(points),
        )

    @property
    def flights(self) -> list[tuple[int, int]]:
        """First tick of each flight, and the first tick after it."""
        air = np.concatenate([[False], ~self.stance.any(axis=1), [False]])
        return list(zip(*(np.flatnonzero(air[1:] != air[:-1]).reshape(-1, 2).T.tolist()), strict=True))

    def placed(self, points: Array, yaw: float) -> Maneuver:
        """Return the manoeuvre that begins with feet in the middle of ``points`` (nc, 3), m, along a heading, rad."""
        c, s = math.cos(yaw), math.sin(yaw)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])  # of row vectors
        start, shift = self.points[0].mean(axis=0), points.mean(axis=0)
        q = self.q.copy()
        q[:, :3] = (q[:, :3] - start) @ turn + shift
        half = np.array([0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)])
        q[:, 3:7] = quaternion.compose(half, q[:, 3:7])
        return replace(
            self,
            q=q,
            rotation=turn.T @ self.rotation,
            com=(self.com - start) @ turn + shift,
            momentum=(self.momentum.reshape(-1, 2, 3) @ turn).reshape(-1, 6),
            momentum_rate=(self.momentum_rate.reshape(-1, 2, 3) @ turn).reshape(-1, 6),
            forces=self.forces @ turn,
            points=(self.points - start) @ turn + shift,
        )


def _updated(terms: WholeBodyTerms, q: Array, v: Array) -> WholeBodyTerms:
    terms.update(q, v)
    return terms


def _check_ends(robot: Robot, xs: Array, flags: BoolArray) -> None:
    """Check that a trajectory leads from standing to standing."""
    reference = robot.q_reference[robot.joint_q]
    for where, x, stance in (("beginning", xs[0], flags[0]), ("end", xs[-1], flags[-1])):
        off, speed = np.abs(x[: robot.nq][robot.joint_q] - reference), np.abs(x[robot.nq :]).max()
        if not stance.all():
            raise InputError("trajectory", f"feet in the air at its {where}", "one that begins and ends on all feet")
        if speed > _SPEED:
            raise InputError("trajectory", f"a speed of {speed:.2g} at its {where}", f"rest: less than {_SPEED:g}")
        if off.max() > _POSTURE_ERROR:
            joint = robot.joint_names[int(off.argmax())]
            got = f"{joint} {off.max():.2g} rad from the reference posture at its {where}"
            raise InputError(
                "trajectory", got, f"at most {_POSTURE_ERROR:g} rad, because the robot stands in this posture"
            )


class Performance:
    """A manoeuvre that is performed: its clock, its place, and the targets of each tick.

    Args:
        maneuver: the manoeuvre, in its own place.
        wbc: the whole-body controller, sensed at the present tick.
        tasks: its tasks.
        robot: the controller's model.

    Attributes:
        plan: the manoeuvre where it is performed.
        done: whether it is over.
        failure: reason why it cannot go on; empty if it can.
        stance: (nc,) which feet carry at this tick.
        landed: whether the last tick began a stance.
    """

    def __init__(self, maneuver: Maneuver, wbc: WholeBodyController, tasks: MotionTasks, robot: Robot) -> None:
        self.plan = maneuver.placed(wbc.terms.contact_points, wbc.terms.yaw)
        self.done, self.landed, self.failure = False, False, ""
        self.stance = self.plan.stance[0].copy()
        self._wbc, self._tasks, self._robot = wbc, tasks, robot
        self._flights = self.plan.flights
        self._row, self._waited, self._since_landing = -1, 0, len(self.plan.q)
        self._shift = np.zeros(3)
        self._touching = np.zeros(len(self.stance), dtype=np.int_)
        self._flies = False
        changed = (tasks.com, tasks.base_orientation, tasks.angular_momentum, tasks.posture, tasks.swing)
        self._before = [(task, task.weight.copy(), task.kp.copy(), task.kd.copy()) for task in changed]
        self._set_weights(flies=False)

    @property
    def com(self) -> Array:
        """(3,) planned centre of mass of this tick, where the robot is, m."""
        com: Array = self.plan.com[self._row] + self._shift
        return com

    @property
    def base(self) -> Array:
        """(7,) planned base pose of this tick [position, quaternion x y z w]."""
        pose = self.plan.q[self._row, :7].copy()
        pose[:3] += self._shift
        return pose

    def advance(self, contacts: BoolArray | None) -> None:
        """Advance by one tick, and write the targets; ``contacts`` (nc,) are measured, None where they are not."""
        self.landed = False
        flight = self._flight(self._row + 1)
        if flight is None:
            self._row += 1
        else:
            self._fly(*flight, contacts)
        if self._row >= len(self.plan.q):
            self._row, self.done = len(self.plan.q) - 1, True
        self._since_landing += 1
        self.stance[:] = self.plan.stance[self._row]
        if self._since_landing * self.plan.period < _SETTLING and contacts is not None and contacts.any():
            self.stance &= contacts
        self._write_targets()

    def end(self) -> None:
        """Return weights and gains to what they were before."""
        for task, weight, kp, kd in self._before:
            task.weight[:], task.kp[:], task.kd[:] = weight, kp, kd

    def write_horizon(self, node_s: float, friction: float, motion: MotionReference, contacts: ContactHorizon) -> None:
        """Write the planned motion and contacts over the MPC's horizon, which begins at this tick."""
        plan, last = self.plan, len(self.plan.q) - 1
        nodes = np.minimum(self._row + np.rint(node_s / plan.period * np.arange(len(motion.com))).astype(int), last)
        middles = np.minimum(nodes[:-1] + round(0.5 * node_s / plan.period), last)
        motion.com[:] = plan.com[nodes] + self._shift
        motion.com_velocity[:] = plan.momentum[nodes, :3] / self._robot.mass
        motion.q[:] = plan.q[nodes]
        motion.q[:, :3] += self._shift
        motion.angular_velocity[:] = (plan.rotation[nodes] @ plan.v[nodes, 3:6, None])[..., 0]
        motion.catching = False
        contacts.flags[:] = plan.stance[middles]
        contacts.flags[0] = self.stance
        contacts.points[:] = plan.points[middles] + self._shift
        stays = np.logical_and.accumulate(contacts.flags, axis=0) & self.stance
        contacts.points[stays] = np.broadcast_to(self._wbc.terms.contact_points, contacts.points.shape)[stays]
        contacts.normals[:] = self._wbc.terms.normals
        contacts.friction[:] = friction

    def _flight(self, row: int) -> tuple[int, int] | None:
        """Return the flight that a tick is in."""
        return next(((begin, end) for begin, end in self._flights if begin <= row < end), None)

    def _fly(self, begin: int, end: int, contacts: BoolArray | None) -> None:
        """Advance in a flight: to its end if a foot touches early, no further than its end until one does."""
        self._row += 1
        if contacts is None:
            return
        self._touching = np.where(contacts, self._touching + 1, 0)
        early = self._row > 0.5 * (begin + end) and self._touching.max() >= _SURE
        if early:
            self._row = end
        elif self._row == end - 1 and not contacts.any():
            self._waited += 1
            self._row -= 1
            if self._waited * self.plan.period > _LATE:
                self.failure = f"no ground {_LATE:g} s after the planned touchdown"
        if self._row == end:
            self._land()

    def _land(self) -> None:
        """Go on from where the feet are."""
        middle = self._wbc.terms.contact_points.mean(axis=0)
        self._shift = middle - self.plan.points[self._row].mean(axis=0)
        self._touching[:], self._waited, self._since_landing, self.landed = 0, 0, 0, True

    def _set_weights(self, flies: bool) -> None:
        phase, tasks = "flight" if flies else "stance", self._tasks
        stepping, share = self._wbc.settings.scaled(self._robot).stepping_weights, 0.0 if flies else 1.0
        tasks.com.weight[:] = share * np.asarray(stepping.com)
        tasks.base_orientation.weight[:] = share * _WEIGHTS["base_orientation"] * stepping.base_orientation
        tasks.angular_momentum.weight[:] = share * _WEIGHTS["angular_momentum"] * stepping.angular_momentum
        tasks.posture.weight[:], tasks.swing.weight[:] = _POSTURE_WEIGHT[phase], 0.0
        for task, stiffness in ((tasks.posture, _GAINS[phase]), (tasks.com, _GAINS["stance"])):
            task.kp[:], task.kd[:] = stiffness, 2.0 * math.sqrt(stiffness)

    def _write_targets(self) -> None:
        plan, row, tasks, mass = self.plan, self._row, self._tasks, self._robot.mass
        flies = not self.stance.any()
        if flies is not self._flies:
            self._flies = flies
            self._set_weights(flies)
        self._wbc.contacts.stance[:] = self.stance
        self._wbc.contacts.target_forces[:] = plan.forces[row] * self.stance[:, None]
        com, base, momentum = tasks.com.target, tasks.base_orientation.target, tasks.angular_momentum.target
        com.position[:] = plan.com[row] + self._shift
        com.velocity[:], com.acceleration[:] = plan.momentum[row, :3] / mass, plan.momentum_rate[row, :3] / mass
        base.rotation[:], base.angular_velocity[:] = plan.rotation[row], plan.v[row, 3:6]
        momentum.momentum[:], momentum.rate[:] = plan.momentum[row, 3:], plan.momentum_rate[row, 3:]
        joints, of = tasks.posture.target, self._robot.joint_v
        joints.position[:], joints.velocity[:] = plan.q[row, self._robot.joint_q], plan.v[row, of]
        joints.acceleration[:] = plan.acceleration[row, of]
