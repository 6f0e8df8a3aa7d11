"""Residuals of the optimality conditions of a linear-quadratic problem."""

import math
from dataclasses import dataclass

import numpy as np

from lgmpc.ocp.quadratic import OcpQp
from lgmpc.typing import Array


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
    def unknown(cls) -> "KktResidual":
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
    return above + below  # one of them is zero


def kkt_residual(
    qp: OcpQp, costates: Array, multipliers: Array, step: tuple[Array, Array] | None = None
) -> KktResidual:
    """Return the residual of a linear-quadratic problem's optimality conditions; all NaN at a point that is not finite.

    With costates lambda_1 .. lambda_N of the dynamics ``A dx + B du + b - dx+ = 0`` and multipliers mu of the path
    constraint (positive at an active upper bound, negative at a lower one) the Lagrangian is stationary in
    dx_1 .. dx_N and du_0 .. du_{N-1}. dx_0 is given: it has no condition.

    Args:
        qp: the problem.
        costates: (N, ndx) lambda_1 .. lambda_N.
        multipliers: (N, ng).
        step: (N+1, ndx) states and (N, nu) controls; zero unless given, where a subproblem's residual is that of the
            nonlinear problem at the point of expansion.
    """
    of_states = qp.vector("q") + _pulled(costates, qp.dense("A")) + _pulled(multipliers, qp.dense("C"))
    of_controls = qp.vector("r") + _pulled(costates, qp.dense("B")) + _pulled(multipliers, qp.dense("D"))
    of_last = qp.dense_terminal("q")[:, 0] - costates[-1]
    gaps, rows = qp.vector("b"), np.zeros_like(multipliers)
    if step is not None:
        dxs, dus = step[0][:-1], step[1]
        cross = qp.dense("S")
        of_states = of_states + _applied(qp.dense("Q"), dxs) + _pulled(dus, cross)
        of_controls = of_controls + _applied(cross, dxs) + _applied(qp.dense("R"), dus)
        of_last = of_last + qp.dense_terminal("Q") @ step[0][-1]
        gaps = gaps + _applied(qp.dense("A"), dxs) + _applied(qp.dense("B"), dus) - step[0][1:]
        rows = _applied(qp.dense("C"), dxs) + _applied(qp.dense("D"), dus)
    point = (costates, multipliers, *(step or ()))
    if not all(math.isfinite(part.sum()) for part in point):
        return KktResidual.unknown()
    lower, upper = qp.vector("lower"), qp.vector("upper")
    return KktResidual(
        max(_largest(of_states[1:] - costates[:-1]), _largest(of_controls), _largest(of_last)),
        _largest(gaps),
        max(float((lower - rows).max(initial=0.0)), float((rows - upper).max(initial=0.0))),
        _largest(complementarity(multipliers, rows, lower, upper)),
    )


def _pulled(vectors: Array, matrices: Array) -> Array:
    """Return (N, n) each stage's ``M^T v``."""
    return (vectors[:, None] @ matrices)[:, 0]


def _applied(matrices: Array, vectors: Array) -> Array:
    """Return (N, m) each stage's ``M v``."""
    return (matrices @ vectors[..., None])[..., 0]


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))
