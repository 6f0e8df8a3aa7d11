"""Execution of configs: run a closed loop, or solve a problem, and save it in a run folder."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from signal import Signals
from typing import TYPE_CHECKING, Any

from lgmpc.config.build import prepare
from lgmpc.config.loading import dump_config
from lgmpc.config.schema import Config, SolveConfig
from lgmpc.config.session import (
    IterationReport,
    Notify,
    ProgressReport,
    Session,
    SessionResult,
    SolveOutcome,
    StopSignals,
    ignore,
    stop_signals,
)
from lgmpc.config.solving import prepare_solve
from lgmpc.errors import Interrupted
from lgmpc.ocp import ShootingProblem
from lgmpc.problems import Scenario
from lgmpc.robot import Robot
from lgmpc.runs import Outcome, RunFolder, RunResult, SolveResult
from lgmpc.runs.result import SettingsChange
from lgmpc.settings.dotted import differing
from lgmpc.solvers import Solution
from lgmpc.typing import typed
from lgmpc.world import Course, Heights

if TYPE_CHECKING:
    from lgmpc.viz import Plots


@contextmanager
def _new_folder(config: Config | SolveConfig, out: str | Path, stop: StopSignals) -> Iterator[RunFolder]:
    """Create ``out/<time>-<name>/`` with the config in it, for the duration of a block.

    It is created before the run, so that an unwritable folder is reported first. If an exception leaves the block (the
    run cannot start, fails, or cannot be saved), it is removed, with ``out`` and its parents that did not exist before.
    Signals are deferred while it is created, so that none leaves a folder behind.

    Raises:
        RunFolderError: if it cannot be created or written.
    """
    out = Path(out)
    missing = [each for each in (out, *out.parents) if not each.exists()]
    folder = None
    try:
        with stop.held():
            folder = RunFolder.create(out, config.name)
        folder.write_config(dump_config(_with_own_files(config, folder.path)))
        yield folder
    except BaseException:
        if folder is not None:
            shutil.rmtree(folder.path, ignore_errors=True)
        for each in missing:
            with suppress(OSError):  # another run has been saved in it
                each.rmdir()
        raise


def _with_own_files(config: Config | SolveConfig, folder: Path) -> Config | SolveConfig:
    """Copy the files of the world into a run folder, and return a config that reads them there."""
    copies: dict[str, Any] = {}
    section = getattr(config, "world", None)
    parts = section.parts if isinstance(section, Course) else (section,)
    for i, part in enumerate(parts):
        if isinstance(part, Heights) and part.file is not None and Path(part.file).is_file():
            copy = f"world_{i}{Path(part.file).suffix}"
            shutil.copyfile(part.file, folder / copy)
            copies["world.file" if part is section else f"world.parts.{i}.file"] = copy
    return config.replace(copies) if copies else config


@dataclass(frozen=True)
class _Finished:
    """The common part of finished runs and finished solves."""

    folder: RunFolder
    result: RunResult | SolveResult
    signal: Signals | None = field(default=None, kw_only=True)

    @property
    def exit_code(self) -> int:
        """The command line's exit code."""
        return self.result.verdict.exit_code if self.signal is None else Interrupted(self.signal).exit_code

    def show(self, html: str | Path | None = None) -> Path | None:
        """Replay it: embedded in a notebook, else in the browser, or as a file; see :func:`lgmpc.show`."""
        from lgmpc.config.showing import show

        return show(self.folder.path, html)

    def plot(self) -> "Plots":
        """Draw its figures; see :func:`lgmpc.plot`."""
        from lgmpc.config.showing import plot

        return plot(self.folder.path)


@dataclass(frozen=True)
class FinishedRun(_Finished):
    """A finished and saved run.

    Attributes:
        folder: the run folder.
        result: the content of ``run.json``.
        config: the simulated config.
        session: log, metrics and verdict.
        signal: the signal that ended it early, if any.
    """

    result: RunResult
    config: Config = field(repr=False)
    session: SessionResult = field(repr=False)


@typed
def run_config(
    config: Config, out: str | Path = "runs", *, notify: Notify = ignore, progress: ProgressReport = ignore
) -> FinishedRun:
    """Run ``config`` and save it as ``out/<time>-<name>/``.

    Ctrl-C, SIGTERM or SIGHUP during the simulation end it between two ticks: the partial log is saved, marked as
    interrupted. While the run is being saved they are deferred; a second Ctrl-C acts at once. A run that cannot start,
    fails, or cannot be saved leaves no folder.

    Args:
        config: the closed loop.
        out: folder of run folders.
        notify: called with a description of what is being prepared.
        progress: called with the progress of the simulation.

    Raises:
        LgmpcError: if the config cannot be built, or the folder cannot be written or has too little space.
        Interrupted: by a signal before the simulation begins.
    """
    return run_session(config, lambda announce: prepare(config, notify=announce), out, notify=notify, progress=progress)


def run_session(
    config: Config,
    prepare: Callable[[Notify], Session],
    out: str | Path,
    *,
    notify: Notify = ignore,
    progress: ProgressReport = ignore,
) -> FinishedRun:
    """Run the session that ``prepare`` returns and save it, see :func:`run_config`."""
    with stop_signals() as stop, _new_folder(config, out, stop) as folder:
        session = prepare(stop.checked(notify))
        folder.check_space(session.log_bytes)
        with stop.deferred(progress) as report:
            result = session.run(report, folder.path)
            saved = _save_run(folder, config, result)
    return FinishedRun(folder, saved, config, result, signal=stop.received if result.interrupted else None)


def save_run(config: Config, result: SessionResult, out: str | Path) -> Path:
    """Save the result of a session of ``config`` as ``out/<time>-<name>/``, and return that folder.

    Raises:
        RunFolderError: the folder cannot be written.
    """
    with _new_folder(config, out, StopSignals()) as folder:
        _save_run(folder, config, result)
    return folder.path


def _save_run(folder: RunFolder, config: Config, result: SessionResult) -> RunResult:
    """Write log and ``run.json`` of a simulated config, and return the content of the latter.

    Raises:
        RunFolderError: the folder cannot be written.
    """
    folder.write_arrays(result.log)
    saved = RunResult(
        name=config.name,
        verdict=result.verdict,
        metrics=result.metrics,
        seed=config.seed,
        certificate=result.certificate,
        changes=tuple(_settings_changes(config)),
    )
    folder.write_result(saved)
    return saved


def _settings_changes(config: Config) -> Iterator[SettingsChange]:
    """Yield the values before and after each of the config's changes."""
    for (_, before), (time_s, after) in pairwise(config.parts()):
        values = differing(before.model_dump(mode="json"), after.model_dump(mode="json"))
        yield SettingsChange(time_s, {key: (a, b) for key, a, b in values})


@dataclass(frozen=True)
class FinishedSolve(_Finished):
    """A finished and saved solve, converged or not.

    Attributes:
        folder: the run folder.
        result: the content of ``run.json``.
        outcome: trajectory, figures and verdict.
        scenario: the problem with its robot, initial guess and figures.
        signal: the signal that ended it early, if any.
    """

    result: SolveResult
    outcome: SolveOutcome = field(repr=False)
    scenario: "Scenario" = field(repr=False)

    @property
    def solution(self) -> "Solution":
        """States, controls, gains and multipliers."""
        return self.outcome.solution

    @property
    def robot(self) -> "Robot":
        """The robot of the problem."""
        return self.scenario.robot

    @property
    def problem(self) -> "ShootingProblem":
        """The optimal control problem."""
        return self.scenario.problem


@typed
def solve_config(
    config: SolveConfig, out: str | Path = "runs", *, notify: Notify = ignore, progress: IterationReport = ignore
) -> FinishedSolve:
    """Solve the problem of ``config`` and save it as ``out/<time>-<name>/``.

    Folder and signals are those of :func:`run_config`; a signal ends the solve between two iterations.

    Args:
        config: the problem.
        out: folder of run folders.
        notify: called with a description of what is being prepared.
        progress: called after every iteration.

    Raises:
        LgmpcError: if the config cannot be built, or the folder cannot be written or has too little space.
        Interrupted: by a signal before the first iteration.
    """
    with stop_signals() as stop, _new_folder(config, out, stop) as folder:
        session = prepare_solve(config, notify=stop.checked(notify))
        folder.check_space(session.log_bytes)
        with stop.deferred(progress) as report:
            notify("solving")
            outcome = session.run(report)
            folder.write_arrays(outcome.log)
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
    return FinishedSolve(folder, saved, outcome, session.scenario, signal=stop.received if interrupted else None)
