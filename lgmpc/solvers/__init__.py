"""Solvers of optimal control problems: FDDP, SQP on structured quadratic programmes, ipopt and fatrop."""

from lgmpc.solvers.augmented_lagrangian import (
    AugmentedLagrangianFddp as AugmentedLagrangianFddp,
    AugmentedLagrangianSettings as AugmentedLagrangianSettings,
)
from lgmpc.solvers.box import BoxFddp as BoxFddp
from lgmpc.solvers.fddp import Fddp as Fddp, FddpSettings as FddpSettings
from lgmpc.solvers.line_search_sqp import LineSearchSqp as LineSearchSqp, LineSearchSqpSettings as LineSearchSqpSettings
from lgmpc.solvers.loop import (
    Callback as Callback,
    History as History,
    IterativeSolver as IterativeSolver,
    Progress as Progress,
    Solver as Solver,
    SolverSettings as SolverSettings,
)
from lgmpc.solvers.methods import (
    AnySolverSettings as AnySolverSettings,
    check_method as check_method,
    make_solver as make_solver,
)
from lgmpc.solvers.nlp import NlpSettings as NlpSettings, NlpSolver as NlpSolver
from lgmpc.solvers.real_time_sqp import RealTimeSqp as RealTimeSqp
from lgmpc.solvers.solution import Solution as Solution
from lgmpc.status import Status as Status
