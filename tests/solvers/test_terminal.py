"""Constraints on the last state."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from lgmpc.actions import FreeForwardDynamics, HoldAction, MultibodyAction
from lgmpc.costs import ConstraintItem, CostItem, MissingQuantityError
from lgmpc.costs.library import Control, FrameTranslation, StateError
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, check_derivatives
from lgmpc.solvers import AugmentedLagrangianFddp, Fddp, IterativeSolver, LineSearchSqp, NlpSettings, NlpSolver, Status


@pytest.fixture
def reach(monkeypatch: pytest.MonkeyPatch) -> ShootingProblem:
    """An arm of two joints with bounded motors, whose hand must be at a target at the end, at rest."""
    monkeypatch.setenv("LGMPC_JIT", "0")
    model = pin.Model()
    for k, joint in enumerate((pin.JointModelRY(), pin.JointModelRY())):
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.4 * (k > 0)]))
        index = model.addJoint(k, joint, place, f"joint_{k}")
        model.appendBodyToJoint(
            index, pin.Inertia(0.5, np.array([0.0, 0.0, -0.2]), 0.01 * np.eye(3)), pin.SE3.Identity()
        )
    model.addFrame(pin.Frame("hand", 2, 0, pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.4])), pin.FrameType.OP_FRAME))
    dynamics = FreeForwardDynamics(model)
    motors, still = ConstraintItem("motors", Control(2), -1.05, 1.05), StateError(dynamics.state)
    costs = [CostItem("effort", Control(2), 0.1), CostItem("motion", still, [0.1, 0.1, 0.3, 0.3])]
    move = MultibodyAction("move", dynamics, costs, [motors])
    arrive = HoldAction(
        "arrive",
        model,
        [CostItem("rest", still, [0.0, 0.0, 0.1, 0.1])],
        [
            ConstraintItem("hand", FrameTranslation("hand", [0.5, 0.0, -0.5]), [0.0, -np.inf, 0.0], [0.0, np.inf, 0.0]),
            ConstraintItem("speed", still, [-np.inf, -np.inf, -0.02, -0.02], [np.inf, np.inf, 0.02, 0.02]),
        ],
    )
    problem = ShootingProblem([move] * 15 + [arrive])
    problem.set("duration", 0.05)
    problem.set_initial_state([0.1, -0.3, 0.0, 0.0])
    return problem


def test_sqp_ipopt_and_fatrop_satisfy_it(reach: ShootingProblem) -> None:
    assert check_derivatives(reach).passed
    solution = LineSearchSqp(reach).solve(max_iterations=200)
    assert solution.status is Status.CONVERGED, solution.explain()
    np.testing.assert_array_equal(solution.xs[-1], solution.xs[-2])
    model = reach.actions[0].dynamics.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, solution.xs[-1, :2])
    hand = data.oMf[model.getFrameId("hand")].translation
    np.testing.assert_allclose(hand[[0, 2]], [0.5, -0.5], atol=1e-6)
    assert np.abs(solution.xs[-1, 2:]).max() == pytest.approx(0.02, abs=1e-6)
    assert np.abs(solution.us[:15]).max() == pytest.approx(1.05, abs=1e-6)
    assert (np.abs(solution.multipliers[15]) > 1e-4).sum() >= 3
    assert solution.residual().largest <= 1e-6
    for settings in (NlpSettings(tolerance=1e-10), NlpSettings(method="fatrop", tolerance=1e-10)):
        reference = NlpSolver(reach, settings).solve(solution.trajectory)
        assert reference.status is Status.CONVERGED
        assert solution.cost == pytest.approx(reference.cost, rel=1e-6)
        np.testing.assert_allclose(solution.us, reference.us, atol=1e-4)
        np.testing.assert_allclose(solution.multipliers[15], reference.multipliers[15], atol=1e-3)


def test_the_last_cost_is_counted_once(reach: ShootingProblem) -> None:
    x = np.array([0.3, 0.2, 1.0, -2.0])
    arrive = reach.actions[-1]
    p = reach.parameters[-1, : arrive.parameters.size]
    assert arrive.evaluate(x, np.zeros(0), p).cost == 0.0
    assert float(arrive.terminal_value_function(x, p)) == pytest.approx(0.05 * 5.0)


@pytest.mark.parametrize("make", [LineSearchSqp, AugmentedLagrangianFddp])
def test_unreachable_targets_are_called_infeasible(
    reach: ShootingProblem, make: Callable[..., IterativeSolver]
) -> None:
    """The violation is stationary: its gradient, by differences of roll-outs, is small beside that of any row."""
    reach.set("hand_reference", [0.9, 0.0, 0.0])  # longer than the arm
    solution = make(reach).solve(max_iterations=1000)
    assert solution.status is Status.INFEASIBLE and not solution.status.solved
    assert "at node 15, 'hand' row" in solution.explain() and "check bounds, targets" in solution.explain()

    def rows(us: np.ndarray) -> np.ndarray:
        path = reach.rollout(us)
        points = [reach.evaluate(k, path.xs[k], us[k]) for k in range(16)]
        values = np.concatenate([point.constraint for point in points])
        lower, upper = (np.concatenate([getattr(point, name) for point in points]) for name in ("lower", "upper"))
        return values - np.clip(values, lower, upper)

    violation = rows(solution.us)
    assert np.abs(violation).max() > 0.05
    slopes, h = [], 1e-5
    for index in np.ndindex(15, 2):
        ends = []
        for sign in (h, -h):
            us = solution.us.copy()
            us[index] += sign
            ends.append(rows(us))
        slopes.append((ends[0] - ends[1]) / (2 * h))
    jacobian = np.array(slopes)
    assert np.abs(jacobian @ violation).max() < 0.02 * np.linalg.norm(violation) * np.linalg.norm(jacobian)


def test_it_is_refused_where_it_has_no_effect(reach: ShootingProblem) -> None:
    with pytest.raises(InputError, match="'arrive', which has path constraints"):
        Fddp(ShootingProblem([MultibodyAction("free", reach.actions[0].dynamics)] * 3 + [reach.actions[-1]]))
    model = reach.actions[0].dynamics.model
    bound = HoldAction("bound", model, (), [ConstraintItem("motors", Control(2), -1.0, 1.0)])
    with pytest.raises(MissingQuantityError, match="u: got a node without it"):
        bound.value_function  # noqa: B018
