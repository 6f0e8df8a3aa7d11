"""``lgmpc play`` and ``lgmpc plot``: from a run folder to a replay or figures."""

from __future__ import annotations

from pathlib import Path

from rich.text import Text

from lgmpc.cli.screen import out
from lgmpc.config.showing import robot_of_run, show
from lgmpc.runs import RunFolder, SolvedRun

__all__ = ["play_folder", "plot_folder"]


def play_folder(folder: Path, html: Path | None, port: int) -> None:
    """Serve the replay of a run until Ctrl-C, or write it to ``html``."""
    file = show(folder, html, port=port)
    if file is not None:
        out().print(Text(f"wrote {file} ({file.stat().st_size / 1e6:.1f} MB): open it in any browser"))


def plot_folder(folder: Path, into: Path | None) -> None:
    """Draw the figures of a run."""
    from lgmpc.viz import plot_run, plot_trajectory

    run = RunFolder.load_any(folder)
    figures = plot_trajectory(robot_of_run(run), run, into) if isinstance(run, SolvedRun) else plot_run(run, into)
    for figure in figures:
        out().print(Text(f"wrote {figure}"))
