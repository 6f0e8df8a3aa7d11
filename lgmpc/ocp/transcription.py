"""Direct multiple shooting: a problem as one CasADi nonlinear programme, for CasADi's solvers.

The variables are tangent vectors around a base trajectory (which is a parameter), so that states on manifolds need no
unit-norm constraints. The gaps are written in the same coordinates, ``dx_{k+1} - f(x_k, u_k) (-) base_{k+1}``: each is
linear in the next state with the identity as its Jacobian, the structure that Riccati-based solvers require. Bock and
Plitt, "A multiple shooting algorithm for direct solution of optimal control problems", IFAC World Congress 1984.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from lgmpc.actions import Action
from lgmpc.ocp.horizon import like, runs_of, symbols_of
from lgmpc.ocp.problem import ShootingProblem, Trajectory
from lgmpc.state import State
from lgmpc.typing import Array


@dataclass(frozen=True)
class MultipleShooting:
    """The nonlinear programme ``min f(z; p)  subject to  lower <= g(z; p) <= upper``.

    z consists of du_k and dx_{k+1} of each interval, g of the gap of the dynamics and the path constraint of each
    interval, p of the base states (N+1, nx), the base controls (N, nu) and the parameters (N+1, np).

    Attributes:
        programme: CasADi's dictionary with x, p, f and g.
        bounds: ``p -> (lower, upper)``.
        state: the space of the states.
        nu: (N,) controls of each interval.
        ng: (N,) rows of each interval's path constraint.
        differences: whether derivatives are finite differences, because an action is written in Python.
    """

    programme: dict[str, ca.MX]
    bounds: ca.Function
    state: State
    nu: tuple[int, ...]
    ng: tuple[int, ...]
    differences: bool = False

    @property
    def nodes(self) -> int:
        """N."""
        return len(self.nu)

    @property
    def size(self) -> int:
        """Number of variables."""
        return sum(self.nu) + self.nodes * self.state.ndx

    @property
    def equalities(self) -> list[bool]:
        """(rows,) True for each row of g that is a gap."""
        return [gap for ng in self.ng for gap in [True] * self.state.ndx + [False] * ng]

    def pack_parameters(self, problem: ShootingProblem, base: Trajectory) -> Array:
        """Return p for a problem's data around a base trajectory, whose first state is replaced by the problem's."""
        xs = base.xs.copy()
        xs[0] = problem.x0
        return np.concatenate([xs.ravel(), base.us.ravel(), problem.parameters.ravel()])

    def unpack(self, z: Array, p: Array) -> Trajectory:
        """Return the trajectory of the variables z."""
        n, nx = self.nodes, self.state.nx
        xs = p[: (n + 1) * nx].reshape(n + 1, nx).copy()
        us = p[(n + 1) * nx : (n + 1) * nx + n * max(self.nu)].reshape(n, max(self.nu)).copy()
        start = 0
        for k, nu in enumerate(self.nu):
            us[k, :nu] += z[start : start + nu]
            us[k, nu:] = 0.0
            start += nu + self.state.ndx
            xs[k + 1] = self.state.integrate(xs[k + 1], z[start - self.state.ndx : start])
        return Trajectory(xs, us)

    def unpack_multipliers(self, multipliers: Array, p: Array, trajectory: Trajectory) -> tuple[Array, Array]:
        """Return costates (N, ndx) and path constraint multipliers (N, ng) from those of g at a trajectory.

        The costates are those of ``f(x_k, u_k) (-) x_{k+1}``, in the tangent space of the trajectory's own states.
        """
        n, nx, ndx = self.nodes, self.state.nx, self.state.ndx
        base = p[: (n + 1) * nx].reshape(n + 1, nx)
        costates, path = np.empty((n, ndx)), np.zeros((n, max(self.ng)))
        start = 0
        for k, ng in enumerate(self.ng):
            _, jacobian = self.state.Jdiff(base[k + 1], trajectory.xs[k + 1])
            costates[k] = -jacobian.T @ multipliers[start : start + ndx]
            path[k, :ng] = multipliers[start + ndx : start + ndx + ng]
            start += ndx + ng
        return costates, path


def transcribe(problem: ShootingProblem) -> MultipleShooting:
    """Return a problem as one nonlinear programme; first state and parameters are the programme's parameters."""
    state, n = problem.state, problem.nodes
    nx, ndx, nu, n_p = state.nx, state.ndx, problem.nu, problem.parameters.shape[1]
    runs = runs_of(problem.actions)
    x, dx = ca.SX.sym("x", nx), ca.SX.sym("dx", ndx)
    integrate = ca.Function("integrate", [x, dx], [state.integrate_symbolic(x, dx)])

    z = ca.MX.sym("z", sum(action.nu for action in problem.actions) + n * ndx)
    data = ca.MX.sym("data", (n + 1) * nx + n * nu + (n + 1) * n_p)
    base_xs = ca.reshape(data[: (n + 1) * nx], nx, n + 1)
    base_us = ca.reshape(data[(n + 1) * nx : (n + 1) * nx + n * nu], nu, n)
    parameters = ca.reshape(data[(n + 1) * nx + n * nu :], n_p, n + 1)
    steps, offset = [], 0
    for action, start, stop in runs:
        size = (action.nu + ndx) * (stop - start)
        steps.append(ca.reshape(z[offset : offset + size], action.nu + ndx, stop - start))
        offset += size
    dxs = ca.horzcat(*(step[action.nu :, :] for step, (action, _, _) in zip(steps, runs, strict=True)))
    xs = ca.horzcat(base_xs[:, 0], integrate.map(n)(base_xs[:, 1:], dxs))

    cost = ca.MX(0)
    rows, lower, upper = [], [], []
    for step, (action, start, stop) in zip(steps, runs, strict=True):
        length = stop - start
        stage, limits = _interval(action)
        us = base_us[: action.nu, start:stop] + step[: action.nu, :]
        p = parameters[: action.parameters.size, start:stop]
        behind = base_xs[:, start + 1 : stop + 1]
        costs, row = stage.map(length)(xs[:, start:stop], us, behind, dxs[:, start:stop], p)
        low, high = limits.map(length)(p)
        cost += ca.sum2(costs)
        rows.append(ca.vec(row))
        lower.append(ca.vec(low))
        upper.append(ca.vec(high))
    terminal = problem.terminal
    cost += terminal.terminal_value_function(xs[:, n], parameters[: terminal.parameters.size, n])
    bounds = ca.Function("bounds", [data], [ca.vertcat(*lower), ca.vertcat(*upper)])
    programme = {"x": z, "p": data, "f": cost, "g": ca.vertcat(*rows)}
    ng = tuple(action.path_rows for action in problem.actions)
    differences = not all(action.smooth for action in (*problem.actions, terminal))
    return MultipleShooting(programme, bounds, state, tuple(action.nu for action in problem.actions), ng, differences)


def _interval(action: Action) -> tuple[ca.Function, ca.Function]:
    """Return ``(x, u, next base, next dx, p) -> (cost, [gap; path constraint])`` and ``p -> (lower, upper)``."""
    state, value = action.state, action.value_function
    base, dx, reached = ca.SX.sym("base", state.nx), ca.SX.sym("dx", state.ndx), ca.SX.sym("x_next", state.nx)
    difference = ca.Function("gap", [base, dx, reached], [dx - state.diff_symbolic(base, reached)])
    x, u, p = symbols_of(value)
    base, dx = like(value, base), like(value, dx)
    x_next, cost, path, *_ = value.call([x, u, p])
    gap = difference(base, dx, x_next)
    stage = ca.Function("stage", [x, u, base, dx, p], [cost, ca.densify(ca.vertcat(gap, path))])
    edges = [ca.densify(ca.vertcat(ca.DM.zeros(state.ndx), edge)) for edge in action.bounds_function.call([p])]
    return stage, ca.Function("limits", [p], edges)
