"""Replays and figures of runs, of solved trajectories and of demonstrations.

A replay is one self-contained HTML page, saved by :func:`write_page` and opened by :func:`open_page`; figures are
matplotlib's, in :class:`Plots`. The viewer and matplotlib are imported when they are used.
"""

from lgmpc.viz.demonstration import demo_page, draw_demo
from lgmpc.viz.figure_files import Plots
from lgmpc.viz.page import embed_page, in_notebook, open_page, write_page
from lgmpc.viz.plots import plot_run
from lgmpc.viz.replay import replay_page
from lgmpc.viz.report import run_report

__all__ = [
    "Plots",
    "demo_page",
    "draw_demo",
    "embed_page",
    "in_notebook",
    "open_page",
    "plot_run",
    "replay_page",
    "run_report",
    "write_page",
]
