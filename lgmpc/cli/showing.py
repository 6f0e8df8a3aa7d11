"""``lgmpc play`` and ``lgmpc plot``: from a run folder to a replay or figures."""

from __future__ import annotations

from pathlib import Path

from rich.text import Text

from lgmpc.cli.screen import has_desktop, out
from lgmpc.config import parse_any_config
from lgmpc.config.robots import build_any_robot
from lgmpc.robot import Robot
from lgmpc.runs import Run, RunFolder, SolvedRun

__all__ = ["play_folder", "plot_folder"]


def play_folder(folder: Path, html: Path | None, port: int) -> None:
    """Serve the replay of a run until Ctrl-C, or write it to ``html``."""
    from lgmpc.viz import replay_page, serve_page, trajectory_page, write_page

    run = RunFolder.load_any(folder)
    robot = _robot_of(run)
    page = trajectory_page(robot, run) if isinstance(run, SolvedRun) else replay_page(robot, run)
    if html is None:
        serve_page(page, run.path.name, port=port, open_browser=has_desktop())
        return
    file = write_page(page, html)
    out().print(Text(f"wrote {file} ({file.stat().st_size / 1e6:.1f} MB): open it in any browser"))


def plot_folder(folder: Path, into: Path | None) -> None:
    """Draw the figures of a run."""
    from lgmpc.viz import plot_run, plot_trajectory

    run = RunFolder.load_any(folder)
    figures = plot_trajectory(_robot_of(run), run, into) if isinstance(run, SolvedRun) else plot_run(run, into)
    for figure in figures:
        out().print(Text(f"wrote {figure}"))


def _robot_of(run: Run | SolvedRun) -> Robot:
    """Load the robot that a run was made with."""
    return build_any_robot(parse_any_config(run.config, name=str(run.path / "config.yaml"), folder=run.path))
