"""Run or solve a config from start to end, into its folder."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TypeVar

from lgmpc.config.build import prepare
from lgmpc.config.loading import dump_config
from lgmpc.config.schema import Config, SolveConfig
from lgmpc.config.session import IterationReport, Notify, ProgressReport, SessionResult, SolveOutcome
from lgmpc.config.solving import prepare_solve
from lgmpc.runs import RunFolder, RunResult, SolveResult

__all__ = ["FinishedRun", "FinishedSolve", "run_config", "solve_config"]

T = TypeVar("T")


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

    The folder is made first, so that a run never ends with nowhere to go, and removed again if the run cannot start,
    breaks, or cannot be saved. Ctrl-C during the simulation ends it between two ticks: what was recorded is saved,
    marked as interrupted; Ctrl-C while saving lets it finish. A second Ctrl-C acts at once, wherever the program is.

    Args:
        config: what to run.
        out: folder of run folders.
        notify: told what is being prepared.
        progress: told where the simulation is.

    Raises:
        LgmpcError: if the config cannot be built or the folder cannot be written.
    """
    folder = RunFolder.create(out, config.name)
    try:
        folder.write_config(dump_config(config))
        session = prepare(config, notify=notify)
        with _stop_between(progress) as stoppable:
            result = session.run(stoppable)
            folder.write_log(result.log)
            saved = RunResult(name=config.name, verdict=result.verdict, metrics=result.metrics, seed=config.seed)
            folder.write_result(saved)
    except BaseException:
        shutil.rmtree(folder.path, ignore_errors=True)
        raise
    return FinishedRun(folder, result, saved)


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
    """Solve the problem of ``config`` and save it as ``out/<time>-<name>/``; folder and Ctrl-C as :func:`run_config`.

    Args:
        config: what to solve.
        out: folder of run folders.
        notify: told what is being prepared.
        progress: told about every iteration.

    Raises:
        LgmpcError: if the config cannot be built or the folder cannot be written.
    """
    folder = RunFolder.create(out, config.name)
    try:
        folder.write_config(dump_config(config))
        session = prepare_solve(config, notify=notify)
        with _stop_between(progress) as stoppable:
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
    except BaseException:
        shutil.rmtree(folder.path, ignore_errors=True)
        raise
    return FinishedSolve(folder, outcome, saved)


@contextmanager
def _stop_between(progress: Callable[[T], None]) -> Iterator[Callable[[T], None]]:
    """Turn the first Ctrl-C into a KeyboardInterrupt out of the next progress report; the second one acts at once."""
    pressed = False

    def on_interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal pressed
        pressed = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    def report(now: T) -> None:
        progress(now)
        if pressed:
            raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGINT, on_interrupt)
    except ValueError:  # not in the main thread: Ctrl-C does not arrive here
        yield progress
        return
    try:
        yield report
    finally:
        signal.signal(signal.SIGINT, before)
