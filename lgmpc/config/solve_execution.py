"""Solve a config from start to end, into its folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lgmpc.config.interrupts import stop_between
from lgmpc.config.new_folder import new_folder
from lgmpc.config.schema import SolveConfig
from lgmpc.config.session import IterationReport, Notify, SolveOutcome
from lgmpc.config.solving import prepare_solve
from lgmpc.runs import RunFolder, SolveResult

__all__ = ["FinishedSolve", "solve_config"]


@dataclass(frozen=True)
class FinishedSolve:
    """A problem that was solved, or not, and saved.

    Attributes:
        folder: where it was saved.
        outcome: its trajectory, figures and verdict.
        result: what ``run.json`` holds.
    """

    folder: RunFolder
    outcome: SolveOutcome
    result: SolveResult


def solve_config(
    config: SolveConfig,
    out: str | Path = "runs",
    *,
    notify: Notify = lambda message: None,
    progress: IterationReport = lambda progress: None,
) -> FinishedSolve:
    """Solve the problem of ``config`` and save it as ``out/<time>-<name>/``.

    Folder and Ctrl-C are as :func:`lgmpc.config.execution.run_config` has them; Ctrl-C ends the solve between two
    iterations.

    Args:
        config: what to solve.
        out: folder of run folders.
        notify: told what is being prepared.
        progress: told about every iteration.

    Raises:
        LgmpcError: if the config cannot be built or the folder cannot be written.
    """
    with new_folder(config, out) as folder:
        session = prepare_solve(config, notify=notify)
        with stop_between(progress) as stoppable:
            notify("solving")
            outcome = session.run(stoppable)
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
    return FinishedSolve(folder, outcome, saved)
