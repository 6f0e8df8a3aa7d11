"""Replay and figures of a run that is saved."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lgmpc.config.loading import parse_any_config
from lgmpc.config.robots import build_any_robot
from lgmpc.robot import Robot
from lgmpc.runs import Run, RunFolder, SolvedRun
from lgmpc.viz import (
    has_desktop,
    plot_run,
    plot_trajectory,
    replay_page,
    serve_page,
    trajectory_page,
    write_page,
)

if TYPE_CHECKING:
    from lgmpc.config.execution import FinishedRun, FinishedSolve

__all__ = ["plot", "show"]


def show(
    run: str | Path | FinishedRun | FinishedSolve, html: str | Path | None = None, *, port: int = 0
) -> Path | None:
    """Replay a run: serve it to the browser until Ctrl-C, or write it to a file and return that file.

    Args:
        run: what :func:`run_config` or :func:`solve_config` returned, or a run folder.
        html: file for the page, which then needs nothing else; no server is started.
        port: TCP port of the server on this machine; 0 takes any free one.

    Raises:
        RunFolderError: if the folder is not a complete run, or the page cannot be written.
        InputError: if the run has nothing to show, or the port is taken.
    """
    loaded = _load(run)
    robot = _robot_of(loaded)
    page = trajectory_page(robot, loaded) if isinstance(loaded, SolvedRun) else replay_page(robot, loaded)
    if html is not None:
        return write_page(page, html)
    serve_page(page, loaded.path.name, port=port, open_browser=has_desktop())
    return None


def plot(run: str | Path | FinishedRun | FinishedSolve, out: str | Path | None = None) -> tuple[Path, ...]:
    """Draw the figures of a run and return their files.

    Args:
        run: what :func:`run_config` or :func:`solve_config` returned, or a run folder.
        out: folder for the figures; ``figures/`` in the run's own unless given.

    Raises:
        RunFolderError: if the folder is not a complete run, or a figure cannot be written.
        InputError: if the run has nothing to draw.
    """
    loaded = _load(run)
    if isinstance(loaded, SolvedRun):
        return plot_trajectory(_robot_of(loaded), loaded, out)
    return plot_run(loaded, out)


def _load(run: str | Path | FinishedRun | FinishedSolve) -> Run | SolvedRun:
    return RunFolder.load_any(run if isinstance(run, str | Path) else run.folder.path)


def _robot_of(run: Run | SolvedRun) -> Robot:
    return build_any_robot(parse_any_config(run.config, name=str(run.path / "config.yaml"), folder=run.path))
