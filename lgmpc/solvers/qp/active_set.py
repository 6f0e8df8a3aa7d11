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
change: one to three sweeps confirm the active set that the multipliers imply. Where a sweep changes more than a few
rows, and not much fewer than the one before, the guess was too far off, and the interior point method takes over.

*Interior point.* With slacks s and multipliers z of every bound, a Newton step on ``s z = sigma mu`` is the solver's
with weights ``z / s``. Steps have a predictor and a corrector that shares its factors (Mehrotra, "On the implementation
of a primal-dual interior point method", SIAM J. Optim. 2, 1992; on optimal control problems: Frison and Diehl, "HPIPM",
IFAC 2020). The path begins at known multipliers. The predictor also identifies the active bounds: their slacks shrink,
the others' multipliers do (El-Bakry, Tapia, Zhang, SIAM Review 36, 1994). As soon as these hardly change any more, the
solve continues with active sets and ends exactly, without the ill-conditioned end of the central path.
"""

import ctypes
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from lgmpc.compile import EXACT, compile_source, frame_of, sequence_of
from lgmpc.errors import InputError
from lgmpc.ocp import OcpQp
from lgmpc.solvers.qp.dense_riccati import DenseRiccati
from lgmpc.solvers.qp.general import PiqpSolver
from lgmpc.solvers.qp.protocol import QpSolution, QpSolver, RiccatiSolver, is_large
from lgmpc.solvers.qp.sparse_riccati import SparseRiccati
from lgmpc.solvers.sweep import all_finite, penalised_feedback
from lgmpc.status import Status
from lgmpc.typing import Array, numbers

_PIQP = (("sparse_multistage", 50), ("sparse_ldlt", 200))  # linear solvers and iterations of the standard fallbacks
ROW_METHODS = ("penalties", "central_path", "active_set")
_HELD = 1e7  # penalty of rows that gains hold at their bounds, in control weights


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
        max_sweeps: int = 12,
        max_iterations: int = 30,
        fallbacks: Sequence[QpSolver] | None = None,
        riccati: RiccatiSolver | None = None,
    ) -> None:
        if not float(numbers("tolerance", tolerance, ())) > 0.0:
            raise InputError("tolerance", tolerance, "above 0")
        s = qp.structure
        self.qp, self.tolerance, self.max_sweeps, self.max_iterations = qp, tolerance, max_sweeps, max_iterations
        self.iterations, self.took_over, self.may_use_fallbacks = 0, False, True
        # PIQP bounds products of multiplier and distance; the smaller of the two may be as large as the root.
        piqp = (PiqpSolver(qp, 1e-2 * tolerance, most, kind) for kind, most in _PIQP) if fallbacks is None else ()
        self._fallbacks = tuple(piqp if fallbacks is None else fallbacks)
        self._riccati = r = riccati_for(qp) if riccati is None else riccati
        self.solution = QpSolution.zeros(qp)
        block = s.blocks["R"]
        diagonal = block.where.start + np.flatnonzero(block.rows == block.columns)
        self._point, self._mu = np.zeros((2, s.nodes, s.ng))
        self._numbers = np.array([tolerance, r.penalty, 0.0])
        # The weights of controls that an interval does not have are 1, and have no meaning.
        self._control_weights = np.add.outer(s.size * np.arange(s.nodes), diagonal).ravel()
        self._counts = np.array([0, max_sweeps, max_iterations, self._control_weights.size])
        self._library = row_methods()
        self.available = r.available and self._library is not None
        if self.available:
            self.frame = self._bind()
        self._scale, self._ready = 0.0, False

    def _bind(self) -> Any:
        """Return the addresses of all that the solver's own machine code reads and writes."""
        qp, r, found, s = self.qp, self._riccati, self.solution, self.qp.structure
        rows = (s.nodes, s.ng)
        plan, bounds = np.array([*rows, s.size]), (qp.vector("lower"), qp.vector("upper"))
        penalties = frame_of(
            plan, np.array([self.tolerance, 0.0]), *bounds, found.multipliers, self._mu, self._point, r.weights,
            r.targets, r.rows, r.multipliers, np.zeros(3),
        )  # fmt: skip
        path = frame_of(
            plan, np.zeros(2), *bounds, found.multipliers, r.rows, r.weights, r.targets, np.zeros(rows),
            np.zeros((*rows, 2, 9)), np.zeros(1, dtype=np.int64), np.zeros(rows), np.zeros(rows), np.zeros(3),
        )  # fmt: skip
        sizes = np.array([len(r.factoring), len(r.solving), *(a.size for a in (r.dxs, r.dus, r.costates, r.residual))])
        calls = (sequence_of(*each) for each in (r.factoring, r.solving, r.refining[:1], r.refining[1:]))
        riccati = frame_of(
            sizes, *calls, r.dxs, r.dus, r.costates, r.rows, r.multipliers, *r.correction, r._cost, r.residual,
            *found.arrays,
        )  # fmt: skip
        weights, work = self._control_weights, np.zeros(self._control_weights.size)
        return frame_of(penalties, path, riccati, self._numbers, self._counts, qp.values, weights, work)

    @property
    def scalar(self) -> bool:
        """Whether the stages are small ones, whose numbers are read in their place."""
        return isinstance(self._riccati, SparseRiccati)

    @property
    def first(self) -> Array:
        """(ndx,) first state of the Riccati solver."""
        return self._riccati.dx0

    def reset(self) -> None:
        """Set the multipliers to zero, and reset the fallbacks."""
        self.solution.write(0.0, 0.0, 0.0, 0.0)
        for solver in self._fallbacks:
            solver.reset()
        self.took_over = False

    def prepare(self) -> None:
        """Take over the matrices (the factorisation needs the active rows, which need the first state)."""
        if self._library is None:  # gains are those of the same penalties
            weights = self.qp.values.take(self._control_weights)
            self._scale = float(np.partition(weights, weights.size // 2)[weights.size // 2]) if weights.size else 0.0
        elif self.available:
            self._library.lgmpc_qp_prepare(self.frame)
            self._scale = float(self._numbers[2])
        self._ready = self.available and self._scale > 0.0
        if self._ready:
            self._riccati.load()

    def solve(self, dx0: Array) -> Status:
        """Solve from the current multipliers; see :class:`~lgmpc.solvers.qp.QpSolver`."""
        self.iterations = self._counts[0] = 0
        self.took_over = False
        self._riccati.dx0[...] = dx0
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # of a path that does not converge
            if self._ready:
                if self._run("resume", "active_set"):
                    return Status.CONVERGED
            lower, upper = self.qp.vector("lower"), self.qp.vector("upper")
            finite = self.qp.is_finite() and all_finite(dx0) and not (np.isnan(lower).any() or np.isnan(upper).any())
            if finite and bool((lower > upper).any()):
                return Status.INFEASIBLE
            if self._ready and finite and self._run("interior_point"):
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
            self.iterations = self._counts[0] = self.iterations + solver.iterations
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
            gains = self._riccati.feedback() if self._riccati.factor() else None
        return penalised_feedback(self.qp, weights) if gains is None else gains

    def _polish(self) -> bool:
        """Solve exactly with the active rows of the fallback: those with more multiplier than distance."""
        s, qp = self.solution, self.qp
        lower, upper = qp.vector("lower"), qp.vector("upper")
        rows = np.einsum("kij,kj->ki", qp.dense("C"), s.dxs[:-1]) + np.einsum("kij,kj->ki", qp.dense("D"), s.dus)
        bounds = np.where(s.multipliers > 0.0, upper, lower)
        active = np.abs(s.multipliers) > np.abs(rows - bounds)
        self._point[...] = np.where(active, bounds, np.minimum(np.maximum(rows, lower), upper))
        self._mu[...] = np.where(active, s.multipliers, 0.0)
        return self._run("active_set")

    def _run(self, *names: str) -> bool:
        """Call functions of ``active_set.c``; return whether the last one has found the solution."""
        assert self._library is not None  # else it is not ready
        for name in names:
            found = self._library[f"lgmpc_qp_{name}"](self.frame)
        self.iterations = int(self._counts[0])
        return bool(found)


def row_methods() -> ctypes.CDLL | None:
    """Return the machine code of active sets and central path, None where nothing can be compiled."""
    texts = (files("lgmpc.solvers.qp").joinpath(f"{name}.c").read_text("utf-8") for name in ROW_METHODS)
    return compile_source("lgmpc_active_set", EXACT + "".join(texts))
