"""Several solvers of one problem, tried in turn: interior point methods fail on different problems."""

from __future__ import annotations

from collections.abc import Sequence

from lgmpc.errors import InputError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.protocol import QpSolution, QpSolver, QpStatus
from lgmpc.typing import Array

__all__ = ["Cascade"]


class Cascade:
    """:class:`~lgmpc.solvers.qp.QpSolver` that tries the next one where one does not solve the problem.

    Where none does, the first approximate solution counts; without any, the last solver's status.

    Args:
        solvers: of the same :class:`~lgmpc.ocp.OcpQp`, in the order in which they are tried.

    Attributes:
        iterations: of all that were tried in the last solve.

    Raises:
        InputError: no solver, or solvers of different problems.
    """

    name = "cascade"

    def __init__(self, solvers: Sequence[QpSolver]) -> None:
        if not solvers or any(solver.qp is not solvers[0].qp for solver in solvers):
            raise InputError("solvers", f"{len(solvers)}", "at least one, all of the same problem")
        self.qp: OcpQp = solvers[0].qp
        self.iterations = 0
        self._solvers = tuple(solvers)
        self.solution = QpSolution.zeros(self.qp)

    def reset(self) -> None:
        """Discard all state of earlier solves."""
        self.solution.write(0.0, 0.0, 0.0, 0.0)
        for solver in self._solvers:
            solver.reset()

    def prepare(self) -> None:
        """Do nothing: :meth:`solve` prepares each solver that it tries."""

    def solve(self, dx0: Array) -> QpStatus:
        """Solve; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        self.iterations = 0
        approximate = False
        for solver in self._solvers:
            solver.prepare()
            status = solver.solve(dx0)
            self.iterations += solver.iterations
            if status is QpStatus.SOLVED or (status is QpStatus.MAX_ITERATIONS and not approximate):
                approximate = True
                self.solution.write(*solver.solution.arrays)
            if status in (QpStatus.SOLVED, QpStatus.NOT_FINITE):
                return status
        return QpStatus.MAX_ITERATIONS if approximate else status
