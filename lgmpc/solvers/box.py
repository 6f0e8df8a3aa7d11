"""Bounds on controls: found in the actions' path constraints, and kept to in the backward sweep."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from lgmpc.actions import Action
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingFunctions, ShootingProblem
from lgmpc.solvers.compiled_sweep import make_sweep
from lgmpc.solvers.sweep import all_finite
from lgmpc.typing import Array, IntArray

__all__ = ["BoxSweep", "ControlBounds", "control_bounds"]

_ROUNDING = 1e-12  # by which a free control may pass its bound, relative to it
_EXCHANGES = 10  # of held controls; a model that takes more is regularised


@dataclass(frozen=True)
class ControlBounds:
    """Which control each row of each action's path constraint bounds.

    Attributes:
        problem: whose constraints these are.
        rows: for each interval (N) the indices (ng,) of its rows' controls.
        limits: for each interval the function ``p -> (lower, upper)`` of its rows.
    """

    problem: ShootingProblem
    rows: tuple[IntArray, ...]
    limits: tuple[ca.Function, ...]

    def write(self, parameters: Array, lower: Array, upper: Array) -> None:
        """Write the bounds of all controls (N, nu); infinite where there is none, the tighter of two."""
        lower[...], upper[...] = -np.inf, np.inf
        for k, (rows, limits) in enumerate(zip(self.rows, self.limits, strict=True)):
            if rows.size:
                p = parameters[k, : self.problem.actions[k].parameters.size]
                low, high = (value.full()[:, 0] for value in limits(p))
                np.maximum.at(lower[k], rows, low)
                np.minimum.at(upper[k], rows, high)

    def multipliers(self, of_controls: Array) -> Array:
        """Give each row (N, ng) the multiplier of its control (N, nu); the first of several rows gets it."""
        out = np.zeros((len(self.rows), max(rows.size for rows in self.rows)))
        for k, rows in enumerate(self.rows):
            controls, first = np.unique(rows, return_index=True)
            out[k, first] = of_controls[k, controls]
        return out


def control_bounds(problem: ShootingProblem) -> ControlBounds:
    """Read the bounds on controls off a problem's path constraints.

    Raises:
        InputError: a row is something else than one control between bounds.
    """
    known: dict[int, tuple[IntArray, ca.Function]] = {}
    for k, action in enumerate(problem.actions):
        if id(action) not in known:
            known[id(action)] = _rows(action, k)
    found = [known[id(action)] for action in problem.actions]
    return ControlBounds(problem, tuple(rows for rows, _ in found), tuple(limits for _, limits in found))


def _rows(action: Action, node: int) -> tuple[IntArray, ca.Function]:
    x, u, p = (
        ca.SX.sym(name, n) for name, n in (("x", action.state.nx), ("u", action.nu), ("p", action.parameters.size))
    )
    path = action.constraint(x, u, p)
    value = ca.SX(path.value)
    slope = ca.jacobian(value, u)
    rows: list[int] = []
    for i in range(value.shape[0]):
        row = slope[i, :]
        of_state = ca.jacobian(value[i], x).nnz() > 0
        if of_state or row.nnz() != 1 or not ca.SX(row.nz[0]).is_one():
            expected = "bounds on controls only (the SQP and the NLP take any constraint)"
            raise InputError(f"actions[{node}]", f"'{action.name}', whose constraint row {i} is no control", expected)
        rows.append(int(row.sparsity().get_triplet()[1][0]))
    # A row is a control plus an expression in the parameters, a reference for instance.
    offset = ca.substitute(value, ca.vertcat(x, u), ca.SX.zeros(action.state.nx + action.nu))
    edges = [ca.densify(ca.SX(edge) - offset) for edge in (path.lower, path.upper)]
    return np.array(rows, dtype=np.int64), ca.Function("limits", [p], edges)


@dataclass(frozen=True)
class _Held:
    """An expansion in which some controls are known: their columns have moved into gaps and gradients."""

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
    def of(cls, f: ShootingFunctions) -> _Held:
        """One of the same size that writes the same gains."""
        jacobian, hessian, gradient, gaps = (np.zeros_like(a) for a in (f.jacobian, f.hessian, f.gradient, f.gaps))
        return cls(
            jacobian, hessian, gradient, gaps, f.last_hessian, f.last_gradient, f.feedback, f.feedforward, f.compiled
        )


class BoxSweep:
    """Minimises the linear-quadratic model over all controls between their bounds, on the whole horizon at once.

    A control is free or held at a bound. With the held ones known, a backward sweep and a linear forward one give the
    minimiser over the free ones, and the multipliers of the held ones. Then free controls beyond a bound are held, held
    ones whose multiplier has the wrong sign are freed, until there are none (the primal-dual active set method:
    Hintermueller, Ito, Kunisch, SIAM J. Optim. 13, 2002); the next run begins with what is held. That Newton's step in
    the free controls is a sweep: Dunn and Bertsekas, J. Optim. Theory Appl. 63, 1989; Pantoja and Mayne, Int. J.
    Control 53, 1991.

    Boxes on each node's own step (Tassa, Mansard, Todorov, ICRA 2014) would leave out what feedback adds to it: where
    the states move far, the roll-out then clips controls that the sweep assumed, and the line search stalls.

    Args:
        functions: where expansion and bounds are read and the gains are written.
        progress: called with a description of what is being compiled.

    Attributes:
        value_hessian: (N+1, ndx, ndx) of the cost-to-go, the held controls being held.
        value_gradient: (N+1, ndx).
        held: (N, nu) -1 at the lower bound, 1 at the upper one, 0 free.
        dxs: (N+1, ndx) the minimiser.
        dus: (N, nu).
    """

    def __init__(self, functions: ShootingFunctions, progress: Callable[[str], None] | None = None) -> None:
        self._functions, self._model = functions, _Held.of(functions)
        self._sweep = make_sweep(self._model, progress)
        self.value_hessian, self.value_gradient = self._sweep.value_hessian, self._sweep.value_gradient
        self.held: IntArray = np.zeros(functions.us.shape, dtype=np.int64)
        self.dxs: Array = np.zeros(functions.gaps.shape)
        self.dus: Array = np.zeros(functions.us.shape)

    def run(self, regularization: float, *, closed: bool) -> bool:
        """Minimise, and write the gains; False if that takes more regularisation.

        It does where a Hessian in the free controls is not positive definite, and where what is held does not settle.

        Args:
            regularization: added to the diagonals of the Hessians in controls and states.
            closed: whether all gaps are zero.
        """
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
                return True
            held[pulled] = 0
            held[beyond] = np.where(above, 1, -1)[beyond]
        return False

    def expected(self, *, closed: bool) -> tuple[float, float]:
        """Slope and curvature of the model's decrease along its step."""
        f, dxs = self._functions, self.dxs
        step = np.hstack([dxs[:-1], self.dus])
        slope = np.vdot(f.gradient, step) + np.vdot(f.last_gradient, dxs[-1])
        curvature = np.einsum("ki,kij,kj->", step, f.hessian, step) + dxs[-1] @ f.last_hessian @ dxs[-1]
        return -float(slope), -float(curvature)

    def _minimise(self, move: Array, regularization: float, closed: bool) -> bool:
        """Minimise over the free controls, the held ones moving by ``move`` (N, nu)."""
        f, m, held = self._functions, self._model, self.held != 0
        ndx = self.dxs.shape[1]
        free = np.hstack([np.ones((held.shape[0], ndx)), ~held])
        np.multiply(f.jacobian, free[:, :, None], out=m.jacobian)
        np.multiply(f.hessian, free[:, :, None] * free[:, None, :], out=m.hessian)
        m.hessian[:, range(free.shape[1]), range(free.shape[1])] += 1.0 - free
        np.multiply(f.gradient + np.einsum("kij,kj->ki", f.hessian[:, :, ndx:], move), free, out=m.gradient)
        m.gaps[...] = 0.0 if closed else f.gaps
        m.gaps[1:] += np.einsum("kij,ki->kj", f.jacobian[:, ndx:], move)
        if not self._sweep.run(regularization, closed=closed and not move.any()):
            return False
        f.feedforward[held] = -move[held]
        self.dxs[0] = m.gaps[0]
        for t, (dx, du) in enumerate(zip(self.dxs, self.dus, strict=False)):
            np.subtract(-f.feedforward[t], f.feedback[t].dot(dx), out=du)
            self.dxs[t + 1] = m.gaps[t + 1] + dx.dot(m.jacobian[t, :ndx]) + du.dot(m.jacobian[t, ndx:])
        return all_finite(self.dxs)

    def _slopes(self, regularization: float) -> Array:
        """The regularised model's slopes (N, nu) in the controls at the minimiser: zero in free ones."""
        f, ndx = self._functions, self.dxs.shape[1]
        # The sweep's gradients are those where the gaps are closed.
        moved = self.dxs - self._model.gaps
        costates = self.value_gradient + np.einsum("kij,kj->ki", self.value_hessian, moved)
        step = np.hstack([self.dxs[:-1], self.dus])
        slopes: Array = f.gradient[:, ndx:] + np.einsum("kij,kj->ki", f.hessian[:, ndx:], step)
        slopes += regularization * self.dus + np.einsum("kij,kj->ki", f.jacobian[:, ndx:], costates[1:])
        return slopes
