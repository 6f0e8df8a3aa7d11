"""Functions of a problem over the whole horizon: quadratic subproblems, path constraints."""

import casadi as ca
import numpy as np

from lgmpc.actions import Action
from lgmpc.compile import BatchKernel, cached
from lgmpc.ocp import horizon
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.ocp.quadratic import OcpQp, OcpQpStructure
from lgmpc.typing import Array


class SubproblemFunctions:
    """Expansion of one :class:`~lgmpc.ocp.ShootingProblem` as an :class:`~lgmpc.ocp.OcpQp`, on arrays of its own.

    Args:
        problem: the problem.

    Attributes:
        compiled: whether it is machine code.
        qp: the subproblem around (xs, us), written by :meth:`linearize`.
        xs: (N+1, nx) point of expansion.
        us: (N, nu).
        xs_base: (N+1, nx) base points of :meth:`retract`.
        dxs: (N+1, ndx) its tangent vectors.
    """

    def __init__(self, problem: ShootingProblem) -> None:
        n, state, nu = problem.nodes, problem.state, problem.nu
        actions = horizon.distinct(problem)
        structure, kernels, terminal, retract = cached(_compile, actions, problem.terminal, n, nu)
        self.qp = OcpQp(structure)
        self.xs: Array = np.tile(problem.x0, (n + 1, 1))
        self.us: Array = np.zeros((n, nu))
        self.xs_base: Array = self.xs.copy()
        self.dxs: Array = np.zeros((n + 1, state.ndx))
        last = self.qp.terminal_values.reshape(1, -1)
        self._calls = (
            *horizon.bind_intervals(problem, kernels, x=self.xs, u=self.us, x_next=self.xs[1:], values=self.qp.values),
            horizon.bind_last(problem, terminal, x=self.xs[n:], values=last),
        )
        self._retract = retract.bind(n + 1, x=self.xs_base, dx=self.dxs, x_next=self.xs)
        self.compiled = retract.compiled

    def linearize(self) -> None:
        """Write the subproblem around (xs, us)."""
        for call in self._calls:
            call()

    def retract(self) -> None:
        """Write ``xs = xs_base (+) dxs``."""
        self._retract()


def _compile(
    actions: tuple[Action, ...], last: Action, nodes: int, nu: int
) -> tuple[OcpQpStructure, tuple[BatchKernel, ...], BatchKernel, BatchKernel]:
    """Return the structure and the kernels of actions, terminal cost, retraction."""
    ng = max(action.value_function.size1_out("constraint") for action in actions)
    matrices = [horizon.StageMatrices(action, nu, ng) for action in actions]
    structure = horizon.structure_of(matrices, last, nodes)
    kernels = tuple(BatchKernel(stage.packed(structure.blocks)) for stage in matrices)
    terminal = BatchKernel(horizon.pack_terminal(last, structure.terminal_blocks))
    return structure, kernels, terminal, BatchKernel(horizon.retraction(last.state))


class PathFunctions:
    """Path constraints of one :class:`~lgmpc.ocp.ShootingProblem` at a trajectory of the caller's.

    Args:
        problem: the problem.
        xs: (N+1, nx) states, read by every call.
        us: (N, nu) controls.

    Attributes:
        values: (N, ng) of the rows; 0 for rows that a node's action does not have.
        lower: (N, ng) bounds; minus infinity for such rows.
        upper: (N, ng); infinity for such rows.
    """

    def __init__(self, problem: ShootingProblem, xs: Array, us: Array) -> None:
        kernels = cached(_compile_paths, horizon.distinct(problem), problem.nu)
        ng = max(0 if kernel is None else kernel.output_sizes["values"] for kernel in kernels)
        self.values: Array = np.zeros((problem.nodes, ng))
        self.lower: Array = np.full((problem.nodes, ng), -np.inf)
        self.upper: Array = np.full((problem.nodes, ng), np.inf)
        results = {"values": self.values, "lower": self.lower, "upper": self.upper}
        self._calls = horizon.bind_intervals(problem, kernels, x=xs, u=us, **results)

    def evaluate(self) -> None:
        """Write :attr:`values`, :attr:`lower` and :attr:`upper`."""
        for call in self._calls:
            call()


def _compile_paths(actions: tuple[Action, ...], nu: int) -> tuple[BatchKernel | None, ...]:
    """Return the kernel of each action; None of those without path constraints."""
    return tuple(
        BatchKernel(_path(action, nu)) if action.value_function.numel_out("constraint") else None for action in actions
    )


def _path(action: Action, nu: int) -> ca.Function:
    x, _, p = horizon.symbols_of(action.value_function)
    u = horizon.like(action.value_function, ca.SX.sym("u", nu))
    _, _, *rows = action.value_function.call([x, u[: action.nu], p])
    names = ["values", "lower", "upper"]
    return ca.Function(f"{action.name}_path_{nu}", [x, u, p], [ca.densify(row) for row in rows], ["x", "u", "p"], names)
