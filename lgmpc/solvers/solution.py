"""What every solver of a shooting problem returns: a trajectory with methods that measure and explain it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum

import casadi as ca
import numpy as np

from lgmpc.actions import Action, Cost
from lgmpc.ocp import KktResidual, ShootingProblem, Trajectory
from lgmpc.typing import Array

__all__ = ["Solution", "Status", "Timings"]


class Status(Enum):
    """How a solve ended; the value is the remedy."""

    CONVERGED = "nothing to do"
    ACCEPTABLE = "nothing to do if the accuracy is enough; else bring the weights closer together"
    ITERATION_LIMIT = "raise max_iterations, or start closer to the solution"
    TIME_LIMIT = "raise time_limit, or start closer to the solution"
    PRECISION_LIMIT = "rounding hides what is left to gain: loosen the tolerance, or bring the weights closer together"
    STOPPED = "nothing to do: the callback requested the stop"
    STALLED = (
        "no step lowers the cost: start elsewhere, make the intervals shorter, or bring the weights closer together"
    )
    INFEASIBLE = "no point satisfies the constraints: check bounds and first state, or start elsewhere"
    NOT_FINITE = "check guess, first state, parameters and the action's expressions for NaN, infinity and division by 0"
    FAILED = "the underlying solver broke down: bring the weights closer together, or start elsewhere"

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return self.value

    @property
    def solved(self) -> bool:
        """Whether the trajectory satisfies the requested conditions."""
        return self in (Status.CONVERGED, Status.ACCEPTABLE)


@dataclass(frozen=True)
class Timings:
    """Where the time went, s.

    Attributes:
        total: from call to return.
        expansion: derivatives.
        backward: Riccati sweeps, or subproblems.
        forward: roll-outs, or trial points.
    """

    total: float
    expansion: float = 0.0
    backward: float = 0.0
    forward: float = 0.0


@dataclass(frozen=True, eq=False)
class Solution:
    """The last trajectory of a solve, with the data that its measures need. Its arrays are read-only and its own.

    Attributes:
        problem: the problem with the data of this solve (a copy).
        xs: (N+1, nx) states.
        us: (N, nu) controls.
        feedback: (N, nu, ndx) K of ``u = us - K (x (-) xs)``; none (length 0) from solvers without a sweep.
        feedforward: (N, nu) k of the last sweep: what it would still have moved; (0, nu) from solvers without.
        costates: (N, ndx) multipliers lambda_1 .. lambda_N of the dynamics.
        multipliers: (N, ng) of the path constraint, positive at the upper bound, negative at the lower one; ng is the
            largest of all actions.
        status: how it ended.
        iterations: taken.
        cost: at the trajectory.
        gaps: (N+1, ndx) of the dynamics, as the solver measured them; row 0 is the first state's.
        kkt: residual of the optimality conditions, as the solver measured it.
        timings: where the time went.
        criterion: what the solver compared with its tolerance.
    """

    problem: ShootingProblem = field(repr=False)
    xs: Array = field(repr=False)
    us: Array = field(repr=False)
    feedback: Array = field(repr=False)
    feedforward: Array = field(repr=False)
    costates: Array = field(repr=False)
    multipliers: Array = field(repr=False)
    status: Status
    iterations: int
    cost: float
    gaps: Array = field(repr=False)
    kkt: KktResidual
    timings: Timings
    criterion: float = math.nan

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @property
    def trajectory(self) -> Trajectory:
        """States and controls."""
        return Trajectory(self.xs, self.us)

    @property
    def scale(self) -> float:
        """1 + the largest multiplier or costate: the scale of a solution's stationarity (as in SNOPT)."""
        largest = (float(np.abs(array).max(initial=0.0)) for array in (self.costates, self.multipliers))
        return 1.0 + max(largest)

    def control(self, node: int, x: Array) -> Array:
        """The control (nu,) at a node for a state x (nx,) near its own: with feedback, where the solver gives it."""
        u: Array = self.us[node]
        return u - self.feedback[node] @ self.problem.state.diff(self.xs[node], x) if len(self.feedback) else u.copy()

    def defects(self) -> Array:
        """Recompute the gaps (N+1, ndx) of the dynamics; row 0 is the first state's."""
        problem = self.problem
        gaps = [problem.state.diff(self.xs[0], problem.x0)]
        for k in range(problem.nodes):
            gaps.append(problem.state.diff(self.xs[k + 1], problem.evaluate(k, self.xs[k], self.us[k]).x_next))
        return np.array(gaps)

    def constraint_violation(self) -> Array:
        """Recompute by how much (N,) the worst row of each node's path constraint leaves its bounds."""
        return np.array([self.problem.evaluate(k, x, u).violation for k, (x, u) in enumerate(self._nodes())])

    def stationarity(self) -> Array:
        """Recompute the Lagrangian's gradient (N+1, ndx + nu) with respect to each node's state and control.

        The first state is given and the last node has no control: these parts are zero.
        """
        problem, ndx = self.problem, self.problem.state.ndx
        out = np.zeros((problem.nodes + 1, ndx + problem.nu))
        for k, (x, u) in enumerate(self._nodes()):
            action = problem.actions[k]
            p = problem.parameters[k, : action.parameters.size]
            found = action.quadratic_function(x=x, u=u[: action.nu], x_next=self.xs[k + 1], p=p)
            m = {name: found[name].full() for name in ("A", "B", "C", "D", "q", "r")}
            mu = self.multipliers[k, : m["C"].shape[0]]
            out[k, :ndx] += m["q"][:, 0] + m["A"].T @ self.costates[k] + m["C"].T @ mu
            out[k, ndx : ndx + action.nu] = m["r"][:, 0] + m["B"].T @ self.costates[k] + m["D"].T @ mu
            out[k + 1, :ndx] -= self.costates[k]
        terminal = problem.terminal
        p = problem.parameters[-1, : terminal.parameters.size]
        out[-1, :ndx] += terminal.terminal_quadratic_function(x=self.xs[-1], p=p)["q"].full()[:, 0]
        out[0, :ndx] = 0.0
        return out

    def complementarity(self) -> Array:
        """Recompute, for each node (N,), the largest of its rows' smaller of multiplier and distance to its bound."""
        worst = np.zeros(self.problem.nodes)
        for k, (x, u) in enumerate(self._nodes()):
            point = self.problem.evaluate(k, x, u)
            mu = self.multipliers[k, : point.constraint.size]
            above = np.minimum(np.maximum(mu, 0.0), np.abs(point.upper - point.constraint))
            below = np.minimum(np.maximum(-mu, 0.0), np.abs(point.constraint - point.lower))
            worst[k] = np.max(above + below, initial=0.0)
        return worst

    def residual(self) -> KktResidual:
        """Recompute the residual of the optimality conditions, independently of the solver and of compiled code."""
        parts = (self.stationarity(), self.defects(), self.constraint_violation(), self.complementarity())
        return KktResidual(*(float(np.abs(part).max()) for part in parts))

    def measured(self) -> Solution:
        """The same with gaps and residual as recomputed."""
        return replace(self, gaps=self.defects(), kkt=self.residual())

    def explain(self) -> str:
        """Say in a few lines how it ended, what to do, and which node violates which condition most."""
        with np.errstate(invalid="ignore", over="ignore"):  # the text reports NaN
            return self._explanation()

    def _explanation(self) -> str:
        iterations = f"{self.iterations} iteration{'' if self.iterations == 1 else 's'}"
        ended = self.status.name.lower().replace("_", " ")
        lines = [f"{ended} after {iterations}: {self.status.remedy}."]
        if not np.isfinite(self.problem.x0).all():
            return "\n".join([*lines, "The first state holds NaN or infinity."])
        bad = np.flatnonzero(~np.isfinite(np.hstack([self.xs[:-1], self.us])).all(axis=1))
        if bad.size:
            return "\n".join([*lines, f"NaN or infinity first at node {bad[0]} of the trajectory."])
        first = self._first_not_finite()
        if first is not None:
            return "\n".join([*lines, first])
        ndx = self.problem.state.ndx
        defects, gradient, violation = np.abs(self.defects()), np.abs(self.stationarity()), self.constraint_violation()
        k, i = _where(defects)
        if defects[k, i] == 0.0:
            lines.append("dynamics: no gap anywhere.")
        elif k == 0:
            lines.append(f"dynamics: largest gap {defects[k, i]:.2e}, the first state's own, tangent entry {i}.")
        else:
            place = f"where interval {k - 1} ('{self.problem.actions[k - 1].name}') meets node {k}"
            lines.append(f"dynamics: largest gap {defects[k, i]:.2e}, {place}, tangent entry {i}.")
        k, i = _where(gradient)
        entry = f"control {i - ndx}" if i >= ndx else f"tangent entry {i} of the state"
        name = self.problem.action_at(k).name
        lines.append(f"stationarity: largest gradient {gradient[k, i]:.2e} at node {k} ('{name}'), {entry}.")
        if violation.max() > 0.0:
            k = int(violation.argmax())
            point = self.problem.evaluate(k, self.xs[k], self.us[k])
            row = int(np.maximum(point.lower - point.constraint, point.constraint - point.upper).argmax())
            bounds = f"[{point.lower[row]:.4g}, {point.upper[row]:.4g}]"
            value = f"{point.constraint[row]:.4g}, not in {bounds}"
            owner = _row_name(self.problem.actions[k], row, point.constraint.size)
            lines.append(f"constraint: largest violation {violation[k]:.2e} at node {k}, {owner} ({value}).")
        loose = self.complementarity()
        if loose.max() > 0.0:
            k = int(loose.argmax())
            lines.append(f"complementarity: largest {loose[k]:.2e} (a multiplier away from its bound) at node {k}.")
        costs = self._costs()
        k = int(costs.argmax())
        share = self._largest_term(k)
        lines.append(f"cost: {costs.sum():.6g}, most of it at node {k} ({costs[k]:.6g}{share}).")
        return "\n".join(lines)

    def _nodes(self) -> list[tuple[Array, Array]]:
        return list(zip(self.xs[:-1], self.us, strict=True))

    def _costs(self) -> Array:
        problem = self.problem
        last = problem.terminal.terminal_value_function(
            self.xs[-1], problem.parameters[-1, : problem.terminal.parameters.size]
        )
        return np.array([*(problem.evaluate(k, x, u).cost for k, (x, u) in enumerate(self._nodes())), float(last)])

    def _largest_term(self, node: int) -> str:
        """Name the cost item that a node pays most for, where the action names its items."""
        action, p = self.problem.action_at(node), self.problem.parameters[node]
        names = [item.name for item in getattr(action, "costs", ())]
        symbols = [
            ca.SX.sym(name, size)
            for name, size in (("x", action.state.nx), ("u", action.nu), ("p", action.parameters.size))
        ]
        last = node == self.problem.nodes
        cost = action.terminal_cost(symbols[0], symbols[2]) if last else action.cost(*symbols)
        if not names or len(cost.terms) != len(names):
            return ""  # a last node leaves out the items that need a control: which ones, the action decides
        terms = ca.Function("terms", symbols, [ca.vertcat(*(Cost((term,)).value for term in cost.terms))])
        u = np.zeros(action.nu) if last else self.us[node, : action.nu]
        values = terms(self.xs[node], u, p[: action.parameters.size]).full()[:, 0]
        worst = int(values.argmax())
        return f", of which '{names[worst]}' {values[worst]:.6g}"

    def _first_not_finite(self) -> str | None:
        """Name the first node whose own values are not finite at a trajectory that is."""
        problem, failed = self.problem, self.status is Status.NOT_FINITE
        for k in range(problem.nodes + 1):
            layout = problem.action_at(k).parameters
            for name, where in layout.items():
                values = problem.parameters[k, where]
                bound = name.endswith(("lower", "upper"))  # may be infinite
                if np.isnan(values).any() or (failed and not bound and np.isinf(values).any()):
                    return f"Parameter '{name}' of node {k} ('{problem.action_at(k).name}') holds NaN or infinity."
        for k, (x, u) in enumerate(self._nodes()):
            point = problem.evaluate(k, x, u)
            parts = {"next state": point.x_next, "cost": np.array(point.cost), "constraint": point.constraint}
            for name, value in parts.items():
                if not np.isfinite(value).all():
                    return f"The {name} of node {k} ('{problem.actions[k].name}') holds NaN or infinity."
        if not np.isfinite(self._costs()[-1]):
            return f"The cost of the last node ('{problem.terminal.name}') holds NaN or infinity."
        return None


def _row_name(action: Action, row: int, rows: int) -> str:
    """What a row of the path constraint belongs to, where the action names its items (they are the last rows)."""
    items = tuple(getattr(action, "constraints", ()))
    start = rows - sum(item.residual.nr for item in items)
    for item in items:
        if start <= row < start + item.residual.nr:
            return f"'{item.name}' row {row - start}"
        start += item.residual.nr
    return f"row {row}"


def _where(array: Array) -> tuple[int, int]:
    row, column = np.unravel_index(int(array.argmax()), array.shape)
    return int(row), int(column)
