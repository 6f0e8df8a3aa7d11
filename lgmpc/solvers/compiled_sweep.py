"""The backward sweep as one call: a loop over the stages in C that calls SciPy's BLAS and LAPACK.

A stage of 36 states and 12 controls has products of a few hundred thousand operations: BLAS does them in 15 us, and the
dozen calls from Python around them would cost as much again.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from lgmpc.compile import compile_source
from lgmpc.solvers.routines import routine_addresses
from lgmpc.solvers.sweep import BackwardSweep, Expansion, all_finite

__all__ = ["CompiledSweep", "make_sweep"]

_ROUTINES = ("dgemm", "dgemv", "dsyrk", "dtrsm", "dpotrf")  # in the order in which the C code expects them

# Matrices are stored column after column; of symmetric ones the lower triangle is computed.
_SOURCE = r"""
#include <string.h>

typedef void (*gemm_t)(char*, char*, int*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
typedef void (*gemv_t)(char*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
typedef void (*syrk_t)(char*, char*, int*, int*, double*, double*, int*, double*, double*, int*);
typedef void (*trsm_t)(char*, char*, char*, char*, int*, int*, double*, double*, int*, double*, int*);
typedef void (*potrf_t)(char*, int*, double*, int*, int*);

/* Returns 0, or 1 + the stage whose Quu is not positive definite. */
__attribute__((visibility("default"))) int lgmpc_sweep(void** frame) {
  const long long* plan = (const long long*) frame[0];
  const double reg = *(const double*) frame[1];
  double *jacobian = frame[2], *hessian = frame[3], *gradient = frame[4], *gaps = frame[5];
  double *last_hessian = frame[6], *last_gradient = frame[7], *feedback = frame[8], *feedforward = frame[9];
  double *value = frame[10], *slope = frame[11], *control = frame[12], *work = frame[13];
  gemm_t gemm = (gemm_t) frame[14];
  gemv_t gemv = (gemv_t) frame[15];
  syrk_t syrk = (syrk_t) frame[16];
  trsm_t trsm = (trsm_t) frame[17];
  potrf_t potrf = (potrf_t) frame[18];
  int nx = (int) plan[1], nu = (int) plan[2], w = nx + nu, closed = (int) plan[3];
  int half = w / 2, rest = w - w / 2, one = 1, info = 0, i, j;
  long long n = plan[0], t;
  double plus = 1, minus = -1, zero = 0;
  double *product = work, *q = product + nx * w, *g = q + w * w;
  double *quu = q + nx + (long long) nx * w, *qux = q + nx, *v, *vs;

  v = value + n * nx * nx;
  vs = slope + n * nx;
  memcpy(v, last_hessian, sizeof(double) * nx * nx);
  memcpy(vs, last_gradient, sizeof(double) * nx);
  for (i = 0; i < nx; ++i) v[i * (nx + 1)] += reg;
  if (!closed) gemv("N", &nx, &nx, &plus, v, &nx, gaps + n * nx, &one, &plus, vs, &one);

  for (t = n - 1; t >= 0; --t) {
    double *f = jacobian + t * w * nx, *k = feedforward + t * nu, *feed = feedback + t * nu * nx;
    gemm("N", "N", &nx, &w, &nx, &plus, v, &nx, f, &nx, &zero, product, &nx);
    memcpy(q, hessian + t * w * w, sizeof(double) * w * w);
    gemm("T", "N", &w, &half, &nx, &plus, f, &nx, product, &nx, &plus, q, &w);
    gemm("T", "N", &rest, &rest, &nx, &plus, f + half * nx, &nx, product + half * nx, &nx, &plus,
         q + half * (w + 1), &w);
    memcpy(g, gradient + t * w, sizeof(double) * w);
    gemv("T", &nx, &w, &plus, f, &nx, vs, &one, &plus, g, &one);
    v = value + t * nx * nx;
    vs = slope + t * nx;
    if (nu > 0) {
      memcpy(control + t * nu, g + nx, sizeof(double) * nu);
      memcpy(k, g + nx, sizeof(double) * nu);
      for (i = 0; i < nu; ++i) quu[i * (w + 1)] += reg;
      potrf("L", &nu, quu, &w, &info);
      if (info) return (int) t + 1;
      trsm("L", "L", "N", "N", &nu, &nx, &plus, quu, &w, qux, &w);
      trsm("L", "L", "N", "N", &nu, &one, &plus, quu, &w, k, &nu);
      syrk("L", "T", &nx, &nu, &minus, qux, &w, &plus, q, &w);
      gemv("T", &nu, &nx, &minus, qux, &w, k, &one, &plus, g, &one);
      trsm("L", "L", "T", "N", &nu, &nx, &plus, quu, &w, qux, &w);
      trsm("L", "L", "T", "N", &nu, &one, &plus, quu, &w, k, &nu);
      for (j = 0; j < nx; ++j)
        for (i = 0; i < nu; ++i) feed[i * nx + j] = qux[i + j * w];
    }
    for (j = 0; j < nx; ++j) {
      v[j * (nx + 1)] = q[j * (w + 1)] + reg;
      for (i = j + 1; i < nx; ++i) v[i + j * nx] = v[j + i * nx] = q[i + j * w];
    }
    memcpy(vs, g, sizeof(double) * nx);
    if (!closed) gemv("N", &nx, &nx, &plus, v, &nx, gaps + t * nx, &one, &plus, vs, &one);
  }
  return 0;
}
"""


class CompiledSweep(BackwardSweep):
    """:class:`~lgmpc.solvers.sweep.BackwardSweep` in machine code.

    Args:
        functions: where the expansion is read and the gains are written.
        library: the machine code.
    """

    def __init__(self, functions: Expansion, library: ctypes.CDLL) -> None:
        super().__init__(functions)
        n, width, ndx = functions.jacobian.shape
        self._plan = np.array([n, ndx, width - ndx, 0], dtype=np.int64)
        self._shift = np.zeros(1)
        f = functions
        arrays = (
            self._plan, self._shift, f.jacobian, f.hessian, f.gradient, f.gaps, f.last_hessian, f.last_gradient,
            f.feedback, f.feedforward, self.value_hessian, self.value_gradient, self.control_gradient,
            np.zeros(width * (ndx + width + 1)),
        )  # fmt: skip
        addresses = [array.ctypes.data for array in arrays] + routine_addresses(*_ROUTINES)
        self._frame = (ctypes.c_void_p * len(addresses))(*addresses)
        self._memory = arrays  # the frame holds addresses only
        self._call: Callable[[Any], int] = library.lgmpc_sweep

    def run(self, regularization: float, *, closed: bool) -> bool:
        """Sweep once; False if some Quu is not positive definite or a number is not finite."""
        self._shift[0] = regularization
        self._plan[3] = closed
        return self._call(self._frame) == 0 and all_finite(self.value_gradient, self.value_hessian[0])


def make_sweep(functions: Expansion, progress: Callable[[str], None] | None = None) -> BackwardSweep:
    """The compiled sweep; in numpy where nothing can be compiled."""
    library = compile_source("lgmpc_sweep", _SOURCE, progress=progress) if functions.compiled else None
    return BackwardSweep(functions) if library is None else CompiledSweep(functions, ctypes.CDLL(str(library)))
