"""The predictive layer above the whole-body QP: what pushes, where to go, and with which forces."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from lgmpc.control.prediction import Predictor
from lgmpc.control.reference import ComReference
from lgmpc.errors import InputError
from lgmpc.estimation import WrenchObserver
from lgmpc.mpc import CentroidalPlan, CentroidalSample, MpcStatus, PostureSample
from lgmpc.typing import Array
from lgmpc.wbc import WholeBodyReference, WholeBodyTerms

__all__ = ["Planner", "PlannerSettings"]


@dataclass(frozen=True)
class PlannerSettings:
    """How the plan is fed and followed.

    Attributes:
        every: whole-body ticks per MPC update.
        wrench_decay_time: s; the estimated external wrench is predicted to fade with this time constant.

    Raises:
        InputError: a value that is not positive.
    """

    every: int = 10
    wrench_decay_time: float = 0.1

    def __post_init__(self) -> None:
        if self.every < 1:
            raise InputError("every", self.every, "at least one whole-body tick")
        if not self.wrench_decay_time > 0:
            raise InputError("wrench_decay_time", self.wrench_decay_time, "a positive number of seconds")


class Planner:
    """Predictive control with a disturbance observer, writing what the whole-body QP should track.

    Every tick the observer compares the change of the centroidal momentum with what the whole-body QP asked for; every
    ``settings.every`` ticks the predictor plans anew from the measured state under the observed wrench; in between the
    plan is interpolated. Whatever the model, it is followed through the whole-body QP, also where it holds torques: the
    QP keeps the friction cones at every tick, which a plan's torques with feedback between two updates do not.
    A plan that is stale is not followed: the whole-body QP then regulates the centre of mass, the angular momentum and
    the posture by itself.

    Args:
        predictor: the receding-horizon controller, of any model.
        observer: estimates the external wrench.
        reference: offset of the centre of mass over time.
        tick_period: time between two updates, s.
        settings: see :class:`PlannerSettings`.

    Attributes:
        plan: the last plan, None before the first update.
        planned: whether the last update made a plan.
        spent: duration of the last update's planning, s (0 where it only interpolated).
    """

    def __init__(
        self,
        predictor: Predictor,
        observer: WrenchObserver,
        reference: ComReference,
        tick_period: float,
        settings: PlannerSettings,
    ) -> None:
        self.predictor = predictor
        self._tick_times: Array = tick_period * np.arange(settings.every, dtype=np.float64)
        self.observer = observer
        self.settings = settings
        self.plan: CentroidalPlan | None = None
        self.planned = False
        self.spent = 0.0
        self._reference = reference
        self._fading = np.exp(-predictor.node_times[:-1] / settings.wrench_decay_time)[:, None]
        self._x_reference = np.zeros((predictor.node_times.size, 9))
        self._start_com = np.zeros(3)
        self._base_rotation, self._joint_position = np.eye(3), np.zeros(0)
        self._tick = 0
        self._motion: CentroidalSample | None = None
        self._posture: PostureSample | None = None

    @property
    def horizon_com(self) -> Array:
        """(N+1, 3) predicted centre of mass of the last plan, m."""
        assert self.plan is not None
        return self.plan.xs[:, :3]

    @property
    def first_forces(self) -> Array:
        """(nc, 3) forces of the last plan's first interval, N."""
        assert self.plan is not None
        return self.plan.first_forces

    @property
    def status(self) -> MpcStatus:
        """Status of the last plan."""
        assert self.plan is not None
        return self.plan.status

    def begin(self, terms: WholeBodyTerms, tracked: WholeBodyReference) -> None:
        """Start afresh: the reference is relative to the present centre of mass, the posture is the tracked one."""
        self._start_com[:] = terms.com
        self._base_rotation, self._joint_position = tracked.base_rotation.copy(), tracked.joint_position.copy()
        self._tick = 0
        self.plan = None
        self._motion = self._posture = None
        self.predictor.reset()
        self.observer.reset()

    def expect(self, terms: WholeBodyTerms, acceleration: Array) -> None:
        """Tell the observer which acceleration (nv,) the whole-body QP gives the robot until the next tick."""
        self.observer.expect(terms.momentum_matrix @ acceleration + terms.momentum_drift)

    def skip(self) -> None:
        """Tell the observer that the torques until the next tick are a fall-back's: what they do is no push."""
        self.observer.skip()

    def update(self, time: float, terms: WholeBodyTerms, tracked: WholeBodyReference) -> None:
        """Observe, plan if it is time to, and write into ``tracked`` what the whole-body QP should follow."""
        wrench = self.observer.update(terms.momentum)
        tracked.external_wrench[:] = wrench
        row = self._tick % self.settings.every
        self.planned = row == 0
        self._tick += 1
        self.spent = 0.0
        if self.planned:
            started = perf_counter()
            self._stand(tracked)
            self.plan = self._plan(time, terms, tracked, wrench)
            # All ticks until the next plan in one call: NumPy's cost per call is that of a hundred rows.
            times = time + self._tick_times
            self._motion = self.plan.sample_at(times)
            self._posture = None if self.plan.posture is None else self.plan.posture.sample_at(times)
            self.spent = perf_counter() - started
        if self._motion is None or self.status is MpcStatus.STALE:
            self._let_go(tracked)
            return
        self._follow(self._motion, row, tracked)
        if self._posture is not None:
            self._take_posture(self._posture, row, tracked)

    def _plan(self, time: float, terms: WholeBodyTerms, tracked: WholeBodyReference, wrench: Array) -> CentroidalPlan:
        predictor, reference = self.predictor, self._x_reference
        offset, velocity, _ = self._reference.sample(time + predictor.node_times)
        np.add(self._start_com, offset, out=reference[:, :3])
        np.multiply(velocity, predictor.mass, out=reference[:, 3:6])
        reference[:, 6:9] = 0.0
        return predictor.predict(time, terms, tracked, reference, self._fading * wrench)

    def _let_go(self, tracked: WholeBodyReference) -> None:
        """Leave the centre of mass to the user's target, and the posture to where it began, as without an MPC."""
        tracked.angular_momentum[:] = 0.0
        tracked.angular_momentum_rate[:] = 0.0
        self._stand(tracked)

    def _stand(self, tracked: WholeBodyReference) -> None:
        """Track the posture where it began, until a plan has one."""
        tracked.base_rotation[:] = self._base_rotation
        tracked.base_angular_velocity[:] = 0.0
        tracked.joint_position[:] = self._joint_position
        tracked.joint_velocity[:] = 0.0

    @staticmethod
    def _follow(motion: CentroidalSample, row: int, tracked: WholeBodyReference) -> None:
        tracked.com[:] = motion.com[row]
        tracked.com_velocity[:] = motion.com_velocity[row]
        tracked.com_acceleration[:] = motion.com_acceleration[row]
        tracked.angular_momentum[:] = motion.angular_momentum[row]
        tracked.angular_momentum_rate[:] = motion.angular_momentum_rate[row]
        tracked.contact_forces[:] = motion.forces[row]

    @staticmethod
    def _take_posture(posture: PostureSample, row: int, tracked: WholeBodyReference) -> None:
        tracked.base_rotation[:] = posture.base_rotation[row]
        tracked.base_angular_velocity[:] = posture.base_angular_velocity[row]
        tracked.joint_position[:] = posture.joint_position[row]
        tracked.joint_velocity[:] = posture.joint_velocity[row]
