"""Actions of Python beside the same ones of expressions: every solver, alone and mixed; errors name the node."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import Action, Limits, PythonAction, StageDerivatives
from lgmpc.costs import Bounded, Cost, CostTerm, Parameter, ParameterLayout
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, check_derivatives
from lgmpc.solvers import (
    AugmentedLagrangianFddp,
    BoxFddp,
    Fddp,
    LineSearchSqp,
    NlpSettings,
    NlpSolver,
    RealTimeSqp,
    Status,
)
from lgmpc.state import StateMultibody

pytestmark = pytest.mark.usefixtures("interpreted")
DT = 0.1
LAYOUT = ParameterLayout(Parameter("goal", 3, "place to reach"))


def ball() -> StateMultibody:
    """A body that turns and moves: a manifold."""
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    model.appendBodyToJoint(root, pin.Inertia(1.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    return StateMultibody(model)


class Expression(Action):
    """Controls push and turn the body."""

    name, nu, parameters = "body", 4, LAYOUT

    def __init__(self, limit: float = np.inf) -> None:
        self.state, self.limit = ball(), limit

    def step(self, x: Any, u: Any, p: Any) -> Any:
        v = x[7:] + DT * ca.vertcat(u[0], u[1] + u[0] * x[9], u[2], 0.3 * u[3], 0, u[3])
        return self.state.integrate_symbolic(x, ca.vertcat(DT * v, v - x[7:]))

    def cost(self, x: Any, u: Any, p: Any) -> Cost:
        return Cost((CostTerm(u, weight=0.01), CostTerm(x[:3] - p, weight=0.1), CostTerm(ca.sin(x[7:]), weight=0.1)))

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        return Cost((CostTerm(x[:3] - p, weight=10.0), CostTerm(x[7:], weight=1.0)))

    def constraint(self, x: Any, u: Any, p: Any) -> Bounded:
        if np.isinf(self.limit):
            return Bounded.stack()
        return Bounded(u, -self.limit * ca.SX.ones(4), self.limit * ca.SX.ones(4))


class Python(PythonAction):
    """The same."""

    name, nu, parameters = "body_python", 4, LAYOUT

    def __init__(self, limit: float = np.inf) -> None:
        self.state, self.limit = ball(), limit

    def step(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        v = x[7:] + DT * np.array([u[0], u[1] + u[0] * x[9], u[2], 0.3 * u[3], 0.0, u[3]])
        return self.state.integrate(x, np.r_[DT * v, v - x[7:]])

    def residual(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.r_[0.1 * u, np.sqrt(0.1) * (x[:3] - p), np.sqrt(0.1) * np.sin(x[7:])]

    def terminal_residual(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.r_[np.sqrt(10.0) * (x[:3] - p), x[7:]]

    def limits(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> Limits:
        return Limits(np.zeros(0)) if np.isinf(self.limit) else Limits(u, -self.limit, self.limit)


def problem_of(*actions: Action) -> ShootingProblem:
    problem = ShootingProblem(actions)
    problem.set("goal", [0.4, -0.3, 0.2])
    return problem


SOLVERS: dict[str, tuple[Callable[..., Any], float]] = {
    "fddp": (Fddp, np.inf),
    "box": (BoxFddp, 1.2),
    "sqp": (LineSearchSqp, 1.2),
    "al": (AugmentedLagrangianFddp, 1.2),
    "ipopt": (NlpSolver, 1.2),
}


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in ("al", "ipopt") else name for name in SOLVERS]
)
def test_every_solver_finds_the_optimum_of_the_expression(name: str, mixed: bool) -> None:
    make, limit = SOLVERS[name]
    one, other = Expression(limit), Python(limit)
    expected = make(problem_of(*[one] * 8)).solve()
    problem = problem_of(*[one] * 3, *[other] * 5) if mixed else problem_of(*[other] * 8)
    found = make(problem).solve()
    assert expected.status is found.status is Status.CONVERGED, found.explain()
    assert found.cost == pytest.approx(expected.cost, rel=1e-6)
    np.testing.assert_allclose(found.us, expected.us, atol=1e-3)
    if np.isfinite(limit):
        assert np.abs(found.us).max() == pytest.approx(limit, abs=1e-5)
    assert found.residual().largest < 1e-3


@pytest.mark.slow
def test_one_step_a_call_follows_the_expression() -> None:
    """The solver of control loops, on both."""
    points = []
    for action in (Expression(1.2), Python(1.2)):
        solver = RealTimeSqp(problem_of(*[action] * 6))
        solver.set_guess(solver.problem.hold())
        for _ in range(3):
            solver.prepare()
            solver.feedback(solver.problem.x0)
        points.append(np.hstack([solver.xs[:-1], solver.us]))
    np.testing.assert_allclose(points[1], points[0], atol=1e-7)


def test_derivatives_by_differences_are_those_of_the_expression() -> None:
    """At a random point, with a next state elsewhere; in tangent coordinates."""
    one, other, rng = Expression(2.0), Python(2.0), np.random.default_rng(0)
    for _ in range(3):
        x, x_next = (one.state.integrate(one.state.neutral(), rng.uniform(-1.0, 1.0, 12)) for _ in range(2))
        u, p = rng.standard_normal(4), rng.standard_normal(3)
        expected, found = (each.quadratic_function(x=x, u=u, x_next=x_next, p=p) for each in (one, other))
        for name, value in expected.items():
            np.testing.assert_allclose(found[name].full(), value.full(), atol=1e-8, err_msg=name)
        last = [each.terminal_quadratic_function(x=x, p=p) for each in (one, other)]
        for name in ("Q", "q", "cost"):
            np.testing.assert_allclose(last[1][name].full(), last[0][name].full(), atol=1e-7, err_msg=name)


def test_problems_and_solutions_are_copied_and_checked_as_others() -> None:
    problem = problem_of(*[Python(1.2)] * 4)
    solution = LineSearchSqp(problem).solve()
    assert "stationarity" in solution.explain()
    twin = pickle.loads(pickle.dumps(problem))
    assert LineSearchSqp(twin).solve().cost == solution.cost
    assert solution.residual().largest < 1e-5
    assert check_derivatives(problem).passed


class Given(Python):
    """With derivatives of its own."""

    def derivatives(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> StageDerivatives:
        return super().derivatives(x, u, p)


def test_derivatives_of_the_wrong_shape_are_named_with_the_node() -> None:
    class Flat(Given):
        def derivatives(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> StageDerivatives:
            d = super().derivatives(x, u, p)
            return StageDerivatives(d.step_x, d.step_u[:, :3], d.residual_x, d.residual_u, d.limits_x, d.limits_u)

    actions = [*[Expression()] * 3, *[Flat()] * 2]
    for make in (Fddp, LineSearchSqp):
        message = r"step_u of 'body_python', node 3: got shape \(12, 3\); expected shape \(12, 4\)"
        with pytest.raises(InputError, match=message):
            make(problem_of(*actions)).solve()


def test_what_python_raises_is_named_with_the_node() -> None:
    class Fragile(Python):
        def residual(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
            if x[0] > 2.0:
                raise ValueError("out of the table")
            return super().residual(x, u, p)

    problem = problem_of(*[Fragile()] * 5)
    guess = problem.hold()
    guess.xs[3, 0] = 2.5
    for make in (Fddp, LineSearchSqp):
        with pytest.raises(
            InputError, match="action 'body_python', node 3: got ValueError: out of the table"
        ) as raised:
            make(problem).solve(guess)
        assert isinstance(raised.value.__cause__, ValueError)
    assert Fddp(problem).solve().status is Status.CONVERGED  # the next solve is not affected

    class Broken(Python):
        def step(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
            return x / {}["mass"]

    with pytest.raises(InputError, match="action 'body_python': got KeyError: 'mass'; expected results in the neutral"):
        Fddp(problem_of(*[Broken()] * 2))


def test_results_of_the_wrong_shape_are_named() -> None:
    class Short(Python):
        def step(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
            return x[:5]

    class Square(Python):
        def terminal_residual(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
            return np.eye(2)

    class Pair(Python):
        def limits(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> Any:
            return u, 1.0

    class Wide(Python):
        def limits(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> Any:
            return Limits(u, -np.ones(2), 1.0)

    with pytest.raises(
        InputError, match=r"lower of the limits of 'body_python': got shape \(2,\); expected a number or"
    ):
        problem_of(*[Wide()] * 2).rollout(np.zeros((2, 4)))
    with pytest.raises(InputError, match=r"step of 'body_python': got shape \(5,\); expected shape \(13,\)"):
        Fddp(problem_of(*[Short()] * 2))
    with pytest.raises(InputError, match=r"terminal_residual of 'body_python': got shape \(2, 2\); expected an array"):
        Fddp(problem_of(*[Square()] * 2))
    with pytest.raises(InputError, match="limits of 'body_python': got tuple; expected Limits"):
        Fddp(problem_of(*[Pair()] * 2))


def test_values_that_are_not_finite_are_explained_with_the_node() -> None:
    class Hole(Python):
        def residual(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
            return super().residual(x, u, p) * (np.nan if x[0] > 2.0 else 1.0)

    class Kink(Given):
        def derivatives(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> StageDerivatives:
            d = super().derivatives(x, u, p)
            return StageDerivatives(d.step_x, d.step_u * np.nan, d.residual_x, d.residual_u, d.limits_x, d.limits_u)

    problem = problem_of(*[Hole()] * 5)
    guess = problem.hold()
    guess.xs[3, 0] = 2.5
    for make in (Fddp, LineSearchSqp):
        solution = make(problem).solve(guess)
        assert solution.status is Status.NOT_FINITE
        assert "The cost of node 3 ('body_python') contains NaN or infinity" in solution.explain()
    broken = Fddp(problem_of(*[Expression()] * 2, Kink())).solve()
    assert broken.status is Status.NOT_FINITE
    assert "derivatives of node 2 ('body_python'), next state by control, contain NaN" in broken.explain()


def test_rows_that_are_no_bounds_and_solvers_without_differences_are_named() -> None:
    class Curved(Python):
        def limits(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> Limits:
            return Limits(np.array([u[1], u[0] * x[0]]), -1.0, 1.0)

    with pytest.raises(InputError, match=r"actions\[0\]: got 'body_python', whose constraint row 1 is no control"):
        BoxFddp(problem_of(Curved()))
    with pytest.raises(InputError, match="method: got fatrop; expected ipopt, FDDP or SQP"):
        NlpSolver(problem_of(Python()), NlpSettings(method="fatrop"))


class Runaway(PythonAction):
    """A body whose speed overflows where it is pushed hard, as a simulator's may in trial roll-outs."""

    name, nu, parameters = "runaway", 4, LAYOUT

    def __init__(self, raises: bool) -> None:
        self.state, self.raises = ball(), raises

    def step(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        v = x[7:] + DT * np.array([u[0], u[1], u[2], u[3], 0.0, u[3]])
        fast = float(np.abs(v).max())
        if fast > 20.0 and self.raises:
            math.exp(1e3 * fast)  # OverflowError
        v = np.full(6, np.inf) if fast > 20.0 else v
        return self.state.integrate(x, np.concatenate([DT * v, v - x[7:]]))

    def residual(self, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        return 1e-3 * u

    def terminal_residual(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.concatenate([x[:3] - 8.0, x[7:]])


@pytest.mark.parametrize("raises", [False, True])
def test_trial_steps_that_overflow_are_shortened(raises: bool) -> None:
    """Eight metres in half a second: the first full steps are faster than the body can be simulated."""
    problem = ShootingProblem(Runaway(raises), 5)
    steps: list[float] = []
    with np.errstate(invalid="ignore"):
        solution = Fddp(problem).solve(max_iterations=20, callback=lambda now: steps.append(now.step_length))
    assert min(steps) < 1.0 and np.isfinite(solution.cost)
    assert solution.status is not Status.NOT_FINITE
