"""Solve a config from start to end, into its folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from signal import Signals

from lgmpc.config.interrupts import stop_signals
from lgmpc.config.new_folder import new_folder
from lgmpc.config.schema import SolveConfig
from lgmpc.config.session import IterationReport, Notify, SolveOutcome
from lgmpc.config.solving import prepare_solve
from lgmpc.errors import Interrupted
from lgmpc.runs import Outcome, RunFolder, SolveResult

__all__ = ["FinishedSolve", "solve_config"]


@dataclass(frozen=True)
class FinishedSolve:
    """A problem that was solved, or not, and saved.

    Attributes:
        folder: where it was saved.
        outcome: its trajectory, figures and verdict.
        result: what ``run.json`` holds.
        signal: what ended it early.
    """

    folder: RunFolder
    outcome: SolveOutcome
    result: SolveResult
    signal: Signals | None = None

    @property
    def exit_code(self) -> int:
        """What the command line returns for it."""
        return self.outcome.verdict.exit_code if self.signal is None else Interrupted(self.signal).exit_code


def solve_config(
    config: SolveConfig,
    out: str | Path = "runs",
    *,
    notify: Notify = lambda message: None,
    progress: IterationReport = lambda progress: None,
) -> FinishedSolve:
    """Solve the problem of ``config`` and save it as ``out/<time>-<name>/``.

    Folder and signals are as :func:`lgmpc.config.execution.run_config` has them; a signal ends the solve between two
    iterations.

    Args:
        config: what to solve.
        out: folder of run folders.
        notify: called with what is being prepared.
        progress: called after every iteration.

    Raises:
        LgmpcError: if the config cannot be built, or the folder cannot be written or has too little space.
        Interrupted: by a signal before the first iteration.
    """
    with stop_signals() as stop, new_folder(config, out) as folder:
        session = prepare_solve(config, notify=notify)
        folder.check_space(session.log_bytes)
        with stop.deferred(progress) as report:
            notify("solving")
            outcome = session.run(report)
            folder.write_trajectory(outcome.log)
            saved = SolveResult(
                name=config.name,
                verdict=outcome.verdict,
                method=config.solver.method,
                status=outcome.status,
                explanation=outcome.explanation,
                figures=outcome.figures,
            )
            folder.write_result(saved)
    interrupted = outcome.verdict.outcome is Outcome.INTERRUPTED
    return FinishedSolve(folder, outcome, saved, stop.received if interrupted else None)
