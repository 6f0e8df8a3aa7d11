"""Expansion and roll-out of a whole horizon on shared arrays, without copies, for shooting methods."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from lgmpc.actions import Action
from lgmpc.compile import BatchKernel, StageKernel, aligned_zeros, cached
from lgmpc.ocp.horizon import StageMatrices, bind_intervals, bind_last, difference, distinct, like, symbols_of
from lgmpc.ocp.problem import ShootingProblem
from lgmpc.state import State
from lgmpc.typing import Array


class ShootingFunctions:
    """Expansion and roll-out of one :class:`~lgmpc.ocp.ShootingProblem`, on arrays of its own.

    Write :attr:`xs` and :attr:`us` (and the problem's parameters and first state), call :meth:`expand`, read the
    expansion; write gains, gaps and step length, call :meth:`roll_out`, read the candidate. Controls that a
    node's action does not have are zero in every result.

    Args:
        problem: the problem.

    Attributes:
        compiled: whether it is machine code.
        xs: (N+1, nx) point of expansion.
        us: (N, nu).
        jacobian: (N, ndx + nu, ndx), ``[A B]^T`` of each interval, in tangent coordinates.
        hessian: (N, ndx + nu, ndx + nu), ``[Q S^T; S R]``; the identity for controls that an action does not have.
        gradient: (N, ndx + nu), ``[q; r]``.
        gaps: (N+1, ndx), ``f(x_{k-1}, u_{k-1}) (-) x_k`` in row k; row 0 is ``x0 (-) xs[0]``, zero.
        costs: (N+1,) cost of each node.
        last_hessian: (ndx, ndx) of the terminal cost.
        last_gradient: (ndx,).
        feedback: (N, nu, ndx) K.
        feedforward: (N, nu) k.
        u_lower: (N, nu) lower bounds of the roll-out's controls; initially minus infinity.
        u_upper: (N, nu) upper bounds; initially infinity.
        step_length: (1,) alpha.
        xs_try: (N+1, nx) the roll-out's states.
        us_try: (N, nu) its controls, ``u - alpha k - K (x_try (-) x)``.
        costs_try: (N+1,) cost of each node.
        moved: (N+1, ndx), ``xs (-) xs_try``, after :meth:`measure_move`.
    """

    def __init__(self, problem: ShootingProblem) -> None:
        n, ndx, nu = problem.nodes, problem.state.ndx, problem.nu
        self.problem = problem
        self.xs: Array = np.tile(problem.x0, (n + 1, 1))
        self.us: Array = np.zeros((n, nu))
        # Vectors that begin within a line of the caches take twice as long to write.
        self.jacobian: Array = aligned_zeros(n * (ndx + nu) * ndx).reshape(n, ndx + nu, ndx)
        self.hessian: Array = aligned_zeros(n * (ndx + nu) ** 2).reshape(n, ndx + nu, ndx + nu)
        self.gradient: Array = np.zeros((n, ndx + nu))
        self.gaps: Array = np.zeros((n + 1, ndx))
        self.costs: Array = np.zeros(n + 1)
        self.last_hessian: Array = np.zeros((ndx, ndx))
        self.last_gradient: Array = np.zeros(ndx)
        self.feedback: Array = np.zeros((n, nu, ndx))
        self.feedforward: Array = np.zeros((n, nu))
        self.u_lower: Array = np.full((n, nu), -np.inf)
        self.u_upper: Array = np.full((n, nu), np.inf)
        self.step_length: Array = np.ones(1)
        self.xs_try: Array = self.xs.copy()
        self.us_try: Array = np.zeros((n, nu))
        self.costs_try: Array = np.zeros(n + 1)
        self.moved: Array = np.zeros((n + 1, ndx))

        actions = distinct(problem)
        made = cached(_compile, actions, problem.terminal, problem.state, nu)
        self._expand = (
            *bind_intervals(
                problem, made.expand, x=self.xs, u=self.us, x_next=self.xs[1:], jacobian=self.jacobian,
                hessian=self.hessian, gradient=self.gradient, gap=self.gaps[1:], cost=self.costs[:, None],
            ),
            bind_last(
                problem, made.expand_last, x=self.xs[n:], hessian=self.last_hessian.reshape(1, -1),
                gradient=self.last_gradient, cost=self.costs[n:],
            ),
        )  # fmt: skip
        self._roll = (
            *bind_intervals(
                problem, made.roll_out, x=self.xs_try, x_base=self.xs, u_base=self.us, feedback=self.feedback,
                feedforward=self.feedforward, gap=self.gaps[1:], lower=self.u_lower, upper=self.u_upper,
                alpha=self.step_length, x_next=self.xs_try[1:], u=self.us_try, cost=self.costs_try[:, None],
            ),
            bind_last(problem, made.last_cost, x=self.xs_try[n:], cost=self.costs_try[n:]),
        )  # fmt: skip
        self._difference = made.difference.bind(n + 1, x0=self.xs_try, x1=self.xs, dx=self.moved)
        self.compiled = made.difference.compiled

    def expand(self) -> None:
        """Expand every node around (xs, us)."""
        for call in self._expand:
            call()

    def roll_out(self) -> None:
        """Simulate from the first state under the gains, keeping ``1 - alpha`` of every gap."""
        self.xs_try[0] = self.problem.x0
        for call in self._roll:
            call()

    def measure_move(self) -> None:
        """Write :attr:`moved`."""
        self._difference()

    def accept(self) -> None:
        """Set the point of expansion to the last roll-out."""
        self.xs[...] = self.xs_try
        self.us[...] = self.us_try


@dataclass(frozen=True)
class _RollOut:
    """A roll-out in two kernels: the simulation, and all nodes' costs, several at a time."""

    simulate: StageKernel
    cost: BatchKernel

    def bind(self, stages: int, **memory: Array) -> Callable[[], int]:
        """Return the call that evaluates all stages on this memory; it returns 0."""
        z = np.zeros((stages, self.simulate.output_sizes["z"]))
        cost = self.cost.bind(stages, z=z, **{name: memory[name] for name in ("x", "u", "p", "cost")})
        simulate = self.simulate.bind(stages, z=z, **{name: memory[name] for name in memory if name != "cost"})
        return lambda: simulate() or cost()


@dataclass(frozen=True)
class _Compiled:
    """The kernels of a problem."""

    expand: tuple[BatchKernel, ...]
    roll_out: tuple[StageKernel | _RollOut, ...]
    expand_last: BatchKernel
    last_cost: StageKernel
    difference: StageKernel


def _compile(actions: tuple[Action, ...], last: Action, state: State, nu: int) -> _Compiled:
    def expand(action: Action) -> BatchKernel:
        return BatchKernel(StageMatrices(action, nu).stacked())

    def roll_out(action: Action) -> StageKernel | _RollOut:
        if action.expansion is None:
            return StageKernel(_roll_out(action, nu))
        simulate = StageKernel(_simulation(action, nu))
        return _RollOut(simulate, BatchKernel(action.expansion.cost))

    return _Compiled(
        tuple(map(expand, actions)),
        tuple(map(roll_out, actions)),
        BatchKernel(_last_expansion(last)),
        StageKernel(last.terminal_value_function),
        StageKernel(difference(state)),
    )


def _roll_out(action: Action, nu: int) -> ca.Function:
    symbols, names, u, close = _under_feedback(action, nu)
    policy = ca.Function("policy", symbols, [u])
    x_next, gap, alpha = (
        ca.SX.sym("x_next", action.state.nx),
        symbols[names.index("gap")],
        symbols[names.index("alpha")],
    )
    closing = ca.Function("closing", [x_next, gap, alpha], [close(x_next)])
    inputs = [like(action.value_function, symbol) for symbol in symbols]
    u = policy(*inputs)
    x_next, cost, *_ = action.value_function.call([inputs[0], u[: action.nu], inputs[-1]])
    moved = closing(x_next, *(inputs[names.index(name)] for name in ("gap", "alpha")))
    return ca.Function(f"{action.name}_roll_out_{nu}", inputs, [moved, u, cost], names, ["x_next", "u", "cost"])


def _simulation(action: Action, nu: int) -> ca.Function:
    """Return the roll-out without costs, of the action's own parameters, with the unknowns z of its dynamics."""
    assert action.expansion is not None
    dynamics = action.expansion.dynamics
    inputs, names, u, close = _under_feedback(action, nu)
    inputs[-1] = ca.SX.sym("p", dynamics.numel_in(2))
    x_next, z = dynamics.call([inputs[0], u[: action.nu], inputs[-1]])
    name = f"{dynamics.name()}_roll_out_{nu}"
    return ca.Function(name, inputs, [close(x_next), u, z], names, ["x_next", "u", "z"])


def _under_feedback(action: Action, nu: int) -> tuple[list[Any], list[str], Any, Callable[[Any], Any]]:
    """Return a roll-out's arguments and their names, its control, and the function that leaves its share of the gap."""
    state = action.state
    x, base, gap = ca.SX.sym("x", state.nx), ca.SX.sym("x_base", state.nx), ca.SX.sym("gap", state.ndx)
    u_base, forward, lower, upper = (ca.SX.sym(name, nu) for name in ("u_base", "feedforward", "lower", "upper"))
    back, alpha = ca.SX.sym("feedback", state.ndx, nu), ca.SX.sym("alpha")
    p = ca.SX.sym("p", action.parameters.size)
    u = u_base - alpha * forward - back.T @ state.diff_symbolic(base, x)
    # By comparison, not with fmin and fmax, which return the bound for NaN.
    u = ca.if_else(u < lower, lower, ca.if_else(u > upper, upper, u))
    u = ca.vertcat(ca.reshape(u[: action.nu], action.nu, 1), ca.DM.zeros(nu - action.nu))
    inputs = [x, base, u_base, back, forward, gap, lower, upper, alpha, p]
    names = ["x", "x_base", "u_base", "feedback", "feedforward", "gap", "lower", "upper", "alpha", "p"]
    return inputs, names, u, lambda reached: state.integrate_symbolic(reached, (alpha - 1) * gap)


def _last_expansion(action: Action) -> ca.Function:
    function = action.terminal_quadratic_function
    x, p = symbols_of(function)
    m = dict(zip(function.name_out(), function.call([x, p]), strict=True))
    outputs = [m["Q"], m["q"], m["cost"]]
    return ca.Function(f"{action.name}_last_expansion", [x, p], outputs, ["x", "p"], ["hessian", "gradient", "cost"])
