"""Values of a problem's path constraints over the whole horizon."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from lgmpc.actions import Action
from lgmpc.compile import BatchKernel, cached
from lgmpc.ocp.horizon import bind_intervals, distinct
from lgmpc.ocp.packing import like, symbols_of
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.typing import Array

__all__ = ["PathFunctions"]


class PathFunctions:
    """Path constraints of one :class:`~lgmpc.ocp.ShootingProblem` at a trajectory of the caller's.

    Args:
        problem: the problem.
        xs: (N+1, nx) states, read by every call.
        us: (N, nu) controls.
        progress: called with a description of what is being compiled.

    Attributes:
        values: (N, ng) of the rows; 0 for rows that a node's action does not have.
        lower: (N, ng) bounds; minus infinity for such rows.
        upper: (N, ng); infinity for such rows.
    """

    def __init__(
        self, problem: ShootingProblem, xs: Array, us: Array, progress: Callable[[str], None] | None = None
    ) -> None:
        kernels = cached(_compile, distinct(problem), problem.nu, progress=progress)
        ng = max(0 if kernel is None else kernel.output_sizes["values"] for kernel in kernels)
        self.values: Array = np.zeros((problem.nodes, ng))
        self.lower: Array = np.full((problem.nodes, ng), -np.inf)
        self.upper: Array = np.full((problem.nodes, ng), np.inf)
        results = {"values": self.values, "lower": self.lower, "upper": self.upper}
        self._calls = bind_intervals(problem, kernels, x=xs, u=us, **results)

    def evaluate(self) -> None:
        """Write :attr:`values`, :attr:`lower` and :attr:`upper`."""
        for call in self._calls:
            call()


def _compile(
    actions: tuple[Action, ...], nu: int, progress: Callable[[str], None] | None
) -> tuple[BatchKernel | None, ...]:
    """Return the kernel of each action; None of those without path constraints."""
    return tuple(
        BatchKernel(_path(action, nu), progress) if action.value_function.numel_out("constraint") else None
        for action in actions
    )


def _path(action: Action, nu: int) -> ca.Function:
    x, _, p = symbols_of(action.value_function)
    u = like(action.value_function, ca.SX.sym("u", nu))
    _, _, *rows = action.value_function.call([x, u[: action.nu], p])
    names = ["values", "lower", "upper"]
    return ca.Function(f"{action.name}_path_{nu}", [x, u, p], [ca.densify(row) for row in rows], ["x", "u", "p"], names)
