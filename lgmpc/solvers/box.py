"""Box FDDP: bounds on controls from the actions' path constraints, and a backward sweep subject to them.

Mastalli, Merkt, Marti-Saumell, Ferrolho, Sola, Mansard, Vijayakumar, "A feasibility-driven approach to control-limited
DDP", Autonomous Robots 46, 2022, with another sweep.

Active sets and their sweeps are one call of C (``box.c``); numpy where nothing can be compiled.
"""

import ctypes
from collections.abc import Callable
from importlib.resources import files
from typing import Any

import numpy as np

from lgmpc.compile import compile_source
from lgmpc.errors import InputError
from lgmpc.ocp import PathFunctions, ShootingFunctions, ShootingProblem, Trajectory
from lgmpc.solvers.fddp import Fddp
from lgmpc.solvers.sweep import BackwardSweep, Expansion, all_finite, bilinear, products
from lgmpc.status import Status
from lgmpc.typing import Array, IntArray

_ROUNDING = 1e-12  # largest violation of a bound by a free control, relative to the bound
_EXCHANGES = 10  # most iterations of the active set; beyond them the regularisation increases


def bounded_rows(problem: ShootingProblem) -> IntArray:
    """Return the control that each row of each interval's path constraint bounds, (N, ng); -1 where there is no row.

    Raises:
        InputError: a row that is not one control between bounds.
    """
    known: dict[int, IntArray] = {}
    for k, action in enumerate(problem.actions):
        if id(action) not in known:
            rows = known[id(action)] = action.bounded_controls()
            if (rows < 0).any():
                expected = "bounds on controls only (the SQP and the NLP take any constraint)"
                got = f"'{action.name}', whose constraint row {int(rows.argmin())} is no control"
                raise InputError(f"actions[{k}]", got, expected)
    found = np.full((problem.nodes, max(rows.size for rows in known.values())), -1)
    for k, action in enumerate(problem.actions):
        found[k, : known[id(action)].size] = known[id(action)]
    return found


class ControlBounds:
    """The bounds of all controls in a problem's path constraints.

    Args:
        problem: its parameters are read at every call.
        rows: of :func:`bounded_rows`.
    """

    def __init__(self, problem: ShootingProblem, rows: IntArray) -> None:
        self._place = np.nonzero(rows >= 0)
        self._control = self._place[0], rows[self._place]
        # Of several rows of a control the first has its multiplier.
        _, first = np.unique(np.column_stack(self._control), axis=0, return_index=True)
        self._first = tuple(index[first] for index in self._place)
        self._bounded = tuple(index[first] for index in self._control)
        # A row is its control and an expression in the parameters: its value for zero controls in any state.
        xs = np.tile(problem.state.neutral(), (problem.nodes + 1, 1))
        self._path = PathFunctions(problem, xs, np.zeros((problem.nodes, problem.nu)))

    def write(self, lower: Array, upper: Array) -> None:
        """Write the bounds of all controls (N, nu): infinite where there is none, the tightest of several."""
        path = self._path
        path.evaluate()
        lower[...], upper[...] = -np.inf, np.inf
        np.maximum.at(lower, self._control, (path.lower - path.values)[self._place])
        np.minimum.at(upper, self._control, (path.upper - path.values)[self._place])

    def multipliers(self, of_controls: Array) -> Array:
        """Return each row's (N, ng) multiplier, that of its control (N, nu)."""
        out = np.zeros(self._path.values.shape)
        out[self._first] = of_controls[self._bounded]
        return out


class BoxSweep:
    """Minimises the linear-quadratic model over all controls between their bounds, on the whole horizon at once.

    A control is free or fixed at a bound. Given the fixed ones, a backward sweep and a linear forward one compute the
    minimiser over the free ones and the multipliers of the fixed ones. Then free controls beyond a bound are fixed, and
    fixed ones whose multiplier has the wrong sign are freed, until there are none (the primal-dual active set method:
    Hintermueller, Ito, Kunisch, SIAM J. Optim. 13, 2002); the next run starts from this active set. Newton's step in
    the free controls is a sweep by Dunn and Bertsekas, J. Optim. Theory Appl. 63, 1989; Pantoja and Mayne, Int. J.
    Control 53, 1991.

    Boxes on each node's feedforward step alone (Tassa, Mansard, Todorov, ICRA 2014) ignore its feedback: after large
    changes of the states the roll-out then clips controls that the sweep assumed, and the line search stalls.

    Args:
        functions: expansion and bounds (read) and gains (written).

    Attributes:
        value_hessian: (N+1, ndx, ndx) of the cost-to-go for the fixed controls.
        value_gradient: (N+1, ndx).
        held: (N, nu) -1 fixed at the lower bound, 1 at the upper one, 0 free.
        dxs: (N+1, ndx) the minimiser.
        dus: (N, nu).
        compiled: whether it is machine code.
    """

    def __init__(self, functions: ShootingFunctions) -> None:
        f = self._functions = functions
        # The expansion in which some controls are fixed: their columns are part of gaps and gradients.
        jacobian, hessian, gradient, gaps = (np.zeros_like(a) for a in (f.jacobian, f.hessian, f.gradient, f.gaps))
        last, gains = (f.last_hessian, f.last_gradient), (f.feedback, f.feedforward)
        self._model = Expansion(jacobian, hessian, gradient, gaps, *last, *gains, f.compiled)
        self._sweep = BackwardSweep(self._model)
        self.value_hessian, self.value_gradient = self._sweep.value_hessian, self._sweep.value_gradient
        self.held: IntArray = np.zeros(functions.us.shape, dtype=np.int64)
        self.dxs: Array = np.zeros(functions.gaps.shape)
        self.dus: Array = np.zeros(functions.us.shape)
        self._expected = np.zeros(2)
        source = (files("lgmpc.solvers") / "box.c").read_text()
        library = compile_source("lgmpc_box", source) if self._sweep.compiled else None
        self.compiled = library is not None
        if library is not None:
            self._bind(library.lgmpc_box)

    def _bind(self, call: Callable[[Any], int]) -> None:
        """Give the machine code its arrays."""
        f, m, sweep, (n, nu), ndx = self._functions, self._model, self._sweep, self.dus.shape, self.dxs.shape[1]
        self._plan = np.array([n, ndx, nu, 0, _EXCHANGES], dtype=np.int64)
        arrays = (
            self._plan, f.jacobian, f.hessian, f.gradient, f.gaps, f.feedback, f.feedforward, self.value_hessian,
            self.value_gradient, f.us, f.u_lower, f.u_upper, sweep.shift, np.array([_ROUNDING]), self.held, m.jacobian,
            m.hessian, m.gradient, m.gaps, self.dxs, self.dus, np.zeros(ndx), self._expected,
            np.zeros(n, dtype=np.int64), f.last_hessian, f.last_gradient,
        )  # fmt: skip
        self._memory = arrays  # the frame contains addresses only
        addresses = [array.ctypes.data for array in arrays]
        addresses += [sweep.address, ctypes.addressof(sweep.frame), sweep.plan.ctypes.data]
        self._frame = (ctypes.c_void_p * len(addresses))(*addresses)
        self._call = call

    def run(self, regularization: float, *, closed: bool) -> bool:
        """Minimise, and write the gains; return False if more regularisation is required.

        This is the case if a Hessian in the free controls is not positive definite, or if the active set does not
        converge.

        Args:
            regularization: added to the diagonals of the Hessians in controls and states.
            closed: whether all gaps are zero.
        """
        if not self.compiled:
            return self._in_numpy(regularization, closed)
        self._sweep.shift[0], self._plan[3] = regularization, closed
        return self._call(self._frame) == 0

    def expected(self, *, closed: bool) -> tuple[float, float]:
        """Return slope and curvature of the model's decrease along its step, of the last run."""
        slope, curvature = self._expected.tolist()
        return slope, curvature

    def _in_numpy(self, regularization: float, closed: bool) -> bool:
        f, held = self._functions, self.held
        low, high = f.u_lower - f.us, f.u_upper - f.us
        rounding = _ROUNDING * (1.0 + np.abs(f.us))
        fixed = low == high
        held[fixed] = 1
        for _ in range(_EXCHANGES):
            if not self._minimise(np.where(held > 0, high, np.where(held < 0, low, 0.0)), regularization, closed):
                return False
            above, below = self.dus > high + rounding, self.dus < low - rounding
            beyond = (held == 0) & (above | below)
            pulled = (held * self._slopes(regularization) > 0.0) & ~fixed
            if not (beyond | pulled).any():
                step = np.hstack([self.dxs[:-1], self.dus])
                slope = np.vdot(f.gradient, step) + np.vdot(f.last_gradient, self.dxs[-1])
                curvature = bilinear(step, f.hessian, step) + self.dxs[-1] @ f.last_hessian @ self.dxs[-1]
                self._expected[:] = -slope, -curvature
                return True
            held[pulled] = 0
            held[beyond] = np.where(above, 1, -1)[beyond]
        return False

    def _minimise(self, move: Array, regularization: float, closed: bool) -> bool:
        """Minimise over the free controls, the fixed ones changing by ``move`` (N, nu)."""
        self._fix(move, closed)
        if not self._sweep.run(regularization, closed=closed and not move.any()):
            return False
        held = self.held != 0
        self._functions.feedforward[held] = -move[held]
        self._follow()
        return all_finite(self.dxs)

    def _fix(self, move: Array, closed: bool) -> None:
        """Write the model in which controls change by ``move``, and the fixed ones by nothing else."""
        f, m, ndx = self._functions, self._model, self.dxs.shape[1]
        nodes, controls = self.held.nonzero()
        controls += ndx
        m.jacobian[...], m.hessian[...] = f.jacobian, f.hessian
        np.add(f.gradient, products(f.hessian[:, :, ndx:], move), out=m.gradient)
        m.jacobian[nodes, controls] = 0.0
        m.hessian[nodes, controls] = m.hessian[nodes, :, controls] = 0.0
        m.hessian[nodes, controls, controls] = 1.0
        m.gradient[nodes, controls] = 0.0
        m.gaps[...] = 0.0 if closed else f.gaps
        m.gaps[1:] += np.einsum("kij,ki->kj", f.jacobian[:, ndx:], move)

    def _follow(self) -> None:
        """Write the minimiser under the sweep's gains."""
        f, m, ndx = self._functions, self._model, self.dxs.shape[1]
        # dx+ = (A - B K) dx + gap - B k: one product a stage is left to the loop.
        by_state, by_control = m.jacobian[:, :ndx], m.jacobian[:, ndx:]
        closed_loop = by_state - f.feedback.transpose(0, 2, 1) @ by_control
        offset = m.gaps[1:] - np.einsum("ki,kij->kj", f.feedforward, by_control)
        self.dxs[0] = m.gaps[0]
        for dx, matrix, constant, dx_next in zip(self.dxs, closed_loop, offset, self.dxs[1:], strict=False):
            dx.dot(matrix, dx_next)
            dx_next += constant
        np.negative(f.feedforward, out=self.dus)
        self.dus -= products(f.feedback, self.dxs[:-1])

    def _slopes(self, regularization: float) -> Array:
        """Return the regularised model's gradient (N, nu) by the controls at the minimiser: zero for free ones."""
        f, ndx = self._functions, self.dxs.shape[1]
        # The sweep's gradients are those with closed gaps.
        moved = self.dxs - self._model.gaps
        costates = self.value_gradient + products(self.value_hessian, moved)
        step = np.hstack([self.dxs[:-1], self.dus])
        slopes: Array = f.gradient[:, ndx:] + products(f.hessian[:, ndx:], step)
        slopes += regularization * self.dus + products(f.jacobian[:, ndx:], costates[1:])
        return slopes


class BoxFddp(Fddp):
    """Feasibility-driven DDP whose controls stay within bounds: every constraint row bounds one control.

    The bounds are those of the actions' path constraints and may depend on parameters. The sweep minimises over the
    boxes of all nodes together (:class:`BoxSweep`), with and without gaps, and the roll-out clips
    to them.

    Raises:
        InputError: a path constraint that is not a bound on a control.
    """

    name = "box FDDP"

    def _check_constraints(self) -> None:
        self._rows = bounded_rows(self.problem)

    def _make_sweep(self) -> BoxSweep:
        self._bounds = ControlBounds(self.problem, self._rows)
        self._box = BoxSweep(self.functions)
        return self._box

    def _begin(self, guess: Trajectory) -> Status | None:
        f = self.functions
        self._bounds.write(f.u_lower, f.u_upper)
        self._box.held[...] = 0
        if not (f.u_lower <= f.u_upper).all():
            super()._begin(guess)
            nan = np.isnan(f.u_lower).any() or np.isnan(f.u_upper).any()
            return Status.NOT_FINITE if nan else Status.INFEASIBLE
        return super()._begin(Trajectory(guess.xs, np.clip(guess.us, f.u_lower, f.u_upper)))

    def _split(self, gradient: Array) -> tuple[Array, Array]:
        f = self.functions
        held = ((f.us <= f.u_lower) & (gradient > 0.0)) | ((f.us >= f.u_upper) & (gradient < 0.0))
        return self._bounds.multipliers(np.where(held, -gradient, 0.0)), np.where(held, 0.0, gradient)

    def _expected_from_gaps(self) -> float:
        return 0.0  # the sweep's own roll-out has accounted for them
