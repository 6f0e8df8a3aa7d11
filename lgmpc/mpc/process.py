"""A predictive controller in a process of its own, for which the loop of a robot never waits.

In one process the interpreter lets only one thread compute, and a QP of some milliseconds holds up whole ticks. Here an
update sends its arguments and goes on with the last plan; the tick after the new one has arrived takes that. Plans are
sampled by time: an older one is followed further along its horizon.

Numbers go through memory that both processes share, and a message says that they are there. A side writes only after it
has read what the other one wrote, so that neither waits nor finds half a value.
"""

import functools
import itertools
import logging
import math
import select
import signal
from collections.abc import Callable
from dataclasses import fields, is_dataclass, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from lgmpc.errors import SolverError
from lgmpc.locomotion.horizon import ContactHorizon, MotionReference
from lgmpc.mpc.interface import MeasuredState, Mpc
from lgmpc.mpc.plan import Plan
from lgmpc.mpc.settings import MpcSettings
from lgmpc.status import Status
from lgmpc.typing import Array

_LOG = logging.getLogger(__name__)
_READY_S, _FIRST_S = 120.0, 1.0
"""Longest times until the process is ready, which may compile, and until the first plan, s."""
_SHARED = 1 << 17
"""Numbers of 64 bits in the memory of each direction; plans of the full-body model have some thousand."""


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
        self.settings, self.failures, self.restarts, self._make = settings, 0, 0, make
        self._stale = 0.5 * settings.horizon.end
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
        return self._asked and bool(self._poller.poll(0))

    def reset(self) -> None:
        """Discard all history: the last plan is not followed any more, and the process begins anew."""
        self._number += 1
        self._plan = None if self._plan is None else replace(self._plan, status=Status.STALE)

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
                self._requests.send(self._pipe, (self._number, state, contacts, reference, wrench))
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
        return replace(plan, status=Status.STALE)

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()
        self._pipe.close()

    def _start(self) -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._poller = select.poll()  # a tenth of the cost of the pipe's own poll
        self._poller.register(self._pipe, select.POLLIN)
        memories = [context.RawArray("d", _SHARED) for _ in range(2)]
        self._requests, self._answers = map(SharedValues, memories)
        self._process = context.Process(target=_answer, args=(theirs, memories, self._make), daemon=True)
        self._process.start()
        theirs.close()
        self._asked = True  # it says when it is ready

    def _receive(self) -> None:
        """Take an answer, and its plan unless that is from before a reset."""
        number, plan = self._answers.receive(self._pipe, copied=True)
        self._asked = False
        if number == self._number:
            self._plan = plan
            self.failures += not plan.status.usable


class SharedValues:
    """One direction of a link: tuples of numbers, arrays and dataclasses of them, by memory that two processes share.

    Values of other sizes than the last ones are sent whole, and later ones of the same sizes take their places.

    Args:
        memory: shared numbers, zero-initialised.
    """

    def __init__(self, memory: Any) -> None:
        self._memory = np.frombuffer(memory)
        self._kinds: tuple[Any, ...] = ()
        self._views: list[Array] = []
        self._shape: tuple[Any, ...] = ()  # their types

    def send(self, pipe: Connection, values: tuple[Any, ...]) -> None:
        """Write values and announce them."""
        leaves = _leaves(values)
        if _kinds(leaves) != self._kinds:
            self._arrange(values)
            pipe.send(values)
            return
        for view, leaf in zip(self._views, leaves, strict=True):
            view[...] = _ORDER[leaf] if isinstance(leaf, Status) else np.nan if leaf is None else leaf
        pipe.send(None)

    def receive(self, pipe: Connection, copied: bool) -> tuple[Any, ...]:
        """Return values that have been announced.

        Args:
            pipe: with the message.
            copied: whether arrays are copies; else they are valid until the next values are written.
        """
        values: tuple[Any, ...] | None = pipe.recv()
        if values is not None:
            self._arrange(values)
            return values
        leaves = (
            (view.copy() if copied else view) if isinstance(kind, tuple) else _VALUE_OF[kind](float(view))
            for view, kind in zip(self._views, self._kinds, strict=True)
        )
        return tuple(
            kind(*itertools.islice(leaves, len(_names(kind)))) if _names(kind) else next(leaves) for kind in self._shape
        )

    def _arrange(self, values: tuple[Any, ...]) -> None:
        """Give numbers and arrays their places; none where there are other things, or more than the memory holds."""
        leaves, start = _leaves(values), 0
        self._kinds, self._shape, self._views = (), tuple(type(value) for value in values), []
        for leaf in leaves:
            array = leaf if isinstance(leaf, np.ndarray) else np.zeros(())
            end = start - (-array.nbytes // 8)
            if end > self._memory.size or not (leaf is array or type(leaf) in _VALUE_OF):
                return
            self._views.append(self._memory[start:end].view(array.dtype)[: array.size].reshape(array.shape))
            start = end
        self._kinds = _kinds(leaves)


def _kinds(leaves: list[Any]) -> tuple[Any, ...]:
    """Return the shape of each array, and the type of each other thing."""
    return tuple([leaf.shape if isinstance(leaf, np.ndarray) else type(leaf) for leaf in leaves])


def _leaves(values: tuple[Any, ...]) -> list[Any]:
    """Return numbers and arrays of values, those of dataclasses in the order of their fields."""
    leaves = []
    for value in values:
        kind: Any = type(value)
        names = _names(kind)
        leaves += [getattr(value, name) for name in names] if names else [value]
    return leaves


@functools.cache
def _names(kind: Any) -> tuple[str, ...]:
    """Return the names of a dataclass' fields; none of another type."""
    return tuple(each.name for each in fields(kind)) if is_dataclass(kind) else ()


_STATUSES = tuple(Status)
_ORDER = {status: float(k) for k, status in enumerate(_STATUSES)}
_VALUE_OF: dict[type, Callable[[float], Any]] = {
    float: float, np.float64: np.float64, int: int, bool: bool, Status: lambda k: _STATUSES[int(k)],
    type(None): lambda _: None,
}  # fmt: skip


def _answer(pipe: Connection, memories: list[Any], make: Callable[[], Mpc]) -> None:
    """Answer requests until the other end is closed; signals of the terminal are for the loop."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    requests, answers = map(SharedValues, memories)
    mpc, last = make(), 0
    answers.send(pipe, (math.nan, None))
    while True:
        try:
            number, *arguments = requests.receive(pipe, copied=False)
        except EOFError:
            return
        if number != last:
            mpc.reset()
            last = number
        answers.send(pipe, (number, mpc.update(*arguments)))
