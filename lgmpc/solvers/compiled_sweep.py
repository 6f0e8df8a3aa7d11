"""The backward sweep as one call: a loop over the stages in C (``sweep.c``), compiled once for each size of a stage.

A stage of 36 states and 12 controls takes 200,000 operations, mostly of two products of small matrices. On tiles that
the registers hold, in the processor's vectors, these take less time than BLAS needs.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from importlib.resources import files
from typing import Any

import numpy as np

from lgmpc.compile import SQUARES, aligned_zeros, compile_source
from lgmpc.ocp import ShootingFunctions
from lgmpc.solvers.sweep import BackwardSweep, Expansion, all_finite

__all__ = ["CompiledSweep", "compile_stages", "make_sweep", "work_size"]


class CompiledSweep(BackwardSweep):
    """:class:`~lgmpc.solvers.sweep.BackwardSweep` in machine code.

    Args:
        functions: expansion (read) and gains (written).
        library: the machine code.

    Attributes:
        plan: (3,) number of stages, whether all gaps are zero, and the interval that the sweep begins with.
        shift: (1,) regularisation.
        frame: the machine code's argument, of addresses.
        address: of the machine code.
    """

    def __init__(self, functions: Expansion | ShootingFunctions, library: ctypes.CDLL) -> None:
        super().__init__(functions)
        n = len(functions.jacobian)
        self.plan = np.array([n, 0, n - 1], dtype=np.int64)
        self.shift = np.zeros(1)
        f = functions
        arrays = (
            self.plan, self.shift, f.jacobian, f.hessian, f.gradient, f.gaps, f.last_hessian, f.last_gradient,
            f.feedback, f.feedforward, self.value_hessian, self.value_gradient, self.control_gradient,
            aligned_zeros(work_size(library, "lgmpc_sweep_work")),
        )  # fmt: skip
        addresses = [array.ctypes.data for array in arrays]
        self.frame = (ctypes.c_void_p * len(addresses))(*addresses)
        self._memory = arrays  # the frame contains addresses only
        self._call: Callable[[Any], int] = library.lgmpc_sweep
        self.address: int = ctypes.cast(library.lgmpc_sweep, ctypes.c_void_p).value or 0

    def run(self, regularization: float, *, closed: bool) -> bool:
        """Sweep once; return False if some Quu is not positive definite or a value is not finite."""
        self.shift[0] = regularization
        self.plan[1] = closed
        return self._call(self.frame) == 0 and all_finite(self.value_gradient, self.value_hessian[0])


def make_sweep(
    functions: Expansion | ShootingFunctions, progress: Callable[[str], None] | None = None
) -> BackwardSweep:
    """Return the compiled sweep, or the one in numpy where nothing can be compiled."""
    _, width, ndx = functions.jacobian.shape
    library = compile_stages("lgmpc_sweep", "lgmpc.solvers", ndx, width - ndx, progress) if functions.compiled else None
    return BackwardSweep(functions) if library is None else CompiledSweep(functions, library)


def compile_stages(
    name: str, package: str, ndx: int, nu: int, progress: Callable[[str], None] | None = None
) -> ctypes.CDLL | None:
    """Return the library of a recursion over stages of one size, None where nothing can be compiled.

    Args:
        name: ``lgmpc_`` and the name of the C source.
        package: package of the C source.
        ndx: dimension of a state's tangent space.
        nu: of the control.
        progress: called with a description of what is being compiled.
    """
    own = files(package) / f"{name.removeprefix('lgmpc_')}.c"
    parts = (
        SQUARES,
        f"#define NX {ndx}\n#define NU {nu}\n",
        (files("lgmpc.solvers") / "tiles.c").read_text(),
        own.read_text(),
    )
    library = compile_source(f"{name}_{ndx}_{nu}", "".join(parts), progress=progress)
    return None if library is None else ctypes.CDLL(str(library))


def work_size(library: ctypes.CDLL, function: str, *sizes: int) -> int:
    """Return the size of the work memory that a library's function reports for given integers."""
    measure = library[function]
    measure.restype, measure.argtypes = ctypes.c_longlong, [ctypes.c_longlong] * len(sizes)
    return int(measure(*sizes))
