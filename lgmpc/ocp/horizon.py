"""A problem's compiled functions over the whole horizon, one call for all stages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from lgmpc.actions import Action
from lgmpc.compile import BatchKernel, CompiledFunction, compile_functions, recall
from lgmpc.ocp.packing import StageMatrices, pack_terminal, structure_of
from lgmpc.ocp.python_stages import watched
from lgmpc.ocp.quadratic import OcpQp, OcpQpStructure, kkt_function
from lgmpc.typing import Array

__all__ = ["HorizonFunctions"]


class HorizonFunctions:
    """The functions of one action over N intervals, compiled (or interpreted where there is no compiler).

    The linearisation works on rows of arrays of its own; the others take and return one column a stage.

    Args:
        action: the interval.
        nodes: N.
        progress: called with a description of what is being compiled.

    Attributes:
        structure: of the linear-quadratic problem.
        xs: (N+1, nx) point of expansion.
        us: (N, nu).
        parameters: (N+1, np).
        qp: the linear-quadratic problem around it, as :meth:`linearize` wrote it.
        compiled: whether the functions are machine code.
        kkt: see :func:`lgmpc.ocp.quadratic.kkt_function`.
        retract: ``(xs (nx, N+1), dxs (ndx, N+1)) -> xs (+) dxs``.
        advance: ``(xs (nx, N+1), fraction) -> xs`` interpolated at a fraction of an interval from each node to the
            next; the last state stays.
        difference: ``(x0 (nx,), x1 (nx,)) -> x1 (-) x0``.
    """

    def __init__(self, action: Action, nodes: int, progress: Callable[[str], None] | None = None) -> None:
        kernels = recall(_compile, action, nodes, progress=progress)
        self.structure = kernels.structure
        self.qp = OcpQp(self.structure)
        self.xs: Array = np.zeros((nodes + 1, action.state.nx))
        self.us: Array = np.zeros((nodes, action.nu))
        self.parameters: Array = np.zeros((nodes + 1, action.parameters.size))
        self.compiled = kernels.stage.compiled
        stages = kernels.stage.bind(
            nodes, x=self.xs, u=self.us, x_next=self.xs[1:], p=self.parameters, values=self.qp.values
        )
        last = kernels.terminal.bind(
            1, x=self.xs[nodes:], p=self.parameters[nodes:], values=self.qp.terminal_values.reshape(1, -1)
        )
        self._stages, self._terminal = watched(stages, action, 0), watched(last, action, nodes)
        self.kkt, self.retract, self.advance, self.difference = kernels.functions

    def linearize(self) -> None:
        """Write the linear-quadratic problem around (xs, us)."""
        self._stages()
        self._terminal()


@dataclass(frozen=True)
class _Compiled:
    structure: OcpQpStructure
    stage: BatchKernel
    terminal: BatchKernel
    functions: tuple[CompiledFunction, CompiledFunction, CompiledFunction, CompiledFunction]


def _compile(action: Action, nodes: int, progress: Callable[[str], None] | None) -> _Compiled:
    matrices = StageMatrices(action)
    structure = structure_of([matrices], action, nodes)
    stage = BatchKernel(matrices.packed(structure.blocks), progress)
    terminal = BatchKernel(pack_terminal(action, structure.terminal_blocks), progress)
    functions = (
        kkt_function(structure, action.name),
        _retract(action, nodes),
        _advance(action, nodes),
        _difference(action),
    )
    kkt, retract, advance, difference = compile_functions(functions, progress=progress)
    return _Compiled(structure, stage, terminal, (kkt, retract, advance, difference))


def _retract(action: Action, nodes: int) -> ca.Function:
    state = action.state
    x, dx = ca.SX.sym("x", state.nx), ca.SX.sym("dx", state.ndx)
    stage = ca.Function(f"{action.name}_integrate", [x, dx], [state.integrate_symbolic(x, dx)])
    xs, dxs = ca.MX.sym("xs", state.nx, nodes + 1), ca.MX.sym("dxs", state.ndx, nodes + 1)
    return ca.Function(
        f"{action.name}_retract_{nodes}", [xs, dxs], [stage.map(nodes + 1)(xs, dxs)], ["xs", "dxs"], ["xs_next"]
    )


def _advance(action: Action, nodes: int) -> ca.Function:
    state = action.state
    x, x_next, fraction = ca.SX.sym("x", state.nx), ca.SX.sym("x_next", state.nx), ca.SX.sym("fraction")
    moved = state.integrate_symbolic(x, fraction * state.diff_symbolic(x, x_next))
    stage = ca.Function(f"{action.name}_move", [x, x_next, fraction], [moved])
    xs, s = ca.MX.sym("xs", state.nx, nodes + 1), ca.MX.sym("fraction")
    ahead = stage.map(nodes)(xs[:, :nodes], xs[:, 1:], ca.repmat(s, 1, nodes))
    return ca.Function(
        f"{action.name}_advance_{nodes}", [xs, s], [ca.horzcat(ahead, xs[:, nodes])], ["xs", "fraction"], ["xs_next"]
    )


def _difference(action: Action) -> ca.Function:
    x0, x1 = ca.SX.sym("x0", action.state.nx), ca.SX.sym("x1", action.state.nx)
    return ca.Function(
        f"{action.name}_difference", [x0, x1], [action.state.diff_symbolic(x0, x1)], ["x0", "x1"], ["dx"]
    )
