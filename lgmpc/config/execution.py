"""Run the config of a closed loop from start to end, into its folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lgmpc.config.build import prepare
from lgmpc.config.interrupts import stop_between
from lgmpc.config.new_folder import new_folder
from lgmpc.config.schema import Config
from lgmpc.config.session import Notify, ProgressReport, SessionResult
from lgmpc.runs import RunFolder, RunResult

__all__ = ["FinishedRun", "run_config"]


@dataclass(frozen=True)
class FinishedRun:
    """A run that is over and saved.

    Attributes:
        folder: where it was saved.
        session: its log, metrics and verdict.
        result: what ``run.json`` holds.
    """

    folder: RunFolder
    session: SessionResult
    result: RunResult


def run_config(
    config: Config,
    out: str | Path = "runs",
    *,
    notify: Notify = lambda message: None,
    progress: ProgressReport = lambda progress: None,
) -> FinishedRun:
    """Run ``config`` and save it as ``out/<time>-<name>/``.

    Ctrl-C during the simulation ends it between two ticks: what was recorded is saved, marked as interrupted; Ctrl-C
    while saving lets it finish. A second Ctrl-C acts at once, wherever the program is. The folder is as
    :func:`lgmpc.config.new_folder.new_folder` has it: a run that cannot start, breaks, or cannot be saved leaves none.

    Args:
        config: what to run.
        out: folder of run folders.
        notify: told what is being prepared.
        progress: told where the simulation is.

    Raises:
        LgmpcError: if the config cannot be built or the folder cannot be written.
    """
    with new_folder(config, out) as folder:
        session = prepare(config, notify=notify)
        with stop_between(progress) as stoppable:
            result = session.run(stoppable)
            folder.write_log(result.log)
            saved = RunResult(name=config.name, verdict=result.verdict, metrics=result.metrics, seed=config.seed)
            folder.write_result(saved)
    return FinishedRun(folder, result, saved)
