"""Solvers of linear-quadratic subproblems behind one small protocol."""

from __future__ import annotations

from collections.abc import Callable

from lgmpc.errors import InputError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.active_set import ActiveSetSolver
from lgmpc.solvers.qp.dense_riccati import DenseRiccati
from lgmpc.solvers.qp.general import OsqpSolver, PiqpSolver, ProxqpSolver
from lgmpc.solvers.qp.protocol import LARGE_STAGE, QpSolution, QpSolver, RiccatiSolver
from lgmpc.solvers.qp.sparse_riccati import SparseRiccati
from lgmpc.typing import instance

__all__ = [
    "LARGE_STAGE",
    "QP_SOLVERS",
    "ActiveSetSolver",
    "DenseRiccati",
    "OsqpSolver",
    "PiqpSolver",
    "ProxqpSolver",
    "QpSolution",
    "QpSolver",
    "RiccatiSolver",
    "SparseRiccati",
    "make_qp_solver",
]

_Progress = Callable[[str], None]

_MAKERS: dict[str, Callable[[OcpQp, _Progress | None], QpSolver]] = {
    "active_set": lambda qp, progress: ActiveSetSolver(qp, progress=progress),
    "piqp": lambda qp, _: PiqpSolver(qp),
    "osqp": lambda qp, _: OsqpSolver(qp),
    "proxqp": lambda qp, _: ProxqpSolver(qp),
}
QP_SOLVERS: tuple[str, ...] = tuple(_MAKERS)
"""Names that :func:`make_qp_solver` accepts."""


def make_qp_solver(
    solver: str | Callable[[OcpQp], QpSolver], qp: OcpQp, progress: Callable[[str], None] | None = None
) -> QpSolver:
    """Make a solver with its standard settings, by the name that a config has, or by a function.

    Args:
        solver: one of :data:`QP_SOLVERS`, or a function that makes one.
        qp: the problem.
        progress: called with a description of what is being compiled, if anything is.

    Raises:
        InputError: no such solver; names the nearest.
        MissingDependencyError: its package is not installed.
    """
    instance("qp", qp, OcpQp, "an OcpQp")
    if callable(solver):
        return solver(qp)
    if not isinstance(solver, str) or solver not in _MAKERS:
        raise InputError("qp_solver", str(solver), "a solver of quadratic programmes", QP_SOLVERS)
    return _MAKERS[solver](qp, progress)
