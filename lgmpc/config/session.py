"""What a config becomes: a session that can be run once, its progress reports, and its result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lgmpc.runs import Metrics, RunLog, TrajectoryLog, Verdict

__all__ = [
    "Iteration",
    "IterationReport",
    "Notify",
    "Progress",
    "ProgressReport",
    "Session",
    "SessionResult",
    "SolveOutcome",
]


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
"""Called with one line that says what is being prepared, such as "compiling the MPC"."""


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

    @property
    def log_bytes(self) -> int:
        """Size of the log's arrays, B."""

    def run(self, progress: ProgressReport) -> SessionResult:
        """Simulate from the start to the end of the config's duration.

        Args:
            progress: called between ticks, about every 0.05 s of simulated time. If it raises KeyboardInterrupt the
                run ends there and its partial log is returned, marked as interrupted.
        """


@dataclass(frozen=True)
class Iteration:
    """Where a solve is.

    Attributes:
        count: iterations taken.
        cost: at the current trajectory.
        criterion: what is compared with the tolerance; NaN where the solver does not report it.
        gap: largest gap of the dynamics at the start of the iteration.
        step: length of the step; 0 where none was accepted, NaN where the solver does not report it.
        regularization: of the sweep.
        elapsed_s: since the solver began, s.
    """

    count: int
    cost: float
    criterion: float
    gap: float
    step: float
    regularization: float
    elapsed_s: float


IterationReport = Callable[[Iteration], None]
"""Called after every iteration. It may raise KeyboardInterrupt to stop the solve there."""


@dataclass(frozen=True)
class SolveOutcome:
    """What solving a problem left.

    Attributes:
        log: the last trajectory and the iterations that led to it.
        figures: by name, the unit at its end; NaN where one could not be measured.
        verdict: pass, fail or interrupted, with reasons.
        status: how the solver ended, as :class:`lgmpc.solvers.Status` calls it, in lower case.
        explanation: what held convergence back, in a few lines; empty if it converged.
    """

    log: TrajectoryLog
    figures: Mapping[str, float]
    verdict: Verdict
    status: str
    explanation: str

    @property
    def converged(self) -> bool:
        """Whether the solver reached its tolerance."""
        return self.status in ("converged", "acceptable")
