"""Sweeps: many runs of varied configs over worker processes, their statistics, and paired comparisons."""

from lgmpc.sweeps.design import Point as Point, Sweep as Sweep, load_sweep as load_sweep, parse_sweep as parse_sweep
from lgmpc.sweeps.execution import (
    FinishedSweep as FinishedSweep,
    SweepProgress as SweepProgress,
    run_sweep as run_sweep,
)
from lgmpc.sweeps.rows import Ending as Ending, Row as Row
from lgmpc.sweeps.settings import SweepSettings as SweepSettings
