"""Mehrotra's predictor and corrector, in the rows of a problem.

It is the part of an interior point method without the minimisation of the cost with penalised rows.

A row ``lower <= row <= upper`` has a slack ``s = +-(bound - row)`` and a multiplier ``z`` for each of its bounds. The
Newton step on ``s z = target`` minimises the cost with the penalties

    sum_bounds  1/2 (z / s) (row - bound)^2 +- (2 z + (target - s z) / s) row,

which is, row by row, one weight and one target of :class:`~lgmpc.solvers.qp.protocol.RiccatiSolver`. Mehrotra, "On the
implementation of a primal-dual interior point method", SIAM J. Optim. 2, 1992.
"""

from __future__ import annotations

from importlib.resources import files

import numpy as np

from lgmpc.compile import EXACT, compile_source, frame_of
from lgmpc.typing import Array

__all__ = ["CentralPath", "nearest_in"]

_SHORTEST = 1e-6  # a shorter step counts as none
_LONG = 0.8  # a step as long as this separates the active bounds from the others
_SETTLED = 0.02  # share of the active bounds that may still change when they count as identified


def nearest_in(values: Array, lower: Array, upper: Array) -> Array:
    """Return the nearest points to values within bounds (numpy's clip takes three times as long on small arrays)."""
    out: Array = np.maximum(values, lower)
    np.minimum(out, upper, out=out)
    return out


class CentralPath:
    """Slacks and multipliers of all finite bounds on their way to a solution; see the module.

    The calls of a solve: :meth:`begin`, :meth:`start`, and in each iteration :meth:`predict`, :meth:`correct`,
    :meth:`step`, with a minimisation after each but :meth:`start` and :meth:`step`, the one after :meth:`correct` with
    the same weights as before.

    Args:
        lower: (N, ng) bounds of the rows; minus infinity for none. Stages may be further apart in memory.
        upper: (N, ng) the same from above. Where both are equal there is no interior: such rows are penalised
            throughout, with a multiplier that grows (Hestenes' and Powell's).
        rows: (N, ng) of the last minimisation, read.
        weights: (N, ng) of the rows' penalties, written.
        targets: (N, ng) the same.
        known: (N, ng) multipliers that are near the solution's, zero for none: the path begins as near to its end.

    Attributes:
        available: whether there is machine code; else nothing can be called.
        point: (N, ng) of :meth:`identify`, rows of which active ones are at their bounds.
        multipliers: (N, ng) of :meth:`identify`, of the active bounds.
        settled: whether the last steps identified the active bounds.
    """

    def __init__(
        self,
        lower: Array,
        upper: Array,
        rows: Array,
        weights: Array,
        targets: Array,
        known: Array,
    ) -> None:
        source = files("lgmpc.solvers.qp").joinpath("central_path.c").read_text(encoding="utf-8")
        library = compile_source("lgmpc_central_path", EXACT + source)
        self.available = library is not None
        self.settled = False
        self.point, self.multipliers, held = (np.zeros(rows.shape) for _ in range(3))
        self._numbers, self._measures = np.zeros(2), np.zeros(3)
        plan = np.array([*rows.shape, lower.strides[0] // lower.itemsize], dtype=np.int64)
        self._frame = frame_of(
            plan, self._numbers, lower, upper, known, rows, weights, targets, held, np.zeros((*rows.shape, 2, 9)),
            np.zeros(1, dtype=np.int64), self.point, self.multipliers, self._measures,
        )  # fmt: skip
        if library is not None:
            self._begin, self._start = library.lgmpc_path_begin, library.lgmpc_path_start
            self._predict, self._correct = library.lgmpc_path_predict, library.lgmpc_path_correct
            self._step, self._identify = library.lgmpc_path_step, library.lgmpc_path_identify

    def begin(self, start: float, penalty: float) -> None:
        """Write the penalties of the first point: targets are the values within bounds nearest to zero.

        Args:
            start: penalty of all rows at the first point; some control weights.
            penalty: of rows with equal bounds, much larger.
        """
        self._numbers[:] = start, penalty
        self._begin(self._frame)

    def start(self) -> None:
        """Make slacks and multipliers from the rows of the first point and the known multipliers."""
        self._start(self._frame)

    def predict(self) -> None:
        """Write the penalties of the step to ``s z = 0``."""
        self._predict(self._frame)

    def correct(self) -> None:
        """Write, from the rows of the prediction, the penalties of the step to the central path, of second order."""
        self._correct(self._frame)

    def step(self) -> bool:
        """Move towards the rows of the correction; False if that is impossible."""
        self._step(self._frame)
        changed, active, length = self._measures.tolist()
        self.settled = changed <= _SETTLED * active and length > _LONG
        return bool(length > _SHORTEST)  # not NaN

    def identify(self) -> None:
        """Write :attr:`point` and :attr:`multipliers` of the active rows."""
        self._identify(self._frame)
