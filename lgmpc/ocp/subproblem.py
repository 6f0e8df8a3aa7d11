"""The linear-quadratic subproblems of a problem whose intervals may differ, written straight into solvers' buffers.

All intervals share one pattern, the union of their actions'. A control that an action does not have is held at zero by
a unit weight, a row that it does not have is zero, between -1 and 1 (solvers complain about rows without bounds).
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from lgmpc.actions import Action, NumericContactAction
from lgmpc.compile import StageKernel
from lgmpc.ocp.pinocchio_stages import NumericSubproblem
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.ocp.quadratic import Block, OcpQp, OcpQpStructure
from lgmpc.ocp.shooting import runs_of
from lgmpc.typing import Array

__all__ = ["SubproblemFunctions"]

_STAGE = ("A", "B", "b", "Q", "S", "R", "q", "r", "C", "D", "lower", "upper", "cost")
_TERMINAL = ("Q", "q", "cost")
_MATRICES = "ABCDQRS"


class SubproblemFunctions:
    """Expansion of one :class:`~lgmpc.ocp.ShootingProblem` as an :class:`~lgmpc.ocp.OcpQp`, on arrays of its own.

    Args:
        problem: the problem.
        progress: called with a description of what is being compiled.

    Attributes:
        qp: the subproblem around (xs, us), as :meth:`linearize` wrote it.
        xs: (N+1, nx) point of expansion.
        us: (N, nu).
        xs_base: (N+1, nx) where :meth:`retract` starts.
        dxs: (N+1, ndx) what it adds.
    """

    def __init__(self, problem: ShootingProblem, progress: Callable[[str], None] | None = None) -> None:
        n, state, nu = problem.nodes, problem.state, problem.nu
        runs = runs_of(problem.actions)
        ng = max(action.value_function.size1_out("constraint") for action, _, _ in runs)
        padded = {id(action): _padded(action, nu, ng) for action, _, _ in runs}
        last = problem.terminal.terminal_quadratic_function
        blocks, size = _union(list(padded.values()), _STAGE)
        last_blocks, last_size = _union([last], _TERMINAL)
        structure = OcpQpStructure(n, state.ndx, nu, ng, blocks, last_blocks, size, last_size)
        self.qp = OcpQp(structure)
        self.xs: Array = np.tile(problem.x0, (n + 1, 1))
        self.us: Array = np.zeros((n, nu))
        self.xs_base: Array = self.xs.copy()
        self.dxs: Array = np.zeros((n + 1, state.ndx))
        kernels = {
            id(action): NumericSubproblem(action, blocks)
            if isinstance(action, NumericContactAction)
            else StageKernel(_packed(padded[id(action)], blocks), progress)
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
        terminal = StageKernel(_packed(last, last_blocks), progress)
        calls.append(
            terminal.bind(1, x=self.xs[n:], p=problem.parameters[n:], values=self.qp.terminal_values.reshape(1, -1))
        )
        x, dx = ca.SX.sym("x", state.nx), ca.SX.sym("dx", state.ndx)
        moved = [state.integrate_symbolic(x, dx)]
        retract = StageKernel(
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


def _padded(action: Action, nu: int, ng: int) -> ca.Function:
    """The action's expansion with ``nu`` controls and ``ng`` rows."""
    function = action.quadratic_function
    inputs = function.sx_in()
    m = dict(zip(function.name_out(), function.call(inputs), strict=True))
    rows, more_u, more_g = m["lower"].shape[0], nu - action.nu, ng - m["lower"].shape[0]
    ndx = action.state.ndx
    m["B"] = ca.horzcat(m["B"], ca.SX(ndx, more_u))
    m["S"] = ca.vertcat(m["S"], ca.SX(more_u, ndx))
    m["R"] = ca.diagcat(m["R"], ca.SX.eye(more_u)) if more_u else m["R"]
    m["r"] = ca.vertcat(m["r"], ca.SX.zeros(more_u))
    m["C"] = ca.vertcat(ca.reshape(m["C"], rows, ndx), ca.SX(more_g, ndx))
    m["D"] = ca.diagcat(ca.reshape(m["D"], rows, action.nu), ca.SX(more_g, more_u))
    m["lower"] = ca.vertcat(m["lower"], -ca.SX.ones(more_g))
    m["upper"] = ca.vertcat(m["upper"], ca.SX.ones(more_g))
    return ca.Function(f"{action.name}_{nu}x{ng}", inputs, [m[k] for k in _STAGE], function.name_in(), list(_STAGE))


def _union(functions: list[ca.Function], names: tuple[str, ...]) -> tuple[dict[str, Block], int]:
    """Where each block's entries are stored: all that are not structurally zero in one of the functions."""
    blocks: dict[str, Block] = {}
    start = 0
    for name in names:
        pattern = functions[0].sparsity_out(name)
        for function in functions[1:]:
            pattern = pattern + function.sparsity_out(name)
        if name not in _MATRICES:
            pattern = ca.Sparsity.dense(*pattern.shape)
        rows, columns = (np.array(index, dtype=np.int64) for index in pattern.get_triplet())
        blocks[name] = Block(pattern.shape, rows, columns, slice(start, start + rows.size))
        start += rows.size
    return blocks, start


def _packed(function: ca.Function, blocks: dict[str, Block]) -> ca.Function:
    """The function with all stored entries in one column."""
    inputs = function.sx_in()
    outputs = dict(zip(function.name_out(), function.call(inputs), strict=True))
    entries = [ca.vec(ca.project(outputs[name], block.sparsity()).nz[:]) for name, block in blocks.items()]
    column = ca.densify(ca.vertcat(*entries))
    return ca.Function(f"{function.name()}_values_{column.numel()}", inputs, [column], function.name_in(), ["values"])
