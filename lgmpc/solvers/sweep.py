"""The backward sweep of differential dynamic programming, on arrays allocated once: one call of machine code.

With the cost-to-go ``1/2 dx^T V dx + v^T dx`` at the end of an interval, ``F = [A B]``, the stage's Hessian H and
gradient h,

    [Qxx Qxu; Qux Quu] = H + F^T V F,      [Qx; Qu] = h + F^T v,
    K = Quu^-1 Qux,   k = Quu^-1 Qu,   V <- Qxx - Qxu K,   v <- Qx - K^T Qu,

with a multiple of the identity added to Quu and to V. v is the gradient with the gap of the node closed:
``v <- v + V gap``. Mastalli et al., "Crocoddyl: an efficient and versatile framework for multi-contact optimal
control", ICRA 2020.

The loop over the stages is C (``sweep.c``), compiled once for each size of a stage: one of 36 states and 12 controls
takes 200,000 operations, mostly of two products of small matrices, and on tiles that the registers hold these take less
time than BLAS needs. Where nothing can be compiled it is numpy.
"""

import ctypes
import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from scipy.linalg import lapack

from lgmpc.compile import SQUARES, aligned_zeros, compile_source, frame_of
from lgmpc.ocp import OcpQp, ShootingFunctions
from lgmpc.typing import Array


@dataclass
class Expansion:
    """Arrays that a sweep reads, and the gains that it writes, as in :class:`~lgmpc.ocp.ShootingFunctions`.

    Attributes:
        jacobian: (N, ndx + nu, ndx) ``[A B]^T``.
        hessian: (N, ndx + nu, ndx + nu).
        gradient: (N, ndx + nu).
        gaps: (N+1, ndx).
        last_hessian: (ndx, ndx).
        last_gradient: (ndx,).
        feedback: (N, nu, ndx) K.
        feedforward: (N, nu) k.
        compiled: whether the sweep is to be machine code, if there is a compiler.
    """

    jacobian: Array
    hessian: Array
    gradient: Array
    gaps: Array
    last_hessian: Array
    last_gradient: Array
    feedback: Array
    feedforward: Array
    compiled: bool

    @classmethod
    def of_curvature(cls, jacobian: Array, hessian: Array, last_hessian: Array) -> "Expansion":
        """Return an expansion without gradients and gaps, to be swept in numpy."""
        (n, width, ndx), zeros = jacobian.shape, np.zeros
        gains = zeros((n, width - ndx, ndx)), zeros((n, width - ndx))
        vectors = zeros((n, width)), zeros((n + 1, ndx)), last_hessian, zeros(ndx)
        return cls(jacobian, hessian, *vectors, *gains, compiled=False)


def all_finite(*arrays: Array) -> bool:
    """Return whether no entry is NaN or infinite (or too large to square), in one pass."""
    # The dot product would copy rows that are not contiguous. A loop takes half the time of all() of a generator.
    for array in arrays:
        if not math.isfinite(np.vdot(array, array) if array.flags.c_contiguous else array.sum()):
            return False
    return True


def products(matrices: Array, vectors: Array) -> Array:
    """Return (N, m) each stage's product of a matrix (N, m, n) and a vector (N, n); einsum takes twice as long."""
    return (matrices @ vectors[..., None])[..., 0]


def bilinear(left: Array, matrices: Array, right: Array) -> float:
    """Return the sum of ``left_k^T M_k right_k`` over all stages; einsum takes five times as long."""
    return float(np.vdot(left, products(matrices, right)))


class BackwardSweep:
    """The backward sweep over an expansion (see the module).

    Args:
        functions: expansion (read) and gains (written).

    Attributes:
        value_hessian: (N+1, ndx, ndx) V.
        value_gradient: (N+1, ndx) v.
        control_gradient: (N, nu) Qu.
        compiled: whether it is machine code.
        plan: (3,) of the machine code: number of stages, whether all gaps are zero, the interval that it begins with.
        shift: (1,) its regularisation.
        frame: its argument, of addresses.
        address: of the machine code, 0 if there is none.
    """

    def __init__(self, functions: Expansion | ShootingFunctions) -> None:
        f = self._functions = functions
        n, width, ndx = f.jacobian.shape
        self.value_hessian: Array = np.zeros((n + 1, ndx, ndx))
        self.value_gradient: Array = np.zeros((n + 1, ndx))
        self.control_gradient: Array = np.zeros((n, width - ndx))
        library = compile_stages("lgmpc_sweep", "lgmpc.solvers", ndx, width - ndx) if f.compiled else None
        self.compiled = library is not None
        self.plan, self.shift = np.array([n, 0, n - 1], dtype=np.int64), np.zeros(1)
        self.frame = frame_of(
            self.plan, self.shift, f.jacobian, f.hessian, f.gradient, f.gaps, f.last_hessian, f.last_gradient,
            f.feedback, f.feedforward, self.value_hessian, self.value_gradient, self.control_gradient,
            aligned_zeros(0 if library is None else work_size(library, "lgmpc_sweep_work")),
        )  # fmt: skip
        self._call: Callable[[Any], int] = self._in_numpy if library is None else library.lgmpc_sweep
        self.address: int = 0 if library is None else ctypes.cast(library.lgmpc_sweep, ctypes.c_void_p).value or 0

    def run(self, regularization: float, *, closed: bool) -> bool:
        """Sweep once; return False if some Quu is not positive definite or a value is not finite.

        Args:
            regularization: added to the diagonals of Quu and V.
            closed: whether all gaps are zero.
        """
        self.shift[0] = regularization
        self.plan[1] = closed
        return self._call(self.frame) == 0 and all_finite(self.value_gradient, self.value_hessian[0])

    def expected(self, *, closed: bool) -> tuple[float, float]:
        """Return slope and curvature of the model's decrease along its step, without the part of the roll-out's states.

        Args:
            closed: whether all gaps are zero.
        """
        f = self._functions
        slope = float(np.vdot(self.control_gradient, f.feedforward))
        curvature = -slope
        if not closed:
            slope -= float(np.vdot(self.value_gradient, f.gaps))
            curvature += bilinear(f.gaps, self.value_hessian, f.gaps)
        return slope, curvature

    def _in_numpy(self, frame: object) -> int:
        """Sweep once without machine code; return 1 if some Quu is not positive definite."""
        f, ndx, regularization, closed = (
            self._functions,
            len(self._functions.last_gradient),
            self.shift[0],
            self.plan[1],
        )
        v_next, g_next = self.value_hessian[-1], self.value_gradient[-1]
        v_next[...] = f.last_hessian + regularization * np.eye(ndx)
        g_next[...] = f.last_gradient
        if not closed:
            g_next += v_next @ f.gaps[-1]
        for t in reversed(range(len(f.jacobian))):
            jacobian, v, g = f.jacobian[t], self.value_hessian[t], self.value_gradient[t]
            q = jacobian @ v_next @ jacobian.T + f.hessian[t]
            both = jacobian @ g_next + f.gradient[t]
            qux, quu, qu = q[ndx:, :ndx], q[ndx:, ndx:], both[ndx:]
            self.control_gradient[t] = qu
            if qu.size:
                quu += regularization * np.eye(qu.size)
                factor, failed = lapack.dpotrf(quu, 1, 0)
                if failed:
                    return 1
                solved, _ = lapack.dpotrs(factor, np.column_stack([qux, qu]), 1)
                f.feedback[t], f.feedforward[t] = solved[:, :-1], solved[:, -1]
            drop = q[:ndx, :ndx] - qux.T @ f.feedback[t]
            v[...] = 0.5 * (drop + drop.T) + regularization * np.eye(ndx)
            g[...] = both[:ndx] - qu @ f.feedback[t]
            if not closed:
                g += v @ f.gaps[t]
            v_next, g_next = v, g
        return 0


def penalised_feedback(qp: OcpQp, weights: Array | float = 0.0) -> Array:
    """Return the gains (N, nu, ndx) K of ``du = -K dx`` with the cost of each row ``weight / 2 row^2``.

    Args:
        qp: the problem; its bounds are not used.
        weights: (N, ng) of the rows.

    Returns:
        The gains; of length 0 where the cost is not strictly convex along the dynamics.
    """
    m = {name: qp.dense(name) for name in "ABQSRCD"}
    jacobian = np.concatenate([m["A"], m["B"]], axis=2).swapaxes(1, 2).copy()
    rows = np.concatenate([m["C"], m["D"]], axis=2)
    hessian = np.block([[m["Q"], m["S"].swapaxes(1, 2)], [m["S"], m["R"]]])
    hessian += rows.swapaxes(1, 2) @ (np.broadcast_to(weights, rows.shape[:2])[..., None] * rows)
    model = Expansion.of_curvature(jacobian, hessian, qp.dense_terminal("Q"))
    return model.feedback if BackwardSweep(model).run(0.0, closed=True) else model.feedback[:0]


def compile_stages(name: str, package: str, ndx: int, nu: int) -> ctypes.CDLL | None:
    """Return the library of a recursion over stages of one size, None where nothing can be compiled.

    Args:
        name: ``lgmpc_`` and the name of the C source.
        package: package of the C source.
        ndx: dimension of a state's tangent space.
        nu: of the control.
    """
    own = files(package) / f"{name.removeprefix('lgmpc_')}.c"
    parts = (
        SQUARES,
        f"#define NX {ndx}\n#define NU {nu}\n",
        (files("lgmpc.solvers") / "tiles.c").read_text(),
        own.read_text(),
    )
    return compile_source(f"{name}_{ndx}_{nu}", "".join(parts))


def work_size(library: ctypes.CDLL, function: str, *sizes: int) -> int:
    """Return the size of the work memory that a library's function reports for given integers."""
    measure = library[function]
    measure.restype, measure.argtypes = ctypes.c_longlong, [ctypes.c_longlong] * len(sizes)
    return int(measure(*sizes))
