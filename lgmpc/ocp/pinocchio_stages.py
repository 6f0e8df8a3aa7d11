"""Stages evaluated by Pinocchio, with the interface of the compiled :class:`~lgmpc.compile.StageKernel`.

Each kernel is bound to the same memory as the compiled one, writes the same values, and loops in Python. Where a stage
has no solution its values are NaN, as from machine code.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from lgmpc.actions import NumericContactAction, StageQuadratic
from lgmpc.ocp.quadratic import Block
from lgmpc.typing import Array

__all__ = ["NumericExpansion", "NumericRollOut", "NumericSubproblem"]


class NumericExpansion:
    """The expansion of :class:`~lgmpc.ocp.ShootingFunctions`, with ``nu`` controls."""

    def __init__(self, action: NumericContactAction, nu: int) -> None:
        self._action = action
        self._nu = nu

    def bind(self, stages: int, **memory: Array) -> Callable[[], int]:
        """Make the call that expands all stages on this memory; it returns 0."""
        action, ndx, own = self._action, self._action.state.ndx, self._action.nu
        n = ndx + self._nu
        both = np.r_[0:ndx, ndx : ndx + own]

        def call() -> int:
            for k in range(stages):
                m = _expand(action, memory, k)
                if m is None:
                    for name in ("jacobian", "hessian", "gradient", "gap", "cost"):
                        memory[name][k] = np.nan
                    continue
                jacobian, hessian = memory["jacobian"][k].reshape(n, ndx), memory["hessian"][k].reshape(n, n)
                jacobian[...] = 0.0
                jacobian[:ndx], jacobian[ndx : ndx + own] = m.A.T, m.B.T
                hessian[...] = np.eye(n)
                hessian[np.ix_(both, both)] = np.block([[m.Q, m.S.T], [m.S, m.R]])
                gradient = memory["gradient"][k]
                gradient[:ndx], gradient[ndx : ndx + own], gradient[ndx + own :] = m.q, m.r, 0.0
                memory["gap"][k], memory["cost"][k] = m.b, m.cost
            return 0

        return call


class NumericRollOut:
    """The roll-out of :class:`~lgmpc.ocp.ShootingFunctions`, with ``nu`` controls."""

    def __init__(self, action: NumericContactAction, nu: int) -> None:
        self._action = action
        self._nu = nu

    def bind(self, stages: int, **memory: Array) -> Callable[[], int]:
        """Make the call that simulates all stages on this memory; it returns 0."""
        action, state, own = self._action, self._action.state, self._action.nu
        size = action.parameters.size

        def call() -> int:
            alpha = float(memory["alpha"][0])
            for k in range(stages):
                x, feedback = memory["x"][k], memory["feedback"][k].reshape(self._nu, state.ndx)
                u = memory["u_base"][k] - alpha * memory["feedforward"][k]
                u -= feedback @ state.diff(memory["x_base"][k], x)
                u = np.clip(u, memory["lower"][k], memory["upper"][k])
                u[own:] = 0.0
                memory["u"][k] = u
                try:
                    value = action.evaluate(x, u[:own], memory["p"][k, :size])
                    reached = state.integrate(value.x_next, (alpha - 1.0) * memory["gap"][k])
                    memory["x_next"][k], memory["cost"][k] = reached, value.cost
                except _NO_SOLUTION:
                    memory["x_next"][k], memory["cost"][k] = np.nan, np.nan
            return 0

        return call


class NumericSubproblem:
    """The packed expansion of :class:`~lgmpc.ocp.SubproblemFunctions`, its entries stored according to ``blocks``."""

    def __init__(self, action: NumericContactAction, blocks: Mapping[str, Block]) -> None:
        self._action = action
        self._blocks = blocks

    def bind(self, stages: int, **memory: Array) -> Callable[[], int]:
        """Make the call that expands all stages on this memory; it returns 0."""

        def call() -> int:
            for k in range(stages):
                m = _expand(self._action, memory, k)
                if m is None:
                    memory["values"][k] = np.nan
                    continue
                for name, block in self._blocks.items():
                    # Rows that the action does not have are zero between -1 and 1; controls that it does not have are
                    # fixed at zero.
                    dense = np.eye(*block.shape) if name == "R" else np.full(block.shape, _MISSING.get(name, 0.0))
                    own = np.asarray(getattr(m, name))
                    own = own if own.ndim == 2 else own.reshape(-1, 1)
                    dense[: own.shape[0], : own.shape[1]] = own
                    memory["values"][k, block.where] = dense[block.rows, block.columns]
            return 0

        return call


_NO_SOLUTION = (np.linalg.LinAlgError, ValueError)  # lgmpc's InputError is a ValueError
_MISSING = {"lower": -1.0, "upper": 1.0}


def _expand(action: NumericContactAction, memory: Mapping[str, Array], k: int) -> StageQuadratic | None:
    """Return the expansion of stage k; None if a value is not finite or an equation has no solution."""
    x, u, p = memory["x"][k], memory["u"][k, : action.nu], memory["p"][k, : action.parameters.size]
    try:
        return action.quadratic(x, u, memory["x_next"][k], p)
    except _NO_SOLUTION:
        return None
