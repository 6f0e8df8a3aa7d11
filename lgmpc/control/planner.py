"""The predictive layer above the whole-body QP: what pushes, where to go, and with which forces."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np
import pinocchio as pin

from lgmpc.control.reference import ComReference
from lgmpc.errors import InputError
from lgmpc.estimation import WrenchObserver
from lgmpc.mpc import CentroidalMpc, CentroidalPlan, CentroidalSample, MpcStatus
from lgmpc.typing import Array
from lgmpc.wbc import WholeBodyReference, WholeBodyTerms

__all__ = ["CentroidalPlanner", "PlannerSettings"]


@dataclass(frozen=True)
class PlannerSettings:
    """How the plan is fed and followed.

    Attributes:
        every: whole-body ticks per MPC update.
        wrench_decay_time: s; the estimated external wrench is predicted to fade with this time constant.
        uprighting_rate: 1/s; a tilted base is asked for the angular momentum ``-I rate * tilt``, fading at this rate.

    Raises:
        InputError: a value that is not positive (rates may be zero).
    """

    every: int = 10
    wrench_decay_time: float = 0.1
    uprighting_rate: float = 0.0

    def __post_init__(self) -> None:
        if self.every < 1:
            raise InputError("every", self.every, "at least one whole-body tick")
        if not self.wrench_decay_time > 0:
            raise InputError("wrench_decay_time", self.wrench_decay_time, "a positive number of seconds")
        if not self.uprighting_rate >= 0:
            raise InputError("uprighting_rate", self.uprighting_rate, "a rate that is not negative, 1/s")


class CentroidalPlanner:
    """Centroidal MPC with its disturbance observer, writing what the whole-body QP should track.

    Every tick the observer compares the change of the centroidal momentum with what the whole-body QP asked for; every
    ``settings.every`` ticks the MPC plans anew from the measured momenta under the observed wrench; in between the plan
    is interpolated. A plan that is stale is not followed: the whole-body QP then regulates the centre of mass and the
    angular momentum by itself.

    Args:
        mpc: the receding-horizon controller.
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
        mpc: CentroidalMpc,
        observer: WrenchObserver,
        reference: ComReference,
        tick_period: float,
        settings: PlannerSettings,
    ) -> None:
        self.mpc = mpc
        self._tick_times: Array = tick_period * np.arange(settings.every, dtype=np.float64)
        self.observer = observer
        self.settings = settings
        self.plan: CentroidalPlan | None = None
        self.planned = False
        self.spent = 0.0
        self._reference = reference
        nodes, step = mpc.settings.nodes, mpc.settings.node_duration
        self._node_times: Array = step * np.arange(nodes + 1, dtype=np.float64)
        self._fading = np.exp(-self._node_times[:-1] / settings.wrench_decay_time)[:, None]
        self._uprighting = settings.uprighting_rate * np.exp(-settings.uprighting_rate * self._node_times)[:, None]
        self._x_reference = np.zeros((nodes + 1, 9))
        self._mass = mpc.mass
        self._start_com = np.zeros(3)
        self._tick = 0
        self._motion: CentroidalSample | None = None

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

    def begin(self, terms: WholeBodyTerms) -> None:
        """Take the present centre of mass as the one that the reference is relative to, and start afresh."""
        self._start_com[:] = terms.com
        self._tick = 0
        self.plan = None
        self._motion = None
        self.mpc.reset()
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
            self.plan = self._plan(time, terms, tracked, wrench)
            # All ticks until the next plan in one call: NumPy's cost per call is that of a hundred rows.
            self._motion = self.plan.sample_at(time + self._tick_times)
            self.spent = perf_counter() - started
        if self._motion is None or self.status is MpcStatus.STALE:
            self._let_go(tracked)
        else:
            self._follow(self._motion, row, tracked)

    def _plan(self, time: float, terms: WholeBodyTerms, tracked: WholeBodyReference, wrench: Array) -> CentroidalPlan:
        offset, velocity, _ = self._reference.sample(time + self._node_times)
        reference = self._x_reference
        np.add(self._start_com, offset, out=reference[:, :3])
        np.multiply(velocity, self._mass, out=reference[:, 3:6])
        tilt = pin.log3(terms.rotation.T @ tracked.base_rotation)  # body axes, towards upright
        reference[:, 6:9] = self._uprighting * (terms.momentum_matrix[3:, 3:6] @ tilt)
        if tracked.friction is not None:
            self.mpc.friction = tracked.friction
        return self.mpc.update(
            time,
            terms.com,
            terms.momentum[:3],
            terms.momentum[3:],
            terms.contact_points,
            tracked.stance,
            reference,
            self._fading * wrench,
        )

    @staticmethod
    def _let_go(tracked: WholeBodyReference) -> None:
        """Leave the centre of mass to the user's target, as without an MPC."""
        tracked.angular_momentum[:] = 0.0
        tracked.angular_momentum_rate[:] = 0.0

    @staticmethod
    def _follow(motion: CentroidalSample, row: int, tracked: WholeBodyReference) -> None:
        tracked.com[:] = motion.com[row]
        tracked.com_velocity[:] = motion.com_velocity[row]
        tracked.com_acceleration[:] = motion.com_acceleration[row]
        tracked.angular_momentum[:] = motion.angular_momentum[row]
        tracked.angular_momentum_rate[:] = motion.angular_momentum_rate[row]
        tracked.contact_forces[:] = motion.forces[row]
