"""The sweep of box FDDP as one call: active sets and their sweeps in C (``box.c``)."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from importlib.resources import files

import numpy as np

from lgmpc.compile import compile_source
from lgmpc.ocp import ShootingFunctions
from lgmpc.solvers.box import EXCHANGES, ROUNDING, BoxSweep
from lgmpc.solvers.compiled_sweep import CompiledSweep

__all__ = ["CompiledBoxSweep", "make_box_sweep"]


class CompiledBoxSweep(BoxSweep):
    """:class:`~lgmpc.solvers.box.BoxSweep` in machine code.

    Args:
        functions: expansion and bounds (read) and gains (written).
        library: the machine code.
        progress: called with a description of what is being compiled.
    """

    def __init__(
        self, functions: ShootingFunctions, library: ctypes.CDLL, progress: Callable[[str], None] | None = None
    ) -> None:
        super().__init__(functions, progress)
        f, m, sweep = self._functions, self._model, self._sweep
        assert isinstance(sweep, CompiledSweep)
        (n, nu), ndx = self.dus.shape, self.dxs.shape[1]
        self._plan = np.array([n, ndx, nu, 0, EXCHANGES], dtype=np.int64)
        self._expected = np.zeros(2)
        arrays = (
            self._plan, f.jacobian, f.hessian, f.gradient, f.gaps, f.feedback, f.feedforward, self.value_hessian,
            self.value_gradient, f.us, f.u_lower, f.u_upper, sweep.shift, np.array([ROUNDING]), self.held, m.jacobian,
            m.hessian, m.gradient, m.gaps, self.dxs, self.dus, np.zeros(ndx), self._expected,
            np.zeros(n, dtype=np.int64), f.last_hessian, f.last_gradient,
        )  # fmt: skip
        self._memory = arrays  # the frame contains addresses only
        addresses = [array.ctypes.data for array in arrays]
        addresses += [sweep.address, ctypes.addressof(sweep.frame), sweep.plan.ctypes.data]
        self._frame = (ctypes.c_void_p * len(addresses))(*addresses)
        self._shift = sweep.shift
        self._call: Callable[[object], int] = library.lgmpc_box

    def run(self, regularization: float, *, closed: bool) -> bool:
        """Minimise, and write the gains; return False if more regularisation is required."""
        self._shift[0] = regularization
        self._plan[3] = closed
        return self._call(self._frame) == 0

    def expected(self, *, closed: bool) -> tuple[float, float]:
        """Return slope and curvature of the model's decrease along its step, as the last run computed them."""
        slope, curvature = self._expected.tolist()
        return slope, curvature


def make_box_sweep(functions: ShootingFunctions, progress: Callable[[str], None] | None = None) -> BoxSweep:
    """Return the compiled sweep, or the one in numpy where nothing can be compiled."""
    source = (files("lgmpc.solvers") / "box.c").read_text()
    library = compile_source("lgmpc_box", source, progress=progress) if functions.compiled else None
    if library is None:
        return BoxSweep(functions, progress)
    return CompiledBoxSweep(functions, ctypes.CDLL(str(library)), progress)
