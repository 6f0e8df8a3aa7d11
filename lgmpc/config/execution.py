"""Run the config of a closed loop, or solve that of a problem, from start to end, into its folder."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from signal import Signals

from lgmpc.config.build import prepare
from lgmpc.config.interrupts import stop_signals
from lgmpc.config.loading import dump_config
from lgmpc.config.schema import Config, SolveConfig
from lgmpc.config.session import IterationReport, Notify, ProgressReport, SessionResult, SolveOutcome
from lgmpc.config.solving import prepare_solve
from lgmpc.errors import Interrupted
from lgmpc.runs import Outcome, RunFolder, RunResult, SolveResult

__all__ = ["FinishedRun", "FinishedSolve", "new_folder", "run_config", "solve_config"]


@contextmanager
def new_folder(config: Config | SolveConfig, out: str | Path) -> Iterator[RunFolder]:
    """Lend ``out/<time>-<name>/`` with the config in it.

    It is made first, so that a run never ends with nowhere to go. If the block is left by an exception (the run cannot
    start, breaks, or cannot be saved) it is removed again, and so are ``out`` and the folders around it that did not
    exist before.

    Raises:
        RunFolderError: if it cannot be made or written.
    """
    out = Path(out)
    missing = [each for each in (out, *out.parents) if not each.exists()]
    folder = None
    try:
        folder = RunFolder.create(out, config.name)
        folder.write_config(dump_config(config))
        yield folder
    except BaseException:
        if folder is not None:
            shutil.rmtree(folder.path, ignore_errors=True)
        for each in missing:
            with suppress(OSError):  # another run is in it by now
                each.rmdir()
        raise


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
    start, breaks, or cannot be saved leaves no folder (:func:`new_folder`).

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

    Folder and signals are as :func:`run_config` has them; a signal ends the solve between two
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
