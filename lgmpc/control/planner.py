"""The predictive layer above the whole-body QP: the external wrench, the plan, and its samples at every tick."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from lgmpc.control.reference import ComReference
from lgmpc.errors import InputError
from lgmpc.estimation import WrenchObserver
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc import MeasuredState, Mpc, MpcStatus, Plan, PlanSampler
from lgmpc.robot import Robot
from lgmpc.typing import Array
from lgmpc.wbc import WholeBodyController, WholeBodyTerms

__all__ = ["Planner"]

_CREDIBLE_PUSH = 3.0
"""Weights of the robot: a stronger push than this is a fault of the estimate."""


class Planner:
    """Predictive control with a disturbance observer; writes the targets that the whole-body QP tracks.

    Every tick the observer compares the change of the centroidal momentum with what the whole-body QP predicted; at the
    MPC's rate the MPC plans anew from the measured state under the observed wrench; in between the plan is sampled.
    Whatever the model, the plan is followed through the whole-body QP, also where it holds torques: the QP keeps the
    friction cones at every tick, which a plan's torques with feedback between two updates do not. A stale plan
    is not followed: the whole-body QP then regulates centre of mass, angular momentum and posture by itself.

    Args:
        robot: the controller's model.
        mpc: the predictive controller.
        reference: offset of the centre of mass over time.
        period: time between two ticks, s.

    Attributes:
        mpc: as given.
        observer: estimates the external wrench.
        planned: whether the last update made a plan.
        spent: duration of the last update's planning, s (0 where it only sampled).

    Raises:
        InputError: the MPC's rate is no whole fraction of the ticks' rate.
    """

    def __init__(self, robot: Robot, mpc: Mpc, reference: ComReference, period: float) -> None:
        settings = mpc.settings
        self.mpc = mpc
        self.observer = WrenchObserver(period, settings.observer_time_s, force_limit=_CREDIBLE_PUSH * robot.mass * 9.81)
        self.planned = False
        self.spent = 0.0
        self._every = round(1.0 / (period * settings.rate_hz))
        if self._every < 1:
            raise InputError(
                "mpc.rate_hz", settings.rate_hz, f"a rate not above that of the ticks ({1.0 / period:g} Hz)"
            )
        self._sampler = PlanSampler(period, self._every)
        self._reference = reference
        self._node_times: Array = settings.node_s * np.arange(settings.nodes + 1, dtype=np.float64)
        self._fading = np.exp(-self._node_times[:-1] / settings.wrench_decay_s)[:, None]
        self._contacts = ContactHorizon.allocate(settings.nodes, robot.nc)
        self._motion = MotionReference.standing(robot, settings.nodes, np.zeros(3))
        self._start_com = np.zeros(3)
        self._base_rotation, self._joint_position = np.eye(3), np.zeros(0)
        self._tick = 0

    @property
    def plan(self) -> Plan | None:
        """The last plan, None before the first update."""
        return self._sampler.plan

    @property
    def status(self) -> MpcStatus | None:
        """Status of the last plan, None before the first update."""
        return None if self.plan is None else self.plan.status

    def begin(self, wbc: WholeBodyController) -> None:
        """Start afresh: the reference is relative to the present centre of mass, the posture is the tracked one."""
        self._start_com[:] = wbc.terms.com
        self._base_rotation = wbc.tasks["base_orientation"].target.rotation.copy()
        self._joint_position = wbc.tasks["posture"].target.position.copy()
        self._tick = 0
        self._sampler.clear()
        self.mpc.reset()
        self.observer.reset()

    def expect(self, terms: WholeBodyTerms, acceleration: Array) -> None:
        """Give the observer the momentum rate that the whole-body QP's acceleration (nv,) results in."""
        self.observer.expect(terms.momentum_rate(acceleration))

    def skip(self) -> None:
        """Leave the time until the next tick out of the observation: the torques are a fall-back's."""
        self.observer.skip()

    def update(self, time: float, wbc: WholeBodyController) -> None:
        """Observe, plan if it is time to, and write the targets that the whole-body QP follows."""
        wrench = self.observer.update(wbc.terms.momentum)
        wbc.external_wrench[:] = wrench
        self.planned = self._tick % self._every == 0
        self._tick += 1
        self.spent = 0.0
        if self.planned:
            started = perf_counter()
            self._sampler.load(self._plan(time, wbc, wrench), time)
            self.spent = perf_counter() - started
        self._stand(wbc)
        if self.status is not MpcStatus.STALE:
            self._follow(time, wbc)

    def _plan(self, time: float, wbc: WholeBodyController, wrench: Array) -> Plan:
        terms, contacts = wbc.terms, wbc.contacts
        state = MeasuredState(time, terms.q, terms.v, terms.com, terms.momentum, terms.rotation, terms.locked_inertia)
        self._contacts.hold(terms.contact_points, contacts.stance, float(contacts.friction.min()))
        offset, velocity, _ = self._reference.sample(time + self._node_times)
        np.add(self._start_com, offset, out=self._motion.com)
        self._motion.com_velocity[:] = velocity
        return self.mpc.update(state, self._contacts, self._motion, self._fading * wrench)

    def _stand(self, wbc: WholeBodyController) -> None:
        """Track the posture where it began, at rest: the targets of what a plan does not have."""
        base, posture, momentum = (
            wbc.tasks[name].target for name in ("base_orientation", "posture", "angular_momentum")
        )
        momentum.momentum[:] = 0.0
        momentum.rate[:] = 0.0
        base.rotation[:] = self._base_rotation
        base.angular_velocity[:] = 0.0
        posture.position[:] = self._joint_position
        posture.velocity[:] = 0.0

    def _follow(self, time: float, wbc: WholeBodyController) -> None:
        """Track the plan."""
        row, motion, sample = self._sampler.row(time), self._sampler.motion, self._sampler.posture
        assert motion is not None
        com, momentum = (wbc.tasks[name].target for name in ("com", "angular_momentum"))
        com.position[:] = motion.com[row]
        com.velocity[:] = motion.com_velocity[row]
        com.acceleration[:] = motion.com_acceleration[row]
        momentum.momentum[:] = motion.angular_momentum[row]
        momentum.rate[:] = motion.angular_momentum_rate[row]
        wbc.contacts.target_forces[:] = motion.forces[row]
        if sample is not None:
            base, posture = (wbc.tasks[name].target for name in ("base_orientation", "posture"))
            base.rotation[:] = sample.base_rotation[row]
            base.angular_velocity[:] = sample.base_angular_velocity[row]
            posture.position[:] = sample.joint_position[row]
            posture.velocity[:] = sample.joint_velocity[row]
