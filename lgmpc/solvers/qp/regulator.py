"""The regulator of :mod:`lgmpc.solvers.qp.lqr` for large stages: a loop in C that calls SciPy's BLAS and LAPACK.

It minimises the same cost with the same penalties on rows; where a stage has tens of states, dense blocks are faster
than scalar code without zeros, and nothing is compiled for a new problem. A second solve with the same weights and
other targets uses the factors of the first, at a sixth of the cost.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np

from lgmpc.compile import compile_source
from lgmpc.ocp import OcpQp, OcpQpStructure
from lgmpc.solvers.routines import routine_addresses
from lgmpc.typing import Array, IntArray

__all__ = ["BlockRegulator"]

_ROUTINES = ("dgemm", "dgemv", "dsymv", "dsyrk", "dtrsm", "dpotrf")  # in the order in which the C code expects them
_LOAD, _FACTOR, _SOLVE, _MEASURE = range(4)

# Matrices are stored column after column; of symmetric ones the lower triangle is computed. A stage's matrices are
# [Q S^T; S R], [A B] and [C D]^T.
_SOURCE = r"""
#include <math.h>
#include <string.h>

typedef void (*gemm_t)(char*, char*, int*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
typedef void (*gemv_t)(char*, int*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
typedef void (*symv_t)(char*, int*, double*, double*, int*, double*, int*, double*, double*, int*);
typedef void (*syrk_t)(char*, char*, int*, int*, double*, double*, int*, double*, double*, int*);
typedef void (*trsm_t)(char*, char*, char*, char*, int*, int*, double*, double*, int*, double*, int*);
typedef void (*potrf_t)(char*, int*, double*, int*, int*);

/* Returns 0, or 1 + the stage whose Hessian in the controls is not positive definite. */
__attribute__((visibility("default"))) int lgmpc_regulator(void** frame) {
  const long long *plan = frame[0], *places = frame[1];
  double *values = frame[2], *stages = frame[3], *factors = frame[4], *togo = frame[5], *slopes = frame[6];
  double *work = frame[7], *weights = frame[8], *last_hessian = frame[9], *last_gradient = frame[10];
  double *gradient = frame[11], *gaps = frame[12], *dx0 = frame[13], *targets = frame[14], *dxs = frame[15];
  double *dus = frame[16], *costates = frame[17], *rows = frame[18], *cost = frame[19], *multipliers = frame[20];
  double *residual = frame[21];
  gemm_t gemm = (gemm_t) frame[22];
  gemv_t gemv = (gemv_t) frame[23];
  symv_t symv = (symv_t) frame[24];
  syrk_t syrk = (syrk_t) frame[25];
  trsm_t trsm = (trsm_t) frame[26];
  potrf_t potrf = (potrf_t) frame[27];
  int n = (int) plan[0], nx = (int) plan[1], nu = (int) plan[2], ng = (int) plan[3], mode = (int) plan[6];
  long long size = plan[4], entries = plan[5], e;
  int w = nx + nu, half = w / 2, rest = w - w / 2, one = 1, info = 0, used, i, j;
  long long block = (long long) w * (w + nx + ng), t;
  double plus = 1, minus = -1, zero = 0;
  double *product = work, *scaled = product + nx * w, *g = scaled + ng * w, *pull = g + w, *z = pull + ng, *hz = z + w;

  if (mode == 0) {
    for (t = 0; t < n; ++t)
      for (e = 0; e < entries; ++e) stages[t * block + places[2 * e + 1]] = values[t * size + places[2 * e]];
    return 0;
  }
  if (mode == 3) {
    for (t = 0; t < n; ++t) {
      double *h = stages + t * block, *f = h + w * w, *c = f + nx * w, *out = residual + t * w;
      memcpy(z, dxs + t * nx, sizeof(double) * nx);
      memcpy(z + nx, dus + t * nu, sizeof(double) * nu);
      memcpy(out, gradient + t * w, sizeof(double) * w);
      symv("L", &w, &plus, h, &w, z, &one, &plus, out, &one);
      gemv("T", &nx, &w, &plus, f, &nx, costates + t * nx, &one, &plus, out, &one);
      if (ng) gemv("N", &w, &ng, &plus, c, &w, multipliers + t * ng, &one, &plus, out, &one);
      for (i = 0; i < nx; ++i) out[i] = t ? out[i] - costates[(t - 1) * nx + i] : 0;
    }
    return 0;
  }

  memcpy(togo + (long long) n * nx * nx, last_hessian, sizeof(double) * nx * nx);
  memcpy(slopes + n * nx, last_gradient, sizeof(double) * nx);
  for (t = n - 1; t >= 0; --t) {
    double *h = stages + t * block, *f = h + w * w, *c = f + nx * w, *next = togo + (t + 1) * nx * nx;
    double *k = factors + t * w * w, *quu = k + nx + (long long) nx * w, *qux = k + nx;
    double *weight = weights + t * ng, *target = targets + t * ng, *slope = slopes + t * nx, *du = dus + t * nu;
    double *b = gaps + t * nx, *q = gradient + t * w;
    if (mode == 1) {
      double *p = togo + t * nx * nx;
      gemm("N", "N", &nx, &w, &nx, &plus, next, &nx, f, &nx, &zero, product, &nx);
      memcpy(k, h, sizeof(double) * w * w);
      gemm("T", "N", &w, &half, &nx, &plus, f, &nx, product, &nx, &plus, k, &w);
      gemm("T", "N", &rest, &rest, &nx, &plus, f + half * nx, &nx, product + half * nx, &nx, &plus,
           k + half * (w + 1), &w);
      for (used = 0, i = 0; i < ng; ++i)
        if (weight[i] != 0) {
          double root = sqrt(weight[i]), *to = scaled + w * used++, *from = c + w * i;
          for (j = 0; j < w; ++j) to[j] = root * from[j];
        }
      if (used) syrk("L", "N", &w, &used, &plus, scaled, &w, &plus, k, &w);
      if (nu) {
        potrf("L", &nu, quu, &w, &info);
        if (info) return (int) t + 1;
        trsm("L", "L", "N", "N", &nu, &nx, &plus, quu, &w, qux, &w);
        syrk("L", "T", &nx, &nu, &minus, qux, &w, &plus, k, &w);
      }
      for (j = 0; j < nx; ++j)
        for (i = j; i < nx; ++i) p[i + j * nx] = p[j + i * nx] = k[i + j * w];
    }
    memcpy(product, slopes + (t + 1) * nx, sizeof(double) * nx);
    gemv("N", &nx, &nx, &plus, next, &nx, b, &one, &plus, product, &one);
    memcpy(g, q, sizeof(double) * w);
    gemv("T", &nx, &w, &plus, f, &nx, product, &one, &plus, g, &one);
    if (ng) {
      for (i = 0; i < ng; ++i) pull[i] = -weight[i] * target[i];
      gemv("N", &w, &ng, &plus, c, &w, pull, &one, &plus, g, &one);
    }
    memcpy(slope, g, sizeof(double) * nx);
    if (nu) {
      memcpy(du, g + nx, sizeof(double) * nu);
      trsm("L", "L", "N", "N", &nu, &one, &plus, quu, &w, du, &nu);
      gemv("T", &nu, &nx, &minus, qux, &w, du, &one, &plus, slope, &one);
    }
  }

  memcpy(dxs, dx0, sizeof(double) * nx);
  *cost = 0;
  for (t = 0; t < n; ++t) {
    double *h = stages + t * block, *f = h + w * w, *c = f + nx * w, *next = togo + (t + 1) * nx * nx;
    double *k = factors + t * w * w, *quu = k + nx + (long long) nx * w, *qux = k + nx;
    double *dx = dxs + t * nx, *after = dx + nx, *du = dus + t * nu, *costate = costates + t * nx;
    double *b = gaps + t * nx, *q = gradient + t * w;
    if (nu) {
      gemv("N", &nu, &nx, &plus, qux, &w, dx, &one, &plus, du, &one);
      trsm("L", "L", "T", "N", &nu, &one, &minus, quu, &w, du, &nu);
    }
    memcpy(z, dx, sizeof(double) * nx);
    memcpy(z + nx, du, sizeof(double) * nu);
    memcpy(after, b, sizeof(double) * nx);
    gemv("N", &nx, &w, &plus, f, &nx, z, &one, &plus, after, &one);
    memcpy(costate, slopes + (t + 1) * nx, sizeof(double) * nx);
    gemv("N", &nx, &nx, &plus, next, &nx, after, &one, &plus, costate, &one);
    if (ng) gemv("T", &w, &ng, &plus, c, &w, z, &one, &zero, rows + t * ng, &one);
    symv("L", &w, &plus, h, &w, z, &one, &zero, hz, &one);
    for (i = 0; i < w; ++i) *cost += (0.5 * hz[i] + q[i]) * z[i];
  }
  symv("L", &nx, &plus, last_hessian, &nx, dxs + n * nx, &one, &zero, hz, &one);
  for (i = 0; i < nx; ++i) *cost += (0.5 * hz[i] + last_gradient[i]) * dxs[n * nx + i];
  return 0;
}
"""


class BlockRegulator:
    """Minimises an :class:`~lgmpc.ocp.OcpQp` with penalised rows instead of its bounds (see the module).

    Args:
        structure: of the problems.
        progress: called with a description of what is being compiled.

    Attributes:
        available: whether there is machine code; without a compiler nothing here can be called.
        dx0: (ndx,) first state.
        weights: (N, ng) of the rows' penalties, not negative.
        targets: (N, ng) of the rows.
        dxs: (N+1, ndx) the minimiser's states.
        dus: (N, nu) its controls.
        costates: (N, ndx) multipliers of the dynamics.
        rows: (N, ng) values ``C dx + D du``.
        multipliers: (N, ng) of the rows, after :meth:`take_multipliers`.
    """

    def __init__(self, structure: OcpQpStructure, progress: Callable[[str], None] | None = None) -> None:
        s = structure
        n, nx, nu, ng, w = s.nodes, s.ndx, s.nu, s.ng, s.ndx + s.nu
        places = _places(s)
        self._plan = np.array([n, nx, nu, ng, s.size, len(places), _LOAD], dtype=np.int64)
        self._values, self._last, self._last_gradient = np.zeros((n, s.size)), np.zeros((nx, nx)), np.zeros(nx)
        self._gradient, self._gaps, self._residual = np.zeros((n, w)), np.zeros((n, nx)), np.zeros((n, w))
        self.dx0: Array = np.zeros(nx)
        self.weights: Array = np.zeros((n, ng))
        self.targets: Array = np.zeros((n, ng))
        self.dxs: Array = np.zeros((n + 1, nx))
        self.dus: Array = np.zeros((n, nu))
        self.costates: Array = np.zeros((n, nx))
        self.rows: Array = np.zeros((n, ng))
        self.multipliers: Array = np.zeros((n, ng))
        self._cost = np.zeros(1)
        own = (
            self._plan, places, self._values, np.zeros((n, w * (w + nx + ng))), np.zeros((n, w, w)),
            np.zeros((n + 1, nx, nx)), np.zeros((n + 1, nx)), np.zeros(w * (nx + ng) + 3 * w + ng), self.weights,
            self._last,
        )  # fmt: skip
        point = (self.dxs, self.dus, self.costates, self.rows)
        self._frame = _frame(
            *own, self._last_gradient, self._gradient, self._gaps, self.dx0, self.targets, *point, self._cost,
            self.multipliers, self._residual,
        )  # fmt: skip
        # A correction is the same problem with the residual as its gradient, and all that is constant zero.
        self._correction = tuple(np.zeros_like(array) for array in point)
        zeros = np.zeros(max(nx, n * nx, n * ng))
        unused = np.zeros(1)
        self._correcting = _frame(
            *own, zeros, self._residual, zeros, zeros, zeros, *self._correction, unused, unused, unused
        )
        self._memory = (own, zeros, unused)  # the frames hold addresses only
        library = compile_source("lgmpc_regulator", _SOURCE, progress=progress)
        self.available = library is not None
        self._call: Callable[[Any], int] = (
            _unavailable if library is None else ctypes.CDLL(str(library)).lgmpc_regulator
        )

    @property
    def cost(self) -> float:
        """Cost of the minimiser, without the penalties."""
        return float(self._cost[0])

    def load(self, qp: OcpQp) -> None:
        """Take over a problem's matrices and vectors (its bounds are none of the regulator's business)."""
        nx = self.dx0.size
        self._values[...] = qp.values
        self._gradient[:, :nx], self._gradient[:, nx:] = qp.vector("q"), qp.vector("r")
        self._gaps[...] = qp.vector("b")
        self._last[...] = qp.dense_terminal("Q")
        self._last_gradient[...] = qp.dense_terminal("q")[:, 0]
        self._run(_LOAD)

    def factor(self) -> bool:
        """Minimise; False if the Hessian in some stage's controls is not positive definite."""
        return self._run(_FACTOR) == 0

    def solve(self) -> None:
        """Minimise for other targets (or first state), the weights being those of the last :meth:`factor`."""
        self._run(_SOLVE)

    def take_multipliers(self) -> None:
        """Write the multipliers with which the minimiser is stationary: the penalties' slopes."""
        np.multiply(self.weights, self.rows - self.targets, out=self.multipliers)

    def stationarity(self) -> float:
        """Largest entry of the Lagrangian's gradient at the minimiser: zero but for rounding, which weights magnify."""
        self._run(_MEASURE)
        return float(np.abs(self._residual).max(initial=0.0))

    def refine(self) -> None:
        """Correct minimiser and multipliers by the last :meth:`stationarity`, with the factors there are."""
        self._plan[-1] = _SOLVE
        self._call(self._correcting)
        dxs, dus, costates, rows = self._correction
        self.dxs += dxs
        self.dus += dus
        self.costates += costates
        self.rows += rows
        self.multipliers += self.weights * rows

    def _run(self, mode: int) -> int:
        self._plan[-1] = mode
        return self._call(self._frame)


def _frame(*arrays: Array | IntArray) -> Any:
    """Addresses of arrays, and of the routines, as the C code reads them."""
    addresses = [array.ctypes.data for array in arrays] + routine_addresses(*_ROUTINES)
    return (ctypes.c_void_p * len(addresses))(*addresses)


def _places(s: OcpQpStructure) -> IntArray:
    """(entries, 2) where each stored entry of a stage is, and where it belongs in the stage's dense matrices."""
    w, nx = s.ndx + s.nu, s.ndx
    dynamics, path = w * w, w * w + nx * w
    pairs = []
    for name, start, height, row, column in (
        ("Q", 0, w, 0, 0), ("S", 0, w, nx, 0), ("R", 0, w, nx, nx),
        ("A", dynamics, nx, 0, 0), ("B", dynamics, nx, 0, nx),
    ):  # fmt: skip
        block = s.blocks[name]
        pairs.append((block.positions, start + block.rows + row + height * (block.columns + column)))
    for name, row in (("C", 0), ("D", nx)):  # transposed: a row of the constraint is contiguous
        block = s.blocks[name]
        pairs.append((block.positions, path + block.columns + row + w * block.rows))
    places: IntArray = np.hstack([np.vstack(pair) for pair in pairs]).T.astype(np.int64, order="C")
    return places


def _unavailable(_: Any) -> int:
    return 1
