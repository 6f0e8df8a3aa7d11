"""Replays and figures of runs, of solved trajectories and of demonstrations.

A replay is a page, one self-contained text, that :func:`write_page` saves and :func:`serve_page` shows; figures are
files. The viewer and matplotlib are loaded when one is made.
"""

from lgmpc.viz.demonstration import demo_page, draw_demo
from lgmpc.viz.page import has_desktop, serve_page, write_page
from lgmpc.viz.plots import plot_run
from lgmpc.viz.replay import replay_page
from lgmpc.viz.trajectory_plots import plot_trajectory
from lgmpc.viz.trajectory_replay import trajectory_page

__all__ = [
    "demo_page",
    "draw_demo",
    "has_desktop",
    "plot_run",
    "plot_trajectory",
    "replay_page",
    "serve_page",
    "trajectory_page",
    "write_page",
]
