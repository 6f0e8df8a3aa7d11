"""Costs and constraints of one node as expressions: weighted activations of residuals, and bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from lgmpc.costs.activations import Activation, Quadratic

__all__ = ["Bounded", "Cost", "CostTerm", "LeastSquares"]


@dataclass(frozen=True)
class CostTerm:
    """The cost ``sum_i weight_i a(residual_i)`` with an activation a.

    Its Hessian is taken as ``J^T diag(weight a'') J`` with the residual's Jacobian J (Gauss-Newton): positive
    semidefinite for weights that are not negative.

    Attributes:
        residual: CasADi column, a function of state, control and parameters.
        activation: a; half the square unless given.
        weight: CasADi column of the same length or a number, a function of the parameters only.
    """

    residual: Any
    activation: Activation = Quadratic()
    weight: Any = 1.0


@dataclass(frozen=True)
class Cost:
    """A sum of terms.

    Attributes:
        terms: any number of them.
    """

    terms: tuple[CostTerm, ...] = ()

    @property
    def value(self) -> Any:
        """The cost, a CasADi scalar."""
        total = ca.SX(0)
        for term in self.terms:
            total += ca.dot(_column(term.weight, term.residual), term.activation.value(term.residual))
        return total

    @property
    def residual(self) -> Any:
        """The residuals of all terms in one column."""
        return ca.vertcat(ca.SX(0, 1), *(term.residual for term in self.terms))

    @property
    def weight(self) -> Any:
        """The weights of all terms in one column."""
        return ca.vertcat(ca.SX(0, 1), *(_column(term.weight, term.residual) for term in self.terms))

    @property
    def gradient(self) -> Any:
        """The activations' first derivatives in one column, not weighted."""
        return ca.vertcat(ca.SX(0, 1), *(term.activation.gradient(term.residual) for term in self.terms))

    @property
    def curvature(self) -> Any:
        """The activations' second derivatives in one column, not weighted."""
        return ca.vertcat(ca.SX(0, 1), *(term.activation.curvature(term.residual) for term in self.terms))


def LeastSquares(residual: Any, weight: Any) -> Cost:  # noqa: N802 - reads as the kind of cost that it makes
    """Return the cost ``1/2 sum_i weight_i residual_i^2``.

    Args:
        residual: CasADi column, a function of state, control and parameters.
        weight: CasADi column of the same length, a function of the parameters only.
    """
    return Cost((CostTerm(residual, Quadratic(), weight),))


@dataclass(frozen=True)
class Bounded:
    """The hard constraint ``lower <= value <= upper``, row by row.

    Attributes:
        value: CasADi column, a function of state, control and parameters.
        lower: CasADi column, a function of the parameters only; minus infinity where there is no bound.
        upper: CasADi column, a function of the parameters only; infinity where there is no bound.
    """

    value: Any
    lower: Any
    upper: Any

    @staticmethod
    def stack(*parts: Bounded) -> Bounded:
        """Return the constraints of all parts in one; columns of length zero if there is none."""
        empty = ca.SX(0, 1)
        return Bounded(
            ca.vertcat(empty, *(part.value for part in parts)),
            ca.vertcat(empty, *(part.lower for part in parts)),
            ca.vertcat(empty, *(part.upper for part in parts)),
        )


def _column(weight: Any, residual: Any) -> Any:
    column = ca.SX(weight)
    return ca.repmat(column, residual.shape[0], 1) if column.shape == (1, 1) else column
