"""Solvers of optimal control problems: FDDP, SQP on structured quadratic programmes, ipopt and fatrop."""

from lgmpc.solvers.augmented_lagrangian import AugmentedLagrangianFddp, AugmentedLagrangianSettings
from lgmpc.solvers.box import BoxFddp
from lgmpc.solvers.fddp import Fddp, FddpSettings
from lgmpc.solvers.line_search_sqp import LineSearchSqp, LineSearchSqpSettings
from lgmpc.solvers.loop import (
    Callback,
    History,
    Iterate,
    IterativeSolver,
    Progress,
    Solver,
    SolverSettings,
)
from lgmpc.solvers.methods import AnySolverSettings, check_method, make_solver
from lgmpc.solvers.nlp import NlpSettings, NlpSolver
from lgmpc.solvers.real_time_sqp import RealTimeSqp
from lgmpc.solvers.solution import Solution, Timings
from lgmpc.status import Status

__all__ = [
    "AnySolverSettings",
    "AugmentedLagrangianFddp",
    "AugmentedLagrangianSettings",
    "BoxFddp",
    "Callback",
    "Fddp",
    "FddpSettings",
    "History",
    "Iterate",
    "IterativeSolver",
    "LineSearchSqp",
    "LineSearchSqpSettings",
    "NlpSettings",
    "NlpSolver",
    "Progress",
    "RealTimeSqp",
    "Solution",
    "Solver",
    "SolverSettings",
    "Status",
    "Timings",
    "check_method",
    "make_solver",
]
