"""What every solver of linear-quadratic subproblems offers, and what it returns."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from lgmpc.ocp import OcpQp
from lgmpc.typing import Array

__all__ = ["QpSolution", "QpSolver", "QpStatus"]


class QpStatus(Enum):
    """How a solve ended; the value says what to do about it."""

    SOLVED = "nothing to do"
    MAX_ITERATIONS = "raise max_iterations, loosen the tolerance, or scale the weights closer together"
    INFEASIBLE = "no point was found that satisfies the constraints: check the bounds for contradictions"
    UNBOUNDED = "the cost has no minimum: give every control a positive weight"
    NUMERICAL = "the matrices are too badly scaled: bring the weights closer together"
    NOT_FINITE = "the problem's data holds NaN or infinity: check state, references and parameters"


@dataclass(frozen=True)
class QpSolution:
    """A step in tangent coordinates, as views of the solver's buffers: valid until its next solve.

    Attributes:
        dxs: (N+1, ndx) states, the given one first.
        dus: (N, nu) controls.
        costates: (N, ndx) multipliers of the dynamics, lambda_1 .. lambda_N.
        multipliers: (N, ng) of the path constraint; positive at the upper bound, negative at the lower one.
    """

    dxs: Array
    dus: Array
    costates: Array
    multipliers: Array


class QpSolver(Protocol):
    """Solves :class:`~lgmpc.ocp.OcpQp` of one structure again and again.

    A solve begins at the step zero and at the multipliers in :attr:`solution`, which the caller may overwrite (with
    shifted ones, say).

    Attributes:
        name: as a config has it.
        qp: the problem.
        solution: of the last solve.
        iterations: that the last solve took.
    """

    name: str
    qp: OcpQp
    solution: QpSolution
    iterations: int

    def prepare(self) -> None:
        """Take over the matrices of :attr:`qp`; what can be factorised before the first state is known, is."""

    def solve(self, dx0: Array) -> QpStatus:
        """Take over the vectors of :attr:`qp` and solve for the first state ``dx0`` (ndx,).

        Unless the status is SOLVED or MAX_ITERATIONS, :attr:`solution` is left as it was.
        """

    def reset(self) -> None:
        """Forget everything learnt from earlier solves; the next one gives the same bits as in a new solver."""
