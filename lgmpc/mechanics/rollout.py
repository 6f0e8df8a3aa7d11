"""Classical Runge-Kutta on expressions, and roll-outs of a compiled step, thousands of steps in a call."""

from __future__ import annotations

import math
from collections.abc import Callable
from numbers import Integral
from typing import Any

import numpy as np

from lgmpc.compile import StageKernel
from lgmpc.errors import InputError, SolverError
from lgmpc.typing import Array

__all__ = ["rollout", "runge_kutta4"]


def runge_kutta4(field: Callable[[Any, Any], Any], y: Any, h: Any) -> Any:
    """Return ``y`` after one classical Runge-Kutta step of length ``h`` along ``y' = field(elapsed, y)``."""
    k1 = field(0.0, y)
    k2 = field(h / 2, y + h / 2 * k1)
    k3 = field(h / 2, y + h / 2 * k2)
    k4 = field(h, y + h * k3)
    return y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def rollout(
    kernel: StageKernel, start: Array, step: float, steps: int, every: int, parameters: Array
) -> tuple[Array, Array]:
    """Return times (rows,) and states (rows, n) of an integrator at every ``every``-th step, the first included.

    Args:
        kernel: inputs ``time`` (1), ``step`` (1), ``x`` (n), ``p`` (m); output ``x_next`` (n).
        start: (n,) state at time 0.
        step: length of a step, s.
        steps: their number.
        every: number of steps between two returned rows; divides ``steps``.
        parameters: (m,) of the kernel.

    Raises:
        InputError: a step that is not positive and finite, a number of steps that is not whole and positive, or an
            ``every`` that does not divide it.
        SolverError: the state did not stay finite.
    """
    if not (math.isfinite(step) and step > 0.0):
        raise InputError("step", step, "a positive length of time, s")
    if not isinstance(steps, Integral) or steps < 1:
        raise InputError("steps", steps, "a whole number, at least one")
    if not isinstance(every, Integral) or every < 1 or steps % every:
        raise InputError("every", every, f"a divisor of the number of steps, {steps}")
    states, times = np.empty((steps + 1, start.size)), step * np.arange(steps + 1, dtype=np.float64)
    states[0] = start
    kernel.bind(steps, time=times[:-1, None], step=np.array([step]), x=states[:-1], p=parameters, x_next=states[1:])()
    if not np.isfinite(states[-1]).all():
        raise SolverError("simulate", "the state did not stay finite", "Take a shorter step")
    return times[::every], states[::every].copy()
