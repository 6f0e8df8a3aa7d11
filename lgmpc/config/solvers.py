"""From section ``solver`` of a config to what solves its problem."""

from __future__ import annotations

from collections.abc import Callable

from lgmpc.config.schema import SolveConfig
from lgmpc.config.session import Notify
from lgmpc.errors import InputError
from lgmpc.ocp import Trajectory
from lgmpc.problems import Scenario
from lgmpc.solvers import (
    BoxFddp,
    Callback,
    Fddp,
    FddpSettings,
    IterativeSolver,
    LineSearchSqp,
    LineSearchSqpSettings,
    NlpSolver,
    Solution,
)

__all__ = ["Solve", "build_solver"]

Solve = Callable[[Trajectory, Callback], Solution]
"""From a guess to a solution, telling the callback after every iteration."""

_TOLERANCES = {"fddp": 1e-9, "box_fddp": 1e-9, "sqp": 1e-6, "ipopt": 1e-8, "fatrop": 1e-8}


def build_solver(config: SolveConfig, scenario: Scenario, notify: Notify = lambda message: None) -> Solve:
    """Return what section ``solver`` says.

    Raises:
        ConfigError: a method that cannot take the problem's constraints.
    """
    section, problem = config.solver, scenario.problem
    method, most, limit = section.method, section.max_iterations, section.time_limit_s
    tolerance = _TOLERANCES[method] if section.tolerance is None else section.tolerance
    try:
        if method in ("ipopt", "fatrop"):
            nlp = NlpSolver(problem, method, tolerance=tolerance, max_iterations=most, progress=notify)
            if method == "fatrop":  # it can neither tell nor be stopped
                return lambda guess, callback: nlp.solve(guess)
            return lambda guess, callback: nlp.solve(guess, time_limit=limit, callback=callback)
        solver: IterativeSolver
        if method == "sqp":
            solver = LineSearchSqp(problem, LineSearchSqpSettings(tolerance=tolerance), progress=notify)
        else:
            kind = Fddp if method == "fddp" else BoxFddp
            solver = kind(problem, FddpSettings(tolerance=tolerance), progress=notify)
    except InputError as error:
        others = (
            "sqp, ipopt or fatrop" if method == "box_fddp" else "box_fddp (bounds on controls), sqp, ipopt or fatrop"
        )
        raise config.error("solver.method", f"{method} for {error.got}", others) from error
    return lambda guess, callback: solver.solve(guess, max_iterations=most, time_limit=limit, callback=callback)
