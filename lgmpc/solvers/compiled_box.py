"""The sweep of box FDDP with what surrounds it in C (``box.c``), where numpy takes longer for it than for the sweep."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from importlib.resources import files

import numpy as np

from lgmpc.compile import compile_source
from lgmpc.ocp import ShootingFunctions
from lgmpc.solvers.box import BoxSweep
from lgmpc.typing import Array

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
        f, m = self._functions, self._model
        n, nu = self.dus.shape
        ndx = self.dxs.shape[1]
        self._plan = np.array([n, ndx, nu, 0], dtype=np.int64)
        self._move, self._by_control = np.zeros((n, nu)), np.zeros((n, nu))
        self._shift = np.zeros(1)
        arrays = (
            self._plan, f.jacobian, f.hessian, f.gradient, f.gaps, f.feedback, f.feedforward, self.value_hessian,
            self.value_gradient, self.held, self._move, self._shift, m.jacobian, m.hessian, m.gradient, m.gaps,
            self.dxs, self.dus, self._by_control, np.zeros(ndx),
        )  # fmt: skip
        self._memory = arrays  # the frame contains addresses only
        self._frame = (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))
        self._library = library

    def _fix(self, move: Array, closed: bool) -> None:
        self._move[...] = move
        self._plan[3] = closed
        self._library.lgmpc_fix(self._frame)

    def _follow(self) -> None:
        self._library.lgmpc_follow(self._frame)

    def _slopes(self, regularization: float) -> Array:
        self._shift[0] = regularization
        self._library.lgmpc_slopes(self._frame)
        return self._by_control


def make_box_sweep(functions: ShootingFunctions, progress: Callable[[str], None] | None = None) -> BoxSweep:
    """Return the compiled sweep, or the one in numpy where nothing can be compiled."""
    source = (files("lgmpc.solvers") / "box.c").read_text()
    library = compile_source("lgmpc_box", source, progress=progress) if functions.compiled else None
    if library is None:
        return BoxSweep(functions, progress)
    return CompiledBoxSweep(functions, ctypes.CDLL(str(library)), progress)
