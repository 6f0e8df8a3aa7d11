"""Runs: recorder, run folder, metrics and verdict."""

from lgmpc.runs.atomic import atomic_write
from lgmpc.runs.figures import judge_figures
from lgmpc.runs.folder import Run, RunFolder, SolvedRun, find_run, load_run
from lgmpc.runs.gate import Gate, Outcome, SolveGate, Verdict, judge, measured
from lgmpc.runs.intervals import PushInterval, push_intervals
from lgmpc.runs.log import RunLog
from lgmpc.runs.metrics import EstimatorErrors, Metrics, Timing, compute_metrics, flat_metrics, metric_names
from lgmpc.runs.modes import ModeMetrics
from lgmpc.runs.recorder import LogSettings, Recorder
from lgmpc.runs.result import HostInfo, RunResult, SolveResult, host_info, versions
from lgmpc.runs.trajectory import TrajectoryLog
from lgmpc.runs.walking import WalkingMetrics

__all__ = [
    "EstimatorErrors",
    "Gate",
    "HostInfo",
    "LogSettings",
    "Metrics",
    "ModeMetrics",
    "Outcome",
    "PushInterval",
    "Recorder",
    "Run",
    "RunFolder",
    "RunLog",
    "RunResult",
    "SolveGate",
    "SolveResult",
    "SolvedRun",
    "Timing",
    "TrajectoryLog",
    "Verdict",
    "WalkingMetrics",
    "atomic_write",
    "compute_metrics",
    "find_run",
    "flat_metrics",
    "host_info",
    "judge",
    "judge_figures",
    "load_run",
    "measured",
    "metric_names",
    "push_intervals",
    "versions",
]
