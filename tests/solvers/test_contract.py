"""The contract of all solvers of shooting problems, on one problem."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import Action, FreeForwardDynamics, MultibodyAction
from lgmpc.costs import Activation, Bounded, ConstraintItem, Cost, CostItem, CostTerm, ParameterLayout
from lgmpc.costs.library import Control, JointPosition
from lgmpc.errors import InputError, SolverError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.solvers import (
    AugmentedLagrangianFddp,
    AugmentedLagrangianSettings,
    BoxFddp,
    Fddp,
    FddpSettings,
    LineSearchSqp,
    LineSearchSqpSettings,
    NlpSettings,
    NlpSolver,
    Solution,
    Status,
)
from lgmpc.state import StateVector

pytestmark = pytest.mark.usefixtures("interpreted")
Make = Callable[..., ShootingProblem]
SOLVERS: dict[str, Callable[[ShootingProblem], Any]] = {
    "fddp": lambda problem: Fddp(problem, FddpSettings(tolerance=1e-13)),
    "box fddp": lambda problem: BoxFddp(problem, FddpSettings(tolerance=1e-13)),
    "sqp": lambda problem: LineSearchSqp(problem, LineSearchSqpSettings(tolerance=1e-8)),
    "al_fddp": lambda problem: AugmentedLagrangianFddp(problem, AugmentedLagrangianSettings(tolerance=1e-9)),
    "ipopt": NlpSolver,
    "fatrop": lambda problem: NlpSolver(problem, NlpSettings(method="fatrop")),
}
BOUNDED = ("box fddp", "sqp", "al_fddp", "ipopt", "fatrop")
STOPPABLE = ("fddp", "box fddp", "sqp", "al_fddp", "ipopt")


def lagrangian(solution: Solution, xs: np.ndarray, us: np.ndarray) -> float:
    """Cost plus multipliers times constraints, from the actions' values alone."""
    problem, total = solution.problem, 0.0
    for k in range(problem.nodes):
        point = problem.evaluate(k, xs[k], us[k])
        gap = problem.state.diff(xs[k + 1], point.x_next)
        total += point.cost + solution.costates[k] @ gap
        total += solution.multipliers[k, : point.constraint.size] @ point.constraint
    last = problem.terminal
    return total + float(last.terminal_value_function(xs[-1], problem.parameters[-1, : last.parameters.size]))


def lagrangian_slope(solution: Solution) -> float:
    """Largest central difference of the Lagrangian at a solution, in tangent coordinates."""
    state, h, largest = solution.problem.state, 1e-5, 0.0
    for k in range(1, len(solution.xs)):
        for step in h * np.eye(state.ndx):
            ends = []
            for sign in (1.0, -1.0):
                xs = solution.xs.copy()
                xs[k] = state.integrate(xs[k], sign * step)
                ends.append(lagrangian(solution, xs, solution.us))
            largest = max(largest, abs(ends[0] - ends[1]) / (2 * h))
    for index in np.ndindex(*solution.us.shape):
        ends = []
        for sign in (h, -h):
            us = solution.us.copy()
            us[index] += sign
            ends.append(lagrangian(solution, solution.xs, us))
        largest = max(largest, abs(ends[0] - ends[1]) / (2 * h))
    return largest


@pytest.mark.parametrize(
    ("name", "bounded"), [*((name, False) for name in SOLVERS), *((name, True) for name in BOUNDED)]
)
def test_a_solution_satisfies_the_conditions_by_differences_of_values(
    satellite: Make, name: str, bounded: bool
) -> None:
    """Independent of the solvers' derivatives and residuals."""
    problem = satellite(bounded=bounded, nodes=3)
    solution = SOLVERS[name](problem).solve(problem.hold())
    assert solution.status is Status.CONVERGED
    assert lagrangian_slope(solution) < 2e-5
    for k in range(3):
        point = problem.evaluate(k, solution.xs[k], solution.us[k])
        np.testing.assert_allclose(problem.state.diff(solution.xs[k + 1], point.x_next), 0.0, atol=1e-8)
        if not bounded:
            continue
        mu = solution.multipliers[k]
        assert point.violation < 1e-7  # fatrop loosens bounds by 1e-8 of their value
        room = np.where(mu > 0.0, point.upper - point.constraint, point.constraint - point.lower)
        assert np.minimum(np.abs(mu), room).max() < 1e-6  # a multiplier only where its bound holds
    if bounded:
        assert (np.abs(solution.multipliers) > 1e-3).any()


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("where", ["xs", "us", "x0", "parameters"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_non_finite_values_have_a_status(unicycle: ShootingProblem, name: str, where: str, value: float) -> None:
    guess = unicycle.hold()
    solver = SOLVERS[name](unicycle)
    if where == "x0":
        unicycle.x0[1] = value
    elif where == "parameters":
        unicycle.parameters[7] = value
    else:
        getattr(guess, where)[7, 1] = value
    solution = solver.solve(guess)
    assert solution.status is Status.NOT_FINITE
    assert "NaN or infinity" in solution.explain()
    with pytest.raises(SolverError, match="not_finite"):
        solver.solve(guess, throw=True)


class Cliff(Action):
    """``x+ = x + sqrt(x) / 10 - u / 10``: NaN where a step makes x negative, and nowhere before."""

    def __init__(self, base: Action) -> None:
        self.name, self.state, self.nu, self.parameters = "brink", base.state, base.nu, base.parameters
        self._base = base

    def step(self, x, u, p):
        return x + 0.1 * ca.sqrt(x) - 0.1 * u

    def cost(self, x, u, p):
        return self._base.cost(x, u, p)

    def terminal_cost(self, x, p):
        return self._base.terminal_cost(x, p)

    def constraint(self, x, u, p):
        return self._base.constraint(x, u, p)


@pytest.mark.parametrize("name", SOLVERS)
def test_steps_to_non_finite_values_end(linear: Callable[..., Action], name: str) -> None:
    problem = ShootingProblem(Cliff(linear(np.eye(2), np.eye(2), np.zeros(2))), 6)
    problem.set("weight", 1e-4)
    problem.set("goal", -0.5)  # beyond the domain
    problem.set_initial_state([1.0, 2.0])
    solution = SOLVERS[name](problem).solve(problem.rollout(np.zeros((6, 2))))
    assert solution.status is not Status.ITERATION_LIMIT
    if solution.status.solved:
        assert solution.residual().largest < 1e-4
    else:
        assert len(solution.explain().splitlines()) >= 2
    if solution.status is not Status.NOT_FINITE:
        assert np.isfinite(solution.xs).all() and np.isfinite(solution.cost)


@pytest.mark.parametrize("name", SOLVERS)
def test_wrong_shapes_are_named(unicycle: ShootingProblem, name: str) -> None:
    solver = SOLVERS[name](unicycle)
    for xs, us, match in (((20, 3), (20, 2), "xs: got shape"), ((21, 3), (20, 3), "us: got shape")):
        with pytest.raises(InputError, match=match):
            solver.solve(Trajectory(np.zeros(xs), np.zeros(us)))


@pytest.mark.parametrize("name", STOPPABLE)
def test_the_time_limit_is_kept_to_an_iteration(unicycle: ShootingProblem, name: str) -> None:
    solver = SOLVERS[name](unicycle)
    free = solver.solve()
    elapsed: list[float] = []

    def slow(progress: Any) -> None:
        elapsed.append(progress.elapsed)
        time.sleep(0.05)

    solution = solver.solve(time_limit=0.08, callback=slow)
    assert solution.status is Status.TIME_LIMIT
    # Two calls take longer than the limit on any machine: at most one more iteration starts.
    assert solution.iterations <= 3 < free.iterations
    assert all(time_s < 0.08 for time_s in elapsed[:-1])
    assert np.isfinite(solution.xs).all()
    assert "time_limit" in solution.explain()


@pytest.mark.parametrize("name", BOUNDED)
def test_bounds_that_contradict_each_other_are_infeasible(satellite: Make, name: str) -> None:
    problem = satellite(bounded=True, nodes=4)
    problem.set("limit", -1.0)
    solution = SOLVERS[name](problem).solve()
    assert solution.status is Status.INFEASIBLE
    assert "check bounds" in solution.explain()


@pytest.mark.parametrize("name", SOLVERS)
def test_one_interval_is_enough(linear: Callable[..., Action], name: str) -> None:
    problem = ShootingProblem(linear(np.eye(2), np.eye(2), np.zeros(2)), 1)
    problem.set("goal", 1.0)
    problem.set("weight", 0.5)
    solution = SOLVERS[name](problem).solve()
    assert solution.status is Status.CONVERGED
    # minimise 0.5 u^2 / 2 + 10 (u - 1)^2 / 2
    np.testing.assert_allclose(solution.us, 10.0 / 10.5, atol=1e-7)


class Rewarded(Action):
    """A linear reward of the control: the cost has no minimum."""

    name, nu = "rewarded", 1

    def __init__(self) -> None:
        self.state, self.parameters = StateVector(1), ParameterLayout()

    def step(self, x, u, p):
        return x + 0.1 * u

    def cost(self, x, u, p):
        return Cost((CostTerm(u, Slope(), 1.0),))

    def terminal_cost(self, x, p):
        return Cost()

    def constraint(self, x, u, p):
        return Bounded.stack()


class Slope(Activation):
    def value(self, r):
        return r

    def gradient(self, r):
        return type(r).ones(*r.shape)

    def curvature(self, r):
        return type(r).zeros(*r.shape)


@pytest.mark.parametrize("name", ["fddp", "box fddp", "sqp", "al_fddp", "ipopt"])
def test_a_cost_without_minimum_is_called_unbounded(name: str) -> None:
    solution = SOLVERS[name](ShootingProblem(Rewarded(), 3)).solve()
    assert solution.status is Status.UNBOUNDED and not solution.status.solved
    assert "falls without limit" in solution.explain()


@pytest.mark.parametrize("name", ["sqp", "al_fddp", "ipopt", "fatrop"])
def test_a_first_state_outside_a_constraint_is_named_at_once(name: str) -> None:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "swing")
    model.appendBodyToJoint(joint, pin.Inertia(1.0, np.array([0.0, 0.0, -0.5]), 0.1 * np.eye(3)), pin.SE3.Identity())
    dynamics = FreeForwardDynamics(model)
    walls = ConstraintItem("walls", JointPosition(1), -0.5, 0.5)
    motor = ConstraintItem("motor", Control(1), 1.0, 2.0)  # zero control violates it, and a control can satisfy it
    action = MultibodyAction("swing", dynamics, [CostItem("effort", Control(1))], [motor, walls])
    problem = ShootingProblem(action, 4)
    problem.set_initial_state([0.6, 0.0])
    solution = SOLVERS[name](problem).solve()
    assert solution.status is Status.INFEASIBLE and solution.iterations == 0
    assert "first state violates 'walls' row 0 of node 0 by 0.1" in solution.explain()
    problem.set_initial_state([0.3, 0.0])
    assert SOLVERS[name](problem).solve().iterations > 0
    problem.set("motor_lower", 5.0, [2])
    crossed = SOLVERS[name](problem).solve()
    assert crossed.status is Status.INFEASIBLE
    words = "bounds of 'motor' row 0 of node 2 contradict each other: lower 5 is above upper 2"
    assert words in crossed.explain()
    with pytest.raises(InputError, match="lower of 'motor': got 5 in row 0, above the upper bound 2"):
        ConstraintItem("motor", Control(1), 5.0, 2.0)
