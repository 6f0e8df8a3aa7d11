"""Run the config of a closed loop from start to end, into its folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from signal import Signals

from lgmpc.config.build import prepare
from lgmpc.config.interrupts import stop_signals
from lgmpc.config.new_folder import new_folder
from lgmpc.config.schema import Config
from lgmpc.config.session import Notify, ProgressReport, SessionResult
from lgmpc.errors import Interrupted
from lgmpc.runs import RunFolder, RunResult

__all__ = ["FinishedRun", "run_config"]


@dataclass(frozen=True)
class FinishedRun:
    """A run that is over and saved.

    Attributes:
        folder: where it was saved.
        session: its log, metrics and verdict.
        result: what ``run.json`` holds.
        signal: what ended it early.
    """

    folder: RunFolder
    session: SessionResult
    result: RunResult
    signal: Signals | None = None

    @property
    def exit_code(self) -> int:
        """What the command line returns for it."""
        return self.session.verdict.exit_code if self.signal is None else Interrupted(self.signal).exit_code


def run_config(
    config: Config,
    out: str | Path = "runs",
    *,
    notify: Notify = lambda message: None,
    progress: ProgressReport = lambda progress: None,
) -> FinishedRun:
    """Run ``config`` and save it as ``out/<time>-<name>/``.

    Ctrl-C, SIGTERM or SIGHUP during the simulation end it between two ticks: what was recorded is saved, marked as
    interrupted. While the run is being saved they wait for its end; a second Ctrl-C acts at once. A run that cannot
    start, breaks, or cannot be saved leaves no folder (:func:`lgmpc.config.new_folder.new_folder`).

    Args:
        config: what to run.
        out: folder of run folders.
        notify: called with what is being prepared.
        progress: called with where the simulation is.

    Raises:
        LgmpcError: if the config cannot be built, or the folder cannot be written or has too little space.
        Interrupted: by a signal before the simulation begins.
    """
    with stop_signals() as stop, new_folder(config, out) as folder:
        session = prepare(config, notify=notify)
        folder.check_space(session.log_bytes)
        with stop.deferred(progress) as report:
            result = session.run(report)
            folder.write_log(result.log)
            saved = RunResult(name=config.name, verdict=result.verdict, metrics=result.metrics, seed=config.seed)
            folder.write_result(saved)
    return FinishedRun(folder, result, saved, stop.received if result.interrupted else None)
