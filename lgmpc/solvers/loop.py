"""The common loop of iterative solvers: iteration and time limits, callbacks, the result."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, TypeVar

import numpy as np
from pydantic import Field

from lgmpc.errors import InputError, SolverError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.settings import Positive, Settings, key
from lgmpc.solvers.solution import Solution
from lgmpc.status import Status
from lgmpc.typing import Array, instance

K = TypeVar("K", bound="SolverSettings")


class SolverSettings(Settings):
    """Termination of a solver. A config selects the solver by ``method``."""

    method: str
    max_iterations: Annotated[int, Field(strict=True, ge=0, le=100_000)] = key(200, "Largest number of iterations.")
    tolerance: Positive
    time_limit_s: Positive | None = key(None, "Time limit, s, compilation excluded. null: none.")


@dataclass(frozen=True, eq=False)
class Iterate:
    """The trajectory of a solver between two iterations: read-only views, valid until the callback returns.

    Attributes:
        xs: (N+1, nx) states.
        us: (N, nu) controls.
        feedback: (N, nu, ndx) K of the last sweep, around the trajectory before the step; of length 0 from solvers
            without a sweep.
    """

    xs: Array
    us: Array
    feedback: Array

    @classmethod
    def of(cls, xs: Array, us: Array, feedback: Array) -> "Iterate":
        """Return read-only views of a solver's arrays."""
        views = [array.view() for array in (xs, us, feedback)]
        for view in views:
            view.setflags(write=False)
        return cls(*views)


@dataclass(frozen=True)
class Progress:
    """Progress of a solve after an iteration.

    Attributes:
        iteration: number of iterations taken.
        cost: at the current trajectory.
        criterion: the measure compared with the tolerance.
        gap: largest gap of the dynamics at the start of the iteration.
        step_length: of the step taken, or of the last one tried.
        regularization: of the last sweep.
        accepted: whether a step was taken.
        elapsed: s since the start.
        iterate: the current trajectory; None from solvers that do not report it.
    """

    iteration: int
    cost: float
    criterion: float
    gap: float
    step_length: float
    regularization: float
    accepted: bool
    elapsed: float
    iterate: Iterate | None = field(default=None, repr=False, compare=False)


Callback = Callable[[Progress], object]
"""Called after every iteration; returns True to stop."""


class History:
    """A callback that keeps the progress of every iteration, without the iterates; several callbacks can share a solve.

    Args:
        others: further callbacks; each is called, and any stops the solve.

    Attributes:
        reports: one an iteration.
    """

    def __init__(self, *others: Callback) -> None:
        for other in others:
            if not callable(other):
                raise InputError("others", type(other).__name__, "functions of the Progress")
        self.reports: list[Progress] = []
        self._others = others

    def __call__(self, progress: Progress) -> bool:
        """Keep the report; return whether another callback stops the solve."""
        self.reports.append(replace(progress, iterate=None))
        return any([other(progress) is True for other in self._others])

    def column(self, name: str) -> Array:
        """Return one quantity of all iterations (n,): ``cost``, ``criterion``, ``gap``, ``step_length``, ...

        Raises:
            InputError: no such quantity.
        """
        known = tuple(f.name for f in fields(Progress) if f.name != "iterate")
        if not isinstance(name, str) or name not in known:
            raise InputError("name", str(name), "a quantity of Progress", known)
        return np.array([getattr(report, name) for report in self.reports], dtype=np.float64)


def settings_of(problem: object, settings: K | None, kind: type[K]) -> K:
    """Return a solver's settings, the standard ones unless given.

    Raises:
        InputError: the problem is none, or settings of another solver.
    """
    instance("problem", problem, ShootingProblem, "a ShootingProblem")
    if settings is None:
        return kind()
    instance("settings", settings, kind, f"{kind.__name__}(...)")
    return settings


def check_limits(max_iterations: object, time_limit: object, callback: object) -> None:
    """Check the limits of a solve, each None or a value.

    Raises:
        InputError: of a wrong type, or negative.
    """
    if max_iterations is not None:
        instance("max_iterations", max_iterations, (int, np.integer), "a whole number, at least 0")
        if int(max_iterations) < 0:  # type: ignore[call-overload]
            raise InputError("max_iterations", max_iterations, "at least 0")
    if time_limit is not None:
        instance("time_limit", time_limit, (int, float, np.number), "a number, s")
        if not float(time_limit) >= 0.0:  # type: ignore[arg-type]
            raise InputError("time_limit", time_limit, "at least 0 s")
    if callback is not None and not callable(callback):
        raise InputError("callback", type(callback).__name__, "a function of the Progress")


class Solver(ABC):
    """A solver of one :class:`~lgmpc.ocp.ShootingProblem`.

    Attributes:
        name: in messages.
        problem: the problem; its data are read at every solve.
        settings: tolerances and limits.
        interruptible: whether a solve can have limits and a callback.
    """

    name: str
    problem: ShootingProblem
    settings: SolverSettings
    interruptible: bool = True
    _known: Solution | None = None  # the solution that the current solve starts from

    def solve(
        self,
        guess: Trajectory | Solution | None = None,
        *,
        max_iterations: int | None = None,
        time_limit: float | None = None,
        callback: Callback | None = None,
        throw: bool = False,
    ) -> Solution:
        """Iterate from a guess until the solver's conditions hold.

        Args:
            guess: initial states and controls (the first state is replaced by the problem's); the first state at all
                nodes and zero controls unless given. Of a solution, the SQP also takes the multipliers.
            max_iterations: most iterations, at least 0; the settings' unless given. Of ipopt not more than those.
            time_limit: s; checked before each iteration; the settings' unless given.
            callback: called with the progress after every iteration; stops the solve by returning True.
            throw: raise if the solve ends without a solution.

        Raises:
            InputError: a guess of the wrong shape, negative limits, or any of the last three for fatrop.
            SolverError: no solution, with ``throw``; the message contains the remedy and the explanation.
        """
        check_limits(max_iterations, time_limit, callback)
        for name, value in (("max_iterations", max_iterations), ("time_limit", time_limit), ("callback", callback)):
            if not self.interruptible and value is not None:
                raise InputError(name, f"one for {self.name}", f"none: {self.name} cannot be interrupted")
        max_iterations = self.settings.max_iterations if max_iterations is None else max_iterations
        time_limit = self.settings.time_limit_s if time_limit is None else time_limit
        self._known = guess if isinstance(guess, Solution) else None
        start = guess.trajectory if isinstance(guess, Solution) else guess
        checked = self.problem.check(self.problem.hold() if start is None else start)
        # The status and its explanation name what was not finite, so that numpy need not warn.
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            solution = self._run(checked, max_iterations, time_limit, callback)
        if throw and not solution.status.solved:
            raise SolverError(self.name, solution.status.name.lower(), solution.explain())
        return solution

    @abstractmethod
    def _run(
        self, guess: Trajectory, max_iterations: int, time_limit: float | None, callback: Callback | None
    ) -> Solution:
        """Solve from a guess of the right shape."""


class IterativeSolver(Solver):
    """A solver whose iterations are calls of its own."""

    def _run(
        self, guess: Trajectory, max_iterations: int, time_limit: float | None, callback: Callback | None
    ) -> Solution:
        start = time.perf_counter()
        status = self._begin(guess)
        if status is None and self.problem.first_violation() is not None:
            status = Status.INFEASIBLE
        iterations = 0
        while status is None:
            if iterations >= max_iterations:
                status = Status.ITERATION_LIMIT
            elif time_limit is not None and time.perf_counter() - start >= time_limit:
                status = Status.TIME_LIMIT
            else:
                status = self._iterate()
                iterations += 1
                if callback is not None:
                    stop = callback(self._progress(iterations, time.perf_counter() - start))
                    if stop is True and status is None:
                        status = Status.STOPPED
        return self._finish(status, iterations, start)

    @abstractmethod
    def _begin(self, guess: Trajectory) -> Status | None:
        """Start from a guess of the right shape; return a status if no iteration is possible."""

    @abstractmethod
    def _iterate(self) -> Status | None:
        """Take one iteration; return a status if it was the last."""

    @abstractmethod
    def _progress(self, iteration: int, elapsed: float) -> Progress:
        """Return the progress of the solve."""

    @abstractmethod
    def _finish(self, status: Status, iterations: int, start: float) -> Solution:
        """Return the solution; ``start`` is on the clock of ``time.perf_counter``."""
