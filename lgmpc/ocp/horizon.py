"""The stages of a problem, evaluated all together: kernels of its actions on the caller's arrays.

Every distinct action is compiled once, for any horizon and any position in it; consecutive nodes of the same action are
one call, a loop in C.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from typing import Protocol

import casadi as ca

from lgmpc.actions import Action
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.state import State
from lgmpc.typing import Array

__all__ = ["Stages", "advance", "bind_intervals", "bind_last", "difference", "distinct", "retraction", "runs_of"]


class Stages(Protocol):
    """Evaluates stages of one action, for instance a :class:`~lgmpc.compile.StageKernel`."""

    def bind(self, stages: int, **memory: Array) -> Callable[[], int]:
        """Return the call that evaluates all stages on this memory; it returns 0."""


def runs_of(actions: Sequence[Action]) -> list[tuple[Action, int, int]]:
    """Return the runs of nodes of the same action: (action, first node, node after the last)."""
    runs, start = [], 0
    for _, group in groupby(actions, key=id):
        length = len(list(group))
        runs.append((actions[start], start, start + length))
        start += length
    return runs


def distinct(problem: ShootingProblem) -> tuple[Action, ...]:
    """Return the actions of a problem's intervals, each object once."""
    return tuple({id(action): action for action in problem.actions}.values())


def bind_intervals(
    problem: ShootingProblem, stages: Sequence[Stages | None], **memory: Array
) -> list[Callable[[], int]]:
    """Return the calls that evaluate all intervals in order.

    Args:
        problem: its actions select the stages of each node; its parameters are the argument ``p``.
        stages: of each of the :func:`distinct` actions; None evaluates nothing.
        memory: all other arguments and results, (N, ...) or with more rows; (n,) if all nodes share it.
    """
    kernels = dict(zip(map(id, distinct(problem)), stages, strict=True))
    calls = []
    for action, start, stop in runs_of(problem.actions):
        kernel = kernels[id(action)]
        if kernel is not None:
            rows = {name: _rows(array, start, stop) for name, array in memory.items()}
            call = kernel.bind(stop - start, p=problem.parameters[start:stop], **rows)
            calls.append(action.guarded(call, start))
    return calls


def bind_last(problem: ShootingProblem, stages: Stages, **memory: Array) -> Callable[[], int]:
    """Return the call that evaluates the terminal cost; ``memory`` is as of :func:`bind_intervals`, with one row."""
    call = stages.bind(1, p=problem.parameters[problem.nodes :], **memory)
    return problem.terminal.guarded(call, problem.nodes)


def retraction(state: State) -> ca.Function:
    """Return ``(x, dx) -> x_next``, ``x (+) dx``."""
    x, dx = ca.SX.sym("x", state.nx), ca.SX.sym("dx", state.ndx)
    return ca.Function("retraction", [x, dx], [state.integrate_symbolic(x, dx)], ["x", "dx"], ["x_next"])


def difference(state: State) -> ca.Function:
    """Return ``(x0, x1) -> dx``, ``x1 (-) x0``."""
    x0, x1 = ca.SX.sym("x0", state.nx), ca.SX.sym("x1", state.nx)
    return ca.Function("difference", [x0, x1], [state.diff_symbolic(x0, x1)], ["x0", "x1"], ["dx"])


def advance(state: State) -> ca.Function:
    """Return ``(x, x_next, fraction) -> moved``, the state at a fraction of the way from one to the next."""
    x, x_next, fraction = ca.SX.sym("x", state.nx), ca.SX.sym("x_next", state.nx), ca.SX.sym("fraction")
    moved = state.integrate_symbolic(x, fraction * state.diff_symbolic(x, x_next))
    return ca.Function("advance", [x, x_next, fraction], [moved], ["x", "x_next", "fraction"], ["moved"])


def _rows(array: Array, start: int, stop: int) -> Array:
    """Return the rows of some stages, a matrix's entries in a row; an array that all stages share as it is."""
    part = array if array.ndim == 1 else array[start:stop]
    return part.reshape(len(part), -1) if part.ndim > 2 else part
