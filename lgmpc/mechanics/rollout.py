"""Classical Runge-Kutta on expressions, and roll-outs of a compiled step, thousands of steps in a call."""

from __future__ import annotations

import math
from collections.abc import Callable
from numbers import Integral
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.compile import StageKernel
from lgmpc.errors import InputError, SolverError
from lgmpc.typing import Array

__all__ = ["Rollout", "check_grid", "runge_kutta4"]

CHUNK = 4096
"""Least number of steps in a call."""


def runge_kutta4(field: Callable[[Any, Any], Any], y: Any, h: Any) -> Any:
    """Return ``y`` after one classical Runge-Kutta step of length ``h`` along ``y' = field(elapsed, y)``."""
    k1 = field(0.0, y)
    k2 = field(h / 2, y + h / 2 * k1)
    k3 = field(h / 2, y + h / 2 * k2)
    k4 = field(h, y + h * k3)
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def check_grid(step: float, steps: int, every: int) -> None:
    """Check the length and the counts of steps.

    Raises:
        InputError: a step that is not positive and finite, a number of steps that is not whole and positive, or an
            ``every`` that does not divide it.
    """
    if not (math.isfinite(step) and step > 0.0):
        raise InputError("step", step, "a positive length of time, s")
    if not isinstance(steps, Integral) or steps < 1:
        raise InputError("steps", steps, "a whole number, at least one")
    if not isinstance(every, Integral) or every < 1 or steps % every:
        raise InputError("every", every, f"a divisor of the number of steps, {steps}")


class Rollout:
    """A compiled step of an integrator, for repeated evaluation.

    Args:
        function: inputs ``time`` (1), ``step`` (1), ``x`` (n), ``p`` (m); output ``x_next`` (n).
    """

    def __init__(self, function: ca.Function) -> None:
        self._kernel = StageKernel(function)
        self.name = function.name()

    def __call__(
        self, start: Array, step: float, steps: int, every: int, parameters: Array, begin: float = 0.0
    ) -> tuple[Array, Array]:
        """Return the times (rows,) and the states (rows, n) of every ``every``-th step, the first included.

        Args:
            start: (n,) state at ``begin``.
            step: length of a step, s.
            steps: their number.
            every: number of steps between two returned rows; divides ``steps``.
            parameters: (m,) of the function.
            begin: time of the start, s.

        Raises:
            InputError: as :func:`check_grid`.
            SolverError: the state did not stay finite.
        """
        check_grid(step, steps, every)
        rows = np.empty((steps // every + 1, start.size))
        rows[0] = start
        chunk = min(steps, every * max(1, CHUNK // every))
        block, times = np.empty((chunk + 1, start.size)), np.empty((chunk, 1))
        block[0] = start
        done = 0
        while done < steps:
            count = min(chunk, steps - done)
            times[:count, 0] = begin + step * np.arange(done, done + count)
            call = self._kernel.bind(
                count, time=times, step=np.array([step]), x=block[:-1], p=parameters, x_next=block[1:]
            )
            call()
            rows[done // every + 1 : (done + count) // every + 1] = block[every : count + 1 : every]
            block[0] = block[count]
            done += count
        if not np.isfinite(rows[-1]).all():
            raise SolverError(self.name, "the state did not stay finite", "Take a shorter step")
        stored: Array = begin + step * every * np.arange(len(rows), dtype=np.float64)
        return stored, rows
