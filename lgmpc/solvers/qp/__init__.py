"""Solvers of linear-quadratic subproblems behind one small protocol."""

from __future__ import annotations

from collections.abc import Callable

from lgmpc.errors import InputError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.active_set import LARGE_STAGE, ActiveSetSettings, ActiveSetSolver
from lgmpc.solvers.qp.dense_riccati import DenseRiccati
from lgmpc.solvers.qp.osqp import OsqpSettings, OsqpSolver
from lgmpc.solvers.qp.piqp import Cascade, PiqpSettings, PiqpSolver
from lgmpc.solvers.qp.protocol import QpSolution, QpSolver, RiccatiSolver
from lgmpc.solvers.qp.proxqp import ProxqpSettings, ProxqpSolver
from lgmpc.solvers.qp.sparse_riccati import SparseRiccati
from lgmpc.typing import instance

__all__ = [
    "LARGE_STAGE",
    "QP_SOLVERS",
    "ActiveSetSettings",
    "ActiveSetSolver",
    "Cascade",
    "DenseRiccati",
    "OsqpSettings",
    "OsqpSolver",
    "PiqpSettings",
    "PiqpSolver",
    "ProxqpSettings",
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
    "active_set_dense": lambda qp, progress: ActiveSetSolver(qp, riccati=DenseRiccati(qp, progress), progress=progress),
    "piqp": lambda qp, _: PiqpSolver(qp),
    "piqp_multistage": lambda qp, _: PiqpSolver(qp, PiqpSettings(kkt_solver="sparse_multistage")),
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
