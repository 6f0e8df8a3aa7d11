"""Direct multiple shooting: a problem as one CasADi nonlinear programme, for any of CasADi's solvers.

The variables are tangent vectors around a base trajectory (which is a parameter), so that states on manifolds need no
unit-norm constraints; for a vector space they are plain differences. Bock and Plitt, "A multiple shooting algorithm for
direct solution of optimal control problems", IFAC World Congress 1984.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from lgmpc.actions import Action
from lgmpc.ocp.problem import ShootingProblem, Trajectory
from lgmpc.typing import Array

__all__ = ["MultipleShooting", "transcribe"]


@dataclass(frozen=True)
class MultipleShooting:
    """The nonlinear programme ``min f(z; p)  subject to  lower <= g(z; p) <= upper``.

    z holds, interval after interval, du_k and dx_{k+1}; g holds first all gaps of the dynamics, then all path
    constraints. p holds the base states (N+1, nx), the base controls (N, nu) and the parameters (N+1, np).

    Attributes:
        programme: CasADi's dictionary with x, p, f and g.
        bounds: ``p -> (lower, upper)``.
        nodes: N.
        nx: coordinates of a state.
        ndx: dimension of its tangent space.
        nu: dimension of the control.
        ng: rows of the path constraint.
        retract: ``(xs, dxs) -> xs (+) dxs``, columns of N+1 states.
    """

    programme: dict[str, ca.MX]
    bounds: ca.Function
    nodes: int
    nx: int
    ndx: int
    nu: int
    ng: int
    retract: ca.Function

    @property
    def size(self) -> int:
        """Number of variables."""
        return self.nodes * (self.nu + self.ndx)

    def pack_parameters(self, problem: ShootingProblem, base: Trajectory) -> Array:
        """Return p for a problem's data around a base trajectory, whose first state is replaced by the problem's."""
        xs = base.xs.copy()
        xs[0] = problem.x0
        return np.concatenate([xs.ravel(), base.us.ravel(), problem.parameters.ravel()])

    def unpack(self, z: Array, p: Array) -> Trajectory:
        """Return the trajectory that the variables z stand for."""
        steps = z.reshape(self.nodes, self.nu + self.ndx)
        split = (self.nodes + 1) * self.nx
        xs = p[:split].reshape(self.nodes + 1, self.nx)
        us = p[split : split + self.nodes * self.nu].reshape(self.nodes, self.nu)
        dxs = np.vstack([np.zeros(self.ndx), steps[:, self.nu :]])
        return Trajectory(np.array(self.retract(xs.T, dxs.T)).T.copy(), us + steps[:, : self.nu])

    def unpack_multipliers(self, multipliers: Array) -> tuple[Array, Array]:
        """Return costates (N, ndx) and path constraint multipliers (N, ng) from those of g."""
        split = self.nodes * self.ndx
        return multipliers[:split].reshape(self.nodes, self.ndx), multipliers[split:].reshape(self.nodes, self.ng)


def transcribe(action: Action, nodes: int) -> MultipleShooting:
    """Write the problem of an action over ``nodes`` intervals as one nonlinear programme."""
    state, nu, n_p, n = action.state, action.nu, action.parameters.size, nodes
    x, dx, u, x_next = (
        ca.SX.sym(name, size) for name, size in (("x", state.nx), ("dx", state.ndx), ("u", nu), ("x1", state.nx))
    )
    p = ca.SX.sym("p", n_p)
    path = action.constraint(x, u, p)
    gap = ca.Function("gap", [x, u, x_next, p], [state.diff_symbolic(x_next, action.step(x, u, p))])
    value = ca.Function("value", [x, u, p], [action.value_function(x, u, p)[1], path.value])
    limits = ca.Function("limits", [p], [path.lower, path.upper])
    integrate = ca.Function("integrate", [x, dx], [state.integrate_symbolic(x, dx)])

    z = ca.MX.sym("z", n * (nu + state.ndx))
    data = ca.MX.sym("data", (n + 1) * state.nx + n * nu + (n + 1) * n_p)
    steps = ca.reshape(z, nu + state.ndx, n)
    split = (n + 1) * state.nx
    base_xs = ca.reshape(data[:split], state.nx, n + 1)
    base_us = ca.reshape(data[split : split + n * nu], nu, n)
    parameters = ca.reshape(data[split + n * nu :], n_p, n + 1)
    xs = ca.horzcat(base_xs[:, 0], integrate.map(n)(base_xs[:, 1:], steps[nu:, :]))
    us = base_us + steps[:nu, :]
    costs, rows = value.map(n)(xs[:, :n], us, parameters[:, :n])
    gaps = gap.map(n)(xs[:, :n], us, xs[:, 1:], parameters[:, :n])
    cost = ca.sum2(costs) + action.terminal_value_function(xs[:, n], parameters[:, n])
    lower, upper = limits.map(n)(parameters[:, :n])
    zeros = ca.DM.zeros(n * state.ndx)
    bounds = ca.Function("bounds", [data], [ca.vertcat(zeros, ca.vec(lower)), ca.vertcat(zeros, ca.vec(upper))])
    programme = {"x": z, "p": data, "f": cost, "g": ca.vertcat(ca.vec(gaps), ca.vec(rows))}
    ng = path.value.shape[0]
    return MultipleShooting(programme, bounds, n, state.nx, state.ndx, nu, ng, integrate.map(n + 1))
