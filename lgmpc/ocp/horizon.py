"""The stages of a problem, evaluated all together: their expansions as rows of values, on the caller's arrays."""

from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from typing import Any, Protocol

import casadi as ca
import numpy as np

from lgmpc.actions import Action
from lgmpc.compile import Pipeline, PipelineStep
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.ocp.quadratic import OcpQpStructure, StoredBlock
from lgmpc.state import State
from lgmpc.typing import Array


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


_MATRICES = "ABCDQRS"

_STAGE = ("A", "B", "b", "Q", "S", "R", "q", "r", "C", "D", "lower", "upper", "cost")
_TERMINAL = ("Q", "q", "cost")


def symbols_of(function: ca.Function) -> list[Any]:
    """Return symbols for the inputs of an action's function: of scalars, or of matrices if it calls Python."""
    return function.sx_in() if function.is_a("SXFunction") else function.mx_in()


def like(function: ca.Function, symbol: Any) -> Any:
    """Return a symbol of the same name and shape, of the kind that a function takes."""
    return symbol if function.is_a("SXFunction") else ca.MX.sym("s", *symbol.shape)


class StageMatrices:
    """The matrices of an action's expansion, with as many controls and rows as the largest action of a problem has.

    A control that the action does not have is fixed at zero by a unit weight; a row that it does not have is zero
    between -1 and 1 (solvers reject rows without bounds).

    Args:
        action: the action.
        nu: number of controls; the action's unless given.
        ng: number of rows; the action's unless given.

    Attributes:
        patterns: of each matrix of :class:`~lgmpc.ocp.OcpQpStructure`.
    """

    def __init__(self, action: Action, nu: int | None = None, ng: int | None = None) -> None:
        self._action = action
        if action.expansion is None:
            function = action.quadratic_function
            self._names, self._inputs = function.name_in(), symbols_of(function)
            found = dict(zip(function.name_out(), function.call(self._inputs), strict=True))
        else:
            columns = action.expansion.columns
            self._names = list(columns)
            self._inputs = [ca.SX.sym(name, *pattern.shape) for name, pattern in columns.items()]
            found = _split(dict(zip(columns, self._inputs, strict=True)), columns, action.state.ndx)
        rows = found["lower"].shape[0]
        self._matrices = _padded(found, action.nu if nu is None else nu, rows if ng is None else ng)
        self.patterns = {name: matrix.sparsity() for name, matrix in self._matrices.items()}

    def packed(self, blocks: Mapping[str, StoredBlock]) -> ca.Function | Pipeline:
        """Return ``(x, u, x_next, p) -> values`` with the entries of all blocks."""
        column = _packed(self._matrices, blocks)
        return self._evaluation(f"values_{column.numel()}", {"values": column})

    def stacked(self) -> ca.Function | Pipeline:
        """Return ``(x, u, x_next, p) -> (jacobian, hessian, gradient, gap, cost)`` over (dx, u), without rows."""
        m = self._matrices
        outputs = {
            "jacobian": ca.horzcat(m["A"], m["B"]),
            "hessian": ca.blockcat([[m["Q"], m["S"].T], [m["S"], m["R"]]]),
            "gradient": ca.vertcat(m["q"], m["r"]),
            "gap": m["b"],
            "cost": m["cost"],
        }
        return self._evaluation(f"expansion_{m['r'].numel()}", outputs)

    def _evaluation(self, kind: str, outputs: Mapping[str, Any]) -> ca.Function | Pipeline:
        """Return the function of the stage with these results, stored whole."""
        name = f"{self._action.name}_{kind}"
        outputs = {key: ca.densify(value) for key, value in outputs.items()}
        if self._action.expansion is None:
            return ca.Function(name, self._inputs, [*outputs.values()], self._names, [*outputs])
        return _pipeline(name, self._action, dict(zip(self._names, self._inputs, strict=True)), outputs)


def _pipeline(name: str, action: Action, symbols: Mapping[str, Any], outputs: Mapping[str, Any]) -> Pipeline:
    """Return the pipeline of an action's expansion in steps, with results of chosen entries.

    Args:
        name: in messages.
        action: with an expansion in steps.
        symbols: of the expansion's columns.
        outputs: matrices whose entries are such symbols, or constants.
    """
    assert action.expansion is not None
    known = {
        entry.element_hash(): (column, i)
        for column, symbol in symbols.items()
        for i, entry in enumerate(ca.vertsplit(ca.vec(symbol)))
    }
    numbers: list[float] = []

    def place(entry: Any) -> tuple[str, int]:
        if not entry.is_constant():
            return known[entry.element_hash()]
        number = float(entry)
        if number not in numbers:
            numbers.append(number)
        return "numbers", numbers.index(number)

    entries = {key: tuple(place(e) for e in ca.vertsplit(ca.vec(v))) for key, v in outputs.items()}
    steps = action.expansion.steps
    if numbers:
        constants = ca.Function(f"numbers_{len(numbers)}", [], [ca.SX(ca.DM(numbers))])
        steps = (*steps, PipelineStep(constants, (), ("numbers",)))
    inputs = {"x": action.state.nx, "u": action.nu, "x_next": action.state.nx, "p": action.parameters.size}
    return Pipeline(name, inputs, steps, entries)


def structure_of(stages: Sequence[StageMatrices], terminal: Action, nodes: int) -> OcpQpStructure:
    """Return the structure of the linear-quadratic problems of stages that have the same numbers of controls and rows.

    Args:
        stages: of the distinct actions of a horizon.
        terminal: the action whose terminal cost applies to the last state.
        nodes: number of intervals.
    """
    last = terminal.terminal_quadratic_function
    blocks, size = _blocks([stage.patterns for stage in stages])
    last_blocks, last_size = _blocks([{name: last.sparsity_out(name) for name in _TERMINAL}])
    (ndx, nu), ng = blocks["B"].shape, blocks["lower"].shape[0]
    return OcpQpStructure(nodes, ndx, nu, ng, blocks, last_blocks, size, last_size)


def pack_terminal(terminal: Action, blocks: Mapping[str, StoredBlock]) -> ca.Function:
    """Return ``(x, p) -> values`` of the terminal cost."""
    function = terminal.terminal_quadratic_function
    inputs = symbols_of(function)
    column = _packed(dict(zip(function.name_out(), function.call(inputs), strict=True)), blocks)
    name = f"{function.name()}_values_{column.numel()}"
    return ca.Function(name, inputs, [column], function.name_in(), ["values"])


def _packed(matrices: Mapping[str, Any], blocks: Mapping[str, StoredBlock]) -> Any:
    """Return the entries of all blocks in one column."""
    entries = [ca.vec(ca.project(matrices[name], block.sparsity()).nz[:]) for name, block in blocks.items()]
    return ca.densify(ca.vertcat(*entries))


def _split(found: Mapping[str, Any], patterns: Mapping[str, ca.Sparsity], ndx: int) -> dict[str, Any]:
    """Return the matrices of a stage from the results of an expansion in steps."""
    m = {name: ca.project(value, patterns[name]) for name, value in found.items()}
    return {
        "A": m["jacobian"][:, :ndx], "B": m["jacobian"][:, ndx:], "b": m["gap"],
        "Q": m["hessian"][:ndx, :ndx], "S": m["hessian"][ndx:, :ndx], "R": m["hessian"][ndx:, ndx:],
        "q": m["gradient"][:ndx], "r": m["gradient"][ndx:], "C": m["rows"][:, :ndx], "D": m["rows"][:, ndx:],
        "lower": m["lower"], "upper": m["upper"], "cost": m["cost"],
    }  # fmt: skip


def _padded(m: dict[str, Any], nu: int, ng: int) -> dict[str, Any]:
    ndx, own, rows = m["A"].shape[0], m["r"].shape[0], m["lower"].shape[0]
    more_u, more_g = nu - own, ng - rows
    m["B"] = ca.horzcat(m["B"], ca.DM(ndx, more_u))
    m["S"] = ca.vertcat(m["S"], ca.DM(more_u, ndx))
    m["R"] = ca.diagcat(m["R"], ca.DM.eye(more_u)) if more_u else m["R"]
    m["r"] = ca.vertcat(m["r"], ca.DM.zeros(more_u))
    m["C"] = ca.vertcat(ca.reshape(m["C"], rows, ndx), ca.DM(more_g, ndx))
    m["D"] = ca.diagcat(ca.reshape(m["D"], rows, own), ca.DM(more_g, more_u))
    m["lower"] = ca.vertcat(m["lower"], -ca.DM.ones(more_g))
    m["upper"] = ca.vertcat(m["upper"], ca.DM.ones(more_g))
    return {name: m[name] for name in _STAGE}


def _blocks(patterns: Sequence[Mapping[str, ca.Sparsity]]) -> tuple[dict[str, StoredBlock], int]:
    """Return each block's stored entries, all that are not structurally zero in one of the patterns, and their number.

    Vectors are stored whole, so that they can be viewed as arrays.
    """
    blocks: dict[str, StoredBlock] = {}
    start = 0
    for name, first in patterns[0].items():
        pattern = first
        for other in patterns[1:]:
            pattern = pattern + other[name]
        if name not in _MATRICES:
            pattern = ca.Sparsity.dense(*pattern.shape)
        rows, columns = (np.array(index, dtype=np.int64) for index in pattern.get_triplet())
        blocks[name] = StoredBlock(pattern.shape, rows, columns, slice(start, start + rows.size))
        start += rows.size
    return blocks, start
