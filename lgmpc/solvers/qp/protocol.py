"""The interfaces of solvers of linear-quadratic problems, with bounds and without, and their results."""

import math
from abc import ABC
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from lgmpc.ocp import KktResidual, OcpQp, kkt_residual
from lgmpc.status import Status
from lgmpc.typing import Array

LARGE_STAGE = 30
"""States and controls of a stage from which dense blocks pay."""


def is_large(qp: OcpQp) -> bool:
    """Return whether dense blocks pay for the stages of a problem."""
    return qp.structure.ndx + qp.structure.nu > LARGE_STAGE


@dataclass(frozen=True)
class QpSolution:
    """A step in tangent coordinates, as views of the solver's buffers: valid until its next solve.

    Its residual is computed from the problem's current numbers, independently of the solver.

    Attributes:
        qp: the problem.
        dxs: (N+1, ndx) states, the given one first.
        dus: (N, nu) controls.
        costates: (N, ndx) multipliers of the dynamics, lambda_1 .. lambda_N.
        multipliers: (N, ng) of the path constraint; positive at the upper bound, negative at the lower one.
    """

    qp: OcpQp = field(repr=False)
    dxs: Array
    dus: Array
    costates: Array
    multipliers: Array

    @classmethod
    def zeros(cls, qp: OcpQp) -> "QpSolution":
        """Return the step zero with multipliers zero."""
        s = qp.structure
        shapes = ((s.nodes + 1, s.ndx), (s.nodes, s.nu), (s.nodes, s.ndx), (s.nodes, s.ng))
        return cls(qp, *(np.zeros(shape) for shape in shapes))

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array]:
        """States, controls, costates, multipliers."""
        return self.dxs, self.dus, self.costates, self.multipliers

    def write(self, *arrays: Array | float) -> None:
        """Overwrite states, controls, costates and multipliers, in this order."""
        for mine, given in zip(self.arrays, arrays, strict=True):
            mine[...] = given

    def residual(self) -> KktResidual:
        """Compute the residual of the optimality conditions."""
        return kkt_residual(self.qp, self.costates, self.multipliers, (self.dxs, self.dus))


class QpSolver(Protocol):
    """Solves :class:`~lgmpc.ocp.OcpQp` of one structure repeatedly.

    A solve begins at the step zero and at the multipliers in :attr:`solution`, which the caller may overwrite, for
    example with shifted ones.

    Attributes:
        name: as a config has it.
        qp: the problem.
        solution: of the last solve.
        iterations: that the last solve took.
        may_use_fallbacks: whether a slower one may solve what it does not; without meaning where there is none.
    """

    name: str
    qp: OcpQp
    solution: QpSolution
    iterations: int
    may_use_fallbacks: bool

    def prepare(self) -> None:
        """Read the matrices of :attr:`qp`, and factorise as far as possible without the first state."""

    def solve(self, dx0: Array) -> Status:
        """Take over the vectors of :attr:`qp` and solve for the first state ``dx0`` (ndx,).

        Returns CONVERGED, or ITERATION_LIMIT with an approximate solution; any other status leaves
        :attr:`solution` as it was.
        """

    def reset(self) -> None:
        """Discard all state of earlier solves; the next one gives the same bits as in a new solver."""

    def feedback(self, multipliers: Array) -> Array:
        """Return the gains (N, nu, ndx) K of ``du = -K dx`` while rows with multipliers (N, ng) stay at their bounds.

        Returns:
            The gains; of length 0 where the cost is not convex along these rows, or from solvers without a sweep.
        """


class RiccatiSolver(ABC):
    """Minimises the cost of an :class:`~lgmpc.ocp.OcpQp`, with penalised rows instead of its bounds.

    The cost plus

        sum_k sum_i  1/2 weight_ki (row_ki - target_ki)^2,        row_k = C_k dx_k + D_k du_k,

    subject to the dynamics only, by one Riccati sweep and a roll-out.

    Args:
        qp: the problem; R + D^T diag(weights) D has to be positive definite.

    Attributes:
        qp: the problem.
        available: whether there is machine code; else nothing can be called.
        penalty: largest weight, as a multiple of the median control weight, with which rounding leaves the result as
            accurate as :class:`~lgmpc.solvers.qp.ActiveSetSolver` requires by default.
            dx0: (ndx,) first state.
        weights: (N, ng) of the rows' penalties, not negative.
        targets: (N, ng) of the rows.
        dxs: (N+1, ndx) the minimiser's states.
        dus: (N, nu) its controls.
        costates: (N, ndx) multipliers of the dynamics, signed as in :func:`~lgmpc.ocp.kkt_residual`.
        rows: (N, ng) their values.
        multipliers: (N, ng) with which the minimiser is stationary, the penalties' slopes; written by the caller.
        factoring: the calls of machine code that :meth:`factor` makes.
        solving: those of :meth:`solve`.
        refining: the call that measures :attr:`residual`, and that which computes a :attr:`correction` from it with the
            last factors; none where penalties are moderate.
        residual: of the minimiser's stationarity: rounding, which weights magnify.
        correction: of states, controls, costates and rows.
    """

    available: bool
    penalty: float
    factoring: tuple[Callable[[], int], ...] = ()
    solving: tuple[Callable[[], int], ...] = ()
    refining: tuple[Callable[[], int], ...] = ()

    def __init__(self, qp: OcpQp) -> None:
        s = qp.structure
        self.qp = qp
        self.dx0: Array = np.zeros(s.ndx)
        self.weights: Array = np.zeros((s.nodes, s.ng))
        self.targets: Array = np.zeros((s.nodes, s.ng))
        self.dxs: Array = np.zeros((s.nodes + 1, s.ndx))
        self.dus: Array = np.zeros((s.nodes, s.nu))
        self.costates: Array = np.zeros((s.nodes, s.ndx))
        self.rows: Array = np.zeros((s.nodes, s.ng))
        self.multipliers: Array = np.zeros((s.nodes, s.ng))
        self._cost = np.zeros(1)
        self.residual: Array = np.zeros(0)
        self.correction: tuple[Array, ...] = (self.residual,) * 4

    @property
    def cost(self) -> float:
        """Cost of the minimiser, without the penalties; not finite if the problem's numbers are not."""
        return float(self._cost[0])

    def load(self) -> None:  # noqa: B027 - not all have something to do
        """Take over the problem's matrices and vectors; nothing where they are read in their place."""

    def factor(self) -> bool:
        """Minimise; False if the Hessian in some stage's controls is not positive definite."""
        return not any([call() for call in self.factoring]) and math.isfinite(self.cost)

    def feedback(self) -> Array | None:
        """Return the gains (N, nu, ndx) K of ``du = -K dx + ...`` of the last :meth:`factor`; None if not kept."""
        return None

    def solve(self) -> None:
        """Minimise for other targets, the weights being those of the last :meth:`factor`."""
        for call in self.solving:
            call()
