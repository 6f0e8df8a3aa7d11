"""Runs: recorder, run folder, metrics and verdict."""

from lgmpc.runs.atomic import atomic_write as atomic_write
from lgmpc.runs.figures import judge_figures as judge_figures
from lgmpc.runs.folder import (
    Run as Run,
    RunFolder as RunFolder,
    SolvedRun as SolvedRun,
    find_run as find_run,
    load_run as load_run,
)
from lgmpc.runs.gate import Gate as Gate, Outcome as Outcome, SolveGate as SolveGate, Verdict as Verdict, judge as judge
from lgmpc.runs.intervals import PushInterval as PushInterval, push_intervals as push_intervals
from lgmpc.runs.log import RunLog as RunLog
from lgmpc.runs.metrics import (
    Metrics as Metrics,
    compute_metrics as compute_metrics,
    flat_metrics as flat_metrics,
    metric_names as metric_names,
)
from lgmpc.runs.modes import ModeMetrics as ModeMetrics
from lgmpc.runs.recorder import LogSettings as LogSettings, Recorder as Recorder
from lgmpc.runs.result import (
    HostInfo as HostInfo,
    RunResult as RunResult,
    SolveResult as SolveResult,
    host_info as host_info,
    versions as versions,
)
from lgmpc.runs.trajectory import TrajectoryLog as TrajectoryLog
from lgmpc.runs.walking import WalkingMetrics as WalkingMetrics
