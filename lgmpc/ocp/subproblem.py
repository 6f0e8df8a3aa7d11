"""The linear-quadratic subproblems of a problem whose intervals may differ, written into solvers' buffers.

All intervals share one pattern, the union of their actions'. A control that an action does not have is fixed at zero
by a unit weight; a row that it does not have is zero between -1 and 1 (solvers reject rows without bounds).
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from lgmpc.actions import NumericContactAction
from lgmpc.compile import BatchKernel
from lgmpc.ocp.packing import StageMatrices, pack_terminal, structure_of
from lgmpc.ocp.pinocchio_stages import NumericSubproblem
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.ocp.quadratic import OcpQp
from lgmpc.ocp.shooting import runs_of
from lgmpc.typing import Array

__all__ = ["SubproblemFunctions"]


class SubproblemFunctions:
    """Expansion of one :class:`~lgmpc.ocp.ShootingProblem` as an :class:`~lgmpc.ocp.OcpQp`, on arrays of its own.

    Args:
        problem: the problem.
        progress: called with a description of what is being compiled.

    Attributes:
        qp: the subproblem around (xs, us), written by :meth:`linearize`.
        xs: (N+1, nx) point of expansion.
        us: (N, nu).
        xs_base: (N+1, nx) base points of :meth:`retract`.
        dxs: (N+1, ndx) its tangent vectors.
    """

    def __init__(self, problem: ShootingProblem, progress: Callable[[str], None] | None = None) -> None:
        n, state, nu = problem.nodes, problem.state, problem.nu
        runs = runs_of(problem.actions)
        ng = max(action.value_function.size1_out("constraint") for action, _, _ in runs)
        matrices = {id(action): StageMatrices(action, nu, ng) for action, _, _ in runs}
        structure = structure_of(list(matrices.values()), problem.terminal, n)
        blocks = structure.blocks
        self.qp = OcpQp(structure)
        self.xs: Array = np.tile(problem.x0, (n + 1, 1))
        self.us: Array = np.zeros((n, nu))
        self.xs_base: Array = self.xs.copy()
        self.dxs: Array = np.zeros((n + 1, state.ndx))
        kernels = {
            id(action): NumericSubproblem(action, blocks)
            if isinstance(action, NumericContactAction)
            else BatchKernel(matrices[id(action)].packed(blocks), progress)
            for action, _, _ in runs
        }
        calls = []
        for action, start, stop in runs:
            k, behind = slice(start, stop), slice(start + 1, stop + 1)
            calls.append(
                kernels[id(action)].bind(
                    stop - start, x=self.xs[k], u=self.us[k], x_next=self.xs[behind], p=problem.parameters[k],
                    values=self.qp.values[k],
                )
            )  # fmt: skip
        terminal = BatchKernel(pack_terminal(problem.terminal, structure.terminal_blocks), progress)
        calls.append(
            terminal.bind(1, x=self.xs[n:], p=problem.parameters[n:], values=self.qp.terminal_values.reshape(1, -1))
        )
        x, dx = ca.SX.sym("x", state.nx), ca.SX.sym("dx", state.ndx)
        moved = [state.integrate_symbolic(x, dx)]
        retract = BatchKernel(
            ca.Function(f"{problem.terminal.name}_add", [x, dx], moved, ["x", "dx"], ["x_next"]), progress
        )
        self._calls = tuple(calls)
        self._retract = retract.bind(n + 1, x=self.xs_base, dx=self.dxs, x_next=self.xs)

    def linearize(self) -> None:
        """Write the subproblem around (xs, us)."""
        for call in self._calls:
            call()

    def retract(self) -> None:
        """Write ``xs = xs_base (+) dxs``."""
        self._retract()
