from __future__ import annotations

import pickle
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import Action, FreeForwardDynamics, MultibodyAction
from lgmpc.costs import Bounded, ConstraintItem, Cost, CostItem, CostTerm, Parameter, ParameterLayout
from lgmpc.costs.library import Control, StateError
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, Trajectory
from lgmpc.solvers import AugmentedLagrangianFddp, BoxFddp, History, LineSearchSqp, NlpSolver, Progress, Status
from lgmpc.state import StateVector


@pytest.fixture
def swing(monkeypatch: pytest.MonkeyPatch) -> ShootingProblem:
    """One joint that lifts a weight, with a bounded effort."""
    monkeypatch.setenv("LGMPC_JIT", "0")
    model = pin.Model()
    model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "joint")
    model.appendBodyToJoint(1, pin.Inertia(1.0, np.array([0.0, 0.0, -0.3]), 0.01 * np.eye(3)), pin.SE3.Identity())
    dynamics = FreeForwardDynamics(model)
    costs = [CostItem("goal", StateError(dynamics.state, [1.0, 0.0]), [10.0, 0.1]), CostItem("effort", Control(1), 0.1)]
    limits = [ConstraintItem("motor", Control(1), -2.0, 2.0)]
    problem = ShootingProblem(MultibodyAction("swing", dynamics, costs, limits), 10)
    problem.set("duration", 0.05)
    return problem


def test_parameters_begin_with_their_defaults(swing: ShootingProblem) -> None:
    np.testing.assert_array_equal(swing.view("goal_weight"), np.tile([10.0, 0.1], (11, 1)))
    np.testing.assert_array_equal(swing.view("motor_upper"), 2.0)


def test_explain_names_items(swing: ShootingProblem) -> None:
    solver = LineSearchSqp(swing)
    guess = swing.hold()
    guess.us[4] = 100.0
    text = solver.solve(guess, max_iterations=0).explain()
    assert "largest violation 9.80e+01 at node 4, 'motor' row 0 (100, not in [-2, 2])" in text
    assert "most of it at node 4" in text and "of which 'effort'" in text
    guess = Trajectory(guess.xs, np.zeros((10, 1)))
    guess.xs[7, 0] = -9.0
    text = solver.solve(guess, max_iterations=0).explain()
    assert "most of it at node 7" in text and "of which 'goal'" in text
    assert "('swing') meets node 7, tangent entry 0" in text or "('swing') meets node 8, tangent entry 0" in text


def test_explain_names_the_parameter_that_is_not_finite(swing: ShootingProblem) -> None:
    swing.view("motor_upper")[...] = np.inf
    solver = LineSearchSqp(swing)
    assert solver.solve().status is Status.CONVERGED
    swing.view("goal_weight")[4, 1] = np.inf
    assert "Parameter 'goal_weight' of node 4 ('swing')" in solver.solve().explain()
    swing.set("goal_weight", 1.0)
    swing.view("motor_lower")[2] = np.nan
    solution = solver.solve()
    assert solution.status is Status.NOT_FINITE
    assert "Parameter 'motor_lower' of node 2 ('swing')" in solution.explain()


def test_a_solution_explains_itself_in_a_few_lines(swing: ShootingProblem) -> None:
    solution = LineSearchSqp(swing).solve()
    assert solution.status is Status.CONVERGED
    assert solution.explain().startswith("converged after ")
    assert len(solution.explain().splitlines()) <= 6
    assert np.abs(solution.us).max() == pytest.approx(2.0, abs=1e-6)  # the motor is not strong enough to lift at once


def test_bounds_on_a_difference_from_a_reference_are_bounds_on_the_control(swing: ShootingProblem) -> None:
    swing.set("motor_reference", 0.5)
    boxed, reference = BoxFddp(swing).solve(), LineSearchSqp(swing).solve()
    assert boxed.status is Status.CONVERGED
    assert boxed.us.max() == pytest.approx(2.5, abs=1e-12)
    np.testing.assert_allclose(boxed.us, reference.us, atol=1e-4)
    np.testing.assert_allclose(boxed.multipliers, reference.multipliers, atol=1e-4)


def test_every_status_has_a_remedy() -> None:
    assert all(len(status.remedy) > 10 for status in Status)
    assert {status for status in Status if status.solved} == {Status.CONVERGED, Status.ACCEPTABLE}


def test_solutions_are_pickled_with_their_problems_data(swing: ShootingProblem) -> None:
    solution = BoxFddp(swing).solve()
    loaded = pickle.loads(pickle.dumps(solution))
    np.testing.assert_array_equal(loaded.xs, solution.xs)
    assert loaded.residual() == solution.residual()


def test_callbacks_receive_the_iterate(swing: ShootingProblem) -> None:
    seen: list[np.ndarray] = []

    def look(progress: Progress) -> None:
        assert progress.iterate is not None
        seen.append(progress.iterate.us.copy())
        with pytest.raises(ValueError, match="read-only"):
            progress.iterate.xs[0] = 0.0

    history = History(look)
    for solver in (BoxFddp(swing), LineSearchSqp(swing)):
        seen.clear()
        solution = solver.solve(callback=history)
        assert len(seen) == solution.iterations
        np.testing.assert_array_equal(seen[-1], solution.us)
    assert history.column("cost")[-1] == solution.cost
    assert history.reports[0].iterate is None
    with pytest.raises(InputError, match="Did you mean gap"):
        history.column("gaps")


class Rewarded(Action):
    """An integrator whose control is rewarded: the origin is stationary, and the worst of all points."""

    name, nu, state = "rewarded", 1, StateVector(1)
    parameters = ParameterLayout(Parameter("weight", 1, "of the control", -1.0))

    def step(self, x: Any, u: Any, p: Any) -> Any:
        return x + u

    def cost(self, x: Any, u: Any, p: Any) -> Cost:
        return Cost((CostTerm(u, weight=p), CostTerm(x)))

    def terminal_cost(self, x: Any, p: Any) -> Cost:
        return Cost((CostTerm(x, weight=0.1),))

    def constraint(self, x: Any, u: Any, p: Any) -> Bounded:
        return Bounded(u, ca.SX(-2), ca.SX(2))


@pytest.mark.usefixtures("interpreted")
@pytest.mark.parametrize("kind", [LineSearchSqp, NlpSolver, AugmentedLagrangianFddp, BoxFddp])
def test_a_stationary_point_that_is_no_minimum_is_called_a_saddle(kind: Any) -> None:
    problem = ShootingProblem(Rewarded(), 3)
    solution = kind(problem).solve()
    assert solution.status is Status.SADDLE and not solution.status.solved
    assert "negative weight" in solution.explain()
    problem.set("weight", 1.0)
    assert kind(problem).solve().status is Status.CONVERGED
