"""Sweeps: many runs of varied configs over worker processes, their statistics, and paired comparisons."""

from lgmpc.sweeps.cluster import dask_client
from lgmpc.sweeps.design import Point, Sweep, load_sweep, parse_sweep
from lgmpc.sweeps.execution import FinishedSweep, SweepProgress, run_sweep
from lgmpc.sweeps.rows import Ending, Row
from lgmpc.sweeps.settings import SweepSettings
from lgmpc.sweeps.slurm import SlurmSettings, load_slurm, slurm_client

__all__ = [
    "Ending",
    "FinishedSweep",
    "Point",
    "Row",
    "SlurmSettings",
    "Sweep",
    "SweepProgress",
    "SweepSettings",
    "dask_client",
    "load_slurm",
    "load_sweep",
    "parse_sweep",
    "run_sweep",
    "slurm_client",
]
