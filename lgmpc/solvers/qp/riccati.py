"""lgmpc's own: active sets by Newton's method on an augmented Lagrangian, each tried with one Riccati sweep.

For multiplier estimates mu and a penalty rho the augmented Lagrangian

    phi(z) = cost(z) + rho/2 sum_i dist(row_i(z) + mu_i / rho, [lower_i, upper_i])^2,      z satisfying the dynamics,

is convex and piecewise quadratic: the rows outside their (shifted) bounds are the active ones, and the minimiser of the
piece that they define is one call of the regulator (:mod:`lgmpc.solvers.qp.lqr`) with these rows penalised. Newton's
method (Qi and Sun, "A nonsmooth version of Newton's method", Math. Prog. 58, 1993) calls it with the active rows of the
last point until they stay the same, with an exact line search where phi would not decrease; then
``mu <- rho (row + mu / rho - nearest point)`` (Hestenes' and Powell's method of multipliers), which with a large rho is
exact after one or two rounds, and after ten with a hundred rows and more at their bounds.

A receding horizon changes its active rows little from one solve to the next, so one or two sweeps mostly confirm the
guess that the multipliers make; in a hard push there are 5 to 20. When they do not converge, an interior point method
takes over.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from lgmpc.compile import BatchKernel, recall
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.line import exact_line_search
from lgmpc.solvers.qp.lqr import StageRegulator
from lgmpc.solvers.qp.piqp import PiqpSolver
from lgmpc.solvers.qp.protocol import QpSolution, QpSolver, QpStatus
from lgmpc.typing import Array

__all__ = ["RiccatiSettings", "RiccatiSolver"]


@dataclass(frozen=True)
class RiccatiSettings:
    """Tolerance and limits of :class:`RiccatiSolver`.

    Attributes:
        tolerance: largest residual of the optimality conditions.
        max_sweeps: calls of the regulator; the other solver takes as long as 25.
        penalty: rho, as a multiple of the largest control weight.
    """

    tolerance: float = 1e-6
    max_sweeps: int = 25
    penalty: float = 1e4


class RiccatiSolver:
    """:class:`~lgmpc.solvers.qp.QpSolver` for problems whose R is positive definite; warm-started by the multipliers.

    Args:
        qp: the problem.
        settings: tolerance, sweeps, penalty.
        fallback: makes the solver that takes over.
        progress: called with a description of what is being compiled.

    Attributes:
        iterations: sweeps of the last solve, and the other solver's iterations if it took over.
        took_over: whether the other solver did the last solve.

    Raises:
        MissingDependencyError: PIQP, the standard fallback, is not installed.
    """

    name = "riccati"

    def __init__(
        self,
        qp: OcpQp,
        settings: RiccatiSettings | None = None,
        fallback: Callable[[OcpQp], QpSolver] = PiqpSolver,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        s = qp.structure
        self.qp = qp
        self.settings = RiccatiSettings() if settings is None else settings
        self.iterations = 0
        self.took_over = False
        self._fallback = fallback(qp)
        r = self._regulator = StageRegulator(qp, progress)
        penalise, measure = recall(_compile, s.ng, progress=progress)
        self._rho, self._measures = np.zeros(1), np.zeros((s.nodes, 3))
        self._mu, self._point, self._multipliers = np.zeros((3, s.nodes, s.ng))
        bounds = {"lower": qp.vector("lower"), "upper": qp.vector("upper"), "mu": self._mu, "rho": self._rho}
        self._penalise = penalise.bind(s.nodes, **bounds, point=self._point, weights=r.weights, targets=r.targets)
        self._measure = measure.bind(
            s.nodes, **bounds, rows=r.rows, weights=r.weights, targets=r.targets, multipliers=self._multipliers,
            measures=self._measures,
        )  # fmt: skip
        block = s.blocks["R"]
        self._control_weights = block.where.start + np.flatnonzero(block.rows == block.columns)
        self.solution = QpSolution.zeros(qp)

    def reset(self) -> None:
        """Set the multipliers to zero, and reset the other solver."""
        self.solution.write(0.0, 0.0, 0.0, 0.0)
        self._fallback.reset()
        self.took_over = False

    def prepare(self) -> None:
        """Do nothing: the matrices are read where they are; the factorisation needs the active rows."""

    def solve(self, dx0: Array) -> QpStatus:
        """Solve from the current multipliers; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        self._regulator.dx0[:] = dx0
        self.took_over = not self._solve()
        if not self.took_over:
            return QpStatus.SOLVED
        self._fallback.prepare()
        status = self._fallback.solve(dx0)
        self.iterations += self._fallback.iterations
        if status in (QpStatus.SOLVED, QpStatus.MAX_ITERATIONS):
            self.solution.write(*self._fallback.solution.arrays)
        return status

    def _solve(self) -> bool:
        """Solve by active sets; False, and nothing written, if they do not converge."""
        settings, r = self.settings, self._regulator
        rho = settings.penalty * max(self.qp.values[0].take(self._control_weights).tolist())
        if not rho > 0.0:
            return False
        self._rho[0] = rho
        self._mu[...] = self.solution.multipliers
        self._point[...] = 0.0  # the zero step is the first point
        cost_before, phi = 0.0, math.inf
        for self.iterations in range(1, settings.max_sweeps + 1):
            self._penalise()
            r.minimise()
            cost = r.cost
            if not math.isfinite(cost):
                return False
            self._measure()
            change, residual, _ = np.maximum.reduce(self._measures, axis=0).tolist()
            if change <= settings.tolerance:
                if residual <= settings.tolerance:
                    self.solution.write(r.dxs, r.dus, r.costates, self._multipliers)
                    return True
                self._mu[...] = self._multipliers
                self._point[...] = r.rows
                cost_before, phi = cost, math.inf
                continue
            before, phi = phi, cost + 0.5 * rho * float(np.add.reduce(self._measures[:, 2]))
            if phi < before:
                self._point[...] = r.rows
                cost_before = cost
            else:
                low, high = (self.qp.vector(name) - self._mu / rho for name in ("lower", "upper"))
                step = r.rows - self._point
                end = -float(np.vdot(self._multipliers, step))
                self._point[...], cost_before, phi = exact_line_search(
                    self._point, step, cost_before, cost, end, rho, low, high
                )
        return False


def _compile(ng: int, progress: Callable[[str], None] | None) -> tuple[BatchKernel, BatchKernel]:
    """Return the functions before and after the regulator."""
    penalise, measure = (BatchKernel(function, progress) for function in _penalty_functions(ng))
    return penalise, measure


def _penalty_functions(ng: int) -> tuple[ca.Function, ca.Function]:
    """Functions of one stage before and after a call of the regulator.

    Returns:
        ``(lower, upper, mu, rho, point) -> (weights, targets)``, the penalties of the rows that are outside their
        shifted bounds at a point, and ``(lower, upper, mu, rho, rows, weights, targets) -> (multipliers, measures)``:
        the multipliers with which the regulator's point is stationary; and their largest difference from those of the
        augmented Lagrangian, the largest residual of bounds and complementarity, and the sum of squares of what the
        rows are outside their shifted bounds.
    """
    lower, upper, mu, point, rows, weights, targets = (
        ca.SX.sym(name, ng) for name in ("lower", "upper", "mu", "point", "rows", "weights", "targets")
    )
    rho = ca.SX.sym("rho")
    given, names = [lower, upper, mu, rho], ["lower", "upper", "mu", "rho"]
    low, high = lower - mu / rho, upper - mu / rho
    nearest = _nearest(point, low, high)
    penalise = ca.Function(
        f"penalise_{ng}",
        [*given, point],
        [ca.if_else(point != nearest, rho, 0.0), nearest],
        [*names, "point"],
        ["weights", "targets"],
    )
    multipliers, outside = weights * (rows - targets), rows - _nearest(rows, low, high)
    residual = rows - _nearest(rows + multipliers / rho, lower, upper)
    measures = ca.vertcat(_largest(rho * outside - multipliers), _largest(residual), ca.sumsqr(outside))
    measure = ca.Function(
        f"measure_penalty_{ng}",
        [*given, rows, weights, targets],
        [multipliers, measures],
        [*names, "rows", "weights", "targets"],
        ["multipliers", "measures"],
    )
    return penalise, measure


def _nearest(values: ca.SX, lower: ca.SX, upper: ca.SX) -> ca.SX:
    """Return the nearest points to values within bounds; NaN for bounds that are."""
    return ca.if_else(values >= lower, ca.if_else(values <= upper, values, upper), lower)


def _largest(column: ca.SX) -> ca.SX:
    """Return the largest absolute value; 0 of an empty column."""
    largest = ca.SX(0)
    for entry in ca.vertsplit(ca.fabs(column)) if column.numel() else ():
        largest = ca.if_else(entry > largest, entry, largest)
    return largest
