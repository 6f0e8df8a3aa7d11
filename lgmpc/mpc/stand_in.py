"""A predictive controller with another one as its stand-in while its own plans cannot be followed."""

from __future__ import annotations

import logging

from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.centroidal import CentroidalMpc
from lgmpc.mpc.interface import MeasuredState
from lgmpc.mpc.multibody import MultibodyMpc
from lgmpc.mpc.plan import Plan
from lgmpc.mpc.settings import MpcSettings
from lgmpc.typing import Array

__all__ = ["StandInMpc"]

_LOG = logging.getLogger(__name__)
_PAUSE = 4
"""Updates for which the multibody model pauses after a plan was dropped: its subproblems are the most costly then."""


class StandInMpc:
    """Plans with base and joints as far as the legs reach, and with the centroidal model beyond.

    A stretched leg is singular: the linearisation there contains motions that the leg does not have, and an iteration
    from such a plan leads away from the solution. In a push hard enough the forecast stretches the legs long before the
    robot does, if the robot does at all. So a plan that stretches a leg further than ``settings.reach_rad``, like one
    that failed, is dropped, and a centroidal model, which has no legs, plans instead. Every fifth update the multibody
    model is tried again, and followed from the second plan in a row that keeps the reach: the first has no guess.

    Args:
        mpc: the controller with base and joints.
        stand_in: plans meanwhile; of the same horizon.

    Attributes:
        mpc: as given.
        stand_in: as given.
        stood_in: updates so far that the stand-in planned.
    """

    def __init__(self, mpc: MultibodyMpc, stand_in: CentroidalMpc) -> None:
        self.mpc = mpc
        self.stand_in = stand_in
        self.stood_in = 0
        self._trusted = True
        self._pause = 0

    @property
    def settings(self) -> MpcSettings:
        """Horizon, weights, limits of the controller with base and joints."""
        return self.mpc.settings

    @property
    def failures(self) -> int:
        """Updates so far for which neither model had a fresh plan."""
        return self.stand_in.failures

    def reset(self) -> None:
        """Forget the past."""
        self.mpc.reset()
        self.stand_in.reset()
        self.stood_in = 0
        self._trusted = True
        self._pause = 0

    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured state; see :meth:`lgmpc.mpc.interface.Mpc.update`."""
        if self._pause > 0:
            self._pause -= 1
        else:
            trusted_before = self._trusted
            plan = self._plan(state, contacts, reference, wrench)
            if self._trusted and trusted_before:
                return plan
            if trusted_before:
                _LOG.info("at %.3f s the plan stretches the legs or failed: centroidal model instead", state.time)
        self.stood_in += 1
        return self.stand_in.update(state, contacts, reference, wrench)

    def _plan(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan with base and joints, and judge the plan."""
        plan = self.mpc.update(state, contacts, reference, wrench)
        self._trusted = plan.status.fresh and self.mpc.keeps_reach(plan)
        if not self._trusted:
            self.mpc.forget()
            self._pause = _PAUSE
        return plan
