"""A predictive controller in a process of its own, for which the loop of a robot never waits.

In one process the interpreter lets only one thread compute, and a QP of some milliseconds holds up whole ticks. Here an
update sends its arguments and goes on with the last plan; the tick after the new one has arrived takes that. Plans are
sampled by time: an older one is followed further along its horizon.
"""

from __future__ import annotations

import logging
import math
import signal
from collections.abc import Callable
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from lgmpc.errors import SolverError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.interface import MeasuredState, Mpc
from lgmpc.mpc.plan import MpcStatus, Plan
from lgmpc.mpc.settings import MpcSettings
from lgmpc.typing import Array

__all__ = ["ProcessMpc"]

_LOG = logging.getLogger(__name__)
_READY_S, _FIRST_S = 120.0, 1.0
"""Longest times until the process is ready, which may compile, and until the first plan, s."""


class ProcessMpc:
    """An :class:`lgmpc.mpc.Mpc` whose updates are computed in another process, which is started anew if it ends.

    Args:
        make: returns the controller, in that process; it can be pickled.
        settings: of that controller.

    Attributes:
        settings: as given.
        failures: plans that were not fresh.
        restarts: how often the process was started anew.

    Raises:
        SolverError: the process does not become ready.
    """

    def __init__(self, make: Callable[[], Mpc], settings: MpcSettings) -> None:
        self.settings, self.failures, self.restarts = settings, 0, 0
        self._make = make
        self._stale = 0.5 * settings.nodes * settings.node_s
        self._plan: Plan | None = None
        self._asked = False
        self._number = 0  # of resets: plans from before the last one are of no use
        self._start()
        if not self._pipe.poll(_READY_S):
            self.close()
            raise SolverError("MPC", f"its process is not ready after {_READY_S:g} s", "Is the machine too busy?")
        self._receive()

    @property
    def arrived(self) -> bool:
        """Whether a plan has arrived, which the next update returns."""
        return self._asked and self._pipe.poll()

    @property
    def process_id(self) -> int | None:
        """Number of the process."""
        return self._process.pid

    def reset(self) -> None:
        """Discard all history: the last plan is not followed any more, and the process begins anew."""
        self._number += 1
        self._plan = None if self._plan is None else replace(self._plan, status=MpcStatus.STALE)

    def state(self) -> Any:
        """Return the last plan; what the process holds stays there."""
        return self._plan

    def set_state(self, state: Any) -> None:
        """Continue from a result of :meth:`state`."""
        self._plan = state

    def update(self, state: MeasuredState, contacts: ContactHorizon, reference: MotionReference, wrench: Array) -> Plan:
        """Return the plan that has arrived, or the last one, and ask for the next; see :meth:`lgmpc.mpc.Mpc.update`.

        Raises:
            SolverError: there is no first plan.
        """
        try:
            if self.arrived:
                self._receive()
            elif not self._asked:
                self._pipe.send((self._number, state, contacts, reference, wrench))
                self._asked = True
                if self._plan is None and self._pipe.poll(_FIRST_S):
                    self._receive()
        except (OSError, EOFError):
            self.restarts += 1
            _LOG.error("the process of the MPC ended at %.3f s: it is started anew", state.time)
            self.close()
            self._start()
        plan = self._plan
        if plan is None:
            raise SolverError("MPC", f"no first plan after {_FIRST_S:g} s", "Is the machine too busy for its process?")
        if state.time - plan.time <= self._stale:
            return plan
        return replace(plan, status=MpcStatus.STALE)

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()
        self._pipe.close()

    def _start(self) -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_answer, args=(theirs, self._make), daemon=True)
        self._process.start()
        theirs.close()
        self._asked = True  # it says when it is ready

    def _receive(self) -> None:
        """Take an answer, and its plan unless that is from before a reset."""
        number, plan = self._pipe.recv()
        self._asked = False
        if number == self._number:
            self._plan = plan
            self.failures += not plan.status.fresh


def _answer(pipe: Connection, make: Callable[[], Mpc]) -> None:
    """Answer requests until the other end is closed; signals of the terminal are for the loop."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    mpc, last = make(), 0
    pipe.send((math.nan, None))
    while True:
        try:
            number, *arguments = pipe.recv()
        except EOFError:
            return
        if number != last:
            mpc.reset()
            last = number
        pipe.send((number, mpc.update(*arguments)))
