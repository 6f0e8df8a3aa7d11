"""Signals that stop a run, deferred to the points where it can be stopped."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TypeVar

from lgmpc.errors import Interrupted

__all__ = ["StopSignals", "stop_signals"]

T = TypeVar("T")

_SIGNALS = tuple(signal.Signals[name] for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Ctrl-C, `kill` or a scheduler's time limit, and a terminal that closes."""


class StopSignals:
    """The stop signals received since a run began: the first one stops it.

    Attributes:
        received: the first signal; ``None`` if there is none.
    """

    def __init__(self) -> None:
        self.received: signal.Signals | None = None
        self._deferred = False

    def on_signal(self, number: int, frame: FrameType | None) -> None:
        """Raise :class:`lgmpc.errors.Interrupted`: at once or, where signals are deferred, in the next report.

        A second Ctrl-C acts at once. A second SIGTERM or SIGHUP does not: when a terminal closes, the shell and the
        kernel send one each.
        """
        again = self.received is not None
        if self.received is None:
            self.received = signal.Signals(number)
        if again and number == signal.SIGINT:
            raise Interrupted(signal.SIGINT)
        if not again and not self._deferred:
            raise Interrupted(self.received)

    def checked(self, report: Callable[[T], None]) -> Callable[[T], None]:
        """Return a report that calls ``report``, and raises Interrupted if there is a signal.

        What :meth:`on_signal` raises is lost where it comes while CasADi's C++ calls Python: it is raised again here.
        """

        def checked(now: T) -> None:
            self._raise_received()  # before anything is printed: after SIGHUP the terminal may be closed
            report(now)
            self._raise_received()

        return checked

    @contextmanager
    def deferred(self, progress: Callable[[T], None]) -> Iterator[Callable[[T], None]]:
        """Defer signals to the next call of a progress report, which raises Interrupted.

        Yields:
            The report to use in the block; it calls ``progress``.
        """
        self._deferred = True
        try:
            yield self.checked(progress)
        finally:
            self._deferred = False

    @contextmanager
    def held(self) -> Iterator[None]:
        """Defer signals during the block, and raise Interrupted at its end: for operations that must be completed."""
        self._deferred = True
        try:
            yield
        finally:
            self._deferred = False
        self._raise_received()

    def _raise_received(self) -> None:
        if self.received is not None:
            raise Interrupted(self.received)


@contextmanager
def stop_signals() -> Iterator[StopSignals]:
    """Handle the stop signals while the block runs; do nothing outside the main thread, which receives none.

    SIGTERM and SIGHUP keep the program's own handler, and stay ignored where they are, as under ``nohup``.
    """
    stop = StopSignals()
    before = {}
    try:
        for number in _SIGNALS:
            handler = signal.getsignal(number)
            if handler is signal.SIG_DFL or (number == signal.SIGINT and handler is not None):
                before[number] = signal.signal(number, stop.on_signal)
    except ValueError:
        yield stop
        return
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
