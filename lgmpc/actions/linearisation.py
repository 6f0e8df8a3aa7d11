"""The expansion of a stage as a pipeline: few expressions, a factorisation, and loops over columns.

Written out, the solve of the equations of motion for all derivatives at once makes an expansion of 100,000 scalar
operations. Here the expressions are the equations' own derivatives; one right-hand side is solved for, as often as
there are columns; products with the solutions are loops too:

    factors of A and right-hand side,   A z = right                        (z: accelerations and forces)
    G = -d(A z - right)/d(x, u),        slopes S = A^-1 G, column after column
    [A B] = direct + through S          of the next state, column after column
    H = D^T W D + D^T W T S + (D^T W T S)^T + S^T (T^T W T) S,    for residuals with derivatives D by (x, u), T by z

Only the last line depends on costs. The dynamics' functions depend on the robot, its contacts and the integrator, not
on the action's name, costs or constraints, so that all actions of a robot share what is compiled.
"""

import re
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca

from lgmpc.actions.implicit import LinearUnknown, Unknowns
from lgmpc.compile import PipelineStep
from lgmpc.costs import ParameterLayout
from lgmpc.robot.symbolic import SymbolicModel
from lgmpc.state import State


class Expandable(Protocol):
    """An action whose expansion in steps can be written; see :class:`~lgmpc.actions.multibody.ItemAction`."""

    name: str
    robot: SymbolicModel
    state: State
    nu: int
    parameters: ParameterLayout
    own_parameters: int

    def stage(self, x: Any, u: Any, p: Any, unknowns: Unknowns) -> Any:
        """Return all expressions of the interval."""


@dataclass(frozen=True)
class ExpansionSteps:
    """The steps of an action's expansion.

    They read the columns ``x``, ``u``, ``x_next`` and ``p`` and write, among others, those of :attr:`columns`, matrices
    column after column: ``jacobian`` [A B], ``gap`` b, ``hessian`` [Q S^T; S R], ``gradient`` [q; r], ``cost``, and of
    the path constraint ``rows`` [C D], ``lower`` and ``upper``, as in
    :attr:`lgmpc.actions.Action.quadratic_function`.

    Attributes:
        steps: in order.
        columns: the pattern of each result.
        dynamics: ``(x, u, p) -> (x_next, z)``, of the action's own parameters, the first ones of p.
        cost: ``(x, u, z, p) -> cost``.
    """

    steps: tuple[PipelineStep, ...]
    columns: dict[str, ca.Sparsity]
    dynamics: ca.Function
    cost: ca.Function


def expand_in_steps(action: Expandable) -> ExpansionSteps | None:
    """Return an action's expansion in steps; None if its unknowns are not those of one linear equation."""
    stage = StageSteps(action)
    if stage.equation is None:
        return None
    parts = (*stage.dynamics(stage.equation), *stage.costs(), *stage.constraints())
    return ExpansionSteps(parts, stage.columns, *stage.values(stage.equation))


def at_zero(expressions: list[Any], dx: Any) -> list[Any]:
    """Return expressions at dx = 0, without entries that vanish identically there."""
    zero = ca.SX.zeros(*dx.shape)
    return [ca.sparsify(ca.simplify(e)) if e.numel() else e for e in ca.substitute(expressions, [dx], [zero])]


class StageSteps:
    """The expressions of an action at one point, and their derivatives by ``d = [dx; u]`` and by the unknown z.

    Attributes:
        columns: the patterns of the results that have been written so far.
    """

    def __init__(self, action: Expandable) -> None:
        state = action.state
        self.action, self.n, self.ndx = action, state.ndx + action.nu, state.ndx
        self.x, self.x_next, self.u = ca.SX.sym("x", state.nx), ca.SX.sym("x_next", state.nx), ca.SX.sym("u", action.nu)
        self.dx = ca.SX.sym("dx", state.ndx)
        self.d = ca.vertcat(self.dx, self.u)
        self.own = ca.SX.sym("p", action.own_parameters)
        self.p = ca.vertcat(self.own, ca.SX.sym("p_items", action.parameters.size - action.own_parameters))
        still, moved = Unknowns(keep=True), Unknowns(keep=True)
        self.still = action.stage(self.x, self.u, self.p, still)
        self.stage = action.stage(state.integrate_symbolic(self.x, self.dx), self.u, self.p, moved)
        self.equation, self.moved = still.only_linear, moved.only_linear
        self.z = ca.SX(0, 1) if self.moved is None else self.moved.symbol
        self.columns: dict[str, ca.Sparsity] = {}
        self._slopes = ca.Sparsity(self.z.shape[0], self.n)
        name = re.sub(r"[^A-Za-z0-9]+", "_", action.robot.model.name).strip("_")
        self.robot = name if name[:1].isalpha() else f"robot_{name}".strip("_")

    def values(self, equation: LinearUnknown) -> tuple[ca.Function, ca.Function]:
        """Return the functions of the dynamics and of the cost."""
        x, u, own, z = self.x, self.u, self.own, equation.symbol
        then = ca.Function("then", [x, u, z, own], [self.still.x_next])
        value = equation.system.solve(equation.right)
        dynamics = ca.Function(f"{self.robot}_dynamics", [x, u, own], [then(x, u, value, own), value])
        cost = ca.Function(
            f"{self.action.name}_cost", [x, u, z, self.p], [self.still.cost.value], ["x", "u", "z", "p"], ["cost"]
        )
        return dynamics, cost

    def dynamics(self, equation: LinearUnknown) -> tuple[PipelineStep, ...]:
        """Return the steps of z, its slopes, and the next state's derivatives."""
        x, u, own, z = self.x, self.u, self.own, self.z
        assert self.moved is not None
        factors = equation.system.entries
        factorise = self.function("factors", [x, u, own], [factors, equation.right])
        entries, right = ca.SX.sym("factors", factors.shape[0]), ca.SX.sym("right", z.shape[0])
        solve = self.function("solve", [entries, right], [equation.system.with_entries(entries).solve(right)])
        slopes = at_zero([-ca.jacobian(self.moved.residual, self.d)], self.dx)
        # A column of zeros has the solution zero; any other may fill.
        filled = ca.sum1(ca.DM(slopes[0].sparsity(), 1.0)).sparsity()
        self._slopes = _product(ca.Sparsity.dense(z.shape[0], 1), filled)
        equations = self.function("equations", [x, u, z, own], slopes)
        gap, direct, through = self._gap()
        self.columns["gap"] = ca.Sparsity.dense(*gap.shape)
        step = self.function("step", [x, u, self.x_next, z, own], [gap, direct, _entries(through)])
        return (
            PipelineStep(factorise, ("x", "u", "p"), ("factors", "right")),
            PipelineStep(solve, ("factors", "right"), ("z",)),
            PipelineStep(equations, ("x", "u", "z", "p"), ("equations",)),
            PipelineStep(solve, ("factors", "equations"), ("slopes",), self.n),
            PipelineStep(step, ("x", "u", "x_next", "z", "p"), ("gap", "step_direct", "step_through")),
            self._chain("step_chain", direct, through, "step", "jacobian"),
        )

    def costs(self) -> tuple[PipelineStep, ...]:
        """Return the steps of the cost's expansion."""
        cost = self.stage.cost
        residual, direct, through = self._derivatives(cost.residual)
        of_residual = direct.sparsity() + _product(through.sparsity(), self._slopes)
        used = sorted(set(through.sparsity().get_triplet()[1]))
        through = through[:, used]
        weight, gradient, value = at_zero(
            [cost.weight * cost.curvature, cost.weight * cost.gradient, cost.value], self.dx
        )
        scaled = ca.diag(weight) @ direct
        hessian, slope = ca.triu2symm(ca.triu(direct.T @ scaled)), direct.T @ gradient
        self.columns["hessian"] = _product(of_residual.T, of_residual)
        self.columns["gradient"], self.columns["cost"] = ca.Sparsity.dense(self.n, 1), ca.Sparsity.dense(1, 1)
        if not used:
            function = self.function("costs", self._inputs, [hessian, slope, value], of_robot=False)
            return (PipelineStep(function, ("x", "u", "z", "p"), ("hessian", "gradient", "cost")),)
        mixed, inner = through.T @ scaled, ca.triu2symm(ca.triu(through.T @ (ca.diag(weight) @ through)))
        outputs = [hessian, slope, value, mixed, _entries(mixed), _entries(inner), through.T @ gradient]
        function = self.function("costs", self._inputs, outputs, of_robot=False)
        results = ("direct_hessian", "direct_gradient", "cost", "mixed", "mixed_entries", "inner", "pulled")
        k, column = len(used), ca.SX.sym("slope", self.z.shape[0])
        pulled, first = ca.SX.sym("pulled", k), ca.SX.sym("start")
        pull = self.function("gradient", [first, pulled, column], [first + column[used].T @ pulled])
        return (
            PipelineStep(function, ("x", "u", "z", "p"), results),
            *self._through_slopes(used, mixed, inner),
            PipelineStep(pull, ("direct_gradient", "pulled", "slopes"), ("gradient",), self.n),
        )

    def constraints(self) -> tuple[PipelineStep, ...]:
        """Return the steps of the path constraint's expansion."""
        path = self.stage.path
        value, direct, through = self._derivatives(path.value)
        lower, upper = at_zero([path.lower - path.value, path.upper - path.value], self.dx)
        self.columns["lower"] = self.columns["upper"] = ca.Sparsity.dense(*lower.shape)
        outputs = [lower, upper, direct, _entries(through)]
        function = self.function("constraints", self._inputs, outputs, of_robot=False)
        results = ("lower", "upper", "rows_direct", "rows_through")
        return (
            PipelineStep(function, ("x", "u", "z", "p"), results),
            self._chain("rows_chain", direct, through, "rows", "rows"),
        )

    def _through_slopes(self, used: list[int], mixed: Any, inner: Any) -> tuple[PipelineStep, ...]:
        """Return the steps ``hessian = direct_hessian + M^T S + S^T (M + N S)``, with S the slopes of z.

        They read the dense column ``mixed`` of M, its stored entries, and those of N in ``inner``.

        Args:
            used: entries of z that M (k, n) and N (k, k) belong to.
            mixed: M, whose sparsity counts.
            inner: N, whose sparsity counts.
        """
        size, nz, k = self.n, self.z.shape[0], len(used)
        column, column_mixed = ca.SX.sym("slope", nz), ca.SX.sym("mixed", k)
        inner_entries, own = _symbols("inner", inner)
        half = self.function("half", [inner_entries, column_mixed, column], [own @ column[used] + column_mixed])
        start, half_column = ca.SX.sym("start", size), ca.SX.sym("half", k)
        slopes = ca.SX.sym("slopes", nz, size)
        mixed_entries, mixed_all = _symbols("mixed", mixed)
        whole = start + mixed_all.T @ column[used] + slopes[used, :].T @ half_column
        fill = self.function("hessian", [start, mixed_entries, slopes, half_column, column], [whole])
        return (
            PipelineStep(half, ("inner", "mixed", "slopes"), ("half",), size),
            PipelineStep(fill, ("direct_hessian", "mixed_entries", "slopes", "half", "slopes"), ("hessian",), size),
        )

    def _gap(self) -> tuple[Any, Any, Any]:
        """Return ``x+ (-) x_next`` and its derivatives by d and by z.

        Written out, the derivatives of the exponential and logarithm of a free base are three times as long.
        """
        state, move = self.action.state, self.stage.move
        if move is None:
            return self._derivatives(state.diff_symbolic(self.x_next, self.stage.x_next))
        [reached], (move, by_d, by_z) = at_zero([self.stage.x_next], self.dx), self._derivatives(move)
        of_start, of_move = state.Jintegrate_symbolic(self.x, move)
        _, of_end = state.Jdiff_symbolic(self.x_next, reached)
        start = ca.horzcat(of_start, ca.SX(self.ndx, self.n - self.ndx))
        return state.diff_symbolic(self.x_next, reached), of_end @ (start + of_move @ by_d), of_end @ (of_move @ by_z)

    @property
    def _inputs(self) -> list[Any]:
        return [self.x, self.u, self.z, self.p]

    def _derivatives(self, column: Any) -> tuple[Any, Any, Any]:
        """Return a column and its derivatives by d and by z, at dx = 0."""
        found = at_zero([column, ca.jacobian(column, self.d), ca.jacobian(column, self.z)], self.dx)
        return found[0], found[1], found[2]

    def _chain(self, name: str, direct: Any, through: Any, columns: str, result: str) -> PipelineStep:
        """Return the step ``result = direct + through slopes``."""
        self.columns[result] = direct.sparsity() + _product(through.sparsity(), self._slopes)
        entries, matrix = _symbols("through", through)
        start, slope = ca.SX.sym("direct", through.shape[0]), ca.SX.sym("slope", through.shape[1])
        function = self.function(name, [entries, start, slope], [start + matrix @ slope])
        return PipelineStep(function, (f"{columns}_through", f"{columns}_direct", "slopes"), (result,), self.n)

    def function(self, part: str, inputs: list[Any], outputs: list[Any], of_robot: bool = True) -> ca.Function:
        """Return a dense function, named after the robot or the action."""
        owner = self.robot if of_robot else self.action.name
        return ca.Function(f"{owner}_{part}", inputs, [ca.densify(ca.SX(output)) for output in outputs])


def _product(left: ca.Sparsity, right: ca.Sparsity) -> ca.Sparsity:
    """Return the pattern of a product."""
    return (ca.DM(left, 1.0) @ ca.DM(right, 1.0)).sparsity()


def _entries(matrix: Any) -> Any:
    return ca.vec(ca.SX(matrix).nz[:])


def _symbols(name: str, matrix: Any) -> tuple[Any, Any]:
    """Return a column of symbols, and the matrix of the given one's sparsity that has them as its entries."""
    entries = ca.SX.sym(name, matrix.nnz())
    return entries, ca.SX(matrix.sparsity(), entries)
