"""Sweeps: many runs of varied configs over worker processes, their statistics, and paired comparisons."""

from lgmpc.sweeps.design import Point, Sweep, load_sweep, parse_sweep
from lgmpc.sweeps.execution import FinishedSweep, SweepProgress, run_sweep
from lgmpc.sweeps.rows import Ending, Row
from lgmpc.sweeps.settings import SweepSettings

__all__ = [
    "Ending",
    "FinishedSweep",
    "Point",
    "Row",
    "Sweep",
    "SweepProgress",
    "SweepSettings",
    "load_sweep",
    "parse_sweep",
    "run_sweep",
]
