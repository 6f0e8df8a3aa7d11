"""Solvers of linear-quadratic subproblems behind one small protocol."""

from collections.abc import Callable

from lgmpc.errors import InputError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.active_set import ActiveSetSolver as ActiveSetSolver
from lgmpc.solvers.qp.dense_riccati import DenseRiccati as DenseRiccati
from lgmpc.solvers.qp.general import OsqpSolver as OsqpSolver, PiqpSolver as PiqpSolver
from lgmpc.solvers.qp.protocol import (
    LARGE_STAGE as LARGE_STAGE,
    QpSolution as QpSolution,
    QpSolver as QpSolver,
    RiccatiSolver as RiccatiSolver,
)
from lgmpc.solvers.qp.sparse_riccati import SparseRiccati as SparseRiccati
from lgmpc.typing import instance

_KINDS = ActiveSetSolver, PiqpSolver, OsqpSolver
_MAKERS: dict[str, Callable[[OcpQp], QpSolver]] = {kind.name: kind for kind in _KINDS}
QP_SOLVERS: tuple[str, ...] = tuple(_MAKERS)
"""Names that :func:`make_qp_solver` accepts."""


def make_qp_solver(solver: str | Callable[[OcpQp], QpSolver], qp: OcpQp) -> QpSolver:
    """Make a solver with its standard settings, by the name that a config has, or by a function.

    Args:
        solver: one of :data:`QP_SOLVERS`, or a function that makes one.
        qp: the problem.

    Raises:
        InputError: no such solver; names the nearest.
        MissingDependencyError: its package is not installed.
    """
    instance("qp", qp, OcpQp, "an OcpQp")
    if callable(solver):
        return solver(qp)
    if not isinstance(solver, str) or solver not in _MAKERS:
        raise InputError("qp_solver", str(solver), "a solver of quadratic programmes", QP_SOLVERS)
    return _MAKERS[solver](qp)
