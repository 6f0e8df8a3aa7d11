"""Stages evaluated by Pinocchio, with the interface of the compiled :class:`~lgmpc.compile.StageKernel`.

Each kernel is bound to the same memory as the compiled one and writes the same values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from lgmpc.actions import Action, NumericContactAction, StageQuadratics
from lgmpc.ocp.horizon import Stages
from lgmpc.ocp.quadratic import Block
from lgmpc.typing import Array

__all__ = ["NumericExpansion", "NumericRollOut", "NumericSubproblem", "with_numeric"]


def with_numeric(
    kernels: Sequence[Stages | None], actions: Sequence[Action], make: Callable[[NumericContactAction], Stages]
) -> list[Stages | None]:
    """Return the kernels of a problem's distinct actions, those that Pinocchio evaluates made by a function."""
    pairs = zip(kernels, actions, strict=True)
    return [make(action) if isinstance(action, NumericContactAction) else kernel for kernel, action in pairs]


class NumericExpansion:
    """The expansion of :class:`~lgmpc.ocp.ShootingFunctions`, with ``nu`` controls."""

    def __init__(self, action: NumericContactAction, nu: int) -> None:
        self._action = action
        self._nu = nu

    def bind(self, stages: int, **memory: Array) -> Callable[[], int]:
        """Make the call that expands all stages on this memory; it returns 0."""
        ndx, used = self._action.state.ndx, self._action.state.ndx + self._action.nu
        n = ndx + self._nu
        jacobian, hessian = memory["jacobian"].reshape(stages, n, ndx), memory["hessian"].reshape(stages, n, n)
        missing = np.arange(used, n)

        def call() -> int:
            m = _expand(self._action, memory)
            jacobian[:, :ndx], jacobian[:, ndx:used] = np.swapaxes(m.A, 1, 2), np.swapaxes(m.B, 1, 2)
            hessian[:, :ndx, :ndx], hessian[:, ndx:used, :ndx] = m.Q, m.S
            hessian[:, :ndx, ndx:used], hessian[:, ndx:used, ndx:used] = np.swapaxes(m.S, 1, 2), m.R
            memory["gradient"][:, :ndx], memory["gradient"][:, ndx:used] = m.q, m.r
            memory["gap"][...], memory["cost"][:, 0] = m.b, m.cost
            # Controls that the action does not have are fixed at zero.
            jacobian[:, used:] = hessian[:, used:] = hessian[:, :, used:] = memory["gradient"][:, used:] = 0.0
            hessian[:, missing, missing] = 1.0
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
        p = memory["p"][:, : action.parameters.size]
        feedback = memory["feedback"].reshape(stages, self._nu, state.ndx)
        lower, upper, zs = memory["lower"], memory["upper"], np.zeros((stages, action.nz))

        def call() -> int:
            alpha = float(memory["alpha"][0])
            base = memory["u_base"] - alpha * memory["feedforward"]
            left = (alpha - 1.0) * memory["gap"]
            for k in range(stages):
                x = memory["x"][k]
                u = base[k] - feedback[k] @ state.diff(memory["x_base"][k], x)
                u = np.minimum(np.maximum(u, lower[k]), upper[k])
                u[own:] = 0.0
                memory["u"][k] = u
                x_next, zs[k] = action.advance(x, u[:own], p[k])
                memory["x_next"][k] = state.integrate(x_next, left[k])
            memory["cost"][:, 0] = action.costs(memory["x"], memory["u"][:, :own], zs, p)
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
            m = _expand(self._action, memory)
            for name, block in self._blocks.items():
                # Rows that the action does not have are zero between -1 and 1; controls that it does not have are
                # fixed at zero.
                dense = np.empty((stages, *block.shape))
                dense[...] = np.eye(*block.shape) if name == "R" else _MISSING.get(name, 0.0)
                own = np.asarray(getattr(m, name))
                own = own if own.ndim == 3 else own.reshape(stages, -1, 1)
                dense[:, : own.shape[1], : own.shape[2]] = own
                memory["values"][:, block.where] = dense[:, block.rows, block.columns]
            return 0

        return call


_MISSING = {"lower": -1.0, "upper": 1.0}


def _expand(action: NumericContactAction, memory: Mapping[str, Array]) -> StageQuadratics:
    us, ps = memory["u"][:, : action.nu], memory["p"][:, : action.parameters.size]
    return action.quadratics(memory["x"], us, memory["x_next"], ps)
