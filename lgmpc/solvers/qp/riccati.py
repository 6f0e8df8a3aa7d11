"""lgmpc's own: active sets by Newton's method on an augmented Lagrangian, each tried with one Riccati sweep.

For multiplier estimates mu and a penalty rho the augmented Lagrangian

    phi(z) = cost(z) + rho/2 sum_i dist(row_i(z) + mu_i / rho, [lower_i, upper_i])^2,      z satisfying the dynamics,

is convex and piecewise quadratic: the rows outside their (shifted) bounds are the active ones, and the minimiser of the
piece that they define is one call of the regulator (:mod:`lgmpc.solvers.qp.lqr`) with these rows penalised. Newton's
method (Qi and Sun, "A nonsmooth version of Newton's method", Math. Prog. 58, 1993) calls it with the active rows of the
last point until they stay the same; then ``mu <- rho (row + mu / rho - nearest point)`` (Hestenes' and Powell's method
of multipliers), which with a large rho is exact after one or two rounds.

A receding horizon changes its active rows little from one solve to the next, so one or two sweeps mostly confirm the
guess that the multipliers make. When they do not converge (phi does not fall, or their number is used up: in a hard
push, with a hundred rows and more at their bounds), an interior point method takes over.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lgmpc.compile import compile_function
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.lqr import lqr_function
from lgmpc.solvers.qp.piqp import PiqpSolver
from lgmpc.solvers.qp.protocol import QpSolution, QpSolver, QpStatus
from lgmpc.typing import Array

__all__ = ["RiccatiSettings", "RiccatiSolver"]


@dataclass(frozen=True)
class RiccatiSettings:
    """How accurate, and how long before the other solver takes over.

    Attributes:
        tolerance: largest residual of the optimality conditions.
        max_sweeps: calls of the regulator.
        max_sweeps_after: the same after a solve that the other solver took over: hard problems follow each other, and
            where they end they end at once.
        penalty: rho, as a multiple of the largest control weight.
    """

    tolerance: float = 1e-6
    max_sweeps: int = 8
    max_sweeps_after: int = 3
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
        lqr = compile_function(lqr_function(s, f"qp_{s.ndx}_{s.nu}_{s.ng}"), progress=progress)
        self._lqr = lqr
        self._values: Array = lqr.input("values").T
        self._weights: Array = lqr.input("weights").T
        self._targets: Array = lqr.input("targets").T
        self._rows: Array = lqr.output("rows").T
        self._lower, self._upper = np.zeros((s.nodes, s.ng)), np.zeros((s.nodes, s.ng))
        r = s.blocks["R"]
        self._control_weights = r.where.start + np.flatnonzero(r.rows == r.columns)
        self.solution = QpSolution.zeros(qp)

    def reset(self) -> None:
        """Set the multipliers to zero, and reset the other solver."""
        self.solution.write(0.0, 0.0, 0.0, 0.0)
        self._fallback.reset()
        self.took_over = False

    def prepare(self) -> None:
        """Take over the matrices (the factorisation needs the active rows, which need the first state)."""
        self._values[:] = self.qp.values
        self._lqr.input("terminal_values")[:] = self.qp.terminal_values
        self._lower[:] = self.qp.vector("lower")
        self._upper[:] = self.qp.vector("upper")

    def solve(self, dx0: Array) -> QpStatus:
        """Solve from the current multipliers; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        self._lqr.input("dx0")[:] = dx0
        self.took_over = not self._sweep(self.settings.max_sweeps_after if self.took_over else self.settings.max_sweeps)
        if not self.took_over:
            return QpStatus.SOLVED
        self._fallback.prepare()
        status = self._fallback.solve(dx0)
        self.iterations += self._fallback.iterations
        if status in (QpStatus.SOLVED, QpStatus.MAX_ITERATIONS):
            self.solution.write(*self._fallback.solution.arrays)
        return status

    def _sweep(self, most: int) -> bool:
        """Solve by active sets; False, and nothing written, if they do not converge."""
        settings, lqr, rows, lower, upper = self.settings, self._lqr, self._rows, self._lower, self._upper
        rho = settings.penalty * float(self._values[0, self._control_weights].max())
        if not rho > 0.0:
            return False
        mu = self.solution.multipliers
        low, high = lower - mu / rho, upper - mu / rho
        nearest = np.clip(0.0, low, high)  # the zero step is the first point
        outside = -nearest
        phi = math.inf
        for self.iterations in range(1, most + 1):
            np.multiply(outside != 0.0, rho, out=self._weights)
            self._targets[:] = nearest
            lqr.run()
            cost = float(lqr.output("cost")[0])
            if not math.isfinite(cost):
                return False
            nearest = np.clip(rows, low, high)
            outside = rows - nearest
            penalised = self._weights * (rows - self._targets)  # multipliers with which this point is stationary
            if np.abs(rho * outside - penalised).max() <= settings.tolerance:
                mu = penalised
                if np.abs(rows - np.clip(rows + mu / rho, lower, upper)).max() <= settings.tolerance:
                    self.solution.write(*(lqr.output(name).T for name in ("dxs", "dus", "costates")), mu)
                    return True
                low, high = lower - mu / rho, upper - mu / rho
                nearest = np.clip(rows, low, high)
                outside = rows - nearest
                phi = math.inf
                continue
            before = phi
            phi = cost + 0.5 * rho * float(np.vdot(outside, outside))
            if phi >= before:
                return False
        return False
