"""Functions of a problem over the whole horizon, at a trajectory of the caller's: path constraints, exact Hessians."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from lgmpc.actions import Action
from lgmpc.actions.lagrangian import lagrangian_hessian, terminal_hessian
from lgmpc.compile import BatchKernel, cached
from lgmpc.ocp.horizon import bind_intervals, bind_last, distinct, runs_of
from lgmpc.ocp.packing import like, symbols_of
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.typing import Array

__all__ = ["LagrangianHessians", "PathFunctions"]


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
