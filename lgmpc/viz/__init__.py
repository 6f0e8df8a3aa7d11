"""Replays and figures of runs, of solved trajectories and of demonstrations.

A replay is one self-contained HTML page, saved by :func:`write_page` and opened by :func:`open_page`; figures are
matplotlib's, in :class:`Plots`. The viewer and matplotlib are imported when they are used.
"""

from lgmpc.viz.demonstration import demo_page as demo_page, draw_demo as draw_demo
from lgmpc.viz.figure_files import Plots as Plots
from lgmpc.viz.page import (
    embed_page as embed_page,
    in_notebook as in_notebook,
    open_page as open_page,
    write_page as write_page,
)
from lgmpc.viz.plots import plot_run as plot_run
from lgmpc.viz.replay import replay_page as replay_page
from lgmpc.viz.report import run_report as run_report
