"""Comparison of actions' and problems' derivatives with central differences on the manifold."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from lgmpc.actions import Action
from lgmpc.errors import InputError
from lgmpc.ocp.problem import ShootingProblem, Trajectory
from lgmpc.typing import Array, instance, numbers

MEANINGS = {
    "A": "next state by state",
    "B": "next state by control",
    "q": "cost by state",
    "r": "cost by control",
    "C": "constraint by state",
    "D": "constraint by control",
    "terminal q": "terminal cost by state",
}
"""Names of the derivatives of an action in messages."""


@dataclass(frozen=True)
class DerivativeCheck:
    """The comparison of one derivative at one point.

    Attributes:
        action: name of the action.
        node: of the problem, or index of the random point.
        quantity: A, B, q, r, C, D or terminal q, as in :attr:`lgmpc.actions.Action.quadratic_function`.
        error: largest difference of an entry, relative to the largest entry (at least 1); NaN if one is not finite.
        row: of the entry with the largest difference.
        column: of that entry, in tangent coordinates.
        analytic: its value.
        numeric: its value by central differences.
    """

    action: str
    node: int
    quantity: str
    error: float
    row: int
    column: int
    analytic: float
    numeric: float


@dataclass(frozen=True)
class DerivativeReport:
    """The result of :func:`check_derivatives`; ``print`` shows it.

    Attributes:
        checks: all of them.
        tolerance: largest error of a correct derivative.
    """

    checks: tuple[DerivativeCheck, ...]
    tolerance: float

    @property
    def wrong(self) -> tuple[DerivativeCheck, ...]:
        """The failed checks: non-finite ones first, then by decreasing error."""
        failed = [check for check in self.checks if not check.error <= self.tolerance]
        return tuple(sorted(failed, key=lambda check: -np.inf if np.isnan(check.error) else -check.error))

    @property
    def passed(self) -> bool:
        """True if all derivatives are correct."""
        return not self.wrong

    def __str__(self) -> str:
        """Return one line for all, or one for each wrong derivative."""
        largest = max((check.error for check in self.checks), default=0.0)
        if self.passed:
            return f"{len(self.checks)} derivatives agree with central differences (largest error {largest:.1e})"
        lines = [f"{len(self.wrong)} of {len(self.checks)} derivatives disagree with central differences:"]
        lines += [
            f"  {c.action}, node {c.node}, {c.quantity} ({MEANINGS[c.quantity]}): entry [{c.row}, {c.column}] is"
            f" {c.analytic:.9g}, by differences {c.numeric:.9g} (error {c.error:.1e})"
            for c in self.wrong
        ]
        return "\n".join(lines)


def check_derivatives(
    subject: Action | ShootingProblem,
    rng: np.random.Generator | None = None,
    *,
    trajectory: Trajectory | None = None,
    parameters: Array | None = None,
    points: int = 3,
    spread: float = 0.5,
    step: float = 1e-5,
    tolerance: float = 1e-6,
) -> DerivativeReport:
    """Compare derivatives with central differences in tangent coordinates.

    A problem is checked at every node of a trajectory, or of random points about its first state; an action at random
    points, its terminal cost at one. Differences across a kink, such as the edge of a barrier, are wrong although the
    derivative is correct.

    Args:
        subject: the action or problem.
        rng: for the random points; a generator of seed 0 unless given.
        trajectory: of the problem.
        parameters: (np,) of the action; their defaults unless given.
        points: number of random points of an action.
        spread: largest entry of the random tangent vectors and controls.
        step: of the differences.
        tolerance: see :class:`DerivativeReport`.

    Raises:
        InputError: parameters or a trajectory of the wrong shape; no point, or a step that is not positive.
    """
    instance("subject", subject, (Action, ShootingProblem), "an action, or a ShootingProblem")
    instance("points", points, (int, np.integer), "a whole number")
    for name, value in (("spread", spread), ("step", step), ("tolerance", tolerance)):
        numbers(name, value, (), finite=True)
    if rng is not None:
        instance("rng", rng, np.random.Generator, "a numpy.random.Generator")
    if points < 1:
        raise InputError("points", points, "at least 1")
    if not spread >= 0.0:
        raise InputError("spread", spread, "at least 0")
    if not step > 0.0:
        raise InputError("step", step, "a positive number")
    random = np.random.default_rng(0) if rng is None else rng
    if isinstance(subject, Action):
        given = subject.parameters.default if parameters is None else parameters
        problem = ShootingProblem(subject, int(points))
        problem.parameters[...] = numbers("parameters", given, (subject.parameters.size,))
    else:
        problem = subject
    if trajectory is None:
        moves = random.uniform(-spread, spread, (problem.nodes + 1, problem.state.ndx))
        xs = [problem.state.integrate(problem.x0, dx) for dx in moves]
        trajectory = Trajectory(np.array(xs), random.uniform(-spread, spread, (problem.nodes, problem.nu)))
    at = problem.check(trajectory)
    checks: list[DerivativeCheck] = []
    for k in range(problem.nodes + 1):
        action = problem.action_at(k)
        p = problem.parameters[k, : action.parameters.size]
        if k == problem.nodes:
            checks += _end(action, k, at.xs[k], p, step)
        else:
            checks += _stage(action, k, at.xs[k], at.us[k, : action.nu], p, step)
    return DerivativeReport(tuple(checks), tolerance)


def _stage(action: Action, node: int, x: Array, u: Array, p: Array, h: float) -> list[DerivativeCheck]:
    state = action.state
    here = action.evaluate(x, u, p)
    names = action.quadratic_function.name_out()
    found = dict(zip(names, action.quadratic_function(x, u, here.x_next, p), strict=True))

    def outcome(dx: Array, du: Array) -> Array:
        v = action.evaluate(state.integrate(x, dx), u + du, p)
        return np.r_[state.diff(here.x_next, v.x_next), v.cost, v.constraint]

    zero_x, zero_u, n = np.zeros(state.ndx), np.zeros(action.nu), state.ndx
    by_x = _differences(lambda d: outcome(d, zero_u), n, h)
    by_u = _differences(lambda d: outcome(zero_x, d), action.nu, h)
    numeric = {
        "A": by_x[:n],
        "B": by_u[:n],
        "q": by_x[n : n + 1],
        "r": by_u[n : n + 1],
        "C": by_x[n + 1 :],
        "D": by_u[n + 1 :],
    }
    return [
        _compare(action.name, node, name, found[name].full().reshape(value.shape), value)
        for name, value in numeric.items()
        if value.size
    ]


def _end(action: Action, node: int, x: Array, p: Array, h: float) -> list[DerivativeCheck]:
    gradient = action.terminal_quadratic_function(x, p)[1].full().T

    def outcome(dx: Array) -> Array:
        return action.terminal_value_function(action.state.integrate(x, dx), p).full().ravel()

    return [_compare(action.name, node, "terminal q", gradient, _differences(outcome, action.state.ndx, h))]


def _differences(function: Callable[[Array], Array], size: int, h: float) -> Array:
    with np.errstate(invalid="ignore"):  # infinity minus infinity is reported, as NaN
        columns = [(function(step) - function(-step)) / (2 * h) for step in h * np.eye(size)]
    return np.array(columns).T if columns else np.zeros((function(np.zeros(size)).size, 0))


def _compare(action: str, node: int, quantity: str, analytic: Array, numeric: Array) -> DerivativeCheck:
    gap = np.abs(analytic - numeric)
    index = int(np.argmax(np.where(np.isnan(gap), np.inf, gap)))
    row, column = divmod(index, gap.shape[1])
    error = float(gap[row, column] / max(1.0, float(np.abs(numeric).max())))
    return DerivativeCheck(
        action, node, quantity, error, row, column, float(analytic[row, column]), float(numeric[row, column])
    )
