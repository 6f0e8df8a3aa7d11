from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from samples import JointEffort

from lgmpc.actions import FreeForwardDynamics, FreeInverseDynamics, MultibodyAction, thrusters
from lgmpc.actions.dynamics import Dynamics
from lgmpc.costs import ConstraintItem, CostItem
from lgmpc.costs.library import Control, FrameTranslation, StateError
from lgmpc.errors import InputError
from lgmpc.ocp import ShootingProblem, Trajectory, check_derivatives
from lgmpc.solvers import Fddp, FddpSettings, LineSearchSqp, LineSearchSqpSettings

pytestmark = pytest.mark.usefixtures("interpreted")


def arm_problem(dynamics: Dynamics, bound: float) -> ShootingProblem:
    """A hand reaches a place; efforts are paid for and bounded."""
    model = dynamics.model
    effort = JointEffort(model.nv)
    costs = [
        CostItem("hand", FrameTranslation(model.frames[-1].name, [0.4, 0.2, 0.7]), 50.0),
        CostItem("rest", StateError(dynamics.state), 1e-2),
        CostItem("effort", effort, 1e-3),
    ]
    limits = [ConstraintItem("motors", effort, -bound, bound)] if np.isfinite(bound) else []
    problem = ShootingProblem(MultibodyAction(type(dynamics).__name__.lower(), dynamics, costs, limits), 12)
    problem.set("duration", 0.03)
    problem.set_initial_state(np.concatenate([pin.neutral(model) + 0.3, np.zeros(model.nv)]))
    return problem


@pytest.mark.parametrize("bound", [np.inf, 14.0])
def test_forward_and_inverse_dynamics_have_the_same_optimum(bound: float) -> None:
    """The controls of one are the efforts of the other."""
    whole = pin.buildSampleModelManipulator()
    model = pin.buildReducedModel(whole, [4, 6], np.zeros(whole.nq))  # four joints
    found = {}
    for dynamics in (FreeForwardDynamics(model), FreeInverseDynamics(model)):
        problem = arm_problem(dynamics, bound)
        solver = (
            Fddp(problem, FddpSettings(tolerance=1e-14))
            if np.isinf(bound)
            else LineSearchSqp(problem, LineSearchSqpSettings(tolerance=1e-7))
        )
        found[type(dynamics)] = solver.solve(problem.hold(), max_iterations=200)
        assert found[type(dynamics)].status.solved
    forward, inverse = found[FreeForwardDynamics], found[FreeInverseDynamics]
    assert inverse.cost == pytest.approx(forward.cost, rel=1e-9)
    np.testing.assert_allclose(inverse.xs, forward.xs, atol=1e-5)
    data, nq = model.createData(), model.nq
    efforts = [pin.rnea(model, data, x[:nq], x[nq:], a) for x, a in zip(inverse.xs[:-1], inverse.us, strict=True)]
    np.testing.assert_allclose(efforts, forward.us, atol=1e-3 * np.abs(forward.us).max())
    if np.isfinite(bound):
        assert np.abs(forward.us).max() == pytest.approx(bound, rel=1e-6)  # it is reached


def flyer() -> tuple[pin.Model, np.ndarray]:
    """A body with four thrusters, and a passive pendulum that hangs from it."""
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    model.appendBodyToJoint(root, pin.Inertia(1.5, np.zeros(3), np.diag([0.03, 0.03, 0.05])), pin.SE3.Identity())
    joint = model.addJoint(root, pin.JointModelRY(), pin.SE3.Identity(), "pendulum")
    model.appendBodyToJoint(joint, pin.Inertia(0.2, np.array([0, 0, -0.3]), 1e-3 * np.eye(3)), pin.SE3.Identity())
    corners = np.array([[0.2, 0.2, 0], [0.2, -0.2, 0], [-0.2, -0.2, 0], [-0.2, 0.2, 0]])
    return model, thrusters(model, corners, np.tile([0.0, 0.0, 1.0], (4, 1)), [0.05, -0.05, 0.05, -0.05])


def test_what_no_actuator_moves_is_held_to_the_equations_of_motion() -> None:
    """Accelerations of forward dynamics satisfy the constraint for any thrusts, others do not."""
    model, thrust = flyer()
    dynamics = FreeInverseDynamics(model, thrust)
    action = MultibodyAction("flyer", dynamics, [CostItem("a", Control(model.nv))])
    assert action.value_function.size1_out("constraint") == model.nv - 4
    report = check_derivatives(action)
    assert report.passed, str(report)
    rng, data = np.random.default_rng(0), model.createData()
    for _ in range(5):
        x = dynamics.state.integrate(dynamics.state.neutral(), rng.uniform(-1.0, 1.0, 2 * model.nv))
        a = pin.aba(model, data, x[: model.nq], x[model.nq :], thrust @ rng.uniform(0.0, 10.0, 4))
        assert action.evaluate(x, a, action.parameters.default).violation < 1e-10
        assert action.evaluate(x, a + rng.standard_normal(model.nv), action.parameters.default).violation > 1e-2


@pytest.mark.slow
def test_a_flyer_with_a_pendulum_takes_the_same_way_with_either_dynamics() -> None:
    model, thrust = flyer()
    goal = np.concatenate([[0.4, -0.2, 0.3, 0.0, 0.0, 0.0, 1.0, 0.0], np.zeros(model.nv)])
    ways = []
    for dynamics in (FreeForwardDynamics(model, thrust), FreeInverseDynamics(model, thrust)):
        costs = [CostItem("goal", StateError(dynamics.state, goal), 5.0)]
        problem = ShootingProblem(MultibodyAction(type(dynamics).__name__.lower() + "_flyer", dynamics, costs), 15)
        problem.set("duration", 0.05)
        forward = isinstance(dynamics, FreeForwardDynamics)
        hover = np.full(4, 1.7 * 9.81 / 4) if forward else np.zeros(model.nv)
        guess = Trajectory(problem.hold().xs, np.tile(hover, (15, 1)))
        solution = LineSearchSqp(problem).solve(guess, max_iterations=100)
        assert solution.status.solved
        ways.append(solution)
    assert ways[1].cost == pytest.approx(ways[0].cost, rel=1e-6)


def test_bad_actuation_is_named() -> None:
    model = pin.buildSampleModelManipulator()
    with pytest.raises(InputError, match=r"actuation: got shape \(6, 2\), of lower rank; expected a matrix of full"):
        FreeInverseDynamics(model, np.ones((6, 2)))
    with pytest.raises(InputError, match=r"actuation: got shape \(2, 2\)"):
        FreeInverseDynamics(model, np.eye(2))
