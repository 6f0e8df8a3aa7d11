"""Solvers of optimal control problems: FDDP, SQP on structured QPs, and ipopt; one loop, one solution."""

from lgmpc.solvers.box_fddp import BoxFddp
from lgmpc.solvers.fddp import Fddp, FddpSettings
from lgmpc.solvers.line_search_sqp import LineSearchSqp, LineSearchSqpSettings
from lgmpc.solvers.loop import Callback, IterativeSolver, PrintProgress, Progress
from lgmpc.solvers.nlp import NlpSolver
from lgmpc.solvers.real_time_sqp import RealTimeResult, RealTimeSqp, RealTimeStatus, RealTimeTimings
from lgmpc.solvers.solution import Solution, Status, Timings

__all__ = [
    "BoxFddp",
    "Callback",
    "Fddp",
    "FddpSettings",
    "IterativeSolver",
    "LineSearchSqp",
    "LineSearchSqpSettings",
    "NlpSolver",
    "PrintProgress",
    "Progress",
    "RealTimeResult",
    "RealTimeSqp",
    "RealTimeStatus",
    "RealTimeTimings",
    "Solution",
    "Status",
    "Timings",
]
