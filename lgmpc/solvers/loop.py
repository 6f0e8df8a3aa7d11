"""The one loop of all iterative solvers: they supply steps, it counts, checks the time limit, calls the callback."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from lgmpc.errors import InputError, SolverError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.settings import Positive, Settings
from lgmpc.solvers.solution import Solution, Status

__all__ = ["Callback", "IterativeSolver", "PrintProgress", "Progress", "SolverSettings"]


class SolverSettings(Settings):
    """When a solver stops. A config selects the solver by ``method``."""

    method: str
    max_iterations: Annotated[int, Field(strict=True, ge=0, le=100_000)] = Field(
        default=200, description="Most iterations."
    )
    tolerance: Positive
    time_limit_s: Positive | None = Field(
        default=None, description="Stop after this time, s (compiling does not count). null: never."
    )

    @model_validator(mode="before")
    @classmethod
    def _null_is_the_default(cls, data: Any) -> Any:
        """Configs that earlier versions wrote have ``tolerance: null`` for the method's own."""
        return {key: value for key, value in data.items() if value is not None} if isinstance(data, dict) else data


@dataclass(frozen=True)
class Progress:
    """Where a solve stands after an iteration.

    Attributes:
        iteration: number of iterations taken.
        cost: at the current trajectory.
        criterion: what is compared with the tolerance.
        gap: largest gap of the dynamics at the start of the iteration.
        step_length: of the step taken, or of the last one tried.
        regularization: of the last sweep.
        accepted: whether a step was taken.
        elapsed: s since the start.
    """

    iteration: int
    cost: float
    criterion: float
    gap: float
    step_length: float
    regularization: float
    accepted: bool
    elapsed: float


Callback = Callable[[Progress], object]
"""Called after every iteration; returns True to stop."""


class PrintProgress:
    """A callback that prints a line an iteration, with a heading every 20.

    Args:
        write: what prints a line.
    """

    def __init__(self, write: Callable[[str], object] = print) -> None:
        self._write = write

    def __call__(self, progress: Progress) -> None:
        """Print the line."""
        if progress.iteration % 20 == 1:
            self._write(" iter           cost  criterion        gap     step  regularis.   ms")
        self._write(
            f"{progress.iteration:5d} {progress.cost:14.7g} {progress.criterion:10.2e} {progress.gap:10.2e} "
            f"{progress.step_length if progress.accepted else 0.0:8.4f}  {progress.regularization:10.1e} "
            f"{1e3 * progress.elapsed:6.1f}"
        )


class IterativeSolver(ABC):
    """A solver of one :class:`~lgmpc.ocp.ShootingProblem` that works in iterations.

    Attributes:
        name: in messages.
        problem: the problem; its data are read at every solve.
        settings: tolerances and limits.
    """

    name: str
    problem: ShootingProblem
    settings: SolverSettings

    def solve(
        self,
        guess: Trajectory | None = None,
        *,
        max_iterations: int | None = None,
        time_limit: float | None = None,
        callback: Callback | None = None,
        throw: bool = False,
    ) -> Solution:
        """Iterate from a guess until the solver's conditions hold.

        Args:
            guess: states and controls to start from (the first state is replaced by the problem's); the first state at
                rest at all nodes unless given.
            max_iterations: most iterations, at least 0; the settings' unless given.
            time_limit: s; checked before each iteration; the settings' unless given.
            callback: called with the progress after every iteration; stops the solve by returning True.
            throw: raise where the solve ends without a solution.

        Raises:
            InputError: a guess of the wrong shape, or negative limits.
            SolverError: no solution, with ``throw``; the message has the remedy and the explanation.
        """
        max_iterations = self.settings.max_iterations if max_iterations is None else max_iterations
        time_limit = self.settings.time_limit_s if time_limit is None else time_limit
        if max_iterations < 0:
            raise InputError("max_iterations", max_iterations, "at least 0")
        if time_limit is not None and not time_limit >= 0.0:
            raise InputError("time_limit", time_limit, "at least 0 s")
        checked = self.problem.check(self.problem.hold() if guess is None else guess)
        # The status and its explanation name what was not finite; numpy's warnings would only add where it was met.
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            solution = self._run(checked, max_iterations, time_limit, callback)
        if throw and not solution.status.solved:
            raise SolverError(self.name, solution.status.name.lower(), solution.explain())
        return solution

    def _run(
        self, guess: Trajectory, max_iterations: int, time_limit: float | None, callback: Callback | None
    ) -> Solution:
        start = time.perf_counter()
        status = self._begin(guess)
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
        """Start from a guess of the right shape; a status if there is nothing to iterate on."""

    @abstractmethod
    def _iterate(self) -> Status | None:
        """Take one iteration; a status if it was the last."""

    @abstractmethod
    def _progress(self, iteration: int, elapsed: float) -> Progress:
        """Where the solve stands."""

    @abstractmethod
    def _finish(self, status: Status, iterations: int, start: float) -> Solution:
        """Put the result together; ``start`` is on the clock of ``time.perf_counter``."""
