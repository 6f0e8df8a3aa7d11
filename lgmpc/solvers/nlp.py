"""Interior point solution of the nonlinear programme by ipopt, with exact derivatives: slow, and the reference."""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import Enum
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.ocp import ShootingProblem, Trajectory, transcribe
from lgmpc.typing import Array

__all__ = ["IpoptSolver", "NlpResult", "NlpStatus"]


class NlpStatus(Enum):
    """How ipopt ended; the value says what to do about it."""

    CONVERGED = "nothing to do"
    ACCEPTABLE = "nothing to do if the accuracy is enough; else scale the problem better"
    INFEASIBLE = "no feasible point was found: check bounds and first state, or start elsewhere"
    ITERATION_LIMIT = "raise max_iterations, or start closer to the solution"
    FAILED = "check the parameters for NaN and the weights for very different magnitudes"


_STATUS = {
    "Solve_Succeeded": NlpStatus.CONVERGED,
    "Solved_To_Acceptable_Level": NlpStatus.ACCEPTABLE,
    "Infeasible_Problem_Detected": NlpStatus.INFEASIBLE,
    "Maximum_Iterations_Exceeded": NlpStatus.ITERATION_LIMIT,
}


@dataclass(frozen=True)
class NlpResult:
    """What ipopt found.

    Attributes:
        trajectory: states (N+1, nx) and controls (N, nu).
        costates: (N, ndx) multipliers of the dynamics.
        multipliers: (N, ng) of the path constraint.
        status: how it ended.
        iterations: of ipopt.
        cost: at the trajectory.
        duration: s.
    """

    trajectory: Trajectory
    costates: Array
    multipliers: Array
    status: NlpStatus
    iterations: int
    cost: float
    duration: float


class IpoptSolver:
    """Solves a :class:`~lgmpc.ocp.ShootingProblem` by multiple shooting and ipopt.

    Args:
        problem: the problem; its data are read at every solve.
        tolerance: of ipopt's optimality conditions.
        max_iterations: of ipopt.
    """

    def __init__(self, problem: ShootingProblem, tolerance: float = 1e-10, max_iterations: int = 200) -> None:
        self.problem = problem
        self._shooting = transcribe(problem.action, problem.nodes)
        programme: Any = self._shooting.programme
        options: Any = {
            "print_time": False,
            "error_on_fail": False,
            "ipopt": {
                "print_level": 0,
                "sb": "yes",
                "tol": tolerance,
                "compl_inf_tol": tolerance,  # of the unscaled problem, as the next: tol itself is relative
                "dual_inf_tol": 1e2 * tolerance,
                "max_iter": max_iterations,
                "bound_relax_factor": 0.0,  # else active bounds are off by 1e-8 of their value
            },
        }
        self._solver = ca.nlpsol("ipopt", "ipopt", programme, options)

    def solve(self, guess: Trajectory) -> NlpResult:
        """Solve from a guess (whose first state is replaced by the problem's)."""
        start = time.perf_counter()
        shooting = self._shooting
        p = shooting.pack_parameters(self.problem, guess)
        lower, upper = shooting.bounds(p)
        found = self._solver(x0=np.zeros(shooting.size), p=p, lbg=lower, ubg=upper)
        stats = self._solver.stats()
        costates, multipliers = shooting.unpack_multipliers(found["lam_g"].full()[:, 0])
        return NlpResult(
            shooting.unpack(found["x"].full()[:, 0], p),
            costates,
            multipliers,
            _STATUS.get(stats["return_status"], NlpStatus.FAILED),
            int(stats["iter_count"]),
            float(found["f"]),
            time.perf_counter() - start,
        )
