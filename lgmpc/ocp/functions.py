"""Functions of a problem over the whole horizon: quadratic subproblems, path constraints, exact Hessians."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from lgmpc.actions import Action, Unknowns
from lgmpc.actions.linearisation import at_zero
from lgmpc.compile import BatchKernel, cached
from lgmpc.ocp.horizon import (
    StageMatrices,
    bind_intervals,
    bind_last,
    distinct,
    like,
    pack_terminal,
    retraction,
    runs_of,
    structure_of,
    symbols_of,
)
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.ocp.quadratic import OcpQp, OcpQpStructure
from lgmpc.typing import Array

__all__ = ["LagrangianHessians", "PathFunctions", "SubproblemFunctions", "lagrangian_hessian", "terminal_hessian"]


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


class LagrangianHessians:
    """Second derivatives of one :class:`~lgmpc.ocp.ShootingProblem` at a trajectory of the caller's.

    Write :attr:`costates` and :attr:`multipliers`, call :meth:`evaluate`. They may be indefinite.

    Args:
        problem: the problem.
        xs: (N+1, nx) states, read by every call.
        us: (N, nu) controls.
        progress: called with a description of what is being compiled.

    Attributes:
        costates: (N, ndx) of the gaps ``f(x_k, u_k) (-) x_{k+1}``.
        multipliers: (N, ng) of the path constraints; those of rows that a node's action does not have are not used.
        hessian: (N, ndx + nu, ndx + nu), ``[Q S^T; S R]``; the identity for controls that an action does not have.
        last_hessian: (ndx, ndx) of the terminal cost.
    """

    def __init__(
        self, problem: ShootingProblem, xs: Array, us: Array, progress: Callable[[str], None] | None = None
    ) -> None:
        n, ndx, nu = problem.nodes, problem.state.ndx, problem.nu
        actions = distinct(problem)
        self.costates: Array = np.zeros((n, ndx))
        self.multipliers: Array = np.zeros((n, max(action.path_rows for action in actions)))
        self.hessian: Array = np.tile(np.eye(ndx + nu), (n, 1, 1))
        self.last_hessian: Array = np.zeros((ndx, ndx))
        found = np.zeros((n, (ndx + nu) ** 2))  # an action with fewer controls has fewer entries, contiguous
        kernels = [BatchKernel.of(lagrangian_hessian, action, progress=progress) for action in actions]
        last = BatchKernel.of(terminal_hessian, problem.terminal, progress=progress)
        self._calls = (
            *bind_intervals(
                problem, kernels, x=xs, u=us, x_next=xs[1:], costate=self.costates, multiplier=self.multipliers,
                hessian=found,
            ),
            bind_last(problem, last, x=xs[n:], hessian=self.last_hessian.reshape(1, -1)),
        )  # fmt: skip
        self._copies = []
        for action, start, stop in runs_of(problem.actions):
            width = ndx + action.nu
            part = found[start:stop, : width * width].reshape(stop - start, width, width)
            self._copies.append((self.hessian[start:stop, :width, :width], part))

    def evaluate(self) -> None:
        """Write :attr:`hessian` and :attr:`last_hessian`."""
        for call in self._calls:
            call()
        for place, found in self._copies:
            place[...] = 0.5 * (found + np.swapaxes(found, 1, 2))


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
        kernels = cached(_compile_paths, distinct(problem), problem.nu, progress=progress)
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


def _compile_paths(
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


def lagrangian_hessian(action: Action) -> ca.Function:
    """Return ``(x, u, x_next, p, costate (ndx,), multiplier (ng,)) -> hessian (ndx + nu, ndx + nu)`` of the Lagrangian.

    Gauss-Newton's Hessian leaves out the curvature of residuals and of the dynamics. The Lagrangian of a stage

        L(d) = cost + costate^T (f (-) x_next) + multiplier^T g,        d = [dx; du] in tangent coordinates,

    has both. Unknowns of the dynamics have multipliers too: see :meth:`lgmpc.actions.Unknowns.hessian`.
    """
    state = action.state
    x, x_next, dx = ca.SX.sym("x", state.nx), ca.SX.sym("x_next", state.nx), ca.SX.sym("dx", state.ndx)
    u, p = ca.SX.sym("u", action.nu), ca.SX.sym("p", action.parameters.size)
    unknowns = Unknowns(keep=True)
    stage = action.stage(state.integrate_symbolic(x, dx), u, p, unknowns)
    costate, multiplier = ca.SX.sym("costate", state.ndx), ca.SX.sym("multiplier", stage.path.value.shape[0])
    gap = state.diff_symbolic(x_next, stage.x_next)
    lagrangian = stage.cost.value + ca.dot(costate, gap) + ca.dot(multiplier, stage.path.value)
    inputs = [x, u, x_next, p, costate, multiplier]
    found = at_zero(unknowns.resolve([*inputs, dx], [unknowns.hessian(lagrangian, dx, u)]), dx)
    names = ["x", "u", "x_next", "p", "costate", "multiplier"]
    return ca.Function(f"{action.name}_lagrangian", inputs, [ca.densify(found[0])], names, ["hessian"])


def terminal_hessian(action: Action) -> ca.Function:
    """Return ``(x, p) -> hessian (ndx, ndx)`` of the terminal cost in tangent coordinates."""
    x, p = ca.SX.sym("x", action.state.nx), ca.SX.sym("p", action.parameters.size)
    dx = ca.SX.sym("dx", action.state.ndx)
    hessian, _ = ca.hessian(action.terminal_cost(action.state.integrate_symbolic(x, dx), p).value, dx)
    found = ca.densify(at_zero([hessian], dx)[0])
    return ca.Function(f"{action.name}_terminal_lagrangian", [x, p], [found], ["x", "p"], ["hessian"])
