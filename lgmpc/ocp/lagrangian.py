"""Exact Hessians of a problem's Lagrangian over the whole horizon."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lgmpc.actions.lagrangian import lagrangian_hessian, terminal_hessian
from lgmpc.compile import BatchKernel
from lgmpc.ocp.horizon import bind_intervals, bind_last, distinct, runs_of
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.typing import Array

__all__ = ["LagrangianHessians"]


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
