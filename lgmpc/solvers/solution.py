"""The result of every solver of a shooting problem: a trajectory, its residuals and an explanation."""

import math
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from lgmpc.actions import Action
from lgmpc.costs import Cost
from lgmpc.errors import InputError
from lgmpc.ocp import KktResidual, ShootingProblem, Trajectory
from lgmpc.ocp.kkt import complementarity
from lgmpc.ocp.numdiff import MEANINGS
from lgmpc.solvers.sweep import BackwardSweep, Expansion
from lgmpc.status import Status
from lgmpc.typing import Array, instance, numbers

_DERIVATIVES = ("A", "B", "C", "D", "q", "r")
_ACTIVE = 1e-9  # multiplier of a row that is at its bound
_FLAT = 1e-9  # curvature that counts as none, relative to the largest
_HELD = 1e6  # penalty of active rows, relative to the largest curvature


@dataclass(frozen=True)
class Timings:
    """Computation times, s.

    Attributes:
        total: from call to return.
        expansion: of derivatives; the preparation of a real-time iteration.
        backward: of Riccati sweeps or subproblems; the feedback of a real-time iteration.
        forward: of roll-outs or trial points.
    """

    total: float
    expansion: float = 0.0
    backward: float = 0.0
    forward: float = 0.0


@dataclass(frozen=True, eq=False)
class Solution:
    """The last trajectory of a solve, with the problem's data. Its arrays are read-only copies.

    Attributes:
        problem: the problem with the data of this solve, a copy; from a real-time iteration the problem itself.
        xs: (N+1, nx) states.
        us: (N, nu) controls.
        feedback: (N, nu, ndx) K of ``u = us - K (x (-) xs)``; of length 0 from solvers without a sweep. With
            constraints these are the gains while the active rows stay at their bounds.
        feedforward: (N, nu) k of the last sweep, the remaining full step; (0, nu) from solvers without.
        costates: (N, ndx) multipliers lambda_1 .. lambda_N of the dynamics.
        multipliers: (N, ng) of the path constraint, positive at the upper bound, negative at the lower one; ng is the
            largest of all actions.
        status: outcome.
        iterations: taken.
        cost: at the trajectory; NaN from a real-time iteration, which does not evaluate it.
        gaps: (N+1, ndx) of the dynamics, as computed by the solver; row 0 is the first state's. Of length 0 from a
            real-time iteration.
        kkt: residual of the optimality conditions, as computed by the solver; after a real-time iteration that of its
            subproblem.
        timings: computation times.
        criterion: the measure that the solver compared with its tolerance.
        qp_iterations: of the QP solver, all subproblems together.
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
    qp_iterations: int = 0

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
        """The scale of the stationarity residual: 1 + the largest multiplier or costate (as in SNOPT)."""
        largest = (float(np.abs(array).max(initial=0.0)) for array in (self.costates, self.multipliers))
        return 1.0 + max(largest)

    def control(self, node: int, x: Array) -> Array:
        """Return the control (nu,) at a node for a state x (nx,) near the node's: with feedback, if there is any."""
        instance("node", node, (int, np.integer), f"an interval, 0 to {len(self.us) - 1}")
        if not 0 <= node < len(self.us):
            raise InputError("node", node, f"an interval, 0 to {len(self.us) - 1}")
        x = numbers("x", x, self.xs[node].shape)
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
        """Recompute the largest violation (N,) of each node's path constraint."""
        return np.array([self.problem.evaluate(k, x, u).violation for k, (x, u) in enumerate(self._nodes())])

    def stationarity(self) -> Array:
        """Recompute the Lagrangian's gradient (N+1, ndx + nu) with respect to each node's state and control.

        The first state is fixed and the last node has no control: these parts are zero.
        """
        problem, ndx = self.problem, self.problem.state.ndx
        out = np.zeros((problem.nodes + 1, ndx + problem.nu))
        for k in range(problem.nodes):
            action, m = problem.actions[k], self.derivatives(k)
            mu = self.multipliers[k, : m["C"].shape[0]]
            out[k, :ndx] += m["q"][:, 0] + m["A"].T @ self.costates[k] + m["C"].T @ mu
            out[k, ndx : ndx + action.nu] = m["r"][:, 0] + m["B"].T @ self.costates[k] + m["D"].T @ mu
            out[k + 1, :ndx] -= self.costates[k]
        terminal = problem.terminal
        p = problem.parameters[-1, : terminal.parameters.size]
        out[-1, :ndx] += terminal.terminal_quadratic_function(x=self.xs[-1], p=p)["q"].full()[:, 0]
        out[0, :ndx] = 0.0
        return out

    def derivatives(self, node: int) -> dict[str, Array]:
        """Return the expansion of a node; see :attr:`lgmpc.actions.Action.quadratic_function`."""
        action = self.problem.actions[node]
        p = self.problem.parameters[node, : action.parameters.size]
        u = self.us[node, : action.nu]
        found = action.quadratic_function(x=self.xs[node], u=u, x_next=self.xs[node + 1], p=p)
        return {name: value.full() for name, value in found.items()}

    def last_hessian(self) -> Array:
        """Return the Gauss-Newton Hessian (ndx, ndx) of the terminal cost."""
        terminal, p = self.problem.terminal, self.problem.parameters[-1]
        found = terminal.terminal_quadratic_function(x=self.xs[-1], p=p[: terminal.parameters.size])
        return np.asarray(found["Q"].full(), dtype=np.float64)

    def complementarity(self) -> Array:
        """Recompute each node's (N,) largest complementarity residual; see :class:`~lgmpc.ocp.KktResidual`."""
        worst = np.zeros(self.problem.nodes)
        for k, (x, u) in enumerate(self._nodes()):
            point = self.problem.evaluate(k, x, u)
            mu = self.multipliers[k, : point.constraint.size]
            worst[k] = complementarity(mu, point.constraint, point.lower, point.upper).max(initial=0.0)
        return worst

    def is_minimum(self) -> bool:
        """Return whether the Gauss-Newton model at this stationary point has no negative curvature.

        Along the dynamics, and along the rows with multipliers, it can only have where a stage's Hessian is indefinite,
        as with a negative weight.
        """
        problem, (n, nu), ndx = self.problem, self.us.shape, self.problem.state.ndx
        jacobian, hessian = np.zeros((n, ndx + nu, ndx)), np.tile(np.eye(ndx + nu), (n, 1, 1))
        last, held = self.last_hessian(), np.zeros_like(hessian)
        for k, action in enumerate(problem.actions):
            m, own = self.derivatives(k), ndx + action.nu
            jacobian[k, :own] = np.hstack([m["A"], m["B"]]).T
            hessian[k, :own, :own] = np.block([[m["Q"], m["S"].T], [m["S"], m["R"]]])
            rows = np.hstack([m["C"], m["D"]])
            active = (np.abs(self.multipliers[k, : len(rows)]) > _ACTIVE) | (m["lower"] == m["upper"])[:, 0]
            rows = rows[active] / np.maximum(np.linalg.norm(rows[active], axis=1, keepdims=True), _ACTIVE)
            held[k, :own, :own] = rows.T @ rows
        scale = 1.0 + max(float(np.abs(hessian).max()), float(np.abs(last).max(initial=0.0)))
        stages = min(float(np.linalg.eigvalsh(hessian).min()), float(np.linalg.eigvalsh(last).min(initial=0.0)))
        if not stages < -_FLAT * scale:
            return True
        model = Expansion.of_curvature(jacobian, hessian + _HELD * scale * held, last)
        return BackwardSweep(model).run(_FLAT * scale, closed=True)

    def residual(self) -> KktResidual:
        """Recompute the residual of the optimality conditions, independently of the solver and of compiled code."""
        parts = (self.stationarity(), self.defects(), self.constraint_violation(), self.complementarity())
        return KktResidual(*(float(np.abs(part).max()) for part in parts))

    def measured(self) -> "Solution":
        """Return a copy with gaps and residual recomputed."""
        return replace(self, gaps=self.defects(), kkt=self.residual())

    def explain(self) -> str:
        """Return a few lines: outcome, remedy, and for each condition the node that violates it most."""
        with np.errstate(invalid="ignore", over="ignore"):  # the text reports NaN
            return self._explanation()

    def _explanation(self) -> str:
        iterations = f"{self.iterations} iteration{'' if self.iterations == 1 else 's'}"
        ended = self.status.name.lower().replace("_", " ")
        lines = [f"{ended} after {iterations}: {self.status.remedy}."]
        if not np.isfinite(self.problem.x0).all():
            return "\n".join([*lines, "The first state contains NaN or infinity."])
        bad = np.flatnonzero(~np.isfinite(np.hstack([self.xs[:-1], self.us])).all(axis=1))
        if bad.size:
            return "\n".join([*lines, f"NaN or infinity first at node {bad[0]} of the trajectory."])
        first = self._first_not_finite()
        if first is not None:
            return "\n".join([*lines, first])
        crossed = self._crossed_bounds()
        if crossed is not None:
            lines.append(crossed)
        beyond = self.problem.first_violation()
        if beyond is not None:
            row, size = beyond
            owner = _row_name(self.problem.actions[0], row, self.problem.actions[0].path_rows)
            lines.append(f"The first state violates {owner} of node 0 by {size:.4g}, which no control changes.")
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

    def _crossed_bounds(self) -> str | None:
        """Return a message on the first row whose bounds contradict each other."""
        for k, (x, u) in enumerate(self._nodes()):
            point = self.problem.evaluate(k, x, u)
            rows = np.flatnonzero(point.lower > point.upper)
            if rows.size:
                row = int(rows[0])
                owner = _row_name(self.problem.actions[k], row, point.constraint.size)
                bounds = f"lower {point.lower[row]:.4g} is above upper {point.upper[row]:.4g}"
                return f"The bounds of {owner} of node {k} contradict each other: {bounds}."
        return None

    def _nodes(self) -> list[tuple[Array, Array]]:
        return list(zip(self.xs[:-1], self.us, strict=True))

    def _costs(self) -> Array:
        problem = self.problem
        last = problem.terminal.terminal_value_function(
            self.xs[-1], problem.parameters[-1, : problem.terminal.parameters.size]
        )
        return np.array([*(problem.evaluate(k, x, u).cost for k, (x, u) in enumerate(self._nodes())), float(last)])

    def _largest_term(self, node: int) -> str:
        """Return the cost item with the largest value at a node, if the action names its items."""
        action, p = self.problem.action_at(node), self.problem.parameters[node]
        names = [item.name for item in getattr(action, "costs", ())]
        if not names:
            return ""
        symbols = [
            ca.SX.sym(name, size)
            for name, size in (("x", action.state.nx), ("u", action.nu), ("p", action.parameters.size))
        ]
        last = node == self.problem.nodes
        cost = action.terminal_cost(symbols[0], symbols[2]) if last else action.cost(*symbols)
        if len(cost.terms) != len(names):
            return ""  # the last node omits the items that need a control, as determined by the action
        terms = ca.Function("terms", symbols, [ca.vertcat(*(Cost((term,)).value for term in cost.terms))])
        u = np.zeros(action.nu) if last else self.us[node, : action.nu]
        values = terms(self.xs[node], u, p[: action.parameters.size]).full()[:, 0]
        worst = int(values.argmax())
        return f", of which '{names[worst]}' {values[worst]:.6g}"

    def _first_not_finite(self) -> str | None:
        """Return a message on the first node whose values are not finite although the trajectory is."""
        problem, failed = self.problem, self.status is Status.NOT_FINITE
        for k in range(problem.nodes + 1):
            layout = problem.action_at(k).parameters
            for name, where in layout.items():
                values = problem.parameters[k, where]
                bound = name.endswith(("lower", "upper"))  # may be infinite
                if np.isnan(values).any() or (failed and not bound and np.isinf(values).any()):
                    return f"Parameter '{name}' of node {k} ('{problem.action_at(k).name}') contains NaN or infinity."
        for k, (x, u) in enumerate(self._nodes()):
            point = problem.evaluate(k, x, u)
            parts = {"next state": point.x_next, "cost": np.array(point.cost), "constraint": point.constraint}
            for name, value in parts.items():
                if not np.isfinite(value).all():
                    return f"The {name} of node {k} ('{problem.actions[k].name}') contains NaN or infinity."
            found = self.derivatives(k)
            bad = [MEANINGS[name] for name in _DERIVATIVES if not np.isfinite(found[name]).all()]
            if failed and bad:
                name = problem.actions[k].name
                return f"The derivatives of node {k} ('{name}'), {bad[0]}, contain NaN or infinity."
        if not np.isfinite(self._costs()[-1]):
            return f"The cost of the last node ('{problem.terminal.name}') contains NaN or infinity."
        return None


def _row_name(action: Action, row: int, rows: int) -> str:
    """Return the item of a row of the path constraint, if the action names its items (they are the last rows)."""
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
