"""``lgmpc play`` and ``lgmpc plot``: from a run folder to a replay or figures."""

from __future__ import annotations

from pathlib import Path

from rich.text import Text

from lgmpc.cli.screen import has_desktop, out
from lgmpc.config import parse_config
from lgmpc.config.robots import build_robot
from lgmpc.robot import Robot
from lgmpc.runs import Run, RunFolder

__all__ = ["play_folder", "plot_folder"]


def play_folder(folder: Path, html: Path | None, port: int) -> None:
    """Serve the replay of a run until Ctrl-C, or write it to ``html``."""
    from lgmpc.viz.replay import export_html, play

    run = RunFolder.load(folder)
    robot = _robot_of(run)
    if html is None:
        play(robot, run, port=port, open_browser=has_desktop())
        return
    page = export_html(robot, run, html)
    out().print(Text(f"wrote {page} ({page.stat().st_size / 1e6:.1f} MB): open it in any browser"))


def plot_folder(folder: Path, into: Path | None) -> None:
    """Draw the figures of a run."""
    from lgmpc.viz.plots import plot_run

    for figure in plot_run(RunFolder.load(folder), into):
        out().print(Text(f"wrote {figure}"))


def _robot_of(run: Run) -> Robot:
    """Load the robot that a run was made with."""
    return build_robot(parse_config(run.config, name=str(run.path / "config.yaml"), folder=run.path))
