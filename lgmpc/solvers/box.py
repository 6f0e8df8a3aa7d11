"""Bounds on controls: found in the actions' path constraints, and kept to in the backward sweep."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import lapack

from lgmpc.actions import Action
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem
from lgmpc.solvers.sweep import BackwardSweep
from lgmpc.typing import Array, IntArray

__all__ = ["BoxSweep", "ControlBounds", "control_bounds", "minimise_in_box"]


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
    # A row is a control plus what the parameters say, a reference for instance.
    offset = ca.substitute(value, ca.vertcat(x, u), ca.SX.zeros(action.state.nx + action.nu))
    edges = [ca.densify(ca.SX(edge) - offset) for edge in (path.lower, path.upper)]
    return np.array(rows, dtype=np.int64), ca.Function("limits", [p], edges)


class BoxSweep(BackwardSweep):
    """A sweep whose feedforward keeps each control within its bounds, with feedback in the free controls only."""

    def run(self, regularization: float, *, closed: bool) -> bool:
        """Sweep once; with gaps left the bounds wait (the roll-out keeps to them)."""
        self._boxed = closed
        return super().run(regularization, closed=closed)

    def _gains(self, t: int, quu: Array, qux: Array, qu: Array, feedback: Array, feedforward: Array) -> bool:
        f = self._functions
        if not self._boxed or not (np.isfinite(f.u_lower[t]).any() or np.isfinite(f.u_upper[t]).any()):
            return super()._gains(t, quu, qux, qu, feedback, feedforward)
        step, free = minimise_in_box(quu, qu, f.u_lower[t] - f.us[t], f.u_upper[t] - f.us[t])
        if step is None:
            return False
        feedback[...] = 0.0
        if free.any():
            factor, failed = lapack.dpotrf(quu[np.ix_(free, free)], 1, 0)
            if failed:
                return False
            feedback[free] = lapack.dpotrs(factor, qux[free], 1)[0]
        feedforward[...] = -step
        self.control_product[t] = quu.dot(feedforward)
        return True

    def _lower(self, g: Array, qux: Array, qu: Array, t: int, feedback: Array, feedforward: Array) -> None:
        # Also the controls that move to their bounds move the gradient; the free ones' own gradients vanish there.
        g -= feedforward.dot(qux)


def minimise_in_box(
    hessian: Array, gradient: Array, lower: Array, upper: Array, max_iterations: int = 100
) -> tuple[Array | None, Array]:
    """Minimise ``1/2 d^T H d + g^T d`` over ``lower <= d <= upper`` by projected Newton steps.

    Bertsekas, "Projected Newton methods for optimization problems with simple constraints", SIAM J. Control Optim. 20,
    1982.

    Args:
        hessian: (n, n) symmetric.
        gradient: (n,).
        lower: (n,) at most ``upper``.
        upper: (n,).
        max_iterations: Newton steps.

    Returns:
        The minimiser (n,) and which entries (n,) no bound holds; None for the former if H is not positive definite in
        the free entries.
    """
    n = gradient.size
    d = np.clip(np.zeros(n), lower, upper)
    free = np.ones(n, dtype=bool)
    scale = 1e-12 * max(1.0, float(np.abs(gradient).max(initial=0.0)))
    for _ in range(max_iterations):
        slope = gradient + hessian.dot(d)
        free = ~(((d <= lower) & (slope > 0.0)) | ((d >= upper) & (slope < 0.0)))
        if not free.any() or float(np.abs(slope[free]).max()) <= scale:
            break
        factor, failed = lapack.dpotrf(hessian[np.ix_(free, free)], 1, 0)
        if failed:
            return None, free
        newton = np.zeros(n)
        newton[free] = -lapack.dpotrs(factor, slope[free], 1)[0]
        value = d.dot(0.5 * hessian.dot(d) + gradient)
        length = 1.0
        while length > 1e-8:
            moved = np.clip(d + length * newton, lower, upper)
            if value - moved.dot(0.5 * hessian.dot(moved) + gradient) >= 0.1 * slope.dot(d - moved):
                break
            length *= 0.5
        if np.array_equal(moved, d):
            break
        d = moved
    return d, free
