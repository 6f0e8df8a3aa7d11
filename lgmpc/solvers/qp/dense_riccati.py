"""The Riccati solver of large stages: a loop over dense stages in C (``dense_riccati.c``).

Where a stage has tens of states, dense blocks are faster than scalar code without zeros, and are compiled once for each
size of a stage. A second solve with the same weights and other targets uses the factors of the first, at a fraction of
the cost.
"""

import ctypes
import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from lgmpc.compile import aligned_zeros, frame_of
from lgmpc.ocp import OcpQp, OcpQpStructure
from lgmpc.solvers.qp.protocol import RiccatiSolver
from lgmpc.solvers.sweep import compile_stages, work_size
from lgmpc.typing import Array, IntArray

_VALUES = 2  # their place in a frame
_LOAD, _FACTOR, _SOLVE, _MEASURE = range(4)


class DenseRiccati(RiccatiSolver):
    """:class:`~lgmpc.solvers.qp.protocol.RiccatiSolver` on dense blocks (see the module).

    Args:
        qp: the problem.
    """

    penalty = 1e7  # one update of the multipliers is enough; rounding is corrected

    def __init__(self, qp: OcpQp) -> None:
        super().__init__(qp)
        s = qp.structure
        n, nx, nu, ng, w = s.nodes, s.ndx, s.nu, s.ng, s.ndx + s.nu
        library = compile_stages("lgmpc_dense_riccati", "lgmpc.solvers.qp", nx, nu)
        self.available = library is not None
        call: Callable[[Any], int] = _unavailable if library is None else library.lgmpc_dense_riccati

        def measure(part: str, *sizes: int) -> int:
            return 0 if library is None else work_size(library, f"lgmpc_dense_riccati_{part}", *sizes)

        self._tall = measure("tall")
        self._factors = aligned_zeros(n * measure("factors"))
        places = _places(s, self._tall, measure("high"))
        plan = np.array([n, ng, s.size, len(places)], dtype=np.int64)
        self._last, self._last_gradient = np.zeros((nx, nx)), np.zeros(nx)
        self._gradient, self._gaps, self.residual = np.zeros((n, w)), np.zeros((n, nx)), np.zeros((n, w))

        own = (
            places, np.zeros(0), aligned_zeros(n * measure("stage", ng)),
            self._factors, aligned_zeros((n + 1) * measure("togo")), np.zeros((n + 1, nx)),
            aligned_zeros(measure("work", ng)), self.weights, self._last,
        )  # fmt: skip
        point = (self.dxs, self.dus, self.costates, self.rows)
        minimiser = (
            *own, self._last_gradient, self._gradient, self._gaps, self.dx0, self.targets, *point, self._cost,
            self.multipliers, self.residual,
        )  # fmt: skip
        # A correction is the same problem with the residual as its gradient, and all that is constant zero.
        self.correction = tuple(np.zeros_like(array) for array in point)
        zeros = np.zeros(max(nx, n * nx, n * ng))
        unused = np.zeros(1)
        correction = (*own, zeros, self.residual, zeros, zeros, zeros, *self.correction, unused, unused, unused)

        def bound(mode: int, arrays: tuple[Any, ...]) -> Any:
            return functools.partial(call, ctypes.byref(frame_of(np.array([*plan, mode]), *arrays)))

        self._load = bound(_LOAD, minimiser)
        self.factoring, self.solving = (bound(_FACTOR, minimiser),), (bound(_SOLVE, minimiser),)
        self.refining = bound(_MEASURE, minimiser), bound(_SOLVE, correction)

    def load(self) -> None:
        """Take over the problem's matrices and vectors."""
        qp, nx = self.qp, self.dx0.size
        values = np.ascontiguousarray(qp.values)
        self._load.args[0]._obj[_VALUES] = values.ctypes.data
        self._gradient[:, :nx], self._gradient[:, nx:] = qp.vector("q"), qp.vector("r")
        self._gaps[...] = qp.vector("b")
        self._last[...] = qp.dense_terminal("Q")
        self._last_gradient[...] = qp.dense_terminal("q")[:, 0]
        self._load()

    def feedback(self) -> Array | None:
        """Return the gains (N, nu, ndx) K of ``du = -K dx + ...``, from the last :meth:`factor`."""
        (n, nu), nx = self.dus.shape, self.dx0.size
        factors = self._factors.reshape(n, -1)
        # Of each control its column of the eliminated Hessian: half = K^T R above, then R; R's diagonal by reciprocals.
        columns = factors[:, : nu * self._tall].reshape(n, nu, self._tall)
        transposed = np.tril(columns[:, :, nx : nx + nu], -1)
        transposed[:, np.arange(nu), np.arange(nu)] = 1.0 / factors[:, nu * self._tall :][:, :nu]
        return np.asarray(np.linalg.solve(transposed, columns[:, :, :nx]), dtype=np.float64)


def _places(s: OcpQpStructure, tall: int, high: int) -> IntArray:
    """Return (entries, 2) the place of each stored entry of a stage, and its place in the stage's dense matrices.

    The latter have columns of ``tall`` (states and controls) or ``high`` numbers (states).
    """
    nx = s.ndx
    dynamics = tall * (nx + s.nu)
    path = dynamics + high * (nx + s.nu) + tall * nx
    pairs = []
    for name, start, height, row, column in (
        ("Q", 0, tall, 0, 0), ("S", 0, tall, nx, 0), ("R", 0, tall, nx, nx),
        ("A", dynamics, high, 0, 0), ("B", dynamics, high, 0, nx),
    ):  # fmt: skip
        block = s.blocks[name]
        pairs.append((block.positions, start + block.rows + row + height * (block.columns + column)))
    block = s.blocks["S"]
    pairs.append((block.positions, block.columns + tall * (block.rows + nx)))
    for name, row in (("C", 0), ("D", nx)):  # transposed: a row of the constraint is contiguous
        block = s.blocks[name]
        pairs.append((block.positions, path + block.columns + row + tall * block.rows))
    return np.hstack([np.vstack(pair) for pair in pairs]).T.astype(np.int64, order="C")


def _unavailable(_: Any) -> int:
    return 1
