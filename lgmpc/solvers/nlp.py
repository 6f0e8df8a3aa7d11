"""Interior-point solution of the whole problem as one nonlinear programme, with exact Hessians.

Ipopt is a general solver; fatrop exploits the structure of optimal control (Vanroye, Sathya, De Schutter, Decre,
"FATROP: a fast constrained optimal control problem solver", IROS 2023). Both are part of CasADi.
"""

import math
import time
from dataclasses import replace
from typing import Any, Literal

import casadi as ca
import numpy as np
from pydantic import model_validator

from lgmpc.errors import InputError
from lgmpc.ocp import KktResidual, MultipleShooting, ShootingProblem, Trajectory, transcribe
from lgmpc.settings import Positive, key, problem as problem_with
from lgmpc.solvers.loop import Callback, Progress, Solver, SolverSettings, settings_of
from lgmpc.solvers.solution import Solution, Timings
from lgmpc.status import Status
from lgmpc.typing import Array

_STATUS = {
    "Solve_Succeeded": Status.CONVERGED,
    "0": Status.CONVERGED,  # fatrop's
    "Solved_To_Acceptable_Level": Status.ACCEPTABLE,
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
    "Diverging_Iterates": Status.UNBOUNDED,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
    "User_Requested_Stop": Status.STOPPED,
    "Invalid_Number_Detected": Status.NOT_FINITE,
}


class NlpSettings(SolverSettings):
    """Method, tolerance and limits of :class:`NlpSolver`."""

    method: Literal["ipopt", "fatrop"] = key("ipopt", "Interior-point solvers with exact Hessians; any constraints.")
    tolerance: Positive = key(1e-8, "Largest residual of the optimality conditions of a solution.")

    @model_validator(mode="after")
    def _fatrop_has_no_clock(self) -> "NlpSettings":
        if self.method == "fatrop" and self.time_limit_s is not None:
            raise problem_with("null: fatrop cannot be interrupted", key="time_limit_s", got=self.time_limit_s)
        return self


class NlpSolver(Solver):
    """Solves any :class:`~lgmpc.ocp.ShootingProblem`, path constraints included, by multiple shooting.

    Args:
        problem: the problem; its data are read at every solve.
        settings: solver, tolerance and limits.

    Raises:
        InputError: fatrop, for a problem with actions of Python.
    """

    def __init__(self, problem: ShootingProblem, settings: NlpSettings | None = None) -> None:
        self.settings: NlpSettings = settings_of(problem, settings, NlpSettings)
        self.name, self.interruptible = self.settings.method, self.settings.method == "ipopt"
        self.problem = problem
        self._shooting = transcribe(problem)
        self._watch = _Watch(self._shooting)
        if self._shooting.differences and self.name != "ipopt":
            expected = "ipopt, FDDP or SQP: fatrop requires second derivatives, which an action of Python lacks"
            raise InputError("method", self.name, expected)
        options = _ipopt if self.name == "ipopt" else _fatrop
        chosen = options(self._shooting, self.settings)
        if self.name == "ipopt":
            chosen["iteration_callback"] = self._watch
        programme: Any = self._shooting.programme
        self._values = ca.Function("values", [programme["x"], programme["p"]], [programme["f"], programme["g"]])
        self._solver = ca.nlpsol(f"nlp_{problem.nodes}", self.name, programme, chosen)

    def _run(
        self, base: Trajectory, max_iterations: int, time_limit: float | None, callback: Callback | None
    ) -> Solution:
        start = time.perf_counter()
        shooting, problem = self._shooting, self.problem
        p = shooting.pack_parameters(problem, base)
        lower, upper = shooting.bounds(p)
        if not self._finite_at(p):  # ipopt would report it; fatrop would not terminate
            return self._unsolved(base, Status.NOT_FINITE, start)
        crossed = bool((lower.full() > upper.full()).any())  # CasADi would raise
        if crossed or problem.first_violation() is not None:
            return self._unsolved(base, Status.INFEASIBLE, start)
        self._watch.begin(start, max_iterations, time_limit, callback)
        try:
            found = self._solver(x0=np.zeros(shooting.size), p=p, lbg=lower, ubg=upper)
        except RuntimeError:  # raised by fatrop if an iterate contains NaN
            return self._unsolved(base, Status.FAILED, start)
        if self._watch.error is not None:
            raise self._watch.error
        stats = self._solver.stats()
        z = found["x"].full()[:, 0]
        finite = bool(np.isfinite(z).all() and math.isfinite(float(found["f"])))
        status = _STATUS.get(str(stats["return_status"]), Status.FAILED) if finite else Status.NOT_FINITE
        if status is Status.STOPPED and self._watch.reached is not None:
            status = self._watch.reached
        return self._solution(z, p, found, status, stats, start)

    def _finite_at(self, p: Any) -> bool:
        """Return whether data, cost and constraints are finite at the guess (bounds may be infinite)."""
        values = [np.asarray(value.full()) for value in self._values(np.zeros(self._shooting.size), p)]
        states_and_controls = p.size - self.problem.parameters.size
        return not np.isnan(p).any() and all(np.isfinite(v).all() for v in (p[:states_and_controls], *values))

    def _unsolved(self, base: Trajectory, status: Status, start: float) -> Solution:
        """Return the guess as the result, where the solver cannot start or failed."""
        problem = self.problem
        p = self._shooting.pack_parameters(problem, base)
        cost = float(self._values(np.zeros(self._shooting.size), p)[0])
        guess = Trajectory(np.vstack([problem.x0, base.xs[1:]]), base.us.copy())
        zeros = np.zeros((problem.nodes, problem.state.ndx)), np.zeros((problem.nodes, max(self._shooting.ng)))
        return self._measured(guess, zeros, status, 0, cost, start)

    def _solution(self, z: Any, p: Any, found: dict[str, Any], status: Status, stats: Any, start: float) -> Solution:
        shooting, trajectory = self._shooting, self._shooting.unpack(z, p)
        multipliers = shooting.unpack_multipliers(found["lam_g"].full()[:, 0], p, trajectory)
        if status is Status.NOT_FINITE:
            multipliers = np.full_like(multipliers[0], np.nan), np.full_like(multipliers[1], np.nan)
        count, cost = int(stats["iter_count"]), float(found["f"])
        solution = self._measured(trajectory, multipliers, status, count, cost, start)
        return replace(solution, status=Status.SADDLE) if status.solved and not solution.is_minimum() else solution

    def _measured(
        self,
        at: Trajectory,
        multipliers: tuple[Array, Array],
        status: Status,
        iterations: int,
        cost: float,
        start: float,
    ) -> Solution:
        problem, elapsed = self.problem, time.perf_counter() - start
        n, ndx, nu = problem.nodes, problem.state.ndx, problem.nu
        solution = Solution(
            problem.copy(), at.xs, at.us, np.zeros((0, nu, ndx)), np.zeros((0, nu)), *multipliers, status, iterations,
            cost, np.full((n + 1, ndx), np.nan), KktResidual.unknown(), Timings(elapsed),
        )  # fmt: skip
        return solution if status is Status.NOT_FINITE else solution.measured()


class _Watch(ca.Callback):
    """Reports ipopt's iterations to a callback, and checks the limits of iterations and time."""

    def __init__(self, shooting: MultipleShooting) -> None:
        ca.Callback.__init__(self)
        self._size = {"x": shooting.size, "f": 1, "g": len(shooting.equalities), "lam_x": shooting.size}
        self._size |= {"lam_g": self._size["g"], "lam_p": int(shooting.programme["p"].numel())}
        self._gaps = np.array(shooting.equalities)
        self.begin(0.0, None, None, None)
        self.construct("watch", {})

    def begin(
        self, start: float, max_iterations: int | None, time_limit: float | None, callback: Callback | None
    ) -> None:
        """Reset for a solve that began at ``start``."""
        self.reached: Status | None = None  # which limit
        self.error: BaseException | None = None
        self._start, self._most, self._limit = start, max_iterations, time_limit
        self._callback, self._count = callback, 0

    def get_n_in(self) -> int:
        """As CasADi requires."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """As CasADi requires."""
        return 1

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """As CasADi requires."""
        return ca.Sparsity.dense(self._size[ca.nlpsol_out(i)], 1)

    def eval(self, arg: Any) -> Any:
        """Return 1 to stop."""
        elapsed = time.perf_counter() - self._start
        if self._limit is not None and elapsed >= self._limit:
            self.reached = Status.TIME_LIMIT
        elif self._most is not None and self._count >= self._most:
            self.reached = Status.ITERATION_LIMIT
        stop = self.reached is not None
        if self._callback is not None and self._count > 0:
            values = dict(zip((ca.nlpsol_out(i) for i in range(len(arg))), arg, strict=True))
            gap = float(np.abs(values["g"].full()[self._gaps, 0]).max())
            progress = Progress(self._count, float(values["f"]), math.nan, gap, math.nan, 0.0, True, elapsed)
            try:
                stop = self._callback(progress) is True or stop
            except BaseException as error:  # noqa: B036 - CasADi would only print it: it is raised after the solve
                self.error, stop = error, True
        self._count += 1
        return [int(stop)]


def _ipopt(shooting: MultipleShooting, settings: NlpSettings) -> dict[str, Any]:
    return {
        "print_time": False,
        "error_on_fail": False,
        "ipopt": {
            "print_level": 0,
            "sb": "yes",
            "tol": settings.tolerance,
            "compl_inf_tol": settings.tolerance,  # of the unscaled problem, as is the next: tol itself is relative
            "dual_inf_tol": 1e2 * settings.tolerance,
            "max_iter": settings.max_iterations,
            "bound_relax_factor": 0.0,  # else active bounds are off by 1e-8 of their value
            **({"hessian_approximation": "limited-memory"} if shooting.differences else {}),
        },
    }


def _fatrop(shooting: MultipleShooting, settings: NlpSettings) -> dict[str, Any]:
    n, ndx = shooting.nodes, shooting.state.ndx
    return {
        "print_time": False,
        "error_on_fail": False,
        "structure_detection": "manual",
        "N": n,
        "nx": [0, *[ndx] * n],  # the first state is data
        "nu": [*shooting.nu, 0],
        "ng": [*shooting.ng, 0],
        "equality": shooting.equalities,
        "fatrop": {"print_level": 0, "tol": settings.tolerance, "max_iter": settings.max_iterations},
    }
