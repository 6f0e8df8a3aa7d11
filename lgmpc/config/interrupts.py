"""Signals that stop a run where it can be stopped, and not in the middle of something."""

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
    """The signals received since a run began: the first one stops it.

    Attributes:
        received: the first signal; ``None`` so far.
    """

    def __init__(self) -> None:
        self.received: signal.Signals | None = None
        self._deferred = False

    def on_signal(self, number: int, frame: FrameType | None) -> None:
        """Raise :class:`lgmpc.errors.Interrupted`, at once or, where signals are deferred, in the next report.

        A second Ctrl-C acts at once wherever the program is. A second SIGTERM or SIGHUP does not: a shell and the
        kernel send one each when a terminal closes.
        """
        again = self.received is not None
        if self.received is None:
            self.received = signal.Signals(number)
        if again and number == signal.SIGINT:
            raise Interrupted(signal.SIGINT)
        if not again and not self._deferred:
            raise Interrupted(self.received)

    @contextmanager
    def deferred(self, progress: Callable[[T], None]) -> Iterator[Callable[[T], None]]:
        """Make signals wait for the next call of a progress report, which raises Interrupted.

        Yields:
            The report to use in the block: it calls ``progress``.
        """

        def report(now: T) -> None:
            self._raise_received()  # before progress is shown: SIGHUP means that the terminal may be gone
            progress(now)
            self._raise_received()

        self._deferred = True
        try:
            yield report
        finally:
            self._deferred = False

    def _raise_received(self) -> None:
        if self.received is not None:
            raise Interrupted(self.received)


@contextmanager
def stop_signals() -> Iterator[StopSignals]:
    """Handle the stop signals while the block runs; outside the main thread, where none arrives, do nothing.

    SIGTERM and SIGHUP are left alone where the program has its own handler or ignores them, as under ``nohup``.
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
