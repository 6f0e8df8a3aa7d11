"""Exact Hessians of a problem's Lagrangian over the whole horizon."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lgmpc.actions.lagrangian import lagrangian_hessian, terminal_hessian
from lgmpc.compile import BatchKernel
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.ocp.shooting import runs_of
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
        multipliers: (N, ng) of the path constraints; of rows that a node's action does not have without effect.
        hessian: (N, ndx + nu, ndx + nu), ``[Q S^T; S R]``; the identity for controls that an action does not have.
        last_hessian: (ndx, ndx) of the terminal cost.
    """

    def __init__(
        self, problem: ShootingProblem, xs: Array, us: Array, progress: Callable[[str], None] | None = None
    ) -> None:
        n, ndx, nu = problem.nodes, problem.state.ndx, problem.nu
        runs = runs_of(problem.actions)
        rows = {id(action): action.path_rows for action, _, _ in runs}
        self.costates: Array = np.zeros((n, ndx))
        self.multipliers: Array = np.zeros((n, max(rows.values())))
        self.hessian: Array = np.tile(np.eye(ndx + nu), (n, 1, 1))
        self.last_hessian: Array = np.zeros((ndx, ndx))
        kernels: dict[int, BatchKernel] = {}
        self._copies = []
        self._calls = []
        for action, start, stop in runs:
            if id(action) not in kernels:
                kernels[id(action)] = BatchKernel.of(lagrangian_hessian, action, progress=progress)
            k, width = slice(start, stop), ndx + action.nu
            found = np.zeros((stop - start, width * width))
            self._calls.append(
                kernels[id(action)].bind(
                    stop - start, x=xs[k], u=us[k], x_next=xs[start + 1 : stop + 1], p=problem.parameters[k],
                    costate=self.costates[k], multiplier=self.multipliers[k], hessian=found,
                )
            )  # fmt: skip
            self._copies.append((self.hessian[k, :width, :width], found.reshape(-1, width, width)))
        last = BatchKernel.of(terminal_hessian, problem.terminal, progress=progress)
        self._calls.append(last.bind(1, x=xs[n:], p=problem.parameters[n:], hessian=self.last_hessian.reshape(1, -1)))

    def evaluate(self) -> None:
        """Write :attr:`hessian` and :attr:`last_hessian`."""
        for call in self._calls:
            call()
        for place, found in self._copies:
            place[...] = 0.5 * (found + np.swapaxes(found, 1, 2))
