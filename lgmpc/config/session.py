"""What a config becomes: a session that can be run once, and what it tells while it runs and when it is over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from lgmpc.runs import Metrics, RunLog, Verdict

__all__ = ["Notify", "Progress", "ProgressReport", "Session", "SessionResult"]


@dataclass(frozen=True)
class Progress:
    """Where a run is.

    Attributes:
        time_s: simulated time so far, s.
        duration_s: simulated time of the whole run, s.
        tilt_deg: tilt of the base now, degrees.
        real_time_factor: simulated seconds per second of computing so far.
    """

    time_s: float
    duration_s: float
    tilt_deg: float
    real_time_factor: float


ProgressReport = Callable[[Progress], None]
"""Called by a session every few ticks. It may raise KeyboardInterrupt to stop the run there."""

Notify = Callable[[str], None]
"""Called with one line about what is being prepared, such as "compiling the MPC"."""


@dataclass(frozen=True)
class SessionResult:
    """What a run left.

    Attributes:
        log: everything recorded; of an interrupted run, up to where it was stopped.
        metrics: figures of merit; ``None`` if it was stopped before its first tick.
        verdict: pass, fail or interrupted, with reasons.
        interrupted: whether it was stopped by the user.
    """

    log: RunLog
    metrics: Metrics | None
    verdict: Verdict
    interrupted: bool = False


class Session(Protocol):
    """A plant, its controllers and its references, ready to run."""

    def run(self, progress: ProgressReport) -> SessionResult:
        """Simulate from the start to the end of the config's duration.

        Args:
            progress: called between ticks, about every 0.05 s of simulated time. If it raises KeyboardInterrupt the
                run ends there and its partial log is returned, marked as interrupted.
        """
