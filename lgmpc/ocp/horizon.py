"""A problem's compiled functions over the whole horizon: what solvers call, one call for all stages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from lgmpc.actions import Action
from lgmpc.compile import CompiledFunction, compile_functions
from lgmpc.ocp.quadratic import OcpQpStructure, kkt_function

__all__ = ["HorizonFunctions"]


class HorizonFunctions:
    """The functions of one action over N intervals, compiled (or interpreted where there is no compiler).

    All take and return one column a stage.

    Args:
        action: the interval.
        nodes: N.
        progress: called with a description of what is being compiled.

    Attributes:
        structure: of the linear-quadratic problem.
        linearize: ``(xs (nx, N+1), us (nu, N), parameters (np, N+1)) -> (values (size, N), terminal_values)``.
        kkt: see :func:`lgmpc.ocp.quadratic.kkt_function`.
        retract: ``(xs (nx, N+1), dxs (ndx, N+1)) -> xs (+) dxs``.
        advance: ``(xs (nx, N+1), fraction) -> xs`` moved ahead by a fraction of an interval along the line from each
            node to the next; the last state stays.
        difference: ``(x0 (nx,), x1 (nx,)) -> x1 (-) x0``.
    """

    def __init__(self, action: Action, nodes: int, progress: Callable[[str], None] | None = None) -> None:
        self.structure = OcpQpStructure.of(action, nodes)
        functions = [
            _linearize(action, self.structure),
            kkt_function(self.structure, action.name),
            _retract(action, nodes),
            _advance(action, nodes),
            _difference(action),
        ]
        compiled = compile_functions(functions, progress=progress)
        self.linearize: CompiledFunction = compiled[0]
        self.kkt: CompiledFunction = compiled[1]
        self.retract: CompiledFunction = compiled[2]
        self.advance: CompiledFunction = compiled[3]
        self.difference: CompiledFunction = compiled[4]


def _linearize(action: Action, structure: OcpQpStructure) -> ca.Function:
    n = structure.nodes
    stage = _packed(action.quadratic_function, structure.blocks)
    terminal = _packed(action.terminal_quadratic_function, structure.terminal_blocks)
    xs, us = ca.MX.sym("xs", action.state.nx, n + 1), ca.MX.sym("us", action.nu, n)
    parameters = ca.MX.sym("parameters", action.parameters.size, n + 1)
    values = stage.map(n)(xs[:, :n], us, xs[:, 1:], parameters[:, :n])
    terminal_values = terminal(xs[:, n], parameters[:, n])
    return ca.Function(
        f"{action.name}_linearize_{n}",
        [xs, us, parameters],
        [values, terminal_values],
        ["xs", "us", "parameters"],
        ["values", "terminal_values"],
    )


def _packed(function: ca.Function, blocks: dict[str, Any]) -> ca.Function:
    """Return the function with all outputs' stored entries in one column."""
    inputs = function.sx_in()
    outputs = dict(zip(function.name_out(), function.call(inputs), strict=True))
    entries = [ca.vec(ca.project(outputs[name], block.sparsity()).nz[:]) for name, block in blocks.items()]
    return ca.Function(f"{function.name()}_packed", inputs, [ca.densify(ca.vertcat(*entries))])


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
