"""The predictive layer above the whole-body QP: the external wrench, the plan, and its samples at every tick."""

import math

import numpy as np

from lgmpc.control.reference import MotionTasks
from lgmpc.estimation import SteadyForce, WrenchObserver
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc import MeasuredState, MotionSampler, Mpc, Plan, PostureSample
from lgmpc.robot import Robot
from lgmpc.status import Status
from lgmpc.timegrid import TimeGrid, periods_in
from lgmpc.typing import GRAVITY, Array
from lgmpc.wbc import Contacts, WholeBodyTerms

_LEAST_LOAD = 0.02
"""Weights of the robot: a smaller force that lasts may be an error of the estimate."""

_CREDIBLE_PUSH = 3.0
"""Weights of the robot: a stronger push than this is a fault of the estimate."""


class Planner:
    """Predictive control with a disturbance observer; writes the targets that the whole-body QP tracks.

    Every tick the observer compares the change of the centroidal momentum with what the whole-body QP predicted; at the
    MPC's rate the MPC plans anew from the measured state under the observed wrench; in between the plan is sampled.
    Whatever the model, the plan is followed through the whole-body QP, also where it holds torques: the QP keeps the
    friction cones at every tick, which a plan's torques with feedback between two updates do not. The base keeps the
    commanded attitude, not that of a plan, which trades it for effort: heavy legs would tilt the base twice as far. A
    stale plan is not followed: the whole-body QP then regulates centre of mass, angular momentum and posture by itself.

    Args:
        robot: the controller's model.
        mpc: the predictive controller.
        period: time between two ticks, s.
        delay: from a measurement until the command that it leads to acts, s.

    Attributes:
        mpc: as given.
        observer: estimates the external wrench.
        load: the part of the wrench's horizontal force that lasts.
        horizon: intervals of the horizon, from 0.
        contacts: over the horizon, to be written before :meth:`plan_from`.
        motion: desired motion over the horizon, to be written before :meth:`plan_from`.
        deferred: whether plans are left to :meth:`finish`, after the tick's command has been sent; but the first one.

    Raises:
        InputError: the MPC's rate does not divide that of the ticks.
    """

    def __init__(self, robot: Robot, mpc: Mpc, period: float, delay: float = 0.0) -> None:
        settings = mpc.settings
        self.mpc = mpc
        weight = GRAVITY * robot.mass
        self.observer = WrenchObserver(
            period,
            settings.observer_time_s,
            force_limit=_CREDIBLE_PUSH * weight,
            delay=delay,
            noise_force=settings.observer_noise_share * weight,
        )
        self.load = SteadyForce(1.0 / settings.rate_hz, _LEAST_LOAD * weight)
        self.deferred, self._asked = False, math.nan
        self._expired = False
        ticks = TimeGrid(period, periods_in("mpc.rate_hz", settings.rate_hz, "wbc.rate_hz", 1.0 / period))
        self._sampler, self.horizon = PlanSampler(ticks, robot.nc), settings.horizon
        self._fading = np.exp(-self.horizon.elapsed[:-1] / settings.wrench_decay_s)[:, None]
        self.contacts = ContactHorizon.allocate(settings.nodes, robot.nc)
        self.motion = MotionReference.standing(robot, settings.nodes, np.zeros(3))

    @property
    def plan(self) -> Plan | None:
        """The last plan, None before the first update."""
        return self._sampler.plan

    def reset(self) -> None:
        """Start afresh."""
        self._sampler.clear()
        self.mpc.reset()
        self.observer.reset()
        self.load.reset()

    def due(self, time: float) -> bool:
        """Return whether the MPC should plan at ``time``."""
        ticks = self._sampler.ticks
        return self.plan is None or self._expired or ticks.nearest(time) >= ticks.count

    def plan_from(self, time: float, terms: WholeBodyTerms) -> None:
        """Plan from the sensed state, :attr:`contacts` and :attr:`motion`; where deferred, in :meth:`finish`."""
        self._expired, self._asked = False, time
        if self.plan is None or not self.deferred:
            self.finish(terms)

    def finish(self, terms: WholeBodyTerms) -> bool:
        """Make the plan that this tick has left; return whether there was one. It is followed from the next tick on.

        To be called in the same tick: state, contacts and motion are those of :meth:`plan_from`.
        """
        time, self._asked = self._asked, math.nan
        if math.isnan(time):
            return False
        plan = self.mpc.update(self.state(time, terms), self.contacts, self.motion, self.wrench)
        self._sampler.load(plan, time)
        self.load.update(self.observer.wrench)
        return True

    def state(self, time: float, terms: WholeBodyTerms) -> MeasuredState:
        """Return the sensed state, whose arrays change at the next tick."""
        return MeasuredState(time, terms.q, terms.v, terms.com, terms.momentum, terms.rotation, terms.locked_inertia)

    @property
    def wrench(self) -> Array:
        """(N, 6) predicted external wrench: the observed one, which fades, and acts on the ground only.

        A mass that the model lacks, and torques that saturate, have no wrench in the air. To make up for it there in
        advance, a robot would jump too high.
        """
        predicted: Array = self._fading * self.observer.wrench
        predicted *= self.contacts.flags.any(axis=1, keepdims=True)
        return predicted

    def expire(self) -> None:
        """Make the next plan due at the next tick: the present one is based on other contacts."""
        self._expired = True

    def follow(self, time: float, tasks: MotionTasks, contacts: Contacts, joints: Array) -> bool:
        """Write a plan's targets unless it is stale, of one without joints ``joints`` (3 nu,); return whether."""
        sampler = self._sampler
        if sampler.plan is None or sampler.plan.status is Status.STALE:
            return False
        row, samples, posture = sampler.row(time), sampler.samples, sampler.posture
        tasks.com.targets_together[...] = samples.com[row]
        tasks.angular_momentum.targets_together[...] = samples.angular_momentum[row]
        contacts.target_forces[...] = samples.motion.forces[row]
        if posture is not None:
            joints = np.concatenate([posture.position[row], posture.velocity[row], joints[2 * len(joints) // 3 :]])
        tasks.posture.targets_together[...] = joints
        return True

    def observe(self, momentum: Array, missed: int = 0) -> Array:
        """Return (6,) the external wrench estimated from the measured momentum (6,); call once a tick.

        Args:
            momentum: [linear; angular], world axes.
            missed: ticks without a call since the last one.
        """
        if missed:
            self.observer.miss(missed)
        return self.observer.update(momentum)

    def expect(self, terms: WholeBodyTerms, acceleration: Array | None, wrench: Array | None = None) -> None:
        """Give the observer the momentum rate that the whole-body QP's acceleration (nv,) results in.

        Without one this tick's command is left out of the observation: its torques are a fall-back's. The QP was
        computed for an external ``wrench`` (6,), the observed one unless given.
        """
        if acceleration is None:
            self.observer.skip()
        else:
            self.observer.expect(terms.momentum_rate(acceleration), wrench)


class PlanSampler:
    """The latest plan, sampled by time at the ticks of the controller below.

    All ticks until the next plan are sampled at once; a time between ticks reads the nearest one.

    Args:
        ticks: between two plans, which are sampled in one call.
        contacts: number of contact points.

    Attributes:
        plan: the latest plan, None before the first.
        ticks: from the time of the first row on.
        samples: of its motion, a row a tick.
        posture: samples of its posture, None where the plan has none.
    """

    def __init__(self, ticks: TimeGrid, contacts: int) -> None:
        self.ticks, self.samples = ticks, MotionSampler(ticks.count, contacts)
        self.plan: Plan | None = None
        self.posture: PostureSample | None = None

    def clear(self) -> None:
        """Forget the plan."""
        self.plan = self.posture = None

    def load(self, plan: Plan, time: float) -> None:
        """Sample ``plan`` from ``time`` (s) on."""
        self.plan, self.ticks = plan, self.ticks.begun_at(time)
        times = self.ticks.nodes[:-1]
        self.samples.sample(plan, times)
        self.posture = None if plan.posture is None else plan.posture.sample_at(times)

    def row(self, time: float) -> int:
        """Return the row of the samples that belongs to ``time`` (s); samples on where it lies outside of them."""
        assert self.plan is not None
        row = self.ticks.nearest(time)
        if not 0 <= row < self.ticks.count:
            self.load(self.plan, time)
            return 0
        return row
