"""The base of solvers of general sparse QPs: their matrices, their result, and their state between solves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.assembly import SparseAssembly
from lgmpc.solvers.qp.protocol import QpSolution, QpStatus
from lgmpc.typing import Array

__all__ = ["GeneralQpSolver"]


class GeneralQpSolver(ABC):
    """:class:`~lgmpc.solvers.qp.QpSolver` on a package that takes the whole problem as sparse matrices.

    Args:
        assembly: of the problem, in the package's form.
    """

    name: str
    warm_started: ClassVar[bool]
    """Whether a solve begins at the package's last iterates, which are discarded after a failure."""

    def __init__(self, assembly: SparseAssembly) -> None:
        self.qp: OcpQp = assembly.qp
        self.iterations = 0
        self.solution: QpSolution = assembly.solution
        self._assembly = assembly
        self._solver: Any = None  # the package's, from the first solve on
        self._finite = False

    @abstractmethod
    def _run(self) -> QpStatus:
        """Solve the loaded problem; write :attr:`iterations`, and z and y of the assembly if there is a solution."""

    def reset(self) -> None:
        """Discard all state of earlier solves."""
        self._solver = None
        self._assembly.z[:] = 0.0
        self._assembly.y[:] = 0.0
        self._assembly.finish()

    def prepare(self) -> None:
        """Take over the matrices."""
        self._finite = self._assembly.load_matrices()

    def solve(self, dx0: Array) -> QpStatus:
        """Solve from the current point; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        loaded = self._assembly.load_vectors(dx0) and self._finite
        status = self._run() if loaded else QpStatus.NOT_FINITE
        if status in (QpStatus.SOLVED, QpStatus.MAX_ITERATIONS):
            self._assembly.finish()
        elif self.warm_started:
            self._solver = None
        return status
