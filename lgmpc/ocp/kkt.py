"""Residuals of the optimality conditions of a linear-quadratic problem, compiled for any number of nodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from lgmpc.compile import BatchKernel, cached
from lgmpc.ocp.quadratic import OcpQp, OcpQpStructure
from lgmpc.typing import Array

__all__ = ["KktConditions", "KktResidual", "complementarity"]


@dataclass(frozen=True)
class KktResidual:
    """Residuals of the optimality conditions at a point, each the largest absolute value of its rows.

    Attributes:
        stationarity: gradient of the Lagrangian.
        dynamics: gaps between the stages.
        constraint: violation of the path constraint.
        complementarity: smaller of a row's multiplier and its distance from the multiplier's bound.
    """

    stationarity: float
    dynamics: float
    constraint: float
    complementarity: float

    @classmethod
    def unknown(cls) -> KktResidual:
        """Return an unknown residual: NaN."""
        return cls(math.nan, math.nan, math.nan, math.nan)

    @property
    def largest(self) -> float:
        """The largest of the four; NaN if any is."""
        return float(np.max([self.stationarity, self.dynamics, self.constraint, self.complementarity]))


def complementarity(multipliers: Array, rows: Array | float, lower: Array, upper: Array) -> Array:
    """Return the smaller of each row's multiplier and its distance from the multiplier's bound.

    Args:
        multipliers: of the rows; positive at the upper bound, negative at the lower one.
        rows: their values.
        lower: their lower bounds.
        upper: their upper bounds.
    """
    above = np.minimum(np.maximum(multipliers, 0.0), np.abs(upper - rows))
    below = np.minimum(np.maximum(-multipliers, 0.0), np.abs(rows - lower))
    residual: Array = above + below  # one of them is zero
    return residual


class KktConditions:
    """The optimality conditions of an :class:`~lgmpc.ocp.OcpQp` at a point, read from its own memory.

    With costates lambda_1 .. lambda_N of the dynamics ``A dx + B du + b - dx+ = 0`` and multipliers mu of the path
    constraint (positive at an active upper bound, negative at a lower one) the Lagrangian is stationary in
    dx_1 .. dx_N and du_0 .. du_{N-1}. dx_0 is given: it has no condition.

    Args:
        qp: the problem.
        progress: called with a description of what is being compiled.
    """

    def __init__(self, qp: OcpQp, progress: Callable[[str], None] | None = None) -> None:
        s = qp.structure
        n = s.nodes
        costates = np.zeros((n + 1, s.ndx))  # lambda_0, which does not exist, first
        dxs, dus, multipliers = np.zeros((n + 1, s.ndx)), np.zeros((n, s.nu)), np.zeros((n, s.ng))
        self._point = dxs, dus, costates[1:], multipliers
        self._measures = np.zeros((n + 1, 6))
        stage, last = cached(_compile, replace(s, nodes=1), progress=progress)  # the same for all horizons
        self._calls = (
            stage.bind(
                n, values=qp.values, dx=dxs, dx_next=dxs[1:], du=dus, costate=costates, costate_next=costates[1:],
                multipliers=multipliers, measures=self._measures,
            ),
            last.bind(
                1, terminal_values=qp.terminal_values, dx=dxs[n], costate=costates[n], measures=self._measures[n:]
            ),
        )  # fmt: skip

    def residual(
        self, dxs: Array | float, dus: Array | float, costates: Array | float, multipliers: Array | float
    ) -> KktResidual:
        """Return the residual at a point; all NaN if that is not finite.

        Args:
            dxs: (N+1, ndx) states, or one number for all entries.
            dus: (N, nu) controls.
            costates: (N, ndx) lambda_1 .. lambda_N.
            multipliers: (N, ng).
        """
        for mine, given in zip(self._point, (dxs, dus, costates, multipliers), strict=True):
            mine[...] = given
        for call in self._calls:
            call()
        self._measures[0, 0] = 0.0  # the first state is given
        of_states, of_controls, *others, total = np.maximum.reduce(self._measures, axis=0).tolist()
        return KktResidual(max(of_states, of_controls), *others) if math.isfinite(total) else KktResidual.unknown()


def _compile(s: OcpQpStructure, progress: Callable[[str], None] | None) -> tuple[BatchKernel, BatchKernel]:
    return BatchKernel(_of_stage(s), progress), BatchKernel(_of_last(s), progress)


def _of_stage(s: OcpQpStructure) -> ca.Function:
    """Return the measures of an interval: gradients in its state and control, gap, violation, complementarity, a sum.

    Comparisons and maxima ignore NaN; the sum of the point's entries is finite only if they are.
    """
    v, dx, dx_next, du = (ca.SX.sym("v", n) for n in (s.size, s.ndx, s.ndx, s.nu))
    co, co_next, mu = (ca.SX.sym("co", n) for n in (s.ndx, s.ndx, s.ng))
    m = s.matrices(v)
    gradient_x = m["Q"] @ dx + m["S"].T @ du + m["q"] + m["A"].T @ co_next + m["C"].T @ mu - co
    gradient_u = m["S"] @ dx + m["R"] @ du + m["r"] + m["B"].T @ co_next + m["D"].T @ mu
    gap = m["A"] @ dx + m["B"] @ du + m["b"] - dx_next
    row = m["C"] @ dx + m["D"] @ du
    above, below = m["upper"] - row, row - m["lower"]
    outside = _larger(_larger(-above, -below), ca.SX.zeros(s.ng))
    loose = _larger(_smaller(_larger(mu, ca.SX.zeros(s.ng)), above), _smaller(_larger(-mu, ca.SX.zeros(s.ng)), below))
    largest = [_largest(column) for column in (gradient_x, gradient_u, gap, outside, loose)]
    total = sum((ca.sum1(part) for part in (dx, du, co_next, mu)), ca.SX(0))
    names = ["values", "dx", "dx_next", "du", "costate", "costate_next", "multipliers"]
    return ca.Function(
        f"kkt_{s.ndx}_{s.nu}_{s.ng}",
        [v, dx, dx_next, du, co, co_next, mu],
        [ca.vertcat(*largest, ca.fabs(total))],
        names,
        ["measures"],
    )


def _of_last(s: OcpQpStructure) -> ca.Function:
    """Return the same measures of the last node, which has a state only."""
    v, dx, co = (ca.SX.sym("v", n) for n in (s.terminal_size, s.ndx, s.ndx))
    m = s.matrices(v, last=True)
    gradient = m["Q"] @ dx + m["q"] - co
    return ca.Function(
        f"kkt_last_{s.ndx}",
        [v, dx, co],
        [ca.vertcat(_largest(gradient), ca.SX.zeros(4), ca.fabs(ca.sum1(dx)))],
        ["terminal_values", "dx", "costate"],
        ["measures"],
    )


def _larger(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the elementwise maximum (by comparison: the C library's fmax is a call for each element)."""
    return ca.if_else(a > b, a, b)


def _smaller(a: ca.SX, b: ca.SX) -> ca.SX:
    return ca.if_else(a < b, a, b)


def _largest(column: ca.SX) -> ca.SX:
    """Return the largest absolute value; 0 for an empty column."""
    largest = ca.SX(0)
    for entry in ca.vertsplit(column) if column.numel() else ():
        largest = _larger(ca.fabs(entry), largest)
    return largest
