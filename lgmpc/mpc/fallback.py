"""A full-body predictive controller with a centroidal one as its fallback while its own plans are rejected."""

import logging
from typing import Any

from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.centroidal import CentroidalMpc
from lgmpc.mpc.full_body import FullBodyMpc
from lgmpc.mpc.interface import MeasuredState
from lgmpc.mpc.plan import Plan
from lgmpc.mpc.settings import MpcSettings
from lgmpc.typing import Array

_LOG = logging.getLogger(__name__)
_PAUSE = 4
"""Number of updates without the full-body model after a rejected plan: its subproblems are most costly then."""


class FallbackMpc:
    """Plans with the full-body model within the reach of the legs, and with the centroidal model beyond it.

    A stretched leg is singular: the linearisation there contains motions that the leg does not have, and an iteration
    from such a plan diverges. Under a hard push the predicted motion stretches the legs long before the actual motion,
    if that does so at all. A plan that stretches a leg further than ``settings.reach_rad``, or a failed one, is
    therefore rejected, and a centroidal model, which has no legs, plans instead. Every fifth update the full-body model
    is tried again; its plans are used from the second consecutive one within reach, because the first has no guess.

    Args:
        mpc: the full-body controller.
        fallback: centroidal controller with the same horizon.

    Attributes:
        mpc: as given.
        fallback: as given.
        fallback_updates: number of updates planned by the fallback.
    """

    def __init__(self, mpc: FullBodyMpc, fallback: CentroidalMpc) -> None:
        self.mpc, self.fallback, self.fallback_updates, self._usable, self._pause = mpc, fallback, 0, True, 0

    @property
    def settings(self) -> MpcSettings:
        """Horizon, weights, limits of the controller with base and joints."""
        return self.mpc.settings

    @property
    def failures(self) -> int:
        """Number of updates for which neither model had a fresh plan."""
        return self.fallback.failures

    def reset(self) -> None:
        """Discard all history."""
        self.mpc.reset()
        self.fallback.reset()
        self.fallback_updates = 0
        self._usable = True
        self._pause = 0

    def state(self) -> tuple[Any, ...]:
        """Return what the next update depends on besides its arguments."""
        return self.fallback_updates, self._usable, self._pause, self.mpc.state(), self.fallback.state()

    def set_state(self, state: tuple[Any, ...]) -> None:
        """Continue from a result of :meth:`state`."""
        self.fallback_updates, self._usable, self._pause, mpc, fallback = state
        self.mpc.set_state(mpc)
        self.fallback.set_state(fallback)

    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan from the measured state; see :meth:`lgmpc.mpc.interface.Mpc.update`."""
        if self._pause > 0:
            self._pause -= 1
        else:
            usable_before = self._usable
            plan = self._plan(state, contacts, reference, wrench)
            if self._usable and usable_before:
                return plan
            if usable_before:
                _LOG.info("at %.3f s the plan stretches the legs or failed: centroidal model instead", state.time)
        self.fallback_updates += 1
        return self.fallback.update(state, contacts, reference, wrench)

    def _plan(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Plan with the full-body model, and accept or reject the plan."""
        plan = self.mpc.update(state, contacts, reference, wrench)
        self._usable = plan.status.usable and self.mpc.keeps_reach(plan)
        if not self._usable:
            self.mpc.reset_guess()
            self._pause = _PAUSE
        return plan
