"""Sessions, which are run once, their progress reports and results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from lgmpc.solvers import Progress as Iteration

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lgmpc.runs import Metrics, RunLog, TrajectoryLog, Verdict
    from lgmpc.runs.certificate import Certificate
    from lgmpc.solvers import Solution

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


ProgressReport = Callable[[Progress], None]
"""Called by a session every few ticks. It may raise KeyboardInterrupt to stop the run there."""

Notify = Callable[[str], None]
"""Called with a description of the present preparation, such as "compiling the MPC"."""


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

    def run(self, progress: ProgressReport) -> SessionResult:
        """Simulate from the start to the end of the config's duration.

        Args:
            progress: called between ticks, about every 0.05 s of simulated time. If it raises KeyboardInterrupt the
                run ends there and its partial log is returned, marked as interrupted.
        """


IterationReport = Callable[[Iteration], None]
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
