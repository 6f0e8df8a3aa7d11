"""lgmpc's own for large stages: active sets where the last solve identifies them, an interior point method where not.

Both use the regulator with penalised rows (:class:`~lgmpc.solvers.qp.regulator.BlockRegulator`), whose computing time
does not depend on the number of active rows.

*Active sets.* The rows outside their bounds, shifted by the multipliers, are penalised as in
:mod:`lgmpc.solvers.qp.riccati`, until they stay the same. From one iteration of an SQP to the next few rows change: one
to three sweeps confirm the active set that the multipliers imply.

*Interior point.* With slacks s and multipliers z of every bound, a Newton step on ``s z = sigma mu`` is the regulator
with weights ``z / s``. Steps have a predictor and a corrector that shares its factors (Mehrotra, "On the implementation
of a primal-dual interior point method", SIAM J. Optim. 2, 1992; on optimal control problems: Frison and Diehl, "HPIPM",
IFAC 2020). The predictor also identifies the active bounds: their slacks shrink, the others' multipliers do (El-Bakry,
Tapia, Zhang, SIAM Review 36, 1994). As soon as these hardly change any more, the solve
continues with active sets and ends exactly, without the ill-conditioned end of the central path.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lgmpc.errors import InputError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.cascade import Cascade
from lgmpc.solvers.qp.central_path import CentralPath, nearest_in
from lgmpc.solvers.qp.infeasibility import is_certificate
from lgmpc.solvers.qp.line import exact_line_search
from lgmpc.solvers.qp.piqp import PiqpSettings, PiqpSolver
from lgmpc.solvers.qp.protocol import QpSolution, QpSolver, QpStatus
from lgmpc.solvers.qp.regulator import BlockRegulator
from lgmpc.solvers.sweep import all_finite
from lgmpc.typing import Array

__all__ = ["LARGE_STAGE", "StructuredSettings", "StructuredSolver"]

LARGE_STAGE = 30
"""States and controls of a stage from which dense blocks pay."""

_REFINEMENTS = 2  # corrections of rounding; each takes a factor of the penalty's condition off
_PIQP = (("sparse_multistage", 50), ("sparse_ldlt", 200))  # linear solvers and iterations of the standard fallback
_ELASTIC_PENALTIES = (1e1, 1e3, 1e5, 1e7)  # of violations where infeasibility is examined, in control weights
_FAR = 1e2  # times the controls of a step with a small penalty: larger ones count as none
_ELASTIC_SWEEPS = 8  # with each of them
_FEW = 4  # rows that may change in any sweep of an active set, even if fewer did in the last one
_START = 20.0  # penalty of all rows where the central path begins, in control weights


@dataclass(frozen=True)
class StructuredSettings:
    """Tolerance and limits of :class:`StructuredSolver`.

    Attributes:
        tolerance: largest residual of the optimality conditions.
        max_sweeps: regulators that confirm or correct one guess of the active rows.
        max_iterations: of the interior point method.
        penalty: of active rows, as a multiple of the median control weight: large, so that one round of multipliers is
            enough, and not so large that rounding shows in them.
    """

    tolerance: float = 1e-6
    max_sweeps: int = 12
    max_iterations: int = 30
    penalty: float = 1e7

    def __post_init__(self) -> None:
        """Check tolerance and penalty."""
        if not self.tolerance > 0.0:
            raise InputError("tolerance", self.tolerance, "above 0")
        if not self.penalty > 0.0:
            raise InputError("penalty", self.penalty, "above 0")


class StructuredSolver:
    """:class:`~lgmpc.solvers.qp.QpSolver` for large stages whose R is positive definite; warm-started by multipliers.

    What it cannot solve (an infeasible problem, a singular R) and all problems on a machine without a C compiler are
    solved by PIQP.

    Args:
        qp: the problem.
        settings: tolerance and limits.
        fallback: makes the solver that takes over; PIQP unless given, in dense blocks first, then with sparse factors.
        progress: called with a description of what is being compiled.

    Attributes:
        iterations: factorisations of the last solve, and the other solver's iterations if it took over.
        took_over: whether the other solver did the last solve.
        may_take_over: whether it does such solves at all; else their status is NUMERICAL.
        available: whether there is machine code for the first.

    Raises:
        MissingDependencyError: PIQP, the standard fallback, is not installed.
    """

    name = "structured"

    def __init__(
        self,
        qp: OcpQp,
        settings: StructuredSettings | None = None,
        fallback: Callable[[OcpQp], QpSolver] | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        s = qp.structure
        self.qp = qp
        self.settings = StructuredSettings() if settings is None else settings
        self.iterations = 0
        self.took_over = False
        self.may_take_over = True
        make = self._piqp if fallback is None else fallback
        self._fallback = make(qp)
        self._regulator = BlockRegulator(s, progress)
        self.available = self._regulator.available
        self._lower, self._upper = np.zeros((s.nodes, s.ng)), np.zeros((s.nodes, s.ng))
        self._scale = self._rho = 0.0
        self._ready, self._possible, self._convex = False, True, True
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
        qp = self.qp
        self._lower[...], self._upper[...] = qp.vector("lower"), qp.vector("upper")
        finite = qp.is_finite()
        possible = bool((self._lower <= self._upper).all())  # also False where one is NaN
        # Of intervals without control the weights are ones, which mean nothing.
        weights = qp.values[:, self._control_weights].ravel()
        middle = weights.size // 2
        self._scale = float(np.partition(weights, middle)[middle]) if finite and weights.size else 0.0
        self._rho = self.settings.penalty * self._scale
        self._possible = possible or not finite or bool(np.isnan(self._lower).any() or np.isnan(self._upper).any())
        self._convex = not finite or self._scale >= 0.0  # zero: controls without a cost of their own
        self._ready = self._regulator.available and finite and possible and self._scale > 0.0
        if self._ready:
            self._regulator.load(qp)

    def solve(self, dx0: Array) -> QpStatus:
        """Solve from the current multipliers; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        self.iterations = 0
        if not self._possible:  # bounds that contradict each other
            self.took_over = False
            return QpStatus.INFEASIBLE
        self._regulator.dx0[...] = dx0
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # of a path that does not converge
            self.took_over = not (self._ready and all_finite(dx0) and self._solve())
        if not self.took_over:
            return QpStatus.SOLVED
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            if self._ready and all_finite(dx0) and self._is_infeasible():
                self.took_over = False
                return QpStatus.INFEASIBLE
        if (self._ready or not self._convex) and not self.may_take_over:
            self.took_over = False
            return QpStatus.NUMERICAL
        self._fallback.prepare()
        status = self._fallback.solve(dx0)
        self.iterations += self._fallback.iterations
        if status in (QpStatus.SOLVED, QpStatus.MAX_ITERATIONS):
            self.solution.write(*self._fallback.solution.arrays)
            with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
                if self._ready and self._polish():
                    return QpStatus.SOLVED
        return status

    def feedback(self, multipliers: Array) -> Array:
        """Return the gains (N, nu, ndx) of the controls while rows with multipliers (N, ng) stay at their bounds.

        Returns:
            The gains K of ``du = -K dx``; of length 0 where the regulator does not apply.
        """
        s = self.qp.structure
        self.prepare()
        if self._ready:
            np.multiply(np.abs(multipliers) > self.settings.tolerance, self._rho, out=self._regulator.weights)
            self._regulator.targets[...] = 0.0
            if self._factor():
                return self._regulator.feedback()
        return np.zeros((0, s.nu, s.ndx))

    def _solve(self) -> bool:
        known, least = self.solution.multipliers, self.settings.tolerance
        mu = np.where(np.abs(known) > least, known, 0.0)
        # Rows with multipliers are at their bounds, the others within them.
        within = nearest_in(np.zeros_like(mu), self._lower, self._upper)
        rows = np.where(mu > 0.0, self._upper, np.where(mu < 0.0, self._lower, within))
        return self._active_set(rows, mu) or self._interior_point()

    def _polish(self) -> bool:
        """Solve exactly with the active rows of the other solver: those with more multiplier than distance."""
        s, qp = self.solution, self.qp
        rows = np.einsum("kij,kj->ki", qp.dense("C"), s.dxs[:-1]) + np.einsum("kij,kj->ki", qp.dense("D"), s.dus)
        bounds = np.where(s.multipliers > 0.0, self._upper, self._lower)
        active = np.abs(s.multipliers) > np.abs(rows - bounds)
        rows = np.where(active, bounds, nearest_in(rows, self._lower, self._upper))
        return self._active_set(rows, np.where(active, s.multipliers, 0.0))

    def _piqp(self, qp: OcpQp) -> QpSolver:
        # PIQP bounds products of multiplier and distance; the smaller of the two may be as large as the root.
        tolerance = 1e-2 * self.settings.tolerance
        return Cascade([PiqpSolver(qp, PiqpSettings(name, tolerance, most)) for name, most in _PIQP])

    def _active_set(self, rows: Array, mu: Array) -> bool:
        """Penalise the rows outside their shifted bounds until they stay the same; False if they do not soon."""
        r, rho, lower, upper = self._regulator, self._rho, self._lower, self._upper
        low, high = lower - mu / rho, upper - mu / rho
        nearest = nearest_in(rows, low, high)
        active, changed = rows != nearest, rows.size // 8
        for _ in range(self.settings.max_sweeps):
            np.multiply(active, rho, out=r.weights)
            r.targets[...] = nearest
            if not self._factor():
                return False
            if self._accept():
                return True
            rows = r.rows.copy()
            nearest = nearest_in(rows, low, high)
            before, active = active, rows != nearest
            most, changed = max(changed, _FEW), int(np.count_nonzero(active != before))
            if changed > most:
                return False  # no contraction: the guess was too far off
            if changed == 0:
                low, high = lower - r.multipliers / rho, upper - r.multipliers / rho
                nearest = nearest_in(rows, low, high)
        return False

    def _interior_point(self) -> bool:
        """Follow the central path until the active rows are known; False if it does not converge."""
        r, path = self._regulator, CentralPath(self._lower, self._upper, _START * self._scale, self._rho)
        path.begin(r.weights, r.targets)
        if not self._factor():
            return False
        path.start(r.rows)
        for _ in range(self.settings.max_iterations):
            path.predict(r.weights, r.targets)
            if not self._factor():
                return False
            path.correct(r.rows, r.targets)
            r.solve()
            if not path.step(r.rows):
                return False
            if self._accept():
                return True
            if path.settled and self._active_set(*path.active_rows()):
                return True
        return False

    def _is_infeasible(self) -> bool:
        """Return whether the multipliers of the least violation prove that no step is without one.

        The penalised violation is minimised by Newton's method, with penalties that grow.
        """
        r, lower, upper = self._regulator, self._lower, self._upper
        r.weights[...], r.targets[...] = self._scale, nearest_in(np.zeros_like(lower), lower, upper)
        if not self._factor():
            return False
        rows, cost = r.rows.copy(), r.cost
        reach = _FAR * float(np.abs(r.dus).max(initial=0.0))
        for rho in self._scale * np.array(_ELASTIC_PENALTIES):
            for _ in range(_ELASTIC_SWEEPS):
                nearest = nearest_in(rows, lower, upper)
                active = rows != nearest
                np.multiply(active, rho, out=r.weights)
                r.targets[...] = nearest
                if not self._factor():
                    return False
                r.take_multipliers()
                if np.array_equal(active, r.rows != nearest_in(r.rows, lower, upper)):
                    rows, cost = r.rows.copy(), r.cost
                    break
                end = -float(np.vdot(r.multipliers, r.rows - rows))
                rows, cost, _ = exact_line_search(rows, r.rows - rows, cost, r.cost, end, rho, lower, upper)
            reach = max(reach, 2.0 * float(np.abs(r.dus).max(initial=0.0)))
            if is_certificate(self.qp, r.dx0, r.multipliers, reach):
                return True
        return False

    def _factor(self) -> bool:
        self.iterations += 1
        return self._regulator.factor() and bool(np.isfinite(self._regulator.cost))

    def _accept(self) -> bool:
        """Take the regulator's point and multipliers if they satisfy the optimality conditions."""
        r, tolerance = self._regulator, self.settings.tolerance
        r.take_multipliers()
        if not self._bound_residual() <= tolerance:
            return False
        for _ in range(_REFINEMENTS):
            if r.stationarity() <= tolerance:
                break
            r.refine()
        if not max(self._bound_residual(), r.stationarity()) <= tolerance:
            return False
        self.solution.write(r.dxs, r.dus, r.costates, r.multipliers)
        return True

    def _bound_residual(self) -> float:
        """Return the largest residual of bounds and complementarity: 0 if only rows at bounds have multipliers."""
        r = self._regulator
        return float(np.abs(r.rows - nearest_in(r.rows + r.multipliers, self._lower, self._upper)).max(initial=0.0))
