"""The interface of the regulators with penalised rows that :class:`~lgmpc.solvers.qp.ActiveSetSolver` calls."""

from __future__ import annotations

from typing import Protocol

from lgmpc.ocp import OcpQp
from lgmpc.typing import Array

__all__ = ["Regulator"]


class Regulator(Protocol):
    """Minimises the cost of an :class:`~lgmpc.ocp.OcpQp`, with penalised rows instead of its bounds.

    The cost plus

        sum_k sum_i  1/2 weight_ki (row_ki - target_ki)^2,        row_k = C_k dx_k + D_k du_k,

    subject to the dynamics only, by one Riccati sweep and a roll-out.

    Attributes:
        qp: the problem.
        available: whether there is machine code; else nothing can be called.
        penalty: largest weight, as a multiple of the median control weight, with which rounding leaves the result as
            accurate as :class:`~lgmpc.solvers.qp.ActiveSetSettings` require by default.
        keeps_factors: whether :meth:`solve` takes much less time than :meth:`factor`.
        dx0: (ndx,) first state.
        weights: (N, ng) of the rows' penalties, not negative.
        targets: (N, ng) of the rows.
        dxs: (N+1, ndx) the minimiser's states.
        dus: (N, nu) its controls.
        costates: (N, ndx) multipliers of the dynamics, signed as in :class:`~lgmpc.ocp.KktConditions`.
        rows: (N, ng) their values.
        multipliers: (N, ng) with which the minimiser is stationary, the penalties' slopes; written by the caller.
    """

    qp: OcpQp
    available: bool
    penalty: float
    keeps_factors: bool
    dx0: Array
    weights: Array
    targets: Array
    dxs: Array
    dus: Array
    costates: Array
    rows: Array
    multipliers: Array

    @property
    def cost(self) -> float:
        """Cost of the minimiser, without the penalties; not finite if the problem's numbers are not."""

    def load(self) -> None:
        """Take over the problem's matrices and vectors."""

    def factor(self) -> bool:
        """Minimise; False if the Hessian in some stage's controls is not positive definite."""

    def feedback(self) -> Array | None:
        """Return the gains (N, nu, ndx) K of ``du = -K dx + ...`` of the last :meth:`factor`; None if not kept."""

    def solve(self) -> None:
        """Minimise for other targets, the weights being those of the last :meth:`factor`."""

    def polish(self, tolerance: float) -> int | None:
        """Correct minimiser and :attr:`multipliers` by their rounding.

        Returns:
            The number of corrections; None if the result is not stationary.
        """
