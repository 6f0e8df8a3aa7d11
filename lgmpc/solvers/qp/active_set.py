"""lgmpc's own solver: active sets where the last solve identifies them, an interior point method where not.

Both call one :class:`~lgmpc.solvers.qp.RiccatiSolver` with penalised rows, whose computing time does not depend on the
number of active rows: scalar code where stages are small, dense blocks where they are large.

*Active sets.* For multiplier estimates mu and a penalty rho the augmented Lagrangian

    phi(z) = cost(z) + rho/2 sum_i dist(row_i(z) + mu_i / rho, [lower_i, upper_i])^2,      z satisfying the dynamics,

is convex and piecewise quadratic: the rows outside their (shifted) bounds are the active ones, and the minimiser of the
piece that they define is one call of the Riccati solver with these rows penalised. Newton's method (Qi and Sun, "A
nonsmooth version of Newton's method", Math. Prog. 58, 1993) calls it with the active rows of the last point until they
stay the same; then ``mu <- rho (row + mu / rho - nearest point)`` (Hestenes' and Powell's method of multipliers), with
a larger rho from one time to the next. From one iteration of an SQP, or one tick of an MPC, to the next few rows
change: one to three sweeps confirm the active set that the multipliers imply. Where more rows change in a sweep than
in the one before, the guess was too far off, and the interior point method takes over.

*Interior point.* With slacks s and multipliers z of every bound, a Newton step on ``s z = sigma mu`` is the solver's
with weights ``z / s``. Steps have a predictor and a corrector that shares its factors (Mehrotra, "On the implementation
of a primal-dual interior point method", SIAM J. Optim. 2, 1992; on optimal control problems: Frison and Diehl, "HPIPM",
IFAC 2020). The path begins at known multipliers. The predictor also identifies the active bounds: their slacks shrink,
the others' multipliers do (El-Bakry, Tapia, Zhang, SIAM Review 36, 1994). As soon as these hardly change any more, the
solve continues with active sets and ends exactly, without the ill-conditioned end of the central path.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib.resources import files

import numpy as np

from lgmpc.compile import EXACT, compile_source, frame_of
from lgmpc.errors import InputError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.central_path import CentralPath, nearest_in
from lgmpc.solvers.qp.dense_riccati import DenseRiccati
from lgmpc.solvers.qp.general import PiqpSolver
from lgmpc.solvers.qp.protocol import QpSolution, QpSolver, RiccatiSolver, is_large
from lgmpc.solvers.qp.sparse_riccati import SparseRiccati
from lgmpc.solvers.sweep import all_finite, penalised_feedback
from lgmpc.status import Status
from lgmpc.typing import Array, numbers

__all__ = ["ActiveSetSolver", "Penalties", "riccati_for"]

_PIQP = (("sparse_multistage", 50), ("sparse_ldlt", 200))  # linear solvers and iterations of the standard fallbacks
_FEW = 4  # rows that may change in any sweep of an active set, even if fewer did in the last one
_FIRST = 0.125  # share of the rows that may change in the first sweep
_GROWTH = 10.0  # of the penalty with each update of the multipliers
_STIFFEST = 1e5  # penalty beyond which it does not grow, in control weights
_HELD = 1e7  # penalty of rows that gains hold at their bounds, in control weights
_START = 20.0  # penalty of all rows where the central path begins, in control weights


def riccati_for(qp: OcpQp) -> RiccatiSolver:
    """Return scalar code for small stages, dense blocks for large ones."""
    return DenseRiccati(qp) if is_large(qp) else SparseRiccati(qp)


class ActiveSetSolver:
    """:class:`~lgmpc.solvers.qp.QpSolver` for problems whose R is positive definite; warm-started by multipliers.

    What it cannot solve (a singular R) and all problems on a machine without a C compiler are solved by PIQP.

    Args:
        qp: the problem.
        tolerance: largest residual of the optimality conditions.
        max_sweeps: Riccati sweeps that confirm or correct one guess of the active rows.
        max_iterations: of the interior point method.
        fallbacks: solvers of the same problem that take over, tried in this order: interior point methods fail on
            different problems. PIQP unless given, in dense blocks first, then with sparse factors.
        riccati: of the same problem; :func:`riccati_for` unless given.

    Attributes:
        iterations: factorisations of the last solve, and the fallbacks' iterations if they took over.
        took_over: whether a fallback did the last solve.
        may_use_fallbacks: whether fallbacks are used at all; without them the status of such solves is FAILED.
        available: whether the machine code is available.

    Raises:
        InputError: a tolerance that is not positive.
        MissingDependencyError: PIQP, the standard fallback, is not installed.
    """

    name = "active_set"

    def __init__(
        self,
        qp: OcpQp,
        tolerance: float = 1e-6,
        max_sweeps: int = 25,
        max_iterations: int = 30,
        fallbacks: Sequence[QpSolver] | None = None,
        riccati: RiccatiSolver | None = None,
    ) -> None:
        if not float(numbers("tolerance", tolerance, ())) > 0.0:
            raise InputError("tolerance", tolerance, "above 0")
        s = qp.structure
        self.qp, self.tolerance, self.max_sweeps, self.max_iterations = qp, tolerance, max_sweeps, max_iterations
        self.iterations = 0
        self.took_over = False
        self.may_use_fallbacks = True
        # PIQP bounds products of multiplier and distance; the smaller of the two may be as large as the root.
        piqp = (PiqpSolver(qp, 1e-2 * tolerance, most, kind) for kind, most in _PIQP) if fallbacks is None else ()
        self._fallbacks = tuple(piqp if fallbacks is None else fallbacks)
        self._riccati = r = riccati_for(qp) if riccati is None else riccati
        self.solution = QpSolution.zeros(qp)
        self._penalties = Penalties(qp, r, self.solution.multipliers, tolerance)
        bounds = qp.vector("lower"), qp.vector("upper")
        self._path = CentralPath(*bounds, r.rows, r.weights, r.targets, self.solution.multipliers)
        self.available = r.available and self._penalties.available and self._path.available
        self._scale, self._ready = 0.0, False
        block = s.blocks["R"]
        diagonal = block.where.start + np.flatnonzero(block.rows == block.columns)
        self._control_weights = np.add.outer(s.size * np.arange(s.nodes), diagonal).ravel()

    def reset(self) -> None:
        """Set the multipliers to zero, and reset the fallbacks."""
        self.solution.write(0.0, 0.0, 0.0, 0.0)
        for solver in self._fallbacks:
            solver.reset()
        self.took_over = False

    def prepare(self) -> None:
        """Take over the matrices (the factorisation needs the active rows, which need the first state)."""
        # The weights of controls that an interval does not have are 1, and have no meaning.
        weights = self.qp.values.take(self._control_weights)
        middle = weights.size // 2
        if weights.size:
            weights.partition(middle)
            self._scale = float(weights[middle])
        self._penalties.rho = self._riccati.penalty * self._scale
        self._ready = self.available and self._scale > 0.0
        if self._ready:
            self._riccati.load()

    def solve(self, dx0: Array) -> Status:
        """Solve from the current multipliers; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        self.iterations, self.took_over = 0, False
        self._riccati.dx0[...] = dx0
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # of a path that does not converge
            if self._ready:
                self._penalties.resume()
                if self._active_set():
                    return Status.CONVERGED
            lower, upper = self.qp.vector("lower"), self.qp.vector("upper")
            finite = self.qp.is_finite() and all_finite(dx0) and not (np.isnan(lower).any() or np.isnan(upper).any())
            if finite and bool((lower > upper).any()):
                return Status.INFEASIBLE
            if self._ready and finite and self._interior_point():
                return Status.CONVERGED
        # A scale of zero: controls without a cost of their own, for which the fallback may have a solution.
        if finite and (self._ready or self._scale < 0.0) and not self.may_use_fallbacks:
            return Status.FAILED
        return self._solve_otherwise(dx0, finite)

    def _solve_otherwise(self, dx0: Array, finite: bool) -> Status:
        """Call the fallbacks until one has a solution, and solve exactly with the active rows that it finds."""
        self.took_over = True
        for solver in self._fallbacks:
            solver.prepare()
            status = solver.solve(dx0)
            self.iterations += solver.iterations
            if status in (Status.CONVERGED, Status.NOT_FINITE):
                break
        if status.usable:
            self.solution.write(*solver.solution.arrays)
            with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
                if self._ready and finite and self._polish():
                    return Status.CONVERGED
        return status

    def feedback(self, multipliers: Array) -> Array:
        """Return the gains; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        self.prepare()
        weights = np.where(np.abs(multipliers) > self.tolerance, _HELD * self._scale, 0.0)
        gains = None
        if self._ready:
            self._riccati.weights[...], self._riccati.targets[...] = weights, 0.0
            gains = self._riccati.feedback() if self._factor() else None
        return penalised_feedback(self.qp, weights) if gains is None else gains

    def _polish(self) -> bool:
        """Solve exactly with the active rows of the fallback: those with more multiplier than distance."""
        s, qp = self.solution, self.qp
        lower, upper = qp.vector("lower"), qp.vector("upper")
        rows = np.einsum("kij,kj->ki", qp.dense("C"), s.dxs[:-1]) + np.einsum("kij,kj->ki", qp.dense("D"), s.dus)
        bounds = np.where(s.multipliers > 0.0, upper, lower)
        active = np.abs(s.multipliers) > np.abs(rows - bounds)
        self._penalties.point[...] = np.where(active, bounds, nearest_in(rows, lower, upper))
        self._penalties.mu[...] = np.where(active, s.multipliers, 0.0)
        return self._active_set()

    def _active_set(self) -> bool:
        """Minimise the augmented Lagrangian from point and multiplier estimates; False if that takes too many sweeps.

        Active are rows of the point that are outside their bounds, shifted by the multipliers.
        """
        r, p, tolerance = self._riccati, self._penalties, self.tolerance
        p.rho, allowed = r.penalty * self._scale, _FIRST * p.point.size
        for _ in range(self.max_sweeps):
            p.penalise()
            if not self._factor():
                return False
            p.measure()
            if p.residual <= tolerance and self._accept():
                return True
            if p.changed > max(allowed, _FEW):  # no contraction: the guess was too far off
                return False
            allowed = p.changed
            if p.difference <= tolerance:  # the minimiser for these multipliers
                p.mu[...], p.point[...] = r.multipliers, self._nearest_to(r.rows + r.multipliers)
                p.rho = max(p.rho, min(_GROWTH * p.rho, _STIFFEST * self._scale))
            else:
                p.point[...] = r.rows
        return False

    def _interior_point(self) -> bool:
        """Follow the central path until the active rows are known; False if it does not converge."""
        r, path = self._riccati, self._path
        path.begin(_START * self._scale, self._penalties.rho)
        if not self._factor():
            return False
        path.start()
        for _ in range(self.max_iterations):
            path.predict()
            if not self._factor():
                return False
            path.correct()
            r.solve()
            if not path.step():
                return False
            if self._is_optimal():
                return True
            if path.settled:
                path.identify()
                self._penalties.point[...], self._penalties.mu[...] = path.point, path.multipliers
                if self._active_set():
                    return True
        return False

    def _factor(self) -> bool:
        self.iterations += 1
        return self._riccati.factor() and math.isfinite(self._riccati.cost)

    def _is_optimal(self) -> bool:
        """Take the Riccati solver's point, and its multipliers, if they satisfy the optimality conditions."""
        self._penalties.measure()
        return self._penalties.residual <= self.tolerance and self._accept()

    def _accept(self) -> bool:
        """Take the Riccati solver's point, with rows within their bounds, and its multipliers, if it is stationary."""
        r, tolerance = self._riccati, self.tolerance
        corrections = r.polish(tolerance)
        if corrections is None or (corrections and not self._bound_residual() <= tolerance):
            return False
        self.solution.write(r.dxs, r.dus, r.costates, r.multipliers)
        return True

    def _bound_residual(self) -> float:
        """Return the largest residual of bounds and complementarity: 0 if only rows at bounds have multipliers."""
        r = self._riccati
        return float(np.abs(r.rows - self._nearest_to(r.rows + r.multipliers)).max(initial=0.0))

    def _nearest_to(self, rows: Array) -> Array:
        return nearest_in(rows, self.qp.vector("lower"), self.qp.vector("upper"))


class Penalties:
    """Penalties of the rows of a problem, on the memory of its Riccati solver.

    Args:
        qp: the problem, whose bounds are read.
        riccati: its rows are read, its weights, targets and multipliers written.
        known: (N, ng) multipliers that :meth:`resume` begins with.
        least: smaller ones count as zero.

    Attributes:
        available: whether there is machine code; else nothing can be called.
        mu: (N, ng) multiplier estimates.
        point: (N, ng) rows that define the active set.
        difference: largest difference of the multipliers from the augmented Lagrangian's.
        residual: largest residual of bounds and complementarity.
        changed: number of rows that became active or inactive.
    """

    def __init__(
        self,
        qp: OcpQp,
        riccati: RiccatiSolver,
        known: Array,
        least: float,
    ) -> None:
        s = qp.structure
        source = files("lgmpc.solvers.qp").joinpath("penalties.c").read_text(encoding="utf-8")
        library = compile_source("lgmpc_penalties", EXACT + source)
        self.available = library is not None
        self.mu: Array = np.zeros((s.nodes, s.ng))
        self.point: Array = np.zeros((s.nodes, s.ng))
        self._numbers, self._measures = np.array([least, 0.0]), np.zeros(3)
        r = riccati
        self._frame = frame_of(
            np.array([s.nodes, s.ng, s.size], dtype=np.int64), self._numbers, qp.vector("lower"), qp.vector("upper"),
            known, self.mu, self.point, r.weights, r.targets, r.rows, r.multipliers, self._measures,
        )  # fmt: skip
        if library is not None:
            self._resume, self._penalise = library.lgmpc_resume, library.lgmpc_penalise
            self._measure = library.lgmpc_measure

    @property
    def rho(self) -> float:
        """The penalty of active rows."""
        return float(self._numbers[1])

    @rho.setter
    def rho(self, value: float) -> None:
        self._numbers[1] = value

    def resume(self) -> None:
        """Take over the known multipliers; rows that have one are at their bounds, others within them, near zero."""
        self._resume(self._frame)

    def penalise(self) -> None:
        """Write the penalties of the rows that are active at :attr:`point`."""
        self._penalise(self._frame)

    def measure(self) -> None:
        """Write the multipliers with which the solver's minimiser is stationary, and the measures of its rows."""
        self._measure(self._frame)
        self.difference, self.residual, self.changed = self._measures.tolist()
