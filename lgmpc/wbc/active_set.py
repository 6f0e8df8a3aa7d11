"""A dual active-set method in machine code for the whole-body QP, from the last tick's active limits on.

With the Hessian's Cholesky factor the variables are whitened, ``y = L^T x``, so that the cost is the distance from
``y0 = -L^-1 g`` and every step a projection onto the active constraints' normals, of which a thin QR factorisation is
updated from one active set to the next. The limits that were active at the last tick are tried first. Those whose
multipliers have the wrong sign are left out, which gives the minimiser under some of the limits; from there the dual
method of Goldfarb and Idnani adds one violated limit after the other ("A numerically stable dual method for solving
strictly convex quadratic programs", Math. Prog. 27, 1983). Limits that depend on the active ones (many facets meet at
the tip of a friction pyramid) replace one of them. Variables with equal bounds, such as the forces of feet in the air,
are left out of the problem.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from importlib.resources import files
from typing import Any

import numpy as np

from lgmpc.compile import compile_source
from lgmpc.typing import Array

__all__ = ["ActiveSetSolver"]

_MOST_STEPS = 200  # limits added or removed; states and targets drawn from anywhere take up to 110


class ActiveSetSolver:
    """Solves one QP after another in memory that the caller writes to (see the module).

    ::

        minimise    1/2 x^T hessian x + gradient^T x
        subject to  equality x = equality_rhs,  lower <= inequality x <= upper,  box_lower <= x <= box_upper

    Args:
        hessian: (n, n), symmetric; it has to be positive definite where the variables are not fixed.
        gradient: (n,).
        equality: (e, n).
        equality_rhs: (e,).
        inequality: (m, n).
        lower: (m,).
        upper: (m,).
        box_lower: (n,).
        box_upper: (n,).
        tolerance: largest residual of the optimality conditions.

    Attributes:
        available: whether there is machine code; without a compiler nothing is ever solved.
        solution: (n,) minimiser of the last solve.
        values: (m,) ``inequality x`` there.

    Raises:
        CompileError: the compiler failed.
    """

    def __init__(
        self,
        hessian: Array,
        gradient: Array,
        equality: Array,
        equality_rhs: Array,
        inequality: Array,
        lower: Array,
        upper: Array,
        box_lower: Array,
        box_upper: Array,
        tolerance: float,
    ) -> None:
        (m, n), e = inequality.shape, len(equality)
        self.solution: Array = np.zeros(n)
        self.values: Array = np.zeros(m)
        self._plan = np.array([n, e, m, _MOST_STEPS, 0, 0], dtype=np.int64)
        # The rest of the integers' memory holds flags of variables and limits, a byte each.
        integers = np.zeros(3 * n + (2 * n + m) // 4 + 1, dtype=np.int32)
        self._memory = (
            self._plan, np.array([tolerance]), hessian, gradient, equality, equality_rhs, inequality, lower, upper,
            box_lower, box_upper, self.solution, self.values, np.zeros(3 * n * n + 11 * n), integers,
        )  # fmt: skip
        assert all(array.flags.c_contiguous for array in self._memory)
        self._frame = (ctypes.c_void_p * len(self._memory))(*(array.ctypes.data for array in self._memory))
        library = compile_source("lgmpc_active_set", (files("lgmpc.wbc") / "active_set.c").read_text())
        self.available = library is not None
        self._call: Callable[[Any], int] = (
            _unavailable if library is None else ctypes.CDLL(str(library)).lgmpc_active_set
        )

    @property
    def steps(self) -> int:
        """Limits that the last solve added to the active ones of the one before, or removed."""
        return int(self._plan[5])

    @property
    def active(self) -> int:
        """Number of limits that are active at the solution, without the equalities and the fixed variables."""
        return int(self._plan[4])

    def reset(self) -> None:
        """Forget the active limits: the next solve begins as the first one did."""
        self._plan[4] = 0

    def solve(self) -> bool:
        """Solve; False, and nothing of use written, where the conditions cannot be satisfied to the tolerance."""
        return self._call(self._frame) == 0


def _unavailable(_: Any) -> int:
    return 1
