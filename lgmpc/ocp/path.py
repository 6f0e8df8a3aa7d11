"""Values of a problem's path constraints over the whole horizon."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from lgmpc.actions import Action
from lgmpc.compile import BatchKernel
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.ocp.shooting import runs_of
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
        runs = runs_of(problem.actions)
        ng = max(action.value_function.size1_out("constraint") for action, _, _ in runs)
        self.values: Array = np.zeros((problem.nodes, ng))
        self.lower: Array = np.full((problem.nodes, ng), -np.inf)
        self.upper: Array = np.full((problem.nodes, ng), np.inf)
        kernels: dict[int, BatchKernel] = {}
        self._calls, self._copies = [], []
        for action, start, stop in runs:
            rows = action.value_function.size1_out("constraint")
            if rows == 0:
                continue
            kernel = kernels.setdefault(id(action), BatchKernel(_path(action, problem.nu), progress))
            k = slice(start, stop)
            found = np.zeros((3, stop - start, rows))
            self._calls.append(
                kernel.bind(
                    stop - start, x=xs[k], u=us[k], p=problem.parameters[k],
                    values=found[0], lower=found[1], upper=found[2],
                )
            )  # fmt: skip
            self._copies.append((k, rows, found))

    def evaluate(self) -> None:
        """Write :attr:`values`, :attr:`lower` and :attr:`upper`."""
        for call in self._calls:
            call()
        for k, rows, found in self._copies:
            self.values[k, :rows], self.lower[k, :rows], self.upper[k, :rows] = found


def _path(action: Action, nu: int) -> ca.Function:
    x, p = ca.SX.sym("x", action.state.nx), ca.SX.sym("p", action.parameters.size)
    u = ca.SX.sym("u", nu)
    _, _, *rows = action.value_function.call([x, u[: action.nu], p])
    names = ["values", "lower", "upper"]
    return ca.Function(f"{action.name}_path_{nu}", [x, u, p], [ca.densify(row) for row in rows], ["x", "u", "p"], names)
