"""The linear-quadratic subproblems of a problem whose intervals may differ, written into solvers' buffers.

All intervals share one pattern, the union of their actions'. A control that an action does not have is fixed at zero
by a unit weight; a row that it does not have is zero between -1 and 1 (solvers reject rows without bounds).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lgmpc.actions import Action
from lgmpc.compile import BatchKernel, cached
from lgmpc.ocp.horizon import bind_intervals, bind_last, distinct, retraction
from lgmpc.ocp.packing import StageMatrices, pack_terminal, structure_of
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.ocp.quadratic import OcpQp, OcpQpStructure
from lgmpc.ocp.trajectory_functions import LagrangianHessians
from lgmpc.typing import Array

__all__ = ["SubproblemFunctions"]


class SubproblemFunctions:
    """Expansion of one :class:`~lgmpc.ocp.ShootingProblem` as an :class:`~lgmpc.ocp.OcpQp`, on arrays of its own.

    Args:
        problem: the problem.
        progress: called with a description of what is being compiled.
        exact: whether exact Hessians of the Lagrangian are available: the blocks Q, S and R then have no structural
            zeros.

    Attributes:
        compiled: whether it is machine code.
        qp: the subproblem around (xs, us), written by :meth:`linearize`.
        xs: (N+1, nx) point of expansion.
        us: (N, nu).
        xs_base: (N+1, nx) base points of :meth:`retract`.
        dxs: (N+1, ndx) its tangent vectors.
        lagrangian: exact Hessians at (xs, us); None unless ``exact``.
    """

    def __init__(
        self, problem: ShootingProblem, progress: Callable[[str], None] | None = None, *, exact: bool = False
    ) -> None:
        n, state, nu = problem.nodes, problem.state, problem.nu
        actions = distinct(problem)
        structure, kernels, terminal, retract = cached(
            _compile, actions, problem.terminal, n, nu, "QRS" if exact else "", progress=progress
        )
        self.qp = OcpQp(structure)
        self.xs: Array = np.tile(problem.x0, (n + 1, 1))
        self.us: Array = np.zeros((n, nu))
        self.xs_base: Array = self.xs.copy()
        self.dxs: Array = np.zeros((n + 1, state.ndx))
        last = self.qp.terminal_values.reshape(1, -1)
        self._calls = (
            *bind_intervals(problem, kernels, x=self.xs, u=self.us, x_next=self.xs[1:], values=self.qp.values),
            bind_last(problem, terminal, x=self.xs[n:], values=last),
        )
        self.lagrangian = LagrangianHessians(problem, self.xs, self.us, progress) if exact else None
        self._retract = retract.bind(n + 1, x=self.xs_base, dx=self.dxs, x_next=self.xs)
        self.compiled = retract.compiled

    def linearize(self) -> None:
        """Write the subproblem around (xs, us)."""
        for call in self._calls:
            call()

    def set_exact_hessians(self, costates: Array, multipliers: Array) -> None:
        """Write the Lagrangian's exact Hessians into the subproblem, in place of Gauss-Newton's.

        Args:
            costates: (N, ndx) of the dynamics.
            multipliers: (N, ng) of the path constraints.
        """
        exact, qp, ndx = self.lagrangian, self.qp, self.qp.structure.ndx
        assert exact is not None
        exact.costates[...] = costates
        exact.multipliers[...] = multipliers
        exact.evaluate()
        of_states, of_controls = exact.hessian[:, :ndx, :ndx], exact.hessian[:, ndx:]
        parts = {"Q": of_states, "S": of_controls[:, :, :ndx], "R": of_controls[:, :, ndx:]}
        for name, part in parts.items():
            block = qp.structure.blocks[name]
            qp.values[:, block.where] = part[:, block.rows, block.columns]
        last = qp.structure.terminal_blocks["Q"]
        qp.terminal_values[last.where] = exact.last_hessian[last.rows, last.columns]

    def retract(self) -> None:
        """Write ``xs = xs_base (+) dxs``."""
        self._retract()


def _compile(
    actions: tuple[Action, ...],
    last: Action,
    nodes: int,
    nu: int,
    full: str,
    progress: Callable[[str], None] | None,
) -> tuple[OcpQpStructure, tuple[BatchKernel, ...], BatchKernel, BatchKernel]:
    """Return the structure and the kernels of actions, terminal cost, retraction."""
    ng = max(action.value_function.size1_out("constraint") for action in actions)
    matrices = [StageMatrices(action, nu, ng) for action in actions]
    structure = structure_of(matrices, last, nodes, full=full)
    kernels = tuple(BatchKernel(stage.packed(structure.blocks), progress) for stage in matrices)
    terminal = BatchKernel(pack_terminal(last, structure.terminal_blocks), progress)
    return structure, kernels, terminal, BatchKernel(retraction(last.state), progress)
