from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import CentroidalAction, FreeForwardDynamics, MultibodyAction
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import Control
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem


def test_set_takes_a_number_a_row_or_a_row_a_node(problem: ShootingProblem) -> None:
    problem.set("external_wrench", 2.0)
    assert (problem.view("external_wrench") == 2.0).all()
    problem.set("external_wrench", np.arange(6.0))
    np.testing.assert_array_equal(problem.view("external_wrench"), np.tile(np.arange(6.0), (6, 1)))
    rows = np.random.default_rng(0).standard_normal((6, 6))
    problem.set("external_wrench", rows)
    where = problem.action.parameters["external_wrench"]
    np.testing.assert_array_equal(problem.parameters[:, where], rows)


def test_rollout_follows_the_action(problem: ShootingProblem) -> None:
    us = np.random.default_rng(1).standard_normal((5, 12))
    trajectory = problem.rollout(us)
    np.testing.assert_array_equal(trajectory.xs[0], problem.x0)
    for k in range(5):
        step = problem.action.evaluate(trajectory.xs[k], us[k], problem.parameters[k])
        np.testing.assert_array_equal(trajectory.xs[k + 1], step.x_next)


def test_bad_input_is_named(problem: ShootingProblem) -> None:
    with pytest.raises(InputError, match="nodes: got 0"):
        ShootingProblem(CentroidalAction(1), 0)
    with pytest.raises(InputError, match="action: got float64 at interval 0; expected an action.*attribute x0"):
        ShootingProblem(np.zeros(9), [CentroidalAction(1)])
    with pytest.raises(InputError, match="nodes: got list; expected 2, one for each action"):
        ShootingProblem([CentroidalAction(1)] * 2, [CentroidalAction(1)])
    with pytest.raises(InputError, match="Did you mean friction"):
        problem.set("frction", 0.5)
    with pytest.raises(InputError, match=r"got shape \(2,\); expected a number, shape \(3,\) or shape \(6, 3\)"):
        problem.set("gravity", [0.0, 0.0])
    with pytest.raises(InputError, match="friction: got NaN or infinity"):
        problem.set("friction", np.nan)
    with pytest.raises(InputError, match="x0: got shape"):
        problem.set_initial_state(np.zeros(8))
    with pytest.raises(InputError, match="x0: got NaN"):
        problem.set_initial_state(np.full(9, np.inf))
    with pytest.raises(InputError, match="us: got shape"):
        problem.rollout(np.zeros((4, 12)))


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [("duration", 0.0, "above zero"), ("duration", -0.01, "above zero"), ("effort_weight", [1.0, -1.0], "below zero")],
)
def test_durations_and_weights_of_the_wrong_sign_are_refused(name: str, value: object, expected: str) -> None:
    model = pin.buildSampleModelManipulator()
    model = pin.buildReducedModel(model, [3, 4, 5, 6], pin.neutral(model))
    dynamics = FreeForwardDynamics(model)
    problem = ShootingProblem(MultibodyAction("signs", dynamics, [CostItem("effort", Control(2), 1.0)]), 3)
    before = problem.parameters.copy()
    with pytest.raises(InputError, match=f"{name}: got .*{expected}"):
        problem.set(name, value)
    np.testing.assert_array_equal(problem.parameters, before)
    problem.set("effort_weight", 0.0)
    with pytest.raises(InputError, match="effort_weight: got -1.0; expected no number below zero"):
        CostItem("effort", Control(2), [1.0, -1.0])


def test_a_bound_may_be_infinite_and_nothing_else() -> None:
    model = pin.buildSampleModelManipulator()
    limit = ConstraintItem("limit", Control(model.nv), -1.0, 1.0)
    problem = ShootingProblem(MultibodyAction("arm", FreeForwardDynamics(model), (), [limit]), 3)
    problem.set("limit_upper", np.inf)
    assert np.isposinf(problem.view("limit_upper")).all()
    with pytest.raises(InputError, match="limit_lower: got NaN"):
        problem.set("limit_lower", np.nan)
    with pytest.raises(InputError, match="duration: got NaN or infinity"):
        problem.set("duration", np.inf)
