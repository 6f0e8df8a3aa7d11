"""Sessions, which are run once, their progress reports and results, and the signals that stop them."""

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Protocol, TypeVar

from lgmpc.errors import Interrupted
from lgmpc.runs import Metrics, RunFolder, RunLog, TrajectoryLog, Verdict
from lgmpc.runs.certificate import Certificate
from lgmpc.solvers import Progress as Progress, Solution


@dataclass(frozen=True)
class RunProgress:
    """Progress of a simulation.

    Attributes:
        time_s: simulated time so far, s.
        duration_s: simulated time of the whole run, s.
        tilt_deg: current tilt of the base, degrees.
        real_time_factor: simulated over elapsed time so far.
    """

    time_s: float
    duration_s: float
    tilt_deg: float
    real_time_factor: float


ProgressReport = Callable[[RunProgress], None]
"""Called by a session every few ticks. It may raise KeyboardInterrupt to stop the run there."""

Notify = Callable[[str], None]
"""Called with a description of the present preparation, such as "compiling the MPC"."""


def ignore(report: object) -> None:
    """Do nothing: the report of those who want none."""


@dataclass(frozen=True)
class SessionResult:
    """The result of a run.

    Attributes:
        log: everything recorded; of an interrupted run, until its end.
        metrics: figures of merit; ``None`` if it was stopped before its first tick.
        verdict: pass, fail or interrupted, with reasons.
        interrupted: whether it was stopped by the user.
        certificate: checks of physics and hardware; ``None`` without two ticks with a finite state.
    """

    log: RunLog = field(repr=False)
    metrics: Metrics | None
    verdict: Verdict
    interrupted: bool = False
    certificate: Certificate | None = None


class Session(Protocol):
    """A plant, its controllers and its references, ready to run."""

    @property
    def log_bytes(self) -> int:
        """Size of the log's arrays, B."""

    def run(self, progress: ProgressReport, scratch: Path | None = None) -> SessionResult:
        """Simulate from the start to the end of the config's duration.

        Args:
            progress: called between ticks, about every 0.05 s of simulated time. If it raises KeyboardInterrupt the
                run ends there and its partial log is returned, marked as interrupted.
            scratch: folder for the ticks until they are judged; in memory unless given.
        """


class Saved(Protocol):
    """A run or a solve that has its folder."""

    @property
    def folder(self) -> RunFolder:
        """Its folder."""


IterationReport = Callable[[Progress], None]
"""Called after every iteration. It may raise KeyboardInterrupt to stop the solve there."""


@dataclass(frozen=True)
class SolveOutcome:
    """The result of a solve.

    Attributes:
        log: the last trajectory and the iterations that led to it.
        figures: values by name, which ends in the unit; NaN where one could not be measured.
        verdict: pass, fail or interrupted, with reasons.
        status: the name of the solver's :class:`lgmpc.solvers.Status`, in lower case.
        explanation: the cause of a failure to converge, in a few lines, and the problem's remarks on the solution.
        solution: the last trajectory with gains and multipliers, as the solver returned it.
    """

    log: TrajectoryLog = field(repr=False)
    figures: Mapping[str, float]
    verdict: Verdict
    status: str
    explanation: str
    solution: Solution = field(repr=False)

    @property
    def converged(self) -> bool:
        """Whether the solver reached its tolerance."""
        return self.status in ("converged", "acceptable")


_T = TypeVar("_T")

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

    def checked(self, report: Callable[[_T], None]) -> Callable[[_T], None]:
        """Return a report that calls ``report``, and raises Interrupted if there is a signal.

        What :meth:`on_signal` raises is lost where it comes while CasADi's C++ calls Python: it is raised again here.
        """

        def checked(now: _T) -> None:
            self._raise_received()  # before anything is printed: after SIGHUP the terminal may be closed
            report(now)
            self._raise_received()

        return checked

    @contextmanager
    def deferred(self, progress: Callable[[_T], None]) -> Iterator[Callable[[_T], None]]:
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
