"""The replay of a run: in the browser, or as a page in a file."""

from __future__ import annotations

from pathlib import Path

from lgmpc.config.execution import FinishedRun
from lgmpc.config.loading import parse_any_config
from lgmpc.config.robots import build_any_robot
from lgmpc.config.solve_execution import FinishedSolve
from lgmpc.robot import Robot
from lgmpc.runs import Run, RunFolder, SolvedRun
from lgmpc.viz import has_desktop, replay_page, serve_page, trajectory_page, write_page

__all__ = ["robot_of_run", "show"]


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
    loaded = RunFolder.load_any(run.folder.path if isinstance(run, FinishedRun | FinishedSolve) else run)
    robot = robot_of_run(loaded)
    page = trajectory_page(robot, loaded) if isinstance(loaded, SolvedRun) else replay_page(robot, loaded)
    if html is not None:
        return write_page(page, html)
    serve_page(page, loaded.path.name, port=port, open_browser=has_desktop())
    return None


def robot_of_run(run: Run | SolvedRun) -> Robot:
    """Load the robot of a run."""
    return build_any_robot(parse_any_config(run.config, name=str(run.path / "config.yaml"), folder=run.path))
