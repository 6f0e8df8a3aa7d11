"""The rows of an augmented Lagrangian: which are active, their penalties, and the multipliers that follow.

Row by row it is ``rho/2 dist(row + mu / rho, [lower, upper])^2``: a row outside its bounds, shifted by its multiplier
estimate mu, is active, and its penalty aims at the nearest point within them. A loop in C (``penalties.c``): in numpy
it would take half as long as a small problem's Riccati sweep.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from importlib.resources import files

import numpy as np

from lgmpc.compile import compile_source
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.protocol import RiccatiSolver
from lgmpc.typing import Array

__all__ = ["Penalties"]


class Penalties:
    """Penalties of the rows of a problem, on the memory of its Riccati solver.

    Args:
        qp: the problem, whose bounds are read.
        riccati: its rows are read, its weights, targets and multipliers written.
        known: (N, ng) multipliers that :meth:`resume` begins with.
        least: smaller ones count as zero.
        progress: called with a description of what is being compiled.

    Attributes:
        available: whether there is machine code; else nothing can be called.
        mu: (N, ng) multiplier estimates.
        point: (N, ng) rows that define the active set.
        difference: largest difference of the multipliers from the augmented Lagrangian's.
        residual: largest residual of bounds and complementarity.
        squares: sum of squares of the rows' distances from their shifted bounds.
        changed: number of rows that became active or inactive.
    """

    def __init__(
        self,
        qp: OcpQp,
        riccati: RiccatiSolver,
        known: Array,
        least: float,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        s = qp.structure
        source = files("lgmpc.solvers.qp").joinpath("penalties.c").read_text(encoding="utf-8")
        path = compile_source("lgmpc_penalties", source, progress=progress)
        self.available = path is not None
        self.mu: Array = np.zeros((s.nodes, s.ng))
        self.point: Array = np.zeros((s.nodes, s.ng))
        self._numbers, self._measures = np.array([least, 0.0]), np.zeros(4)
        r = riccati
        parts = (
            np.array([s.nodes, s.ng, s.size], dtype=np.int64), self._numbers, qp.vector("lower"), qp.vector("upper"),
            known, self.mu, self.point, r.weights, r.targets, r.rows, r.multipliers, self._measures,
        )  # fmt: skip
        self._memory = parts  # the frame contains addresses only
        self._frame = (ctypes.c_void_p * len(parts))(*(part.ctypes.data for part in parts))
        if path is not None:
            library = ctypes.CDLL(str(path))
            self._resume, self._penalise = library.lgmpc_resume, library.lgmpc_penalise
            self._measure = library.lgmpc_measure

    @property
    def rho(self) -> float:
        """The penalty of active rows."""
        return float(self._numbers[1])

    @rho.setter
    def rho(self, value: float) -> None:
        self._numbers[1] = value

    def resume(self) -> None:
        """Take over the known multipliers; rows that have one are at their bounds, others within them, near zero."""
        self._resume(self._frame)

    def penalise(self) -> None:
        """Write the penalties of the rows that are active at :attr:`point`."""
        self._penalise(self._frame)

    def measure(self) -> None:
        """Write the multipliers with which the solver's minimiser is stationary, and the measures of its rows."""
        self._measure(self._frame)
        self.difference, self.residual, self.squares, self.changed = self._measures.tolist()
